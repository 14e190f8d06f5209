"""What compiled code asks of the system to receive and to send, and what it makes of the answers. Each test has the module as
argument, so that it can run on mutants (tests/mutation). It is the source of exchange.py without compilation. The system is
made up: it reads and writes memory at the addresses that it is given, as the real one does."""

import ctypes
import errno
import struct
from types import ModuleType
from typing import Any

import numpy as np
import pytest

import protocols.buses.exchange
from protocols.can.frame_batch import make_batch
from tests.mutation.mutants import load_mutant, parse_plain
from tests.mutation.plain import view_fields

FRAME = struct.Struct("=IB3x8s")
MARK = 0x101
CAPACITY, TARGETS = 4096, 256
A_CALL = 32  # frames that one call receives
IN, HANG_UP, ERROR = 1, 0x10, 0x08  # of poll(2)
LISTENER, FIRST, SECOND, WAKES = 50, 51, 52, 53  # descriptors
NOW = 1_700_000_000_123_456_789  # ns of CLOCK_REALTIME


@pytest.fixture
def exchange() -> ModuleType:
    return load_mutant(parse_plain(protocols.buses.exchange))


class Message:
    """A message that comes: frame; stamp [ns] of a local bus or of the kernel, None without one; flags of recvmsg(2)."""

    def __init__(self, can_id: int, stamp: int | None = None, length: int | None = None, flags: int = 0) -> None:
        self.data, self.stamp, self.length, self.flags = FRAME.pack(can_id, 8, bytes(8)), stamp, length, flags


class System:
    """A made-up system under a bus with a listener (if `local`), the sockets FIRST and SECOND, and WAKES.

    `events`: of the descriptors at the next poll. `coming`: what each call to receive from a descriptor brings, or its error.
    `results`: of sends, 0 and more where one is taken, or minus its error. `log` has the calls.
    """

    def __init__(self, module: ModuleType, local: bool = True) -> None:
        self.module, self.local, self.log = module, local, list[tuple[Any, ...]]()
        self.events, self.coming, self.results = dict[int, int](), dict[int, list[Any]](), list[int]()
        self.polled: int | None = None  # what a poll returns, if not the number of descriptors with events
        self.error, self.now = 0, NOW
        self.array = module.make_empty_lines()
        self.lines, self.inbox, self.outbox = view_fields(self.array), make_batch(CAPACITY + 1), make_batch(4)
        line = self.line = self.lines[0]
        heard = [LISTENER, FIRST, SECOND] if local else [FIRST]
        line.mark, line.local, line.heard, line.reached = MARK, local, len(heard), 2 if local else 1
        self.array["polls"]["fd"][0, : len(heard) + 1] = [*heard, WAKES]
        self.array["targets"][0, :2] = FIRST, SECOND
        line.length = 24 if local else 16
        self.array["in_parts"]["length"] = line.length
        parts = self.array[0]["in_parts"]
        self.array["incoming"]["iov"], self.array["incoming"]["iov_length"] = module.read_addresses(parts), 1
        for name in ("ppoll", "recvmmsg", "send", "clock_gettime", "errno_location"):
            setattr(module, f"_{name}", getattr(self, f"_{name}"))

    def _ppoll(self, address: int, count: int, time: int, mask: int) -> int:
        assert address == self.array["polls"].ctypes.data
        assert mask == 0
        self.log.append(("poll", count, *(ctypes.c_int64 * 2).from_address(time)))
        polls = self.array["polls"][0]
        if self.polled is not None:
            return self.polled
        polls["revents"][:count] = [self.events.get(int(fd), 0) for fd in polls["fd"][:count]]
        return int(np.count_nonzero(polls["revents"][:count]))

    def _recvmmsg(self, fd: int, address: int, count: int, flags: int, timeout: int) -> int:
        assert address == self.array["incoming"].ctypes.data
        assert (count, flags, timeout) == (A_CALL, 0x40, 0)
        self.log.append(("receive", fd))
        come = self.coming[fd].pop(0) if self.coming.get(fd) else -errno.EAGAIN
        if isinstance(come, int):
            self.error = -come if come else self.error
            return -1 if come else 0
        for index, message in enumerate(come):
            self._deliver(index, message)
        return len(come)

    def _deliver(self, index: int, message: Message) -> None:
        place, base = self.array["incoming"][0][index], int(self.array["in_parts"][0][index]["base"])
        assert place["control_length"] == (0 if self.local else 32)
        begin = self.inbox.ctypes.data
        assert 0 <= base - begin <= (CAPACITY - 1) * self.inbox.itemsize
        assert (base - begin) % self.inbox.itemsize == 0
        data = message.data + (struct.pack("=q", message.stamp) if self.local else b"")
        ctypes.memmove(base, data, len(data))
        place["length"] = len(data) if message.length is None else message.length
        place["flags"], place["control_length"] = message.flags, 0
        if not self.local and message.stamp is not None:
            place["control_length"] = 32
            self.array["controls"][0][index]["seconds"] = message.stamp // 1_000_000_000
            self.array["controls"][0][index]["nanoseconds"] = message.stamp % 1_000_000_000

    def _send(self, fd: int, address: int, length: int, flags: int) -> int:
        assert flags == 0x4040  # MSG_DONTWAIT, MSG_NOSIGNAL
        assert length == (24 if self.local else 16)
        index, rest = divmod(address - self.outbox.ctypes.data, self.outbox.itemsize)
        assert (rest, 0 <= index < len(self.outbox)) == (0, True)
        self.log.append(("send", fd, index, int(self.outbox["stamp"][index])))
        result = self.results.pop(0) if self.results else 24
        self.error = -result if result < 0 else self.error
        return -1 if result < 0 else result

    def _clock_gettime(self, clock: int, address: int) -> int:
        times = (ctypes.c_int64 * 2).from_address(address)
        times[0], times[1] = divmod(self.now + clock, 1_000_000_000)  # CLOCK_MONOTONIC is 1 ns more
        return 0

    def _errno_location(self) -> list[int]:
        return [self.error]

    def gather(self, timeout: int = 0, first: int = 0, count: int = 0) -> int:
        outcome = self.module.gather(self.lines, timeout, view_fields(self.inbox), first, count)
        assert outcome is not None
        return int(outcome)

    def send(self, count: int, position: int = 0) -> int:
        return int(self.module.send_to_all(self.lines, position, view_fields(self.outbox), count))

    def list_ids(self, count: int) -> list[int]:
        return [int(can_id) for can_id in self.inbox["can_id"][:count]]

    def list_calls(self, *names: str) -> list[tuple[Any, ...]]:
        return [call for call in self.log if call[0] in names]


