"""Frames that compiled code receives and sends, on sockets of this process. Each test has the module as argument, so that it
can run on mutants (tests/mutation)."""

import os
import select
import socket
import struct
from contextlib import suppress
from types import ModuleType, TracebackType
from typing import Any

import numpy as np
import pytest

import protocols.buses.exchange
from protocols.can.frame_batch import make_batch
from tests.mutation.plain import view_records

FRAME = struct.Struct("=IB3x8sq")  # identifier, length, data, stamp [ns]: as a local bus carries it
MARK = 0x101
CAPACITY, TARGETS = 4096, 256


@pytest.fixture(scope="module")
def exchange() -> ModuleType:
    return protocols.buses.exchange


class Bus:
    """`lines` of a local bus with some participants; `ends` are their sockets. `door`: who writes there is a newcomer."""

    def __init__(self, exchange: ModuleType, participants: int = 2) -> None:
        self.module = exchange
        pairs = [socket.socketpair(socket.AF_UNIX, socket.SOCK_SEQPACKET) for _ in range(participants)]
        self.own, self.ends = [pair[0] for pair in pairs], [pair[1] for pair in pairs]
        listener, self.door = os.pipe()
        wakes, self.signal = os.pipe()
        self.pipes = [listener, self.door, wakes, self.signal]
        self.lines = lines = exchange.make_empty_lines()
        lines["mark"], lines["local"], lines["polls"]["events"] = MARK, True, select.POLLIN
        lines["length"] = lines["in_parts"]["length"] = FRAME.size
        parts = lines[0]["in_parts"]
        lines["incoming"]["iov"], lines["incoming"]["iov_length"] = exchange.read_addresses(parts), 1
        heard = [listener, *(one.fileno() for one in self.own)]
        lines["heard"], lines["reached"] = len(heard), participants
        lines["polls"]["fd"][0, : len(heard) + 1] = [*heard, wakes]
        lines["targets"][0, :participants] = [one.fileno() for one in self.own]
        # a mutant that takes a wrong address finds memory of this process there, not that of others
        self._room = make_batch(3 * (CAPACITY + 1)), make_batch(4 + 2 * CAPACITY)
        self.inbox, self.outbox = self._room[0][CAPACITY + 1 : -CAPACITY - 1], self._room[1][CAPACITY:-CAPACITY]

    def __enter__(self) -> "Bus":
        return self

    def __exit__(self, kind: type | None, error: BaseException | None, trace: TracebackType | None) -> None:
        for one in (*self.own, *self.ends):
            one.close()
        for pipe in self.pipes:
            os.close(pipe)

    def put(self, who: int, can_id: int, stamp: int = 0, data: bytes = bytes(8), length: int | None = None) -> None:
        """Let a participant send a frame."""
        self.ends[who].send(FRAME.pack(can_id, len(data) if length is None else length, data, stamp))

    def gather(self, first: int = 0, count: int = 0, timeout: int = 0) -> int:
        return int(self.module.gather(view_records(self.lines), timeout, view_records(self.inbox), first, count))

    def gather_marked(self, timeout: int = 0) -> int:
        return int(self.module.gather_marked(view_records(self.lines), timeout, view_records(self.inbox), 0, 0))

    def send(self, count: int, position: int = 0) -> int:
        return int(self.module.send_to_all(view_records(self.lines), position, view_records(self.outbox), count))

    def read(self, name: str) -> Any:
        return self.lines[name][0]

    def list_ids(self, first: int, end: int) -> list[int]:
        return [int(can_id) for can_id in self.inbox["can_id"][first:end]]


# --- receiving -------------------------------------------------------------------------------------------------------


def test_without_frames_the_count_stays(exchange: ModuleType) -> None:
    with Bus(exchange) as bus:
        assert bus.gather(2, 5) == 5
        assert not bus.read("changed")


