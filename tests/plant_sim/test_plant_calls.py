"""Many turns of the plant in one compiled call are those of as many calls: frames, rows and account."""

import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any, cast

import numpy as np
import pytest

from plant_sim.node.injection import Injection
from plant_sim.node.plant_node import RIG, PlantNode
from plant_sim.node.plant_service import PlantService
from plant_sim.profiles.profile import load_profile
from protocols.buses.bus import Port, open_bus
from protocols.buses.exchange import Exchange
from protocols.can.frames import Frame
from protocols.realtime.beat import TIMING, Beat
from protocols.realtime.clock import Clock
from protocols.realtime.ring import RingReader, RingWriter
from tests.plant_sim.test_plant_turn import FRAMES, LEVEL, make_valve_frame, play_parts

TIMES = [column.name for column in TIMING]


class Until:
    """A stop from the tick `last` on, once no sample of a missed slot is owed.

    `ends` are the ticks after each call, `whole` those of them at which nothing was owed; `heard` is what has come on `port`.
    """

    def __init__(self, node: PlantNode, clock: Clock, port: Port, last: int) -> None:
        self.node, self.clock, self.port, self.last = node, clock, port, last
        self.ends, self.whole, self.heard = list[int](), list[int](), list[Frame]()

    @property
    def asked(self) -> bool:
        self.ends.append(self.node.tick)
        self.heard += self.port.receive()
        if self.clock.slots != self.node.tick:
            return False
        self.whole.append(self.node.tick)
        return self.node.tick >= self.last


class Book:
    """An outlet that nobody asks anything."""

    changes, most = 7, 8

    def __init__(self, node: PlantNode, folder: Path) -> None:
        self.ring = RingWriter(folder / "ring", [*node.columns, *TIMING], 4096)

    def make_beat(self, clock: Clock) -> Beat:
        beat = Beat(clock, self.ring)
        beat.most = self.most
        return beat

    def write(self, row: np.ndarray, *timing: float) -> None:
        self.ring.write(row, [*timing, self.changes])

    def has_change(self) -> bool:
        return False

    def tune(self) -> None:
        """Nothing changes."""


@pytest.fixture
def controller(local_bus: str) -> Iterator[Port]:
    with open_bus(local_bus) as port:
        yield port


def test_turns_of_one_call_are_those_of_many(controller: Port, local_bus: str, tmp_path: Path) -> None:
    """A command before the first, a step at 40 ms, an end at 1.1 s: frames, rows and account.

    On a busy machine slots are missed. The samples of these are made after a wake-up, without a look at the bus, and the age
    of the commands does not count them. Rows made at one wake-up have one time: the parts are played in the same groups.
    """
    with open_bus(local_bus) as port:
        line = Exchange(port, FRAMES["VALVE_COMMAND"].can_id)
        motor = FRAMES["MOTOR_COMMAND"]
        command = Frame(motor.can_id, motor.pack(1, 1, 30.0, 20.0))
        begun = [Injection({LEVEL: 0.9}, at=0.040)]
        PlantNode.warm()
        whole, other = (PlantNode(profile=load_profile("engagement", 1.1), seed=5, injections=begun) for _ in range(2))
        clock, outlet = Clock(2_000_000), Book(whole, tmp_path)
        until = Until(whole, clock, controller, 1110)
        rows = RingReader(tmp_path / "ring")
        whole.sample()
        other.sample()
        controller.send(command)
        service: Any = PlantService("", 1000, RIG)
        timing = service._run_in_real_time(whole, line, outlet, outlet.make_beat(clock), until)
        result = rows.read()
        _, sizes = np.unique(result[:, len(whole.columns) + TIMES.index("clock_s")], return_counts=True)
        frames = []
        for group, size in enumerate(sizes):
            frames += play_parts(other, [command] * (group == 0), owed=int(size) - 1)
            for _ in range(size - 1):
                other.advance()
                frames += other.sample()
        heard, counts = until.heard, FRAMES["PLANT_STATUS"].can_id  # of late cycles, too: the host's matter
        assert [frame for frame in heard if frame.can_id != counts] == [
            frame for frame in frames if frame.can_id != counts
        ]
        assert whole.make_row() == other.make_row()
        assert len(result) == clock.slots == clock.run + clock.skipped == whole.tick
        np.testing.assert_array_equal(result[:, 0], np.arange(1, len(result) + 1) * 1e-3)
        assert set(result[:, -1]) == {7.0}
        assert {39, 1099} <= set(until.ends)  # where somebody has to look
        assert np.median(np.diff(until.ends)) == 8
        assert timing["slots"] == min(tick for tick in until.whole if tick >= 1099)
        assert (line.port.received, line.port.sent) == (1, len(frames))


class BehindTwice:
    """A stop that sets the clock: three slots are over at the first sample, one at the next that waits; then it asks."""

    def __init__(self, clock: Clock) -> None:
        self.clock, self.looks = clock, 0

    @property
    def asked(self) -> bool:
        self.looks += 1
        if self.looks in (1, 4):
            missed = 2 if self.looks == 1 else 0
            self.clock.deadline_ns = time.monotonic_ns() - (1 + missed) * self.clock.period_ns
        return self.looks > 4


def test_what_a_newcomer_sent_is_taken_after_the_samples_that_are_owed(local_bus: str, tmp_path: Path) -> None:
    """He is admitted after the first of them. They take no frames, and a compiled call for them lost his."""
    with open_bus(local_bus) as port:
        line = Exchange(port, FRAMES["VALVE_COMMAND"].can_id)
        node = PlantNode(profile=load_profile("engagement", 1.1), seed=5)
        node.sample()
        clock, outlet, service = Clock(3_600_000_000_000), Book(node, tmp_path), cast(Any, PlantService("", 1000, RIG))
        with open_bus(local_bus) as newcomer:
            newcomer.send(make_valve_frame(1, 2.0))
            outlet.most = 1
            service._run_in_real_time(node, line, outlet, outlet.make_beat(clock), BehindTwice(clock))
        assert (clock.run, clock.skipped, node.tick) == (2, 2, 4)
        assert node.count_receptions()["VALVE_COMMAND"]["received"] == port.received == 1