# --- receiving -------------------------------------------------------------------------------------------------------


def test_all_descriptors_are_polled_for_the_time_given(exchange: ModuleType) -> None:
    for timeout, sentence in ((0, (0, 0)), (7_000_000_005, (7, 5)), (999_999_999, (0, 999_999_999))):
        for local, count in ((True, 4), (False, 2)):
            system = System(exchange, local)
            assert system.gather(timeout, 0, 3) == 3
            assert system.log == [("poll", count, *sentence)]


def test_where_a_poll_tells_nothing_nobody_looks_further(exchange: ModuleType) -> None:
    """A signal has ended it: what is there of events is of the poll before."""
    for polled in (0, -1):
        system = System(exchange)
        system.polled, system.line.changed = polled, True
        system.array["polls"]["revents"][0, :4] = IN
        assert system.gather(0, 0, 3) == 3
        assert system.list_calls("receive") == []
        assert (bool(system.line.changed), bool(system.line.signalled)) == (False, False)


def test_who_has_frames_is_read_and_nobody_else(exchange: ModuleType) -> None:
    system = System(exchange)
    system.events = {SECOND: IN}
    system.coming = {SECOND: [[Message(0x200, 9)]]}
    assert system.gather() == 1
    assert system.list_ids(1) == [0x200]
    assert system.list_calls("receive") == [("receive", SECOND)]
    assert (bool(system.line.changed), bool(system.line.signalled), system.line.ignored) == (False, False, 0)


def test_the_door_of_a_local_bus_is_not_read(exchange: ModuleType) -> None:
    system = System(exchange)
    system.events = {LISTENER: IN, FIRST: IN}
    system.coming = {FIRST: [[Message(0x200, 9)]]}
    assert system.gather() == 1
    assert system.list_calls("receive") == [("receive", FIRST)]
    assert system.line.changed


def test_the_socket_of_a_can_bus_is_its_first(exchange: ModuleType) -> None:
    """Its frames have the kernel's stamp, or that of now, and are received with it."""
    system = System(exchange, local=False)
    system.events = {FIRST: IN}
    system.coming = {FIRST: [[Message(0x200, 3_000_000_007), Message(MARK, None), Message(0x202, 5)]]}
    assert system.gather() == 3
    assert system.inbox["stamp"][:3].tolist() == [3_000_000_007, NOW, 5]
    assert (system.line.marks, system.line.marked_ns) == (1, NOW)
    assert not system.line.changed


