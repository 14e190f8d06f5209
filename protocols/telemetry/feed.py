"""Feed: receives the rows of a bench, those of the last 30 s first, and counts rows that never came."""

import json
import time
from typing import Any

import zenoh

from protocols.errors import InputError, listing
from protocols.telemetry.batch import Batch, decode
from protocols.telemetry.keys import NODES, Keys, bench_name, bus_of, parse_key

_LIVE_GAP = 2.0  # s: longest gap that a viewer asks for again
_ALL_GAP = 30.0  # s: a recorder asks for all that publishers keep
_LIVE_MESSAGES = 512  # 5 s of both nodes: a viewer further behind needs the newest only
_ALL_MESSAGES = 100_000  # some minutes: a recorder needs all of them
_POLL_PERIOD = 0.002  # s between checks for a message
_QUERY_TIMEOUT = 5.0  # s for a publisher to send its history


class NoBenchError(InputError):
    """There is no bench, or not yet."""


class Feed:
    """Rows of every node of a bench. Use as a context manager.

    live: keep a few seconds, and drop the oldest when the reader is slow; else keep some minutes. Rows that were dropped on the
    way are requested again. lost: rows by node that never came, counted from the first that did. alive: nodes that run.
    """

    def __init__(self, session: zenoh.Session, bench: str, live: bool) -> None:
        handler: Any = zenoh.handlers.RingChannel(_LIVE_MESSAGES) if live else zenoh.handlers.FifoChannel(_ALL_MESSAGES)
        self._refill = _LIVE_GAP if live else _ALL_GAP
        self.bench = bench
        self.lost: dict[str, int] = {}
        self.alive = dict.fromkeys(NODES, False)
        self._session = session
        self._records = session.declare_subscriber(Keys(bench, "*").record, handler)
        self._changes = session.declare_subscriber(Keys(bench, "*").event, zenoh.handlers.FifoChannel(1000))
        self._tokens = session.liveliness().declare_subscriber(
            Keys(bench, "*").alive, zenoh.handlers.FifoChannel(100), history=True
        )
        self._position: dict[str, tuple[int, int]] = {}  # by node: session, number of the next row
        self._events: list[dict[str, Any]] = []  # received live and by query
        self._events_returned = 0  # how many of them `events` has returned

    def __enter__(self) -> "Feed":
        return self

    def __exit__(self, *_: object) -> None:
        for subscriber in (self._records, self._changes, self._tokens):
            subscriber.undeclare()

    def read(self, timeout: float = 0.0) -> list[Batch]:
        """Every waiting batch, in order for each node; wait up to `timeout` [s] for the first."""
        end = time.monotonic() + timeout
        batches: list[Batch] = []
        while True:
            while (sample := self._tokens.try_recv()) is not None:
                self.alive[parse_key(str(sample.key_expr)).node] = sample.kind == zenoh.SampleKind.PUT
            while (sample := self._records.try_recv()) is not None:
                batches += self._add_missing(decode(sample.payload.to_bytes()))
            if batches or time.monotonic() >= end:
                return batches
            time.sleep(_POLL_PERIOD)

    def events(self) -> list[dict[str, Any]]:
        """Changes of parameters since the last call, also those before the first row; of an injection only its start."""
        while (sample := self._changes.try_recv()) is not None:
            self._note([json.loads(sample.payload.to_string())])
        events = self._events[self._events_returned :]
        self._events_returned = len(self._events)
        return [event for event in events if event.get("injection", "started") == "started"]

    def describe(self, node: str) -> dict[str, Any] | None:
        """Description of a node (keys.py); None when it does not answer."""
        return ask(self._session, Keys(self.bench, node).describe)

    def _add_missing(self, batch: Batch) -> list[Batch]:
        """New rows up to `batch`: before it those of the history, if it is the first one or rows are missing."""
        session, row = self._position.get(batch.node, (None, 0))
        parts = [batch]
        if session != batch.session:
            parts = [*self._request_history(batch, 0), batch]
            row = parts[0].first_row
            self.lost.setdefault(batch.node, 0)
            self._note(ask(self._session, Keys(self.bench, batch.node).events, attempts=3) or [])
        elif 0 < batch.first_row - row <= self._refill * batch.rate:
            parts = [*self._request_history(batch, row), batch]
        fresh = []
        for part in parts:
            self.lost[batch.node] += max(part.first_row - row, 0)
            part = part.after(row)
            if len(part.rows):
                fresh.append(part)
                row = part.end
        self._position[batch.node] = batch.session, row
        return fresh

    def _request_history(self, batch: Batch, row: int) -> list[Batch]:
        """History of a node from row number `row` to the first of `batch`, in order."""
        selector = f"{Keys(self.bench, batch.node).history}?from={row};to={batch.first_row}"
        replies = self._session.get(
            selector, timeout=_QUERY_TIMEOUT, consolidation=zenoh.ConsolidationMode.NONE
        )  # all of them
        parts = [decode(reply.ok.payload.to_bytes()) for reply in replies if reply.ok is not None]
        return sorted((part for part in parts if part.session == batch.session), key=lambda part: part.first_row)

    def _note(self, events: list[dict[str, Any]]) -> None:
        self._events += [event for event in events if event not in self._events]


def ask(session: zenoh.Session, key: str, attempts: int = 1) -> Any:
    """JSON answer to a query of `key`; None without an answer. On a busy machine several `attempts` help."""
    for _ in range(attempts):
        for reply in session.get(key, timeout=_QUERY_TIMEOUT):
            if reply.ok is not None:
                return json.loads(reply.ok.payload.to_string())
    return None


def benches(session: zenoh.Session) -> list[str]:
    """Names of the benches that publish."""
    replies = session.liveliness().get(Keys("*", "*").alive, timeout=_QUERY_TIMEOUT)
    return sorted({parse_key(str(reply.ok.key_expr)).bench for reply in replies if reply.ok is not None})


def list_live_nodes(session: zenoh.Session, bench: str) -> list[str]:
    """Nodes of a bench that publish."""
    replies = session.liveliness().get(Keys(bench, "*").alive, timeout=_QUERY_TIMEOUT)
    return sorted({parse_key(str(reply.ok.key_expr)).node for reply in replies if reply.ok is not None})


def find_bench(session: zenoh.Session, bus: str | None = None) -> str:
    """The bench on `bus`, or the only one there is. Raises InputError when there is more than one, NoBenchError for none."""
    there = benches(session)
    if bus is None:
        matches = there
    else:
        own = bench_name(bus)
        matches = [own] if own in there else [name for name in there if bus in (name, bus_of(name))]
    if len(matches) == 1:
        return matches[0]
    if matches:
        raise InputError(f"there are {len(matches)} benches: {listing(matches)}; choose one with --bus")
    where = f" on {bus}" if bus else ""
    others = f"; there are {listing(there)}" if there else ""
    raise NoBenchError(f"no bench{where} publishes telemetry{others}; start one with: clutch-hil up")
