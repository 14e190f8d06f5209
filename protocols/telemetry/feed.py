"""Feed: receives the rows of a bench, starting with those of the last 30 s, and counts rows that are lost.

Any program on the network may publish under the keys of a bench. Invalid messages are rejected and counted, and the feed
continues: see `batch.decode` and `message.py`. If a service seems restarted, or rows are missing, the service is queried.
"""

import time
from collections import Counter
from collections.abc import Callable
from contextlib import suppress
from math import inf
from typing import Any, TypeVar

import zenoh

from protocols.errors import InputError, join_names
from protocols.node import Column
from protocols.telemetry.batch import Batch, decode
from protocols.telemetry.distinct import DistinctMessages
from protocols.telemetry.keys import NODES, Keys, find_bus, make_bench_name, parse_key
from protocols.telemetry.lab import advise_start
from protocols.telemetry.message import NODES as ALL_NODES
from protocols.telemetry.message import (
    check_description,
    check_event,
    check_events,
    check_last,
    check_request,
    check_requests,
    parse_message,
)

_LIVE_GAP = 2.0  # s: longest gap that a viewer requests again
_ALL_GAP = 30.0  # s: a recorder requests all rows that publishers keep
_LIVE_MESSAGES = 512  # 5 s of both nodes: a viewer that is further behind needs only the newest
_ALL_MESSAGES = 100_000  # some minutes: a recorder needs all of them
# of one kind until the next `read`; beyond it the session blocks, and all other messages with it
_WAITING_MESSAGES = 1000
# events and requests kept to recognise duplicates: nodes answer with their newest 10 000, at most five a second (5 h)
_MOST_NOTED = 100_000
_POLL_PERIOD = 0.002  # s between checks for a message
_QUERY_TIMEOUT = 5.0  # s for a publisher to send its history
_MOST_FOREIGN = 1000  # sessions remembered as foreign; more are queried again
T = TypeVar("T")


class NoBenchError(InputError):
    """There is no bench, or none yet."""


