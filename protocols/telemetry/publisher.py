"""Publisher: the telemetry process of one service. It reads the ring, publishes batches over zenoh and answers queries.

A delay or crash of this process has no effect on the loop: the ring holds one minute, and overwritten rows are counted.
"""

import json
import os
import select
import time
from collections import deque
from collections.abc import Callable, Iterable
from contextlib import suppress
from pathlib import Path
from typing import Any

import numpy as np
import zenoh

from protocols.can.fault_text import FaultWatch
from protocols.errors import InputError, suggest_closest
from protocols.files.other_units import describe_other_unit
from protocols.node import Column
from protocols.realtime.mailbox import Asker
from protocols.realtime.ring import RingReader
from protocols.realtime.stopping import Stop
from protocols.telemetry.batch import ENCODING, BatchEncoder, list_run_columns
from protocols.telemetry.keys import Keys
from protocols.telemetry.lab import check_name, read_lab
from protocols.telemetry.message import parse_message
from protocols.telemetry.pending_changes import PendingChanges
from protocols.telemetry.session import open_publisher_session
from protocols.telemetry.truth import reveals_truth
from protocols.telemetry.tuning import ASKED, MOST_VALUES

PERIOD = 0.02  # s between batches: 20 rows at 1 kHz; a fifth of the 100 ms allowed from cycle to screen
HISTORY = 30.0  # s of rows for consumers that join late
_REPLY_SECONDS = 1.0  # s of rows in one reply of the history: some hundred kB
_ANSWER_TIMEOUT = 2.0  # s for a loop to make a change of parameters; later it refuses. A cycle takes milliseconds
_ANSWER_MARGIN = 0.2  # s more for its answer to arrive
# s from the arrival of a change, within which a loop may make it: ten changes wait for 2 s, then _ANSWER_TIMEOUT. The caller
# waits for 5 s (clutch_hil/live/tuning). It must not report that nobody answers before the change is made
_MOST_DELAY = 4.0
# s between two changes that are forwarded: each costs the loop a cycle of 1 ms, so less than 1 % of all cycles
_CHANGE_PERIOD = 0.2
_MOST_WAITING = 10  # changes that wait for this period; more are refused
_MOST_DEMAND = 200  # characters of the text of a demand
# newest events and newest requests kept for queries: an answer must fit into a message (message.py)
_MOST_KEPT = 10_000
_SHOWN = 60  # characters of a wrong name in a message
_LINGER_SECONDS = 0.1  # s for the last batch to leave before the session is closed
_QUERIES = ("history", "last", "describe", "parameters", "events", "requests")


