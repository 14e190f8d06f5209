"""Frames in fixed memory: what comes and goes is what `Port` would have taken and sent."""

import random
import time
from collections.abc import Iterator

import can
import numpy as np
import pytest

from protocols.buses.bus import Port, open_bus
from protocols.buses.exchange import CAPACITY, Exchange
from protocols.buses.local_channel import FD, LocalChannel
from protocols.can.frame_batch import load, make_batch, unload
from protocols.can.frames import Frame
from tests.memory import measure_growth
from tests.stopwatch import Stopwatch

MARK = 0x101
QUEUE = 2731  # frames of a participant's queue at most (local_channel)


@pytest.fixture
def ports(local_bus: str) -> Iterator[list[Port]]:
    with open_bus(local_bus) as one, open_bus(local_bus) as two, open_bus(local_bus) as three:
        yield [one, two, three]


def list_frames(line: Exchange) -> list[Frame]:
    return unload(line.inbox[: line.count])


def make_frames(count: int, seed: int = 1) -> list[Frame]:
    generator = random.Random(seed)
    return [
        Frame(generator.randrange(0x800), generator.randbytes(length))
        for length in generator.choices(range(9), k=count)
    ]


def test_a_batch_gives_back_what_it_was_given() -> None:
    frames = make_frames(40)
    room = make_batch(40)
    room["data"] = 0xFF  # what was there before
    assert load(room, frames) == 40
    assert unload(room) == frames
    assert all(not row["data"][row["length"] :].any() for row in room)
    with pytest.raises(ValueError, match="41 frames are too many for a batch of 40"):
        load(room, make_frames(41))


def test_whom_the_port_has_let_in_is_heard_and_reached(ports: list[Port]) -> None:
    """The port takes and sends frames, too, while a service waits for another; a newcomer then comes to the port."""
    line = Exchange(ports[0], MARK)
    outbox = make_batch(1)
    load(outbox, [Frame(2, b"answer")])
    for take in (lambda: ports[0].send(Frame(3, b"")), ports[0].receive):
        with open_bus(ports[0].name) as newcomer:
            take()
            newcomer.receive()
            newcomer.send(Frame(1, b"hello"))
            assert line.receive(1.0)
            assert list_frames(line) == [Frame(1, b"hello")]
            line.clear()
            line.send(outbox, 1)
            assert newcomer.receive() == [Frame(2, b"answer")]
        ports[0].receive()  # it has left
        assert not line.receive()
        line.send(outbox, 1)
        assert ports[0].refused == 0


def test_setting_it_up_takes_no_frame_from_the_port(ports: list[Port]) -> None:
    """A service waits for another by its port: what had come before was heard after what came then, in the loop."""
    frames = make_frames(3)
    for frame in frames:
        ports[1].send(frame)
    line = Exchange(ports[0], MARK)
    assert line.count == 0
    assert ports[0].receive() == frames


def test_frames_come_as_a_port_would_take_them(ports: list[Port]) -> None:
    """From two senders in turn, in the order of their stamps; the marked ones are counted."""
    line, other = Exchange(ports[0], MARK), ports[1]
    sent = [frame for pair in zip(make_frames(100, 2), make_frames(100, 3), strict=True) for frame in pair]
    sent[50] = sent[120] = Frame(MARK, b"mark")
    with open_bus(ports[0].name) as fourth:
        for index, frame in enumerate(sent):
            (other if index % 2 else fourth).send(frame)
        before = time.time_ns()
        assert line.receive(1.0)
        assert list_frames(line) == sent == ports[2].receive()
        assert np.all(np.diff(line.inbox["stamp"][: line.count]) >= 0)
        assert line.marks == 2 + sum(f.can_id == MARK for i, f in enumerate(sent) if i not in (50, 120))
        assert before - 1e9 < line.marked_ns <= before
        assert ports[0].received == 200
        line.clear()
        assert not line.receive()
        assert line.count == 0


def test_the_order_of_each_sender_stays_when_its_clock_is_set_back(
    ports: list[Port], monkeypatch: pytest.MonkeyPatch
) -> None:
    line = Exchange(ports[0], MARK)
    now = time.time_ns()
    for port, first, stamps in ((ports[1], 0, (5, 1, 9)), (ports[2], 10, (4, 6, 7))):
        for index, stamp in enumerate(stamps):
            monkeypatch.setattr("protocols.buses.local_channel.time.time_ns", lambda at=stamp: now + at)
            port.send(Frame(first + index, b""))
    monkeypatch.undo()
    line.receive(1.0)
    ids = [can_id for can_id, _ in list_frames(line)]
    assert [i for i in ids if i < 10] == [0, 1, 2]
    assert [i for i in ids if i >= 10] == [10, 11, 12]
    assert ids.index(10) < ids.index(0)


