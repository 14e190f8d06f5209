"""Publisher: the telemetry process of one service. It reads the ring, puts batches on zenoh and answers queries.

It may be late or die without the loop noticing: the ring holds a minute, what it overwrites is counted.
"""

import json
import os
import time
from collections import deque
from collections.abc import Callable, Iterable
from contextlib import suppress
from pathlib import Path
from typing import Any

import numpy as np
import zenoh

from protocols.can.fault_text import FaultWatch
from protocols.errors import InputError
from protocols.node import Column
from protocols.realtime.mailbox import Asker
from protocols.realtime.ring import RingReader
from protocols.realtime.stopping import Stop
from protocols.telemetry.batch import ENCODING, BatchEncoder, published_columns
from protocols.telemetry.blind import tells_truth
from protocols.telemetry.coming import Coming
from protocols.telemetry.keys import Keys
from protocols.telemetry.session import publisher_session

PERIOD = 0.02  # s between batches: 20 rows at 1 kHz; a fifth of the 100 ms from cycle to screen
HISTORY = 30.0  # s of rows for those who join late
_PIECE = 1.0  # s of rows in one reply of the history: some hundred kB
_ANSWER = 2.0  # s for a loop to make a change of parameters, then it refuses; a cycle takes milliseconds
_LATE = 0.2  # s more for its answer to be there
_LINGER = 0.1  # s for the last batch to leave before the session is closed
_QUERIES = ("history", "last", "describe", "parameters", "events")


