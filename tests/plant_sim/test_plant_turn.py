"""The plant's turn, one compiled call, on a bus: the frames and records of its parts, which are left what it does not do."""

import threading
import time
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest

from plant_sim.node.injection import Injection, switch_on
from plant_sim.node.plant_cycle import Actuators
from plant_sim.node.plant_node import PlantNode
from plant_sim.node.power_shift_node import PowerShiftNode
from plant_sim.profiles.profile import load_profile
from plant_sim.rigs import wet_clutch
from protocols.buses.bus import Port, open_bus
from protocols.buses.exchange import Exchange
from protocols.can.frame_batch import load, make_batch
from protocols.can.frames import Frame, load_frames
from protocols.can.lifecycle import Lifecycle
from protocols.can.reception import INTRUSION
from protocols.node import load_node
from protocols.realtime.beat import TIMING, Beat
from protocols.realtime.clock import Clock
from protocols.realtime.ring import RingReader, RingWriter
from tests.memory import measure_growth

FRAMES = load_frames()
SECONDS = 3.0
PERIOD = 3_600_000_000_000  # ns: slots begin when the test says so, and none is over before
LEVEL = "friction_level.level"


@pytest.fixture
def controller(local_bus: str) -> Iterator[Port]:
    with open_bus(local_bus) as port:
        yield port


@pytest.fixture
def line(local_bus: str, controller: Port) -> Iterator[Exchange]:
    with open_bus(local_bus) as port:
        yield Exchange(port, FRAMES["VALVE_COMMAND"].can_id)


def make_plant(effect: str | None = None, **more: object) -> PlantNode:
    parameters = wet_clutch.load_nominal().with_values(switch_on(effect) if effect else {})
    return PlantNode(parameters=parameters, profile=load_profile("engagement", SECONDS), seed=5, **more)  # type: ignore[arg-type]


@pytest.fixture
def beat() -> Beat:
    return Beat(Clock(PERIOD))


def play_turn(node: PlantNode, line: Exchange, beat: Beat) -> None:
    """A turn in a slot that has just begun."""
    assert node.steady
    beat.clock.deadline_ns = time.monotonic_ns() - PERIOD
    assert node.run_real_time(line, beat, 0, 0) == 0


def play_parts(node: PlantNode, commands: list[Frame], owed: int = 0) -> list[Frame]:
    """Frames of the next sample, made by the parts of a turn; `owed` slots were missed before it."""
    node.advance()
    node.receive(commands)
    node.skip_periods(owed)
    return node.sample()


@pytest.mark.parametrize("effect", [None, "pressure_sensor_gain", "channel_skew"])
def test_a_turn_is_its_parts(line: Exchange, controller: Port, beat: Beat, effect: str | None) -> None:
    whole, other, answering = make_plant(effect), make_plant(effect), load_node("controller")()
    assert not whole.steady  # there is no period before the first sample
    frames = whole.sample()
    assert frames == other.sample()
    for _ in range(round(1000 * SECONDS)):
        commands = answering.step(frames)
        for frame in commands:
            controller.send(frame)
        play_turn(whole, line, beat)
        frames = controller.receive()
        assert frames == play_parts(other, commands)
        assert whole.make_row() == other.make_row()
    assert whole.make_row()[1] > 0.5  # V: the clutch is engaged
    assert whole.count_receptions() == other.count_receptions()
    assert (line.port.received, line.port.sent) == (controller.sent, controller.received)


def catch_up(node: PlantNode, commands: list[Frame], missed: int) -> tuple[list[Frame], list[tuple[float, ...]]]:
    """Frames and rows of `missed` samples and one, made by the parts of a turn."""
    node.advance()
    node.receive(commands)
    node.skip_periods(missed)
    frames, rows = node.sample(), [node.make_row()]
    for _ in range(missed):
        node.advance()
        frames += node.sample()
        rows.append(node.make_row())
    return frames, rows


def make_valve_frame(count: int, volts: float, tick: int | None = None) -> Frame:
    """A command that answers the sample `tick`, which is `count` if not given."""
    codec = FRAMES["VALVE_COMMAND"]
    return Frame(codec.can_id, codec.pack(count, 1, volts, count if tick is None else tick))


def test_samples_of_slots_slept_through_come_first(line: Exchange, controller: Port, beat: Beat) -> None:
    """One a call: the commands are taken before the first of them, and age by one at most."""
    whole, other = make_plant(), make_plant()
    whole.sample()
    other.sample()
    for number in range(1, 30):
        command = make_valve_frame(number, 2.0, whole.tick)
        controller.send(command)
        missed = number % 8  # up to 7, after 5 cycles without a command a valve closes
        beat.clock.deadline_ns = time.monotonic_ns() - (1 + missed) * PERIOD
        frames, rows = catch_up(other, [command], missed)
        for left in range(missed, -1, -1):
            assert whole.run_real_time(line, beat, 0, 0 if left == missed else left + 1) == left
            assert whole.make_row() == rows[missed - left]
        assert controller.receive() == frames
        assert whole.make_row()[1] == pytest.approx(2.0, abs=0.01)
    assert (beat.clock.run, beat.clock.skipped) == (29, sum(number % 8 for number in range(1, 30)))
    assert whole.count_receptions() == other.count_receptions()