def test_frames_are_received_whole(exchange: ModuleType) -> None:
    with Bus(exchange) as bus:
        bus.inbox["data"] = 0xFF
        bus.put(0, 0xFFF, stamp=77, data=bytes(range(1, 9)), length=3)  # 11 bits are the identifier, 3 bytes the data
        bus.put(0, 0x100, stamp=78, data=bytes(range(8)))
        assert bus.gather(0, 0) == 2
        assert bus.list_ids(0, 2) == [0x7FF, 0x100]
        assert bus.inbox["length"][:2].tolist() == [3, 8]
        assert bus.inbox["data"][0].tolist() == [1, 2, 3, 0, 0, 0, 0, 0]
        assert bus.inbox["data"][1].tolist() == list(range(8))
        assert bus.inbox["stamp"][:2].tolist() == [77, 78]
        assert bus.read("ignored") == 0


def test_frames_that_the_bench_does_not_use_are_ignored(exchange: ModuleType) -> None:
    with Bus(exchange) as bus:
        bus.put(0, 0x100)
        bus.put(0, 0x101, length=9)  # no classic frame has more than 8 bytes
        bus.put(0, 0x102, length=255)
        for flag in (0x80000000, 0x40000000, 0x20000000):
            bus.put(0, flag | 0x103)
        bus.ends[0].send(bytes(16))  # without a stamp
        bus.ends[0].send(bytes(72))  # CAN FD
        bus.put(0, 0x104, data=bytes(8), length=8)
        assert bus.gather() == 2
        assert bus.list_ids(0, 2) == [0x100, 0x104]
        assert bus.read("ignored") == 7
        assert bus.read("marks") == 0


def test_marked_frames_are_counted_with_their_stamp(exchange: ModuleType) -> None:
    with Bus(exchange) as bus:
        for can_id, stamp in ((0x100, 1), (MARK, 2), (MARK, 3), (0x102, 4)):
            bus.put(0, can_id, stamp)
        bus.gather()
        assert (bus.read("marks"), bus.read("marked_ns")) == (2, 3)


def test_frames_of_several_are_merged_by_their_stamps(exchange: ModuleType) -> None:
    with Bus(exchange, 3) as bus:
        for who, stamps in enumerate(((10, 30, 50), (20, 30, 60), (5, 55, 40))):
            for stamp in stamps:
                bus.put(who, 0x100 + who, stamp)
        bus.inbox["stamp"][:2] = 1000, 15  # the first is not of these; the second is
        assert bus.gather(1, 2) == 11
        assert bus.inbox["stamp"][:11].tolist() == [1000, 5, 10, 15, 20, 30, 30, 50, 55, 40, 60]
        # of equal stamps the first participant's comes first, and each sender's order stays
        assert bus.list_ids(5, 7) == [0x100, 0x101]


def test_more_frames_than_one_call_receives_come_at_once(exchange: ModuleType) -> None:
    with Bus(exchange, 2) as bus:
        for number in range(70):
            bus.put(1, number, number)
        assert bus.gather() == 70
        assert bus.list_ids(0, 70) == list(range(70))


def test_what_there_is_no_room_for_waits(exchange: ModuleType) -> None:
    with Bus(exchange) as bus:
        bus.put(0, 0x100)
        assert bus.gather(CAPACITY - 31, CAPACITY - 31) == CAPACITY - 31
        assert bus.gather(CAPACITY - 32, CAPACITY - 32) == CAPACITY - 31


def test_a_newcomer_and_who_leaves_are_told(exchange: ModuleType) -> None:
    with Bus(exchange) as bus:
        os.write(bus.door, b"1")
        bus.put(1, 0x100)
        assert bus.gather() == 1
        assert bus.read("changed")
    with Bus(exchange) as bus:
        bus.put(0, 0x100)
        bus.ends[0].close()
        bus.put(1, 0x101)
        assert bus.gather() == 2
        assert bus.read("changed")
        assert bus.read("ignored") == 0


def test_a_signal_is_told_once(exchange: ModuleType) -> None:
    with Bus(exchange) as bus:
        os.write(bus.signal, b"1")
        assert bus.gather() == 0
        assert bus.read("signalled")
        assert bus.lines["polls"]["fd"][0, int(bus.read("heard"))] == -1
        assert not bus.read("changed")


