"""What Python does around the compiled calls of an exchange: counts, participants, time. Each test has the module as argument,
so that it can run on mutants (tests/mutation). Compiled calls, bus and clock are made up."""

import errno
import os
from collections.abc import Iterator
from contextlib import contextmanager
from types import ModuleType, SimpleNamespace
from typing import Any

import numpy as np
import pytest

import protocols.buses.exchange
from protocols.errors import InputError
from tests.mutation.mutants import load_mutant, parse_plain

MARK, TARGETS, CAPACITY = 0x101, 256, 4096
HALF = 500_000_000  # ns


@pytest.fixture
def exchange() -> ModuleType:
    return load_mutant(parse_plain(protocols.buses.exchange))


class Line:
    """An exchange with a made-up port of the sockets `heard`; `log` has the calls from its making on.

    `counts`: what the next calls to receive return, each with whether a participant comes or goes; the count stays without.
    `positions`: where the next calls to send end; all is sent without. `left`: whether a target that fails has left.
    """

    def __init__(self, module: ModuleType, wakes: int | None = 9, local: bool = True, heard: int = 2) -> None:
        self.module, self.log, self.now = module, list[tuple[Any, ...]](), 70_000
        self.counts, self.positions, self.left = list[tuple[int, bool]](), list[int](), False
        self.took = 0  # ns of a call to receive
        raw = SimpleNamespace(listener=5 if local else None, changes=0, list_sockets=self._list_sockets)
        self.port: Any = SimpleNamespace(
            name="bus", raw=raw, received=100, sent=200, ignored=300, count_lost=self._lose
        )
        self.heard, self.reached = list(range(20, 20 + heard)), [31, 32, 33]
        module.gather, module.send_to_all = self._gather, self._send  # type: ignore[attr-defined]
        module.time = SimpleNamespace(monotonic_ns=lambda: self.now)  # type: ignore[attr-defined]
        self.made = list[tuple[Any, ...]]()
        self.line = module.Exchange(self.port, MARK, *(() if wakes is None else (wakes,)))
        self.log.clear()
        self.view = self.line.lines

    def _list_sockets(self) -> tuple[list[int], list[int]]:
        self.log.append(("participants",))
        return self.heard, self.reached

    def _gather(self, lines: np.ndarray, timeout: int, inbox: np.ndarray, first: int, count: int) -> int:
        if not hasattr(self, "line"):  # it is being made
            self.made.append((lines, timeout, inbox, first, count))
            return count
        assert (lines is self.line.lines, inbox is self.line.inbox) == (True, True)
        self.log.append(("gather", timeout, first, count))
        self.now += self.took
        count, self.view["changed"] = self.counts.pop(0) if self.counts else (count, False)
        return count

    def _send(self, lines: np.ndarray, position: int, frames: Any, count: int) -> int:
        if not hasattr(self, "line"):
            self.made.append((lines, position, frames, count))
            return 0
        assert lines is self.line.lines
        self.log.append(("send", position, frames, count))
        return self.positions.pop(0) if self.positions else TARGETS * count

    def _lose(self, descriptor: int, error: int, frames: int) -> bool:
        self.log.append(("lost", descriptor, error, frames))
        return self.left

    @property
    def counters(self) -> tuple[int, int, int]:
        return self.port.received, self.port.sent, self.port.ignored


# --- making ----------------------------------------------------------------------------------------------------------


def test_its_memory_is_that_of_the_bus(exchange: ModuleType) -> None:
    for local, length in ((True, 24), (False, 16)):
        line = Line(exchange, local=local)
        view = line.view[0]
        assert (view["mark"], view["local"], view["length"]) == (MARK, local, length)
        assert (line.view.shape, len(line.line.inbox), line.line.count) == ((1,), CAPACITY + 1, 0)
        assert (view["heard"], view["reached"]) == (2, 3)
        assert view["polls"]["fd"][:3].tolist() == [20, 21, 9]
        assert view["targets"][:3].tolist() == [31, 32, 33]
        assert set(view["polls"]["events"]) == {1}
        assert set(view["in_parts"]["length"]) == {length}
        assert view["incoming"]["iov"].tolist() == exchange.read_addresses(view["in_parts"]).tolist()
        assert set(view["incoming"]["iov_length"]) == {1}
        controls = [0] * 32 if local else exchange.read_addresses(view["controls"]).tolist()
        assert view["incoming"]["control"].tolist() == controls


def test_without_a_descriptor_of_signals_it_polls_none(exchange: ModuleType) -> None:
    assert Line(exchange, None).view["polls"]["fd"][0, :3].tolist() == [20, 21, -1]