def test_a_signal_is_seen_once(exchange: ModuleType) -> None:
    system = System(exchange)
    system.events = {WAKES: IN, FIRST: IN}
    system.coming = {FIRST: [[Message(0x200, 9)]]}
    assert system.gather() == 1
    assert system.line.signalled
    assert system.array["polls"]["fd"][0, :4].tolist() == [LISTENER, FIRST, SECOND, -1]
    assert not system.line.changed


def test_a_full_call_is_followed_by_another(exchange: ModuleType) -> None:
    for come, calls in (([A_CALL], 2), ([A_CALL - 1], 1), ([A_CALL, A_CALL, 1], 3), ([A_CALL, 0], 2)):
        system = System(exchange)
        system.events = {FIRST: IN}
        numbers = iter(range(200))
        system.coming = {FIRST: [[Message(next(numbers), 9) for _ in range(count)] for count in come]}
        system.coming[FIRST] = [one or 0 for one in system.coming[FIRST]]
        assert system.gather() == sum(come)
        assert system.list_ids(sum(come)) == list(range(sum(come)))
        assert len(system.list_calls("receive")) == calls
        assert not system.line.changed


def test_an_error_of_a_socket_is_told_and_an_empty_one_is_none(exchange: ModuleType) -> None:
    for come, changed in ((-errno.EAGAIN, False), (-errno.ECONNRESET, True), (-errno.ENETDOWN, True), (0, False)):
        system = System(exchange)
        system.events, system.coming, system.error = {FIRST: IN}, {FIRST: [come]}, errno.ECONNRESET
        assert system.gather() == 0
        assert bool(system.line.changed) is changed
    system = System(exchange)
    system.events, system.error = {FIRST: IN}, errno.ECONNRESET  # of a call before
    system.coming = {FIRST: [[Message(0x200, 9)]]}
    assert system.gather() == 1
    assert not system.line.changed


def test_who_has_left_is_not_read_again(exchange: ModuleType) -> None:
    """What he sent before is taken. A message without bytes is none that is ignored."""
    system = System(exchange)
    system.events = {FIRST: IN}
    come = [Message(number, 9) for number in range(A_CALL - 1)]
    system.coming = {FIRST: [[*come, Message(0x300, length=0, stamp=9)], [Message(0x301, 9)]]}
    assert system.gather() == A_CALL - 1
    assert system.list_ids(A_CALL - 1) == list(range(A_CALL - 1))
    assert len(system.list_calls("receive")) == 1
    assert (bool(system.line.changed), system.line.ignored) == (True, 0)


def test_a_socket_that_hangs_up_or_fails_is_told(exchange: ModuleType) -> None:
    for events, changed in ((IN, False), (HANG_UP, True), (IN | HANG_UP, True), (IN | ERROR, True)):
        system = System(exchange)
        system.events, system.coming = {FIRST: events}, {FIRST: [[Message(0x200, 9)]]}
        assert system.gather() == 1  # an error is taken away by reading
        assert bool(system.line.changed) is changed


def test_a_frame_that_was_cut_is_ignored(exchange: ModuleType) -> None:
    system = System(exchange)
    system.events = {FIRST: IN}
    system.coming = {FIRST: [[Message(0x200, 9), Message(0x201, 9, flags=0x20), Message(0x202, 9, flags=0x7FFFFFDF)]]}
    assert system.gather() == 2
    assert system.list_ids(2) == [0x200, 0x202]
    assert system.line.ignored == 1


# --- waiting for a marked frame --------------------------------------------------------------------------------------


class Wait:
    """`gather` and the clock, made up: each call takes `took` [ns] and has the `results` (count, marks, changed) in turn."""

    def __init__(self, module: ModuleType, took: int, *results: tuple[int, int, bool]) -> None:
        self.module, self.took, self.results, self.now = module, took, list(results), 40_000
        self.lines = view_fields(module.make_empty_lines())
        self.lines[0].marks = 5
        self.calls = list[tuple[int, ...]]()
        module.gather, module.read_clock = self._gather, self._read_clock  # type: ignore[attr-defined]

    def _gather(self, lines: Any, timeout: int, inbox: str, first: int, count: int) -> int:
        self.calls.append((timeout, first, count))
        self.now += self.took
        outcome, marks, changed = self.results.pop(0)
        lines[0].marks, lines[0].changed = marks, changed
        return outcome

    def _read_clock(self, clock: int, times: Any) -> int:
        assert clock == self.module.CLOCK_MONOTONIC
        return self.now

    def run(self, timeout: int, first: int = 1, count: int = 2) -> int:
        outcome: int = self.module.gather_marked(self.lines, timeout, "inbox", first, count)
        assert not self.results  # it has not ended before
        return outcome