def test_a_marked_frame_ends_a_wait_and_others_do_not(exchange: ModuleType) -> None:
    with Bus(exchange) as bus:
        bus.put(0, 0x100)
        assert bus.gather_marked(3_000_000) == 1
        bus.put(0, MARK)
        assert bus.gather_marked(2_000_000_000) == 1
        os.write(bus.door, b"1")
        assert bus.gather_marked(2_000_000_000) == 0
        assert bus.read("marks") == 1


# --- sending ---------------------------------------------------------------------------------------------------------


def test_frames_are_sent_to_all(exchange: ModuleType) -> None:
    with Bus(exchange) as bus:
        bus.outbox["can_id"], bus.outbox["length"] = (1, 2, 3, 4), 8
        assert bus.send(3) == 3 * TARGETS
        for end in bus.ends:
            received = [FRAME.unpack(end.recv(99)) for _ in range(3)]
            assert [one[0] for one in received] == [1, 2, 3]
            assert all(one[3] > 10**18 for one in received)  # ns since 1970: stamped when it is sent
        assert (bus.read("unsent"), bus.outbox["stamp"][3]) == (0, 0)


def test_sending_goes_on_where_it_has_stopped(exchange: ModuleType) -> None:
    with Bus(exchange) as bus:
        bus.outbox["can_id"], bus.outbox["stamp"] = (1, 2, 3, 4), 7
        assert bus.send(2, position=1) == 2 * TARGETS
        first, second = (FRAME.unpack(bus.ends[1].recv(99)) for _ in range(2))
        assert (first[0], first[3], second[0]) == (1, 7, 2)  # the first was stamped before
        assert second[3] > 7
        assert FRAME.unpack(bus.ends[0].recv(99))[0] == 2
        assert bus.send(4, position=3 * TARGETS) == 4 * TARGETS
        assert FRAME.unpack(bus.ends[0].recv(99))[0] == 4


def test_a_newcomer_is_let_in_before_anything_is_sent(exchange: ModuleType) -> None:
    with Bus(exchange) as bus:
        os.write(bus.door, b"1")
        assert bus.send(1) == -1
        assert bus.send(1, position=1) == TARGETS  # not in the middle


def test_sending_stops_at_who_has_left(exchange: ModuleType) -> None:
    with Bus(exchange, 3) as bus:
        bus.ends[1].close()
        assert bus.send(2) == 1
        assert bus.read("error") == 32  # broken pipe
        assert bus.send(2, position=2) == TARGETS + 1


def test_a_full_queue_is_counted_and_not_waited_for(exchange: ModuleType) -> None:
    with Bus(exchange) as bus:
        bus.own[1].setblocking(False)
        with suppress(BlockingIOError):
            while True:
                bus.own[1].send(bytes(FRAME.size))
        assert bus.send(3) == 3 * TARGETS
        assert (bus.read("unsent"), bus.read("refused")[:2].tolist()) == (3, [0, 3])


def test_a_cycle_is_settled_when_all_was_sent(exchange: ModuleType) -> None:
    for sent, position, changed, settled in (
        (2, 2 * TARGETS, False, True), (0, 0, False, True), (2, 2 * TARGETS - 1, False, False),
        (2, 2 * TARGETS, True, False), (-1, -TARGETS, False, False), (1, 2 * TARGETS, False, False),
    ):  # fmt: skip
        with Bus(exchange) as bus:
            bus.lines["changed"] = changed
            bus.lines["taken"], bus.lines["given"] = 100, 50
            line = view_records(bus.lines)[0] if view_records(bus.lines) is not bus.lines else _view(bus.lines)
            assert bool(exchange.is_settled(line, 3, 7, sent, position)) is settled
            assert (bus.read("taken"), bus.read("given")) == ((104, 50 + sent) if settled else (100, 50))


def _view(lines: np.ndarray) -> Any:
    return lines.view(np.recarray)[0]