def test_addresses_are_those_of_the_elements(exchange: ModuleType) -> None:
    line = Line(exchange)
    parts = line.view[0]["in_parts"]
    assert exchange.read_addresses(parts).tolist() == [parts[at:].ctypes.data for at in range(32)]


def test_fields_are_aligned_as_the_system_wants_them(exchange: ModuleType) -> None:
    for dtype, offset, *_ in (exchange._LINE.fields or {}).values():
        assert offset % dtype.alignment == 0


def test_its_compiled_calls_are_made_once_without_a_frame(exchange: ModuleType) -> None:
    line = Line(exchange)
    received, sent = line.made
    assert received[1:2] + received[3:] == (0, 0, 0)
    assert received[2] is line.line.inbox
    assert sent[1:2] + sent[3:] == (0, 0)
    assert len(sent[2]) == 1
    for lines in (received[0], sent[0]):
        assert lines is not line.line.lines
        assert (lines.shape, set(lines["polls"]["fd"][0])) == ((1,), {-1})
        assert (lines["heard"], lines["reached"]) == (0, 0)


def test_as_many_participants_as_there_is_room_for_are_taken(exchange: ModuleType) -> None:
    line = Line(exchange, heard=256)
    assert line.view[0]["polls"]["fd"].tolist() == [*range(20, 276), 9]
    with pytest.raises(InputError, match="257 participants are on bus; allowed are 256"):
        Line(exchange, heard=257)


# --- receiving -------------------------------------------------------------------------------------------------------


def test_marks_are_those_of_its_memory(exchange: ModuleType) -> None:
    line = Line(exchange)
    line.view["marks"], line.view["marked_ns"] = 3, 4
    assert (line.line.marks, line.line.marked_ns) == (3, 4)
    line.line.count = 5
    line.line.clear()
    assert line.line.count == 0


def test_what_waits_is_received_at_once(exchange: ModuleType) -> None:
    for count, came in ((4, False), (7, True)):
        line = Line(exchange)
        line.line.count, line.counts = 4, [(count, False)]
        assert line.line.receive() is came
        assert line.log == [("gather", 0, 4, 4)]
        assert (line.line.count, line.counters) == (count, (100 + count - 4, 200, 300))