def test_what_is_sent_reaches_everybody_newcomers_too(ports: list[Port]) -> None:
    line = Exchange(ports[0], MARK)
    room = make_batch(8)
    frames = make_frames(8, 4)
    line.send(room, load(room, frames))
    with open_bus(ports[0].name) as newcomer:
        line.send(room, 3)
        assert newcomer.receive() == frames[:3]
        for port in ports[1:]:
            port.wait(1.0)
            assert port.receive() == frames + frames[:3]
    assert ports[0].read_counts() == {"sent": 11, "received": 0, "refused": 0, "down": 0, "ignored": 0}


def test_who_comes_while_it_waits_is_heard_and_who_has_left_is_no_harm(ports: list[Port]) -> None:
    line = Exchange(ports[0], MARK)
    room = make_batch(1)
    load(room, [Frame(1, b"x")])
    for number in range(5):
        with open_bus(ports[0].name) as passing:
            passing.send(Frame(0x200 + number, b"last words"[:8]))
        line.send(room, 1)
        line.receive(0.2)
    assert [can_id for can_id, _ in list_frames(line)] == [0x200 + number for number in range(5)]
    assert ports[0].refused == 0
    with open_bus(ports[0].name) as passing:
        line.send(room, 1)
        reached = int(line._view["reached"])
    line.send(room, 1)
    assert int(line._view["reached"]) == reached - 1
    began, watch = time.monotonic(), Stopwatch()
    assert not line.receive(0.05)
    assert time.monotonic() - began >= 0.05
    assert watch.read_seconds() < 1.0


def test_a_full_queue_is_counted_and_hinders_nobody(ports: list[Port]) -> None:
    line = Exchange(ports[0], MARK)
    room = make_batch(16)
    load(room, make_frames(16, 5))
    got = 0
    for _ in range(2 * QUEUE // 16):  # the third participant never reads
        line.send(room, 16)
        got += len(ports[1].receive())
    assert got == ports[0].sent == 2 * QUEUE // 16 * 16
    assert ports[0].refused == got - len(ports[2].receive()) > 0


def test_can_fd_extended_and_remote_frames_are_not_heard(ports: list[Port]) -> None:
    line = Exchange(ports[0], MARK)
    name = ports[0].name.removeprefix("local:")
    with LocalChannel(name) as raw, can.Bus(name, interface="local") as bus:
        raw.send(FD.pack(0x100, 64, 4, bytes(64)))
        bus.send(can.Message(arbitration_id=0x1ABCDE, data=b"1"))
        bus.send(can.Message(arbitration_id=0x100, is_remote_frame=True, is_extended_id=False))
        bus.send(can.Message(arbitration_id=0x100, data=b"12", is_extended_id=False))
        time.sleep(0.05)
        line.receive(1.0)
    assert list_frames(line) == [Frame(0x100, b"12")]


def test_a_flood_is_taken_in_parts_even_of_senders_who_have_left(ports: list[Port]) -> None:
    line = Exchange(ports[0], MARK)
    flood = [Frame(k % 0x800, b"") for k in range(QUEUE - 100)]
    for _ in range(2):
        with open_bus(ports[0].name) as passing:
            for frame in flood:
                passing.send(frame)
    taken = 0
    while line.receive():
        assert line.count <= CAPACITY
        taken += line.count
        line.clear()
    assert taken == 2 * len(flood) > CAPACITY


def test_a_cycle_allocates_nothing_that_stays(ports: list[Port]) -> None:
    """Of Python's memory (tracemalloc), over cycles that receive and send."""
    line = Exchange(ports[0], MARK)
    room = make_batch(2)
    load(room, [Frame(0x80, bytes(6)), Frame(0x90, bytes(6))])

    def play(count: int) -> None:
        for _ in range(count):
            ports[1].send(Frame(MARK, bytes(8)))
            line.receive(1.0)
            line.send(room, 2)
            line.clear()
            ports[1].receive()
            ports[2].receive()

    # bytes: a byte a cycle would be a list that grows; counters that outgrow an object are allowed
    assert measure_growth(play, 100, 1000) < 1000