class Feed:
    """Rows of every node of a bench. Use as a context manager.

    live: buffer a few seconds, and drop the oldest rows if the reader is slow; else buffer some minutes. Dropped rows are
    requested again. lost: number of missing rows by node, counted from the first received row. alive: running nodes. rejected:
    number of invalid messages by node; first_rejected: reason for the first one.
    """

    def __init__(self, session: zenoh.Session, bench: str, live: bool) -> None:
        handler: Any = zenoh.handlers.RingChannel(_LIVE_MESSAGES) if live else zenoh.handlers.FifoChannel(_ALL_MESSAGES)
        self._refill = _LIVE_GAP if live else _ALL_GAP
        self.bench = bench
        self.lost: dict[str, int] = {}
        self.rejected: Counter[str] = Counter()
        self.first_rejected = ""
        self.alive = dict.fromkeys(NODES, False)
        self._session = session
        self._records = session.declare_subscriber(Keys(bench, "*").record, handler)
        self._changes = session.declare_subscriber(
            Keys(bench, "*").event, zenoh.handlers.FifoChannel(_WAITING_MESSAGES)
        )
        self._asked = session.declare_subscriber(
            Keys(bench, "*").request, zenoh.handlers.FifoChannel(_WAITING_MESSAGES)
        )
        self._tokens = session.liveliness().declare_subscriber(
            Keys(bench, "*").alive, zenoh.handlers.FifoChannel(100), history=True
        )
        self._position: dict[str, tuple[int, int]] = {}  # by node: session, number of the next row
        self._columns: dict[str, tuple[Column, ...]] = {}  # by node, of its session
        self._foreign: set[tuple[str, int]] = set()  # (node, session) of sessions that are not the service's
        self._events, self._requests = DistinctMessages(_MOST_NOTED), DistinctMessages(_MOST_NOTED)
        self._new_events: list[dict[str, Any]] = []  # not yet returned by `take_events`

    def __enter__(self) -> "Feed":
        return self

    def __exit__(self, *_: object) -> None:
        for subscriber in (self._records, self._changes, self._asked, self._tokens):
            subscriber.undeclare()

    def read(self, timeout: float = 0.0) -> list[Batch]:
        """Return every waiting batch, in order for each node; wait up to `timeout` [s] for the first."""
        end = time.monotonic() + timeout
        batches: list[Batch] = []
        while True:
            while (sample := self._tokens.try_recv()) is not None:
                if (node := parse_key(str(sample.key_expr)).node) in ALL_NODES:
                    self.alive[node] = sample.kind == zenoh.SampleKind.PUT
            while (sample := self._records.try_recv()) is not None:
                node = parse_key(str(sample.key_expr)).node
                try:
                    batches += self._add_missing(decode(sample.payload.to_bytes(), node))
                except InputError as error:
                    self._reject(node, error)
            self._receive_messages()
            if batches or time.monotonic() >= end:
                return batches
            time.sleep(_POLL_PERIOD)

    def take_events(self) -> list[dict[str, Any]]:
        """Return the parameter changes since the last call, also those before the first row.

        Of an injection, only its start.
        """
        self._receive_messages()
        events, self._new_events = self._new_events, []
        return [event for event in events if event.get("injection", "started") == "started"]

    def read_requests(self) -> list[dict[str, Any]]:
        """Return the newest 100 000 changes and demands that the nodes have accepted, in order of time.

        Entries of each: node, kind, by, checked, time [s, UNIX], row, and the requested content.
        """
        self._receive_messages()
        return sorted(self._requests.kept, key=lambda request: request["time"])

    def describe(self, node: str) -> dict[str, Any] | None:
        """Return the description of a node (keys.py); None when it does not answer."""
        return ask(self._session, Keys(self.bench, node).describe, check_description)

    def read_clock(self, node: str) -> float:
        """Return CLOCK_MONOTONIC [s] of a node at its newest row; -inf without one."""
        last = ask(self._session, Keys(self.bench, node).last, check_last) or {}
        clock = last.get("values", {}).get(f"{node}_clock_s", {}).get("value")
        return -inf if clock is None else float(clock)

    @property
    def rejections(self) -> str:
        """Text with the number of rejected messages and the reason for the first; "" for none."""
        if not (count := self.rejected.total()):
            return ""
        return f"{count} {'message was' if count == 1 else 'messages were'} rejected, the first because {self.first_rejected}"

    def _reject(self, node: str, why: InputError) -> None:
        self.rejected[node if node in ALL_NODES else "others"] += 1
        self.first_rejected = self.first_rejected or str(why)

    def _receive_messages(self) -> None:
        """Take the events and requests that have arrived. A full channel would also delay the rows."""
        for subscriber, note, check in (
            (self._changes, self._note_events, check_event),
            (self._asked, self._note_requests, check_request),
        ):
            while (sample := subscriber.try_recv()) is not None:
                try:
                    note([check(parse_message(sample.payload.to_bytes()))])
                except InputError as error:
                    self._reject(parse_key(str(sample.key_expr)).node, error)

    def _add_missing(self, batch: Batch) -> list[Batch]:
        """Return the new rows up to `batch`, preceded by the history if it is the first batch or rows are missing.

        Raises InputError for a batch that the service did not send.
        """
        if batch.node not in ALL_NODES:
            raise InputError(f"its node is {batch.node}; the nodes of a bench are {', '.join(ALL_NODES)}")
        session, row = self._position.get(batch.node, (None, 0))
        parts = [batch]
        if session != batch.session:
            self._check_session(batch)
            parts = [*self._request_history(batch, 0), batch]
            row = parts[0].first_row
            self.lost.setdefault(batch.node, 0)
            self._columns[batch.node] = batch.columns
            keys = Keys(self.bench, batch.node)
            self._note_events(ask(self._session, keys.events, check_events, attempts=3) or [])
            self._note_requests(ask(self._session, keys.requests, check_requests, attempts=3) or [])
        elif batch.columns != self._columns[batch.node]:
            raise InputError(f"its columns differ from those that the {batch.node} sent before")
        elif batch.first_row > row:
            self._check_numbers(batch)
            if batch.first_row - row <= self._refill * batch.rate:
                parts = [*self._request_history(batch, row), batch]
        fresh = []
        for part in parts:
            self.lost[batch.node] += max(part.first_row - row, 0)
            part = part.cut_before(row)
            if len(part.rows):
                fresh.append(part)
                row = part.end
        self._position[batch.node] = batch.session, row
        return fresh

    def _check_session(self, batch: Batch) -> None:
        """Raise InputError if the session of a batch differs from the one in the service's description."""
        key = batch.node, batch.session
        if key not in self._foreign and (described := self.describe(batch.node)) is not None:
            if described["session"] == batch.session:
                return
            if len(self._foreign) < _MOST_FOREIGN:
                self._foreign.add(key)
        elif key not in self._foreign:
            return  # the service has ended, and these are its last rows
        raise InputError(f"the {batch.node} did not send it: it is of another session")

    def _check_numbers(self, batch: Batch) -> None:
        """Raise InputError if a batch after a gap has row numbers that the service has not reached."""
        last = ask(self._session, Keys(self.bench, batch.node).last, check_last)
        if last is not None and batch.end - 1 > last["row"]:
            raise InputError(
                f"the {batch.node} did not send it: it has a row {batch.end - 1}, the service {last['row']}"
            )

    def _request_history(self, batch: Batch, row: int) -> list[Batch]:
        """Return the history of a node from row number `row` to the first row of `batch`, in order."""
        selector = f"{Keys(self.bench, batch.node).history}?from={row};to={batch.first_row}"
        replies = self._session.get(
            selector, timeout=_QUERY_TIMEOUT, consolidation=zenoh.ConsolidationMode.NONE
        )  # all of them
        parts = []
        for reply in replies:
            if reply.ok is not None:
                try:
                    parts.append(decode(reply.ok.payload.to_bytes(), batch.node))
                except InputError as error:
                    self._reject(batch.node, error)
                    continue
                if (parts[-1].session, parts[-1].columns, parts[-1].end) == (
                    batch.session,
                    batch.columns,
                    batch.first_row,
                ):
                    break  # the service's last answer: do not wait for other programs that may also answer
        own = [part for part in parts if part.session == batch.session and part.columns == batch.columns]
        return sorted((part for part in own if part.end <= batch.first_row), key=lambda part: part.first_row)

    def _note_requests(self, requests: list[dict[str, Any]]) -> None:
        self._requests.add(requests)

    def _note_events(self, events: list[dict[str, Any]]) -> None:
        self._new_events += self._events.add(events)