class Publisher:
    """Publishes one ring, whose description names node, bench, rate, session and parameters (outlet.py).

    Columns that reveal the truth of a blind node (truth.py) are not published. terminal: descriptor for fault messages.
    checked: whether the session accepts changes only under the name in the sender's certificate (lab.py).
    """

    def __init__(
        self,
        ring: RingReader,
        mailbox: Asker,
        session: zenoh.Session,
        terminal: int | None = None,
        checked: bool = False,
    ) -> None:
        about = ring.description
        self._ring, self._mailbox, self._checked = ring, mailbox, checked
        self._rate = float(about["rate"])
        self._node = str(about["node"])
        self._blind = bool(about["blind"])
        self._shown = [i for i, c in enumerate(ring.columns) if not (self._blind and reveals_truth(c.name))]
        columns = list_run_columns(self._node, [ring.columns[i] for i in self._shown])
        epoch = _measure_epoch()
        self._encoder = BatchEncoder(self._node, about["session"], self._rate, epoch, columns)
        self._columns = columns
        self._parameters = {entry["name"]: entry for entry in about["parameters"]}
        self._bus_faults = {
            entry["name"]: entry for entry in about.get("bus_faults", ())
        }  # only injections change them
        self._terminal = terminal
        self._values = {name: entry["value"] for name, entry in self._parameters.items()}
        self._faults = self._make_fault_watch([column.name for column in ring.columns])
        self._events: deque[dict[str, Any]] = deque(maxlen=_MOST_KEPT)
        self._requests: deque[dict[str, Any]] = deque(maxlen=_MOST_KEPT)
        self._pending = PendingChanges(about["planned"])
        self._history: deque[tuple[int, np.ndarray]] = deque()
        # requested changes: query, request, and until when a loop may make it [s of CLOCK_MONOTONIC]
        self._waiting: deque[tuple[zenoh.Query, dict[str, Any], float]] = deque()
        self._next_change = 0.0  # s of CLOCK_MONOTONIC, from which the next one is forwarded
        self._next = 0  # number of the next row
        keys = Keys(about["bench"], self._node)
        described = about | {
            "columns": [Column(*c)._asdict() for c in columns],
            "names_checked": checked,
        }
        for name in ("parameters", "bus_faults", "planned"):
            described.pop(name, None)
        self._described = described
        self._record = session.declare_publisher(
            keys.record,
            encoding=ENCODING,
            congestion_control=zenoh.CongestionControl.DROP,
            priority=zenoh.Priority.REAL_TIME,
        )
        self._event = session.declare_publisher(keys.event)
        self._request = session.declare_publisher(keys.request)
        answers: dict[str, Callable[[zenoh.Query], None]] = {
            name: getattr(self, f"_answer_{name}") for name in _QUERIES
        }
        self._queries = [
            (session.declare_queryable(getattr(keys, name), zenoh.handlers.FifoChannel(64)), answer)
            for name, answer in answers.items()
        ]
        self._asked = session.declare_queryable(keys.change_by("*"), zenoh.handlers.FifoChannel(64))
        self._token = session.liveliness().declare_token(keys.alive)
        self._publish_stage("accepted", about["planned"])

    def step(self) -> None:
        """Publish new rows, and answer waiting queries."""
        lost = self._ring.lost
        rows = self._ring.read()
        self._print_faults(rows)
        if self._blind:
            rows = rows[:, self._shown]
        self._next += self._ring.lost - lost
        if len(rows):
            self._record.put(self._encoder.encode(self._next, rows, self._ring.lost))
            self._history.append((self._next, rows))
            self._next += len(rows)
            while self._next - self._history[0][0] - len(self._history[0][1]) >= HISTORY * self._rate:
                self._history.popleft()
        self._publish_stage("started", started := self._pending.take_started(self._next))
        self._publish_stage("ended", self._pending.take_ended(self._next / self._rate))
        for change in started:
            (self._parameters | self._bus_faults)[change["name"]]["value"] = change["new"]
        for queryable, answer in self._queries:
            while (query := queryable.try_recv()) is not None:
                _answer(query, answer, last=True)
        while (query := self._asked.try_recv()) is not None:
            _answer(query, self._take_change)
        if self._waiting and (now := time.monotonic()) >= self._next_change:
            query, request, until = self._waiting.popleft()
            self._next_change = now + _CHANGE_PERIOD
            _answer(
                query,
                lambda query: query.reply(query.key_expr, json.dumps(self._forward_request(request, until))),
                last=True,
            )

    def _make_fault_watch(self, columns: list[str]) -> FaultWatch | None:
        """Return a FaultWatch for a controller; None for another node."""
        if "fault" not in columns:
            return None
        return FaultWatch(columns, self._rate, self._values)

    def _print_faults(self, rows: np.ndarray) -> None:
        """Print faults on the terminal of the service, because its loop must not print. Skip them if printing would block."""
        if self._faults is None or self._terminal is None:
            return
        for fault in self._faults.take(rows):
            with suppress(OSError):  # the terminal is closed
                if select.select([], [self._terminal], [], 0.0)[1]:
                    os.write(self._terminal, f"{fault.line}\n".encode()[: select.PIPE_BUF])

    def _answer_history(self, query: zenoh.Query) -> None:
        asked = query.selector.parameters
        begin, end = int(asked.get("from") or 0), int(asked.get("to") or self._next)
        piece: list[np.ndarray] = []
        first = after = 0  # numbers of the first row of the piece and of the row after it
        for number, rows in self._history:
            rows = rows[max(begin - number, 0) : max(end - number, 0)]
            number = max(number, begin)
            if piece and (number != after or after - first >= _REPLY_SECONDS * self._rate):
                query.reply(query.key_expr, self._encoder.encode(first, np.concatenate(piece), self._ring.lost))
                piece = []
            if len(rows):
                first = first if piece else number
                piece.append(rows)
                after = number + len(rows)
        if piece:
            query.reply(query.key_expr, self._encoder.encode(first, np.concatenate(piece), self._ring.lost))

    def _answer_last(self, query: zenoh.Query) -> None:
        row = self._history[-1][1][-1] if self._history else np.full(len(self._columns), np.nan)
        values = {
            column.name: {"value": value if np.isfinite(value) else None, "unit": column.unit}
            for column, value in zip(self._columns, row.tolist(), strict=True)
        }
        query.reply(query.key_expr, json.dumps({"row": self._next - 1, "values": values}))

    def _answer_describe(self, query: zenoh.Query) -> None:
        # its epoch is the present one: the time of day may have been set since the start
        query.reply(query.key_expr, json.dumps(self._described | {"epoch_s": _measure_epoch()}))

    def _answer_events(self, query: zenoh.Query) -> None:
        query.reply(query.key_expr, json.dumps(list(self._events)))

    def _answer_requests(self, query: zenoh.Query) -> None:
        query.reply(query.key_expr, json.dumps(list(self._requests)))

    def _answer_parameters(self, query: zenoh.Query) -> None:
        if query.payload is not None:
            raise InputError("parameters are changed with the key change/NAME, which contains the name of the sender")
        now = self._pending.compute_values(self._next / self._rate)
        entries = [entry | {"value": now.get(name, entry["value"])} for name, entry in self._parameters.items()]
        query.reply(query.key_expr, json.dumps(entries))

    def _take_change(self, query: zenoh.Query) -> None:
        """Queue a change. Raises InputError for a change that the node cannot accept; it never reaches the loop."""
        by = check_name(str(query.key_expr).rpartition("/")[2])
        asked: Any = parse_message(query.payload.to_bytes()) if query.payload else None
        if isinstance(asked, dict) and set(asked) == {"demand"}:
            self._enqueue(query, {"demand": _check_demand(asked["demand"]), "by": by, "checked": self._checked})
            return
        timed = isinstance(asked, dict) and isinstance(asked.get("values"), dict)
        values = asked["values"] if timed else asked
        if not isinstance(values, dict):
            raise InputError("a change must be a JSON object of names and numbers")
        if not 0 < len(values) <= MOST_VALUES:
            raise InputError(f"a change has {len(values)} values; allowed are 1 to {MOST_VALUES}")
        known = self._parameters | (self._bus_faults if timed else {})
        for name, value in values.items():
            if (entry := known.get(name)) is None:
                if self._blind and len(name) <= _SHOWN:
                    continue  # it may belong to a hidden effect of a blind node: the node decides
                raise InputError(f"parameter {name[:_SHOWN]!r} is unknown; {suggest_closest(name[:_SHOWN], known)}")
            number = isinstance(value, (int, float)) and not isinstance(value, bool)
            low, high = entry["bounds"]
            if not (number and low <= value <= high):
                unit = "" if entry["unit"] == "1" else f" {entry['unit']}"
                shown = f"{value:g}" if isinstance(value, float) else repr(value)[:_SHOWN]
                hint = describe_other_unit(value, entry["unit"], low, high) if isinstance(value, float) else ""
                raise InputError(f"parameter {name} = {shown}{unit} is outside {low:g}..{high:g}{hint}")
            if entry["fixed"]:
                raise InputError(entry["fixed"])
        when = {"when": {key: value for key, value in asked.items() if key != "values"}} if timed else {}
        self._enqueue(query, {"values": values, "by": by, "checked": self._checked} | when)

    def _enqueue(self, query: zenoh.Query, request: dict[str, Any]) -> None:
        """Queue a request to the loop. Raises InputError if too many wait."""
        if len(self._waiting) >= _MOST_WAITING:
            rate = 1.0 / _CHANGE_PERIOD
            raise InputError(
                f"{_MOST_WAITING} changes are already waiting, and {rate:g} per second are made; try again later"
            )
        self._waiting.append((query, request, time.monotonic() + _MOST_DELAY))

    def _forward_request(self, request: dict[str, Any], until: float) -> dict[str, Any]:
        """Ask the loop to make or plan a change, and return its answer. Raises InputError if it refuses.

        until: when the loop makes it no more [s of CLOCK_MONOTONIC]; earlier changes may have waited for a stopped loop.
        """
        patience = min(until - time.monotonic(), _ANSWER_TIMEOUT)
        request |= {"until": time.monotonic() + patience}
        try:
            if patience <= 0.0:
                raise InputError(f"earlier changes waited for the service for {_MOST_DELAY:g} s; it is busy or stopped")
            answer = json.loads(self._mailbox.ask(json.dumps(request), patience + _ANSWER_MARGIN))
        except InputError as error:
            raise InputError(f"{self._node}: {error}; nothing was changed") from None
        if "refused" in answer:
            raise InputError(answer["refused"])
        if (planned := answer.pop("planned", None)) is not None:  # else as before
            self._pending.plan(planned, answer["row"])
        logged = {"node": self._node} | answer.pop("logged") | {key: request[key] for key in ASKED if key in request}
        if not self._blind:
            self._requests.append(logged)
            self._request.put(json.dumps(logged))
        who = {"by": logged["by"], "checked": logged["checked"]}
        for change in answer.get("changed", ()):
            self._note_change(change)
            self._pending.forget(change["name"])
            self._put(change | who)
        if not self._blind:
            self._publish_stage("accepted", [change | who for change in answer.get("accepted", ())])
        return answer

    def _note_change(self, change: dict[str, Any]) -> None:
        """Note the present value of a parameter: for the key `parameters`, and as a limit in messages of faults."""
        self._parameters[change["name"]]["value"] = self._values[change["name"]] = change["new"]

    def _publish_stage(self, stage: str, changes: Iterable[dict[str, Any]]) -> None:
        """Publish changes by injections that have reached a stage: accepted, started or ended."""
        for change in changes:
            self._put({"injection": stage} | change)

    def _put(self, content: dict[str, Any]) -> None:
        event = {"node": self._node, "time": time.time(), "clock_s": time.monotonic()} | content
        self._events.append(event)
        self._event.put(json.dumps(event))