def test_a_wait_goes_on_until_a_marked_frame(exchange: ModuleType) -> None:
    wait = Wait(exchange, 100, (3, 5, False), (7, 5, False), (9, 6, False))
    assert wait.run(1000) == 9
    assert wait.calls == [(1000, 1, 2), (900, 1, 3), (800, 1, 7)]


def test_a_wait_ends_with_its_time(exchange: ModuleType) -> None:
    for took, calls in ((1000, 1), (1001, 1), (999, 2), (998, 2), (500, 2)):
        wait = Wait(exchange, took, *([(3, 5, False)] * calls))
        assert wait.run(1000) == 3
        assert len(wait.calls) == calls


def test_who_comes_or_goes_ends_a_wait(exchange: ModuleType) -> None:
    assert Wait(exchange, 0, (3, 5, True)).run(1000) == 3


def test_an_inbox_without_room_for_a_call_ends_a_wait(exchange: ModuleType) -> None:
    full = CAPACITY - A_CALL + 1
    assert Wait(exchange, 0, (full - 1, 5, False), (full, 5, False)).run(1000) == full


# --- time ------------------------------------------------------------------------------------------------------------


def test_clocks_are_those_of_the_kernel(exchange: ModuleType) -> None:
    system = System(exchange)
    assert exchange.read_clock(exchange.CLOCK_REALTIME, system.line.time) == NOW
    assert exchange.read_clock(exchange.CLOCK_MONOTONIC, system.line.time) == NOW + 1


# --- sending ---------------------------------------------------------------------------------------------------------


def test_frames_are_sent_one_after_the_other_with_the_time(exchange: ModuleType) -> None:
    """Before the first of them the door is looked at, without waiting."""
    system = System(exchange)
    system.line.time[:] = 7, 8  # of another call
    assert system.send(2) == 2 * TARGETS
    assert system.log == [
        ("poll", 1, 0, 0), ("send", FIRST, 0, NOW), ("send", SECOND, 0, NOW), ("send", FIRST, 1, NOW), ("send", SECOND, 1, NOW),
    ]  # fmt: skip


def test_on_a_can_bus_there_is_no_door_and_no_time(exchange: ModuleType) -> None:
    system = System(exchange, local=False)
    system.events, system.outbox["stamp"] = {FIRST: IN}, 7
    assert system.send(2) == 2 * TARGETS
    assert system.log == [("send", FIRST, 0, 7), ("send", FIRST, 1, 7)]


def test_a_newcomer_at_the_door_comes_first(exchange: ModuleType) -> None:
    for events, sent in (({LISTENER: IN}, False), ({FIRST: IN}, True)):
        system = System(exchange)
        system.events = events
        assert system.send(1) == (TARGETS if sent else -1)
        assert len(system.list_calls("send")) == (2 if sent else 0)
    system = System(exchange)
    system.polled = -1  # a signal has come: that is none
    assert system.send(1) == TARGETS


def test_in_the_middle_of_a_frame_nothing_is_looked_at_nor_stamped(exchange: ModuleType) -> None:
    system = System(exchange)
    system.outbox["stamp"] = 7
    assert system.send(2, position=1) == 2 * TARGETS
    assert system.log == [("send", SECOND, 0, 7), ("send", FIRST, 1, NOW), ("send", SECOND, 1, NOW)]


def test_a_full_queue_of_any_kind_is_counted(exchange: ModuleType) -> None:
    for error in (errno.EAGAIN, errno.ENOBUFS, errno.ENOMEM):
        system = System(exchange)
        system.results = [24, -error, 24, -error]
        assert system.send(2) == 2 * TARGETS
        assert len(system.list_calls("send")) == 4
        assert (system.line.unsent, system.line.refused[:3].tolist(), system.line.error) == (2, [0, 2, 0], 0)


def test_another_error_stops_at_its_target(exchange: ModuleType) -> None:
    for place, position in enumerate((0, 1, TARGETS, TARGETS + 1)):
        system = System(exchange)
        system.results = [24] * place + [-errno.EPIPE]
        assert system.send(2) == position
        assert (system.line.error, system.line.unsent) == (errno.EPIPE, 0)


def test_what_was_taken_is_sent_whatever_an_older_error(exchange: ModuleType) -> None:
    system = System(exchange)
    system.error, system.results = errno.EPIPE, [0]
    assert system.send(1) == TARGETS
    assert (system.line.error, system.line.unsent) == (0, 0)