def ask(session: zenoh.Session, key: str, check: Callable[[Any], T], attempts: int = 1) -> T | None:
    """Return the JSON answer to a query of `key` that passes `check`; None without one.

    On a busy machine several `attempts` help.
    """
    for _ in range(attempts):
        # check each answer, not only the last: another program may also answer
        for reply in session.get(key, timeout=_QUERY_TIMEOUT, consolidation=zenoh.ConsolidationMode.NONE):
            if reply.ok is not None:
                with suppress(InputError):
                    return check(parse_message(reply.ok.payload.to_bytes()))
    return None


def list_benches(session: zenoh.Session) -> list[str]:
    """Return the names of the benches that publish."""
    replies = session.liveliness().get(Keys("*", "*").alive, timeout=_QUERY_TIMEOUT)
    return sorted({parse_key(str(reply.ok.key_expr)).bench for reply in replies if reply.ok is not None})


def list_live_nodes(session: zenoh.Session, bench: str) -> list[str]:
    """Return the nodes of a bench that publish."""
    replies = session.liveliness().get(Keys(bench, "*").alive, timeout=_QUERY_TIMEOUT)
    return sorted({parse_key(str(reply.ok.key_expr)).node for reply in replies if reply.ok is not None})


def find_bench(session: zenoh.Session, bus: str | None = None, network: str | None = None) -> str:
    """Return the bench on `bus`, or the only one. Raises InputError if there are several, NoBenchError if there is none.

    network: with which `session` was opened; the message of the error then says where a bench is missing.
    """
    there = list_benches(session)
    if bus is None:
        matches = there
    else:
        own = make_bench_name(bus)
        matches = [own] if own in there else [name for name in there if bus in (name, find_bus(name))]
    if len(matches) == 1:
        return matches[0]
    if matches:
        raise InputError(f"{len(matches)} benches run: {join_names(matches)}; choose one with --bus")
    where = f" on {bus}" if bus else ""
    others = f"; running are {join_names(there)}" if there else ""
    raise NoBenchError(f"no bench{where} publishes telemetry{others}; {advise_start(network)}")