def test_samples_of_slots_slept_through_are_rows_of_one_cycle(line: Exchange, controller: Port, tmp_path: Path) -> None:
    whole, other = make_plant(), make_plant()
    ring = RingWriter(tmp_path / "ring", [*whole.columns, *TIMING], 64)
    reader, beat = RingReader(tmp_path / "ring"), Beat(Clock(PERIOD), ring)
    whole.sample()
    other.sample()
    controller.send(make_valve_frame(1, 2.0))
    beat.clock.deadline_ns, beat.most = time.monotonic_ns() - 5 * PERIOD, 5
    assert whole.run_real_time(line, beat, 3, 0) == 0
    frames, rows = catch_up(other, [make_valve_frame(1, 2.0)], 4)
    assert controller.receive() == frames
    result = reader.read()
    np.testing.assert_array_equal(result[:, : len(whole.columns)], rows[:-1])
    assert len({tuple(row) for row in result[:, len(whole.columns) :].tolist()}) == 1
    assert whole.make_row() == rows[-1]
    assert (beat.clock.run, beat.clock.skipped, beat.clock.work.total) == (1, 4, 0)
    assert (line.port.received, line.port.sent) == (1, len(frames))


def test_who_does_not_read_ends_no_call(line: Exchange, controller: Port, local_bus: str, tmp_path: Path) -> None:
    """A viewer that is stopped: what its queue has no room for is counted, and costs the loop nothing."""
    node = make_plant()
    ring = RingWriter(tmp_path / "ring", [*node.columns, *TIMING], 64)
    beat = Beat(Clock(PERIOD), ring)
    frames = len(node.sample())
    with open_bus(local_bus):
        while not line.port.refused:
            line.send(node.outbox, frames)
            controller.receive()
        refused, sent = line.port.refused, line.port.sent
        beat.clock.deadline_ns, beat.most = time.monotonic_ns() - 5 * PERIOD, 5
        assert node.run_real_time(line, beat, 0, 0) == 0
        assert ring.row_count == 4  # all but the last in compiled code
        heard = controller.receive()
        assert line.port.sent - sent == line.port.refused - refused == len(heard) > 5 * 2


def test_when_it_has_caught_up_it_waits_for_an_answer(line: Exchange, controller: Port, tmp_path: Path) -> None:
    """Which may need this CPU; and is taken with the next sample. None is waited for beyond half a period."""
    node, period = make_plant(), 100_000_000
    ring = RingWriter(tmp_path / "ring", [*node.columns, *TIMING], 64)
    beat = Beat(Clock(period), ring)
    node.sample()
    for number in 1, 2:
        answer = threading.Timer(0.02, controller.send, [make_valve_frame(number, 2.0)])
        beat.clock.deadline_ns, beat.most = time.monotonic_ns() - 3 * period - period // 10, 4
        before = beat.clock.skipped
        if number == 1:
            answer.start()
        assert node.run_real_time(line, beat, 0, 0) == 0
        assert beat.clock.skipped - before >= 2
        assert node.count_receptions()["VALVE_COMMAND"]["received"] == 1
    assert line.count == 0


def test_in_step_a_sample_is_its_parts_and_waits_for_its_answer(
    line: Exchange, controller: Port, tmp_path: Path
) -> None:
    """The first one's is there, the second one's does not come: its row is written before it is waited for."""
    whole, other = make_plant(), make_plant()
    ring = RingWriter(tmp_path / "ring", [*whole.columns, *TIMING], 64)
    reader, beat = RingReader(tmp_path / "ring"), Beat(Clock(PERIOD), ring)
    beat.most = 10
    for node in whole, other:
        node.sample()
        node.advance()
    controller.send(make_valve_frame(1, 2.0))
    frames, rows = [], []
    for number in 1, 2:
        frames += other.sample()
        rows.append(other.make_row())
        other.advance()
        if number == 1:
            other.receive([make_valve_frame(1, 2.0)])
    assert whole.run_lockstep(line, beat, 3)
    assert (whole.tick, whole.answered_tick, line.count) == (2, 1, 0)
    assert controller.receive() == frames
    np.testing.assert_array_equal(reader.read()[:, : len(whole.columns)], rows)
    assert (line.port.received, line.port.sent) == (1, len(frames))
    beat.most = 1
    assert not whole.run_lockstep(line, beat, 3)
    assert controller.receive() == other.sample()
    assert whole.make_row() == other.make_row()
    assert reader.read().size == 0
    assert whole.count_receptions() == other.count_receptions()


