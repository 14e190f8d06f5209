"""Tuning: parameters of a running node, described for people and changed between two cycles, all of a request or none."""

import json
import time
from collections.abc import Mapping
from typing import Any, Protocol

from protocols.errors import InputError
from protocols.mailbox import Mailbox
from protocols.parameters import ParameterSet


class Tunable(Protocol):
    """A node whose parameters can be changed while it runs."""

    parameters: ParameterSet

    def fixed(self, name: str) -> str | None:
        """Why a parameter cannot be changed while the node runs; None when it can."""

    def tune(self, values: Mapping[str, float]) -> None:
        """Change parameters, each in its declared unit; all or none. Raises InputError."""


def described(node: Tunable, shipped: ParameterSet) -> list[dict[str, Any]]:
    """Every parameter of a node with its default, for the `parameters` key (telemetry/keys.py)."""
    return [
        {
            "name": name,
            "value": parameter.value,
            "unit": parameter.unit,
            "type": "number",
            "bounds": list(parameter.bounds),
            "source": parameter.source,
            "default": shipped[name].value,
            "uncertainty": parameter.uncertainty,
            "fixed": node.fixed(name),
        }
        for name, parameter in node.parameters.items()
    ]


class Tuning:
    """Makes the changes that come by a mailbox; `changes` are those made, `count` how many parameters they changed.

    A request is JSON: `values` by name, and `until`, the time of CLOCK_MONOTONIC [s] from when on it is refused.
    """

    def __init__(self, node: Tunable, mailbox: Mailbox) -> None:
        self.changes: list[dict[str, Any]] = []
        self._node, self._mailbox = node, mailbox
        self.waiting = mailbox.waiting

    @property
    def count(self) -> int:
        """Parameters changed so far."""
        return len(self.changes)

    def act(self, row: int) -> None:
        """Make the waiting change; `row` is the number of the first row of the record in which it acts."""
        before = self._node.parameters
        try:
            request = json.loads(self._mailbox.request())
            values = request["values"]
            if time.monotonic() > request["until"]:  # who asked has gone, and was told that nothing would change
                raise InputError("the change came too late")
            if reasons := [reason for name in values if (reason := self._node.fixed(name))]:
                raise InputError(reasons[0])
            self._node.tune(values)
        except InputError as error:
            self._mailbox.answer(json.dumps({"refused": str(error)}))
            return
        changed = [
            {
                "name": n,
                "old": before[n].value,
                "new": self._node.parameters[n].value,
                "unit": before[n].unit,
                "row": row,
            }
            for n in values
        ]
        self.changes += changed
        self._mailbox.answer(json.dumps({"row": row, "changed": changed}))
