"""Publisher: the telemetry process of one service. It reads the ring, puts batches on zenoh and answers queries.

It may be late or die without the loop noticing: the ring holds a minute, what it overwrites is counted.
"""

import json
import time
from collections import deque
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import zenoh

from protocols.errors import InputError
from protocols.mailbox import Asker
from protocols.node import Column
from protocols.ring import RingReader
from protocols.stopping import Stop
from protocols.telemetry.batch import ENCODING, BatchEncoder, published_columns
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
    """Publishes one ring; `description` of the ring names node, bench, rate, session and parameters (outlet.py)."""

    def __init__(self, ring: RingReader, mailbox: Asker, session: zenoh.Session) -> None:
        about = ring.description
        self._ring, self._mailbox = ring, mailbox
        self._rate = float(about["rate"])
        self._node = str(about["node"])
        columns = published_columns(self._node, ring.columns)
        epoch = time.time() - time.monotonic()
        self._encoder = BatchEncoder(self._node, about["session"], self._rate, epoch, columns)
        self._columns = columns
        self._parameters = {entry["name"]: entry for entry in about["parameters"]}
        self._events: list[dict[str, Any]] = []
        self._history: deque[tuple[int, np.ndarray]] = deque()
        self._next = 0  # number of the next row
        keys = Keys(about["bench"], self._node)
        described = about | {"columns": [Column(*c)._asdict() for c in columns], "epoch_s": epoch}
        del described["parameters"]
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

    def step(self) -> None:
        """Publish what is new and answer who has asked."""
        lost = self._ring.lost
        rows = self._ring.read()
        self._next += self._ring.lost - lost
        if len(rows):
            self._record.put(self._encoder.encode(self._next, rows, self._ring.lost))
            self._history.append((self._next, rows))
            self._next += len(rows)
            while self._next - self._history[0][0] - len(self._history[0][1]) >= HISTORY * self._rate:
                self._history.popleft()
        for queryable, answer in self._queries:
            while (query := queryable.try_recv()) is not None:
                with query:
                    try:
                        answer(query)
                    except InputError as error:
                        query.reply_err(str(error))
                    except Exception as error:  # whatever somebody asks, the telemetry goes on
                        query.reply_err(f"the question is malformed: {error}")

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
            query.reply(query.key_expr, json.dumps(list(self._parameters.values())))
            return
        values = json.loads(query.payload.to_string())
        if not isinstance(values, dict) or not values:
            raise InputError("a change must be a JSON object of names and numbers")
        query.reply(query.key_expr, json.dumps(self._changed(values)))

    def _changed(self, values: dict[str, Any]) -> dict[str, Any]:
        """Have the loop make a change. Raises InputError when it is refused."""
        request = {"values": values, "until": time.monotonic() + _ANSWER}
        try:
            answer = json.loads(self._mailbox.ask(json.dumps(request), _ANSWER + _LATE))
        except InputError as error:
            raise InputError(f"{self._node}: {error} Nothing is changed, now or later") from None
        if "refused" in answer:
            raise InputError(answer["refused"])
        for change in answer["changed"]:
            self._parameters[change["name"]]["value"] = change["new"]
            event = {"node": self._node, "time": time.time()} | change
            self._events.append(event)
            self._event.put(json.dumps(event))
        return answer


def publish(ring_path: Path, mailbox_path: Path, router: str | None, ready: Callable[[], None]) -> None:
    """Publish a ring until SIGTERM, and then what came last; call `ready` when it begins. Raises InputError."""
    ring, mailbox = RingReader(ring_path), Asker(mailbox_path)
    with Stop() as stop, publisher_session(router) as session:
        publisher = Publisher(ring, mailbox, session)
        ready()
        while not stop.asked:
            publisher.step()
            time.sleep(PERIOD)
        publisher.step()
        time.sleep(_LINGER)
