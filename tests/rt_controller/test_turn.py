"""A turn on a real bus: the same answers as a node stepped by hand, the sample waited for, whoever comes and goes meanwhile."""

import signal
import threading
import time
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest

from plant_sim.node.plant_node import PlantNode
from plant_sim.profiles.profile import load_profile
from protocols.buses.bus import Port, open_bus
from protocols.buses.exchange import Exchange
from protocols.can.frames import Frame, load_frames
from protocols.can.reception import INTRUSION
from protocols.errors import InputError
from protocols.realtime.beat import TIMING, Beat
from protocols.realtime.clock import Clock
from protocols.realtime.mailbox import Asker, Mailbox
from protocols.realtime.ring import RingReader, RingWriter
from protocols.realtime.stopping import Stop
from rt_controller.law.phases import Fault
from rt_controller.loop.cycle_record import RECORD
from rt_controller.loop.node import COLUMNS, ControllerNode
from rt_controller.loop.samples import Samples
from rt_controller.loop.turn import Turn, choose_slot

FRAMES = load_frames()
PERIOD = 1_000_000  # ns
LATER = 0.05  # s after which another thread sends
LONG = 10_000_000_000  # ns: nobody waits for so long
PATIENCE = 5.0  # s
PATIENT_SLOT = (
    100_000_000  # ns: the thread of the plant was late by more than 20 ms beside a soak and two busy processes
)


@pytest.fixture
def plant(local_bus: str) -> Iterator[Port]:
    with open_bus(local_bus) as port:
        yield port


@pytest.fixture
def turn(local_bus: str, plant: Port) -> Iterator[Turn]:
    with open_bus(local_bus) as port:
        yield Turn(Samples(Exchange(port, FRAMES["ENCODER"].can_id), FRAMES), ControllerNode())


def simulate_samples(count: int) -> list[list[Frame]]:
    node = PlantNode(profile=load_profile("engagement", 3.0))
    return [node.step([]) for _ in range(count)]


def send(port: Port, frames: list[Frame]) -> None:
    for frame in frames:
        port.send(frame)


def wait_for_sample(turn: Turn, period: int, ago: float = 1.0) -> Clock:
    """A turn begun by a sample; the cycle before was `ago` periods [ns] before. Returns its clock."""
    beat = Beat(Clock(period))
    beat.clock.start(time.monotonic_ns() - round(ago * period) + period)
    missed = turn.answer_samples(beat, 0)
    assert (beat.clock.run, beat.clock.skipped) == (1, missed)
    return beat.clock


def test_answers_are_those_of_a_node_stepped_by_hand(turn: Turn, plant: Port) -> None:
    other = ControllerNode()
    for number, frames in enumerate(simulate_samples(200)):
        send(plant, frames)
        if number % 2:
            assert turn.answer(1)
        else:
            assert wait_for_sample(turn, LONG).skipped == 0
        assert plant.receive() == other.step(frames)
        assert turn.samples.line.count == 0
    port = turn.samples.line.port
    assert (port.received, port.sent) == (plant.sent, plant.received)


class Several:
    """Turns of `slot` [ns], `most` in a call at most, while another thread plays the plant; `rows` are what they leave."""

    def __init__(self, folder: Path, most: int, slot: int = 20_000_000) -> None:
        self.slot = slot
        self.mailbox = Mailbox(folder / "mailbox")
        ring = RingWriter(folder / "ring", [*COLUMNS, *TIMING], 64)
        self.rows = RingReader(folder / "ring")
        self.beat = Beat(Clock(self.slot), ring, self.mailbox)
        self.beat.most = most

    def begin(self, plant: Port, samples: list[list[Frame]]) -> threading.Thread:
        """One sample at the beginning of each slot; that of the clock is 5 ms behind."""
        start = time.monotonic_ns() + self.slot
        self.beat.clock.start(start + 5_000_000)

        def play() -> None:
            for number, frames in enumerate(samples):
                time.sleep(max(start + number * self.slot - time.monotonic_ns(), 0) / 1e9)
                send(plant, frames)

        thread = threading.Thread(target=play)
        thread.start()
        return thread


BEGUN_BY = {
    "clock": lambda turn, beat: turn.answer_slots(beat, 3),
    "pll": lambda turn, beat: turn.answer_slots(beat, 3, np.zeros(1)),
    "bus": lambda turn, beat: turn.answer_samples(beat, 3),
}


@pytest.mark.parametrize("begun_by", BEGUN_BY)
def test_several_turns_of_one_call_are_those_of_many(turn: Turn, plant: Port, tmp_path: Path, begun_by: str) -> None:
    """Their answers, rows and account; the last one's row is left to the caller."""
    samples, other, several = simulate_samples(8), ControllerNode(), Several(tmp_path, 8, PATIENT_SLOT)
    thread = several.begin(plant, samples)
    clock = several.beat.clock
    clock.deadline_ns -= several.slot // 4 * (begun_by == "bus")  # the sample before was there
    assert BEGUN_BY[begun_by](turn, several.beat) == 0
    thread.join()
    answers, rows = [], []
    for frames in samples:
        answers += other.step(frames)
        rows.append(other.make_row())
    assert plant.receive() == answers
    np.testing.assert_array_equal(several.rows.read()[:, : len(COLUMNS)], rows[:-1])
    assert turn.node.make_row() == rows[-1]
    assert (clock.run, clock.skipped, clock.slots) == (8, 0, 8)
    assert clock.work.total == 7
    port = turn.samples.line.port
    assert (port.received, port.sent) == (plant.sent, plant.received)