def test_a_wait_ends_with_a_frame_or_its_time(exchange: ModuleType) -> None:
    for took, counts, came, waits in (
        (HALF // 2, [0, 3], True, [HALF, HALF // 2]),
        (HALF // 2, [0, 0, 0], False, [HALF, HALF // 2, 0]),
        (HALF - 1, [0, 0, 0], False, [HALF, 1, 0]),
        (2 * HALF, [0, 0], False, [HALF, 0]),
        (2 * HALF, [1], True, [HALF]),
    ):
        line = Line(exchange)
        line.took, line.counts = took, [(count, False) for count in counts]
        assert line.line.receive(0.5) is came
        assert line.log == [("gather", wait, 0, 0) for wait in waits]


def test_frames_of_a_newcomer_end_a_wait(exchange: ModuleType) -> None:
    line = Line(exchange)
    line.counts = [(0, True), (2, False)]
    assert line.line.receive(0.5)
    assert line.log == [("gather", HALF, 0, 0), ("participants",), ("gather", 0, 0, 0)]
    assert (line.line.count, line.port.received) == (2, 102)


def test_who_comes_or_goes_is_admitted_a_few_times_a_call(exchange: ModuleType) -> None:
    line = Line(exchange)
    line.view["changed"], line.line.count = True, 3
    line.counts = [(6, True), (7, False)]
    line.line.accept(5, 1)
    once = ("participants",)
    assert line.log == [once, ("gather", 0, 1, 5), once, ("gather", 0, 1, 6)]
    assert (line.line.count, line.port.received) == (7, 104)
    line = Line(exchange)
    line.view["changed"], line.counts = True, [(0, True)] * 99
    line.line.accept(0, 0)
    assert len(line.log) == 2 * 8


# --- what the port does otherwise ------------------------------------------------------------------------------------


def test_participants_are_noted_anew_when_they_have_changed(exchange: ModuleType) -> None:
    for use in (lambda line: line.receive(), lambda line: line.send("frames", 1), lambda line: line.refresh()):
        line = Line(exchange)
        line.port.raw.changes, line.heard, line.reached = 1, [40], [41]
        use(line.line)
        assert line.log[0] == ("participants",)
        assert line.view["polls"]["fd"][0, :2].tolist() == [40, 9]
        assert (line.view["heard"][0], line.view["reached"][0], line.view["targets"][0, 0]) == (1, 1, 41)
        line.log.clear()
        line.line.refresh()
        assert line.log == []


@contextmanager
def open_pipe() -> Iterator[tuple[int, int]]:
    ends = os.pipe2(os.O_NONBLOCK)
    try:
        yield ends
    finally:
        for end in ends:
            os.close(end)


def test_a_signal_that_was_seen_is_taken_from_its_descriptor(exchange: ModuleType) -> None:
    """Then it is polled again. It may have been taken already."""
    for written in (b"1", b"123", b""):
        with open_pipe() as (wakes, writer):
            line = Line(exchange, wakes)
            os.write(writer, written)
            line.view["signalled"], line.view["polls"]["fd"][0, 2] = True, -1
            line.line.refresh()
            assert line.log == [("participants",)]
            assert (bool(line.view["signalled"][0]), line.view["polls"]["fd"][0, 2]) == (False, wakes)
            with pytest.raises(BlockingIOError):
                os.read(wakes, 1)


# --- sending ---------------------------------------------------------------------------------------------------------


def test_frames_are_sent_and_counted(exchange: ModuleType) -> None:
    line = Line(exchange)
    line.line.send("frames", 3)
    assert line.log == [("send", 0, "frames", 3)]
    assert line.counters == (100, 203, 300)


def test_a_newcomer_gets_what_is_sent(exchange: ModuleType) -> None:
    line = Line(exchange)
    line.positions = [-1]
    line.line.send("frames", 2)
    assert line.log == [("send", 0, "frames", 2), ("participants",), ("send", 0, "frames", 2)]
    assert line.port.sent == 202


def test_who_has_left_is_left_out_and_another_is_passed_by(exchange: ModuleType) -> None:
    """In his place is then the next one."""
    for left in (True, False):
        for stopped in (0, 2, TARGETS, TARGETS + 1):
            line = Line(exchange)
            line.left, line.view["error"] = left, errno.EPIPE
            line.line.finish_send("frames", 2, stopped)
            lost = ("lost", line.reached[stopped % TARGETS], errno.EPIPE, 1)
            on = [("participants",), ("send", stopped, "frames", 2)] if left else [("send", stopped + 1, "frames", 2)]
            assert line.log == [lost, *on]
            assert line.port.sent == 202


def test_who_is_refused_is_counted_in_his_place(exchange: ModuleType) -> None:
    """After a send; with the cycles that are settled; and before participants change their places."""
    for end in (
        lambda line: line.finish_send("frames", 0, 0), lambda line: line.count_settled(),
        lambda line: line._update_participants(),
    ):  # fmt: skip
        line = Line(exchange)
        line.view["refused"][0, [0, 2]], line.view["unsent"], line.view["ignored"] = (4, 5), 9, 7
        end(line.line)
        assert line.log[:2] == [("lost", 31, errno.EAGAIN, 4), ("lost", 33, errno.EAGAIN, 5)]
        assert line.port.ignored == 307
        assert (line.view["refused"].max(), line.view["refused"].min()) == (0, 0)
        assert (line.view["unsent"][0], line.view["ignored"][0]) == (0, 0)


def test_without_refusals_nothing_is_counted(exchange: ModuleType) -> None:
    line = Line(exchange)
    line.view["refused"][0, 0] = 4  # not to be looked at: it takes time
    line.line.finish_send("frames", 0, 0)
    assert (line.log, line.port.ignored) == ([], 300)
    line.view["unsent"] = 1
    line.line.finish_send("frames", 0, 0)
    assert line.log == [("lost", 31, errno.EAGAIN, 4)]


# --- cycles of compiled code -----------------------------------------------------------------------------------------


def test_cycles_that_are_settled_are_counted_once(exchange: ModuleType) -> None:
    line = Line(exchange)
    line.view["taken"], line.view["given"], line.line.count = 11, 12, 4
    for _ in range(2):
        line.line.count_settled()
        assert (line.counters, line.line.count) == ((111, 212, 300), 0)
    assert line.log == []


def test_frames_that_were_used_are_counted_and_discarded(exchange: ModuleType) -> None:
    """Then newcomers are admitted; theirs are the first."""
    line = Line(exchange)
    line.line.count = 4
    line.line.discard_used(9)
    assert (line.port.received, line.line.count, line.log) == (105, 0, [])
    line.view["changed"], line.counts, line.line.count = True, [(2, False)], 4
    line.line.discard_used(4)
    assert line.log == [("participants",), ("gather", 0, 0, 0)]
    assert (line.port.received, line.line.count) == (107, 2)