def _measure_epoch() -> float:
    """Return the time of day [s, UNIX] minus CLOCK_MONOTONIC; 0 on a machine whose days begin at its start."""
    return max(time.time() - time.monotonic(), 0.0)


def _check_demand(text: Any) -> str:
    if not isinstance(text, str) or not 0 < len(text) <= _MOST_DEMAND or not text.isprintable():
        raise InputError(f"a demand is logged as a text of 1 to {_MOST_DEMAND} printable characters")
    return text


def _answer(query: zenoh.Query, answer: Callable[[zenoh.Query], None], last: bool = False) -> None:
    """Answer a query; for a wrong query with the reason. The query ends if it was wrong, or if this is its `last` answer."""
    try:
        answer(query)
        ended = last
    except InputError as error:
        query.reply_err(str(error))
        ended = True
    except Exception as error:  # a wrong query must not stop the telemetry
        query.reply_err(f"the question is malformed: {str(error)[:_SHOWN]}")
        ended = True
    if ended:
        query.drop()


def publish(
    ring_path: Path, mailbox_path: Path, router: str | None, ready: Callable[[], None], terminal: int | None = None
) -> None:
    """Publish a ring until SIGTERM, including its last rows; call `ready` when publishing begins. Raises InputError.

    router: see `open_publisher_session`. terminal: descriptor for fault messages.
    """
    ring, mailbox = RingReader(ring_path), Asker(mailbox_path)
    checked = read_lab(router) is not None
    with Stop() as stop, open_publisher_session(router) as session:
        publisher = Publisher(ring, mailbox, session, terminal, checked)
        ready()
        while not stop.asked:
            publisher.step()
            time.sleep(PERIOD)
        publisher.step()
        time.sleep(_LINGER_SECONDS)
