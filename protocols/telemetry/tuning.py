"""Tuning: describes the parameters of a running node, and changes them between two cycles, all of a request or none.

A change acts at once; on a node that takes injections also at a given time and along a ramp.
"""

import json
import time
from collections.abc import Mapping
from typing import Any, Protocol, runtime_checkable

from protocols.errors import InputError
from protocols.files.parameters import Parameter, ParameterSet
from protocols.realtime.mailbox import MOST_BYTES, Mailbox

ASKED = ("values", "when", "demand")  # entries of a request with the requested content
_MOST_LOGGED = 100_000  # requests, and changes: 5 h at five a second; each has about 0.2 kB
# values in one change: the answer lists each with its old and new value, twice where it goes back, by up to 300 bytes
MOST_VALUES = 100
_MOST_REASON = 1000  # characters of a refusal: the answer must fit into the mailbox


class Tunable(Protocol):
    """A node whose parameters can be changed while it runs."""

    @property
    def parameters(self) -> ParameterSet:
        """Present parameters."""
        ...

    def explain_fixed(self, name: str) -> str | None:
        """Return why a parameter cannot be changed while the node runs; None if it can."""

    def tune(self, values: Mapping[str, float]) -> None:
        """Change parameters, each in its declared unit; all or none. Raises InputError."""


@runtime_checkable
class Injectable(Protocol):
    """A tunable node that also accepts changes for a later time.

    A change is {"name", "unit", "old", "new", "at", "ramp", "row"}: it begins at `at` [s of the node's time], in row number
    `row` of its record, and is complete after `ramp` [s].
    """

    @property
    def blind(self) -> bool:
        """Whether the node's parameters must stay secret."""
        ...

    @property
    def planned_changes(self) -> list[dict[str, Any]]:
        """Changes that have not begun."""
        ...

    @property
    def injected_changes(self) -> list[dict[str, Any]]:
        """Changes that have begun."""
        ...

    def accept(self, values: Mapping[str, float], when: Mapping[str, float]) -> list[dict[str, Any]]:
        """Plan a change of parameters to `values`; return the changes planned for it. All or none; raises InputError."""
        ...


def describe_parameters(node: Tunable, shipped: ParameterSet) -> list[dict[str, Any]]:
    """Return every parameter of a node with its default from `shipped`, for the key `parameters` (keys.py)."""
    return [
        describe_parameter(parameter, shipped[name].value, node.explain_fixed(name))
        for name, parameter in node.parameters.items()
    ]


def describe_parameter(parameter: Parameter, default: float, fixed: str | None = None) -> dict[str, Any]:
    """Return a parameter as an entry of the key `parameters`: with its default in its unit, and why it is `fixed`."""
    return {
        "name": parameter.name,
        "value": parameter.value,
        "unit": parameter.unit,
        "type": "number",
        "bounds": list(parameter.bounds),
        "source": parameter.source,
        "default": default,
        "uncertainty": parameter.uncertainty,
        "fixed": fixed,
    }


class Tuning:
    """Makes the changes that arrive in a mailbox. count: number of parameters changed.

    A request is JSON: `values` by name; `until` [s of CLOCK_MONOTONIC], after which it is refused; for an injection also `when`
    (keys.py); `by`, the sender's name, and whether it was `checked`. A request with a text `demand` instead of values is only
    logged. The answer lists the changes `changed` or `accepted`, the next `row`, all `planned` changes if they may have changed
    and are public, and the `logged` entry.

    changes: those made at once. requests: those accepted, with sender and time [s, UNIX]. Of each, the first _MOST_LOGGED are
    kept.
    """

    def __init__(self, node: Tunable, mailbox: Mailbox) -> None:
        self.changes: list[dict[str, Any]] = []
        self.requests: list[dict[str, Any]] = []
        self._made = 0  # changes at once
        self._node, self._mailbox = node, mailbox
        self._injectable = node if isinstance(node, Injectable) else None
        self.has_request = mailbox.has_request

    @property
    def count(self) -> int:
        """Number of parameters changed so far; without injections for a blind node."""
        return self._made + (0 if self.blind else len(self.injections))

    @property
    def injections(self) -> list[dict[str, Any]]:
        """Injected changes that have begun."""
        return self._injectable.injected_changes if self._injectable else []

    @property
    def blind(self) -> bool:
        """Whether the node's parameters must stay secret."""
        return self._injectable is not None and self._injectable.blind

    @property
    def public_plan(self) -> list[dict[str, Any]]:
        """Injected changes that have not begun; empty for a blind node."""
        return self._injectable.planned_changes if self._injectable and not self.blind else []

    def act(self, row: int) -> None:
        """Make the waiting change; `row` is the number of the first row of the record in which it acts."""
        answer: dict[str, Any]
        try:
            request = json.loads(self._mailbox.request())
            if time.monotonic() > request["until"]:  # the caller has timed out and assumes that nothing changes
                raise InputError("the change arrived too late")
            if len(request.get("values", ())) > MOST_VALUES:  # its answer would not fit, after the change is made
                raise InputError(f"a change has {len(request['values'])} values; allowed are {MOST_VALUES}")
            if "demand" in request:
                answer = {}
            elif "when" in request:
                answer = {"accepted": self._plan_change(request["values"], request["when"])}
            else:
                answer = {"changed": self._change_now(request["values"], row)}
            if "demand" not in request:
                answer["planned"] = self.public_plan
            answer["logged"] = self._log(request, row)  # without the requested content, which the caller knows
        except InputError as error:
            answer = {"refused": str(error)[:_MOST_REASON]}
        except Exception as error:  # whatever a request holds, it must not end the loop
            answer = {"refused": f"the request is malformed: {error}"[:_MOST_REASON]}
        answer["row"] = row
        text = json.dumps(answer)
        if len(text) > MOST_BYTES:  # before its first sample a plant may have more planned changes than fit
            text = json.dumps({name: value for name, value in answer.items() if name != "planned"})
        self._mailbox.answer(text)

    def _log(self, request: Mapping[str, Any], row: int) -> dict[str, Any]:
        """Log a request; return its sender, time and kind."""
        kind = "demand" if "demand" in request else "inject" if "when" in request else "tune"
        who = {"by": request.get("by", "unknown"), "checked": request.get("checked", False)}
        logged = {"kind": kind, **who, "time": time.time(), "row": row}
        if len(self.requests) < _MOST_LOGGED:
            self.requests.append(logged | {key: request[key] for key in ASKED if key in request})
        return logged

    def _change_now(self, values: Mapping[str, float], row: int) -> list[dict[str, Any]]:
        before = self._node.parameters
        if reasons := [reason for name in values if (reason := self._node.explain_fixed(name))]:
            raise InputError(reasons[0])
        self._node.tune(values)
        after = self._node.parameters
        changed = [
            {"name": n, "old": before[n].value, "new": after[n].value, "unit": before[n].unit, "row": row}
            for n in values
        ]
        self._made += len(changed)
        self.changes += changed[: _MOST_LOGGED - len(self.changes)]
        return changed

    def _plan_change(self, values: Mapping[str, float], when: Mapping[str, float]) -> list[dict[str, Any]]:
        if not self._injectable:
            raise InputError(
                "only the plant accepts a change for a later time or along a ramp; allowed here is an immediate change"
            )
        return self._injectable.accept(values, when)