@pytest.mark.parametrize("begun_by", BEGUN_BY)
def test_a_request_ends_a_call(turn: Turn, plant: Port, tmp_path: Path, begun_by: str) -> None:
    """In the turn in which it comes; and with more turns to make it would wait for samples for ever."""
    several = Several(tmp_path, 1_000_000)
    thread = several.begin(plant, simulate_samples(8))
    asker = Asker(tmp_path / "mailbox")

    def ask() -> None:
        with pytest.raises(InputError, match="not answered"):
            asker.ask("{}", 0.0)

    asking = threading.Timer(3.6 * several.slot / 1e9, ask)
    asking.start()
    BEGUN_BY[begun_by](turn, several.beat)
    assert several.mailbox.has_request()
    assert several.beat.clock.run < 8
    asking.join()
    thread.join()


@pytest.fixture
def waking(local_bus: str, plant: Port) -> Iterator[Turn]:
    """A turn that sees signals, as the service's does."""
    before = signal.signal(signal.SIGALRM, lambda *_: None)
    with Stop() as stop, open_bus(local_bus) as port:
        yield Turn(Samples(Exchange(port, FRAMES["ENCODER"].can_id, stop.wakes), FRAMES), ControllerNode())
    signal.signal(signal.SIGALRM, before)


@pytest.mark.parametrize("begun_by", BEGUN_BY)
def test_a_signal_ends_a_call(waking: Turn, tmp_path: Path, begun_by: str) -> None:
    several = Several(tmp_path, 1_000_000)
    signal.setitimer(signal.ITIMER_REAL, 0.11)  # half a period from every slot
    several.beat.clock.start(time.monotonic_ns())
    BEGUN_BY[begun_by](waking, several.beat)
    assert 3 <= several.beat.clock.slots < 50


@pytest.mark.parametrize("begun_by", BEGUN_BY)
def test_a_signal_outside_of_a_sleep_ends_one_call(waking: Turn, tmp_path: Path, begun_by: str) -> None:
    several = Several(tmp_path, 3)
    several.beat.clock.start(time.monotonic_ns())
    signal.raise_signal(signal.SIGALRM)
    for run in 1, 4, 7:
        BEGUN_BY[begun_by](waking, several.beat)
        assert several.beat.clock.run == run


def test_in_step_it_answers_and_waits_for_the_next_sample(turn: Turn, plant: Port, tmp_path: Path) -> None:
    """The second comes while it waits, the third does not: the row of its answer is written, as those before."""
    samples, other, several = simulate_samples(3), ControllerNode(), Several(tmp_path, 10)
    answers, rows = [], []
    for frames in samples:
        answers += other.step(frames)
        rows.append(other.make_row())
    send(plant, samples[0])
    threading.Timer(LATER / 5, send, (plant, samples[1])).start()
    assert turn.answer_in_step(several.beat, 3) == (True, False)
    np.testing.assert_array_equal(several.rows.read()[:, : len(COLUMNS)], rows[:2])
    send(plant, samples[2])
    assert turn.samples.wait_for_next(PATIENCE)
    several.beat.most = 1
    assert turn.answer_in_step(several.beat, 3) == (False, False)
    assert turn.node.make_row() == rows[2]
    assert plant.receive() == answers
    port = turn.samples.line.port
    assert (port.received, port.sent, turn.samples.line.count) == (plant.sent, plant.received, 0)


def test_it_waits_for_the_sample_and_says_when_it_woke(turn: Turn, plant: Port) -> None:
    frames = simulate_samples(1)[0]
    before = time.monotonic_ns()
    late = threading.Timer(LATER, send, (plant, frames))
    late.start()
    clock = wait_for_sample(turn, LONG)
    late.join()
    assert clock.woken_ns - before > 0.9 * LATER * 1e9
    assert clock.deadline_ns == pytest.approx(turn.samples.find_arrival_ns(), abs=1e6)  # ns of another clock
    assert 0 <= clock.lateness_ns == clock.woken_ns - clock.deadline_ns
    assert plant.receive() == ControllerNode().step(frames)


def test_a_slot_without_its_sample_has_its_cycle_half_a_period_later(turn: Turn, plant: Port) -> None:
    """With what has come of it; the grid goes on."""
    other, slot, (first, second) = ControllerNode(), 40_000_000, simulate_samples(2)
    send(plant, first[:-1])  # all but the encoder's, which completes it
    start = time.monotonic_ns()
    clock = wait_for_sample(turn, slot, ago=0.0)
    assert clock.woken_ns >= start + 1.5 * slot
    assert 0 <= clock.deadline_ns - start - (1 + clock.skipped) * slot < clock.woken_ns - start - slot
    assert plant.receive() == other.step(first[:-1], slots=1 + clock.skipped)
    send(plant, [first[-1], *second])
    assert wait_for_sample(turn, LONG).skipped == 0
    assert plant.receive() == other.step([first[-1], *second])