class Publisher:
    """Publishes one ring; `description` of the ring names node, bench, rate, session and parameters (outlet.py).

    Of a `blind` node it keeps back what tells the truth.
    """

    def __init__(self, ring: RingReader, mailbox: Asker, session: zenoh.Session, terminal: int | None = None) -> None:
        about = ring.description
        self._ring, self._mailbox = ring, mailbox
        self._rate = float(about["rate"])
        self._node = str(about["node"])
        self._blind = bool(about["blind"])
        self._shown = [i for i, c in enumerate(ring.columns) if not (self._blind and tells_truth(c.name))]
        columns = published_columns(self._node, [ring.columns[i] for i in self._shown])
        epoch = time.time() - time.monotonic()
        self._encoder = BatchEncoder(self._node, about["session"], self._rate, epoch, columns)
        self._columns = columns
        self._parameters = {entry["name"]: entry for entry in about["parameters"]}
        self._terminal = terminal
        self._faults = self._fault_watch([column.name for column in ring.columns])
        self._events: list[dict[str, Any]] = []
        self._coming = Coming(about["planned"])
        self._history: deque[tuple[int, np.ndarray]] = deque()
        self._next = 0  # number of the next row
        keys = Keys(about["bench"], self._node)
        described = about | {"columns": [Column(*c)._asdict() for c in columns], "epoch_s": epoch}
        del described["parameters"], described["planned"]
        self._described = json.dumps(described)
        self._record = session.declare_publisher(
            keys.record,
            encoding=ENCODING,
            congestion_control=zenoh.CongestionControl.DROP,
            priority=zenoh.Priority.REAL_TIME,
        )
        self._event = session.declare_publisher(keys.event)
        answers: dict[str, Callable[[zenoh.Query], None]] = {
            name: getattr(self, f"_answer_{name}") for name in _QUERIES
        }
        self._queries = [
            (session.declare_queryable(getattr(keys, name), zenoh.handlers.FifoChannel(64)), answer)
            for name, answer in answers.items()
        ]
        self._token = session.liveliness().declare_token(keys.alive)
        self._tell("accepted", about["planned"])

    def step(self) -> None:
        """Publish what is new and answer who has asked."""
        lost = self._ring.lost
        rows = self._ring.read()
        self._tell_faults(rows)
        if self._blind:
            rows = rows[:, self._shown]
        self._next += self._ring.lost - lost
        if len(rows):
            self._record.put(self._encoder.encode(self._next, rows, self._ring.lost))
            self._history.append((self._next, rows))
            self._next += len(rows)
            while self._next - self._history[0][0] - len(self._history[0][1]) >= HISTORY * self._rate:
                self._history.popleft()
        self._tell("started", started := self._coming.started(self._next))
        self._tell("ended", self._coming.ended(self._next / self._rate))
        for change in started:
            self._parameters[change["name"]]["value"] = change["new"]
        for queryable, answer in self._queries:
            while (query := queryable.try_recv()) is not None:
                with query:
                    try:
                        answer(query)
                    except InputError as error:
                        query.reply_err(str(error))
                    except Exception as error:  # whatever somebody asks, the telemetry goes on
                        query.reply_err(f"the question is malformed: {error}")

    def _fault_watch(self, columns: list[str]) -> FaultWatch | None:
        """Of a controller."""
        if "fault" not in columns:
            return None
        return FaultWatch(columns, self._rate, {name: entry["value"] for name, entry in self._parameters.items()})

    def _tell_faults(self, rows: np.ndarray) -> None:
        """Where the service runs, as it must not do so itself."""
        if self._faults is None or self._terminal is None:
            return
        for told in self._faults.take(rows):
            with suppress(OSError):  # a terminal that is gone
                os.write(self._terminal, f"{told.line}\n".encode())

    def _answer_history(self, query: zenoh.Query) -> None:
        asked = query.selector.parameters
        begin, end = int(asked.get("from") or 0), int(asked.get("to") or self._next)
        piece: list[np.ndarray] = []
        first = after = 0  # numbers of the first row of the piece and of the row after it
        for number, rows in self._history:
            rows = rows[max(begin - number, 0) : max(end - number, 0)]
            number = max(number, begin)
            if piece and (number != after or after - first >= _PIECE * self._rate):
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
        query.reply(query.key_expr, self._described)

    def _answer_events(self, query: zenoh.Query) -> None:
        query.reply(query.key_expr, json.dumps(self._events))

    def _answer_parameters(self, query: zenoh.Query) -> None:
        if query.payload is None:
            now = self._coming.values(self._next / self._rate)
            entries = [entry | {"value": now.get(name, entry["value"])} for name, entry in self._parameters.items()]
            query.reply(query.key_expr, json.dumps(entries))
            return
        asked = json.loads(query.payload.to_string())
        timed = isinstance(asked, dict) and isinstance(asked.get("values"), dict)
        values = asked["values"] if timed else asked
        if not isinstance(values, dict) or not values:
            raise InputError("a change must be a JSON object of names and numbers")
        when = {"when": {key: told for key, told in asked.items() if key != "values"}} if timed else {}
        query.reply(query.key_expr, json.dumps(self._answered({"values": values} | when)))

    def _answered(self, request: dict[str, Any]) -> dict[str, Any]:
        """Have the loop make or plan a change. Raises InputError when it is refused."""
        request |= {"until": time.monotonic() + _ANSWER}
        try:
            answer = json.loads(self._mailbox.ask(json.dumps(request), _ANSWER + _LATE))
        except InputError as error:
            raise InputError(f"{self._node}: {error} Nothing is changed, now or later") from None
        if "refused" in answer:
            raise InputError(answer["refused"])
        self._coming.plan(answer.pop("planned"), answer["row"])
        for change in answer.get("changed", ()):
            self._parameters[change["name"]]["value"] = change["new"]
            self._coming.forget(change["name"])
            self._put(change)
        if not self._blind:
            self._tell("accepted", answer.get("accepted", ()))
        return answer

    def _tell(self, stage: str, changes: Iterable[dict[str, Any]]) -> None:
        """Publish that changes by injections are `accepted`, have `started` or have `ended`."""
        for change in changes:
            self._put({"injection": stage} | change)

    def _put(self, told: dict[str, Any]) -> None:
        event = {"node": self._node, "time": time.time()} | told
        self._events.append(event)
        self._event.put(json.dumps(event))


def publish(
    ring_path: Path, mailbox_path: Path, router: str | None, ready: Callable[[], None], terminal: int | None = None
) -> None:
    """Publish a ring until SIGTERM, and then what came last; call `ready` when it begins. Raises InputError.

    Faults are told on the descriptor `terminal`.
    """
    ring, mailbox = RingReader(ring_path), Asker(mailbox_path)
    with Stop() as stop, publisher_session(router) as session:
        publisher = Publisher(ring, mailbox, session, terminal)
        ready()
        while not stop.asked:
            publisher.step()
            time.sleep(PERIOD)
        publisher.step()
        time.sleep(_LINGER)