def test_in_step_heartbeats_are_no_answer(line: Exchange, controller: Port, tmp_path: Path) -> None:
    """Of a controller that was started anew: a call that waits on for as long as they come would never see a signal."""
    node, codec, sentence, beats = make_plant(), FRAMES["CONTROLLER_HEARTBEAT"], threading.Event(), []
    beat = Beat(Clock(PERIOD), RingWriter(tmp_path / "ring", [*node.columns, *TIMING], 64))
    beat.most = 10
    node.sample()

    def say() -> None:
        beats.append(len(beats))
        controller.send(Frame(codec.can_id, codec.pack(len(beats), Lifecycle.ACTIVE, 0, 1000, 7)))

    def go_on() -> None:
        while len(beats) < 200 and not sentence.wait(0.02):
            say()

    say()
    talker = threading.Thread(target=go_on)
    talker.start()
    written = node.run_lockstep(line, beat, 0)
    sentence.set()
    talker.join()
    assert written
    assert len(beats) < 200
    assert node.count_receptions()["CONTROLLER_HEARTBEAT"]["received"] >= 1


def send_as_a_plant(port: Port) -> None:
    for count in range(INTRUSION):
        port.send(Frame(FRAMES["ENCODER"].can_id, FRAMES["ENCODER"].pack_raw(count, 0, count)))


def test_in_step_a_second_plant_closes_the_valve(line: Exchange, controller: Port, tmp_path: Path) -> None:
    node = make_plant()
    beat = Beat(Clock(PERIOD), RingWriter(tmp_path / "ring", [*node.columns, *TIMING], 64))
    beat.most = 2
    node.sample()
    send_as_a_plant(controller)
    node.run_lockstep(line, beat, 0)
    node.take(line.inbox, line.count)
    assert node.first_rejected == "a second plant is on the bus: it sends ENCODER (0x101)"


def test_where_parameters_change_a_plant_is_not_steady(line: Exchange, beat: Beat) -> None:
    """A step at 10 ms, a ramp from 20 to 25 ms, a change made between two samples."""
    begun = [Injection({LEVEL: 0.9}, at=0.010), Injection({LEVEL: 0.8}, at=0.020, ramp=0.005)]
    whole, other = make_plant(injections=begun), make_plant(injections=begun)
    whole.sample()
    other.sample()
    not_turned = []
    for tick in range(1, 50):
        if tick == 30:
            whole.inject(Injection({LEVEL: 1.1}, at=0.040))
            other.inject(Injection({LEVEL: 1.1}, at=0.040))
        if whole.steady:
            play_turn(whole, line, beat)
        else:
            not_turned.append(tick)
            play_parts(whole, [])
        play_parts(other, [])
        assert (whole.tick, whole.make_row()) == (tick, other.make_row())
    assert not_turned == [10, *range(20, 26), 40]  # at 30 the rig that was prepared stays
    assert whole.injected_changes == other.injected_changes
    assert [change["new"] for change in whole.injected_changes] == [0.9, 0.8, 1.1]


def test_a_rig_of_two_clutches_is_left_to_its_parts() -> None:
    node = PowerShiftNode()
    node.sample()
    assert not node.steady


def test_a_second_plant_closes_the_valve_and_the_plant_goes_on(line: Exchange, controller: Port, beat: Beat) -> None:
    node = make_plant()
    node.sample()
    send_as_a_plant(controller)
    controller.send(Frame(FRAMES["VALVE_COMMAND"].can_id, FRAMES["VALVE_COMMAND"].pack(0, 1, 2.0, 0)))
    play_turn(node, line, beat)
    assert node.first_rejected == "a second plant is on the bus: it sends ENCODER (0x101)"
    actuators = [column.name for column in node.columns].index("actuators")
    assert node.make_row()[actuators] == Actuators.TWO_SENDERS
    assert len(controller.receive()) >= 2


def test_who_comes_is_let_in_and_told(line: Exchange, beat: Beat, local_bus: str) -> None:
    node = make_plant()
    node.sample()
    play_turn(node, line, beat)
    with open_bus(local_bus) as newcomer:
        for _ in range(10):  # at most one more turn: it stands at the door when the second begins
            play_turn(node, line, beat)
        assert len([frame for frame in newcomer.receive() if frame.can_id == FRAMES["ENCODER"].can_id]) >= 9


def test_who_leaves_takes_nobody_along(local_bus: str, beat: Beat) -> None:
    """Seen to have left, by the turn that also fails to send to him: whoever is in his place by then stays."""
    leaver = open_bus(local_bus)  # he came first
    with open_bus(local_bus) as controller, open_bus(local_bus) as port:
        node, line = make_plant(), Exchange(port, FRAMES["VALVE_COMMAND"].can_id)
        node.sample()
        for number in range(6):
            if number == 3:
                leaver.close()
            play_turn(node, line, beat)
            heard = [frame.can_id for frame in controller.receive()]
            assert FRAMES["ENCODER"].can_id in heard, number


def test_a_turn_keeps_no_memory(line: Exchange, controller: Port, beat: Beat) -> None:
    node, answers, commands = make_plant(), Exchange(controller, 0), make_batch(1)
    valve = FRAMES["VALVE_COMMAND"]
    load(commands, [Frame(valve.can_id, valve.pack(1, 1, 1.0, 1))])
    node.sample()

    def play(count: int) -> None:
        for _ in range(count):
            answers.send(commands, 1)
            play_turn(node, line, beat)
            answers.receive()
            answers.clear()

    assert measure_growth(play, 300, 1400) < 1000  # bytes in 1400 turns: an object that a turn kept would be 28 each