def test_a_sample_of_the_slot_before_is_left_to_the_next_cycle(turn: Turn, plant: Port) -> None:
    first, second = simulate_samples(2)
    send(plant, first)
    next_one = threading.Timer(0.16, send, (plant, second))
    next_one.start()
    clock = wait_for_sample(turn, 200_000_000, ago=0.0)
    next_one.join()
    assert plant.receive() == ControllerNode().step(first + second, slots=1 + clock.skipped)


def test_who_comes_while_it_waits_is_let_in_and_told(turn: Turn, plant: Port, local_bus: str) -> None:
    frames = simulate_samples(1)[0]
    with open_bus(local_bus) as newcomer:
        late = threading.Timer(LATER, send, (plant, frames))
        late.start()
        assert wait_for_sample(turn, LONG).skipped == 0
        late.join()
        answers = plant.receive()
        assert answers == ControllerNode().step(frames)
        assert newcomer.receive() == frames + answers


def test_what_a_newcomer_sent_before_it_was_let_in_is_heard_in_the_next_turn(
    turn: Turn, plant: Port, local_bus: str
) -> None:
    turn.answer(1)
    plant.receive()
    with open_bus(local_bus) as newcomer:
        newcomer.send(Frame(FRAMES["TORQUE_SETPOINT"].can_id, FRAMES["TORQUE_SETPOINT"].pack(0, 1, 5.0, 10.0, 0.0)))
        turn.answer(1)  # finds it there, when the frames of this turn have been taken
        turn.answer(1)
        assert turn.node.count_receptions()["TORQUE_SETPOINT"]["received"] == 1
        assert turn.node.states["demand"][0] == 5.0


def test_who_leaves_takes_nobody_along(local_bus: str) -> None:
    """Seen to have left, by the turn that also fails to send to him: whoever is in his place by then stays."""
    leaver = open_bus(local_bus)  # he came first
    with open_bus(local_bus) as plant, open_bus(local_bus) as port:
        turn = Turn(Samples(Exchange(port, FRAMES["ENCODER"].can_id), FRAMES), ControllerNode())
        other = ControllerNode()
        for number, frames in enumerate(simulate_samples(6)):
            if number == 3:
                leaver.close()
            send(plant, frames)
            assert turn.answer(1)
            assert plant.receive() == other.step(frames)


def test_a_second_controller_is_a_fault_and_the_controller_goes_on(turn: Turn, plant: Port) -> None:
    valve = FRAMES["VALVE_COMMAND"]
    for data in (bytes(8), bytes(5), *(valve.pack(n, 1, 2.0, n) for n in range(INTRUSION - 1))):
        plant.send(Frame(valve.can_id, data))
    turn.answer(1)
    plant.receive()
    plant.send(Frame(valve.can_id, valve.pack(INTRUSION - 1, 1, 2.0, 0)))
    turn.answer(1)
    assert turn.node.first_rejected == "a second controller is on the bus: it sends VALVE_COMMAND (0x080)"
    assert turn.node.record.view(RECORD)[0]["fault"] == Fault.SECOND_SENDER
    (valve_sent,) = [data for can_id, data in plant.receive() if can_id == valve.can_id]
    assert valve.unpack(valve_sent).valve_enable == 0


@pytest.mark.parametrize(
    ("arrived", "now", "slots"),
    [(1.0, 1.0, 1), (0.6, 0.6, 1), (0.4, 0.4, 0), (0.4, 0.6, 1), (1.4, 1.5, 1), (1.6, 1.7, 2), (7.1, 7.1, 7)],
)
def test_slots_since_the_last_cycle(arrived: float, now: float, slots: int) -> None:
    """By the sample's arrival, whatever was to be waited for."""
    came, at = (100 * PERIOD + round(ago * PERIOD) for ago in (arrived, now))
    for patience in 0, at, 10 * at:
        assert choose_slot(100 * PERIOD, PERIOD, came, at, patience, False) == (slots, came, patience)


@pytest.mark.parametrize(
    ("now", "slots", "patience"),
    [(1.4, 0, 1.5), (1.5, 1, 1.5), (1.9, 1, 1.5), (2.0, 0, 2.5), (8.3, 0, 8.8)],
)
def test_without_a_sample_a_slot_begins_in_its_time_or_is_waited_for_anew(
    now: float, slots: int, patience: float
) -> None:
    result = choose_slot(0, PERIOD, 0, round(now * PERIOD), round(1.5 * PERIOD), False)
    assert result == (slots, slots * PERIOD, round(patience * PERIOD))


@pytest.mark.parametrize("late", [0.0, 0.7])  # periods; the second would be waited for anew, and so on for ever
def test_who_has_waited_anew_leaves_slots_out(late: float) -> None:
    patience, at = round(8.8 * PERIOD), round((8.8 + late) * PERIOD)
    assert choose_slot(0, PERIOD, 0, at, patience, True) == (round(8.3 + late), round(8.3 + late) * PERIOD, patience)
