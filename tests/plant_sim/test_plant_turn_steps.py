"""Steps of a plant's turn: what is received, advanced, shown, sent and written, in which order. Each test has the module as
argument, so that it can run on mutants (tests/mutation). It is the source of plant_turn.py without compilation: bus, clock, rig
and interface are made up."""

from types import ModuleType, SimpleNamespace
from typing import Any

import numpy as np
import pytest

import plant_sim.node.plant_turn
from tests.mutation.mutants import load_mutant, parse_plain

TARGETS = 256  # positions a frame
PERIOD = 1000  # ns
MASK = 0x3FF  # of the tick in a valve command


@pytest.fixture
def plant_turn() -> ModuleType:
    return load_mutant(parse_plain(plant_sim.node.plant_turn))


class PlantTurns:
    """Memory of a plant's turns, and made-up functions around them. `log` has their calls; the lists are what they return."""

    def __init__(self, module: ModuleType, answered: int = -1) -> None:
        self.module, self.log = module, list[tuple[Any, ...]]()
        self.waits, self.counts, self.whys = list[int](), list[int](), list[int]()
        self.called, self.settled = list[bool](), list[bool]()
        self.answers = list[int]()  # the tick that the commands answer, of each call to take
        self.line = SimpleNamespace(changed=False, time="time", taken=100)
        self.clock = SimpleNamespace(late=3, period=PERIOD, woken=0)
        self.clutch = SimpleNamespace(answered_tick=answered, voltage="voltage")
        interface = SimpleNamespace(clutches=[self.clutch], speed_demand="speed", torque_limit="limit")
        answer = SimpleNamespace(sample_tick=SimpleNamespace(mask=MASK))
        settings = SimpleNamespace(clutches=[SimpleNamespace(valve_command=answer)])
        self.plant = module.PlantMemory(
            [interface], [settings], "setpoints", np.array([1.0]), np.array([2.0, 3.0]), "parameters", "effects", 4.0, 5.0,
            0.25, 6, "outbox", "row",
        )  # fmt: skip
        self.beats = ([self.clock], "spins", "rows", "counts", "numbers", "pings")
        for name in (
            "gather", "gather_marked", "read_clock", "send_to_all", "is_called", "is_settled", "wait", "write", "record_cycle",
            "begin", "show", "take", "skip_periods", "note_sample",
        ):  # fmt: skip
            setattr(module, name, getattr(self, f"_{name}"))
        module.wet_clutch = SimpleNamespace(advance=self._advance)  # type: ignore[attr-defined]

    def _gather(self, lines: Any, timeout: int, inbox: str, first: int, count: int) -> int:
        self.log.append(("gather", timeout, first, count))
        return self.counts.pop(0) if self.counts else count

    def _gather_marked(self, lines: Any, timeout: int, inbox: str, first: int, count: int) -> int:
        self.log.append(("gather_marked", timeout, first, count))
        return self.counts.pop(0) if self.counts else count

    def _read_clock(self, clock: int, times: str) -> int:
        assert (clock, times) == (self.module.CLOCK_MONOTONIC, "time")
        return 10_000 + len(self.log)

    def _send_to_all(self, lines: Any, position: int, frames: str, count: int) -> int:
        assert frames == "outbox"
        self.log.append(("send", position, count))
        return TARGETS * count

    def _is_called(self, line: Any, beat: Any) -> bool:
        assert line is self.line
        return self.called.pop(0) if self.called else False

    def _is_settled(self, line: Any, first: int, count: int, sent: int, position: int) -> bool:
        self.log.append(("settled", first, count, sent, position))
        return self.settled.pop(0) if self.settled else True

    def _wait(self, beat: Any) -> int:
        self.log.append(("wait",))
        return self.waits.pop(0)

    def _write(self, beat: Any, row: str, changes: int) -> None:
        self.log.append(("write", row, changes, self.clock.woken))

    def _record_cycle(self, beat: Any, row: str, changes: int) -> None:
        self.log.append(("record", row, changes))

    def _begin(self, interfaces: Any, settings: Any, tick: int, late: int, setpoints: str, outbox: str) -> int:
        assert (interfaces, settings) == self.plant[:2]
        assert (setpoints, outbox) == ("setpoints", "outbox")
        self.log.append(("begin", tick, late))
        return 1

    def _show(self, interfaces: Any, settings: Any, clutch: int, tick: int, rig: Any, states: Any, *more: Any) -> int:
        assert (interfaces, settings) == self.plant[:2]
        assert more == ("parameters", "effects", "outbox", 1)  # behind the frame of `begin`
        self.log.append(("show", clutch, tick, float(rig[0]), states.tolist()))
        return 3

    def _take(self, interfaces: Any, settings: Any, inbox: str, count: int) -> int:
        assert (interfaces, settings, inbox) == (*self.plant[:2], "inbox")
        self.log.append(("take", count))
        if self.answers:
            self.clutch.answered_tick = self.answers.pop(0)
        return self.whys.pop(0) if self.whys else 0

    def _skip_periods(self, interfaces: Any, settings: Any, periods: int) -> None:
        assert (interfaces, settings) == self.plant[:2]
        self.log.append(("skip", periods))

    def _note_sample(self, row: str, time: float, interfaces: Any, rig: Any, *pressures: float) -> None:
        assert (row, interfaces) == ("row", self.plant.interfaces)
        assert rig is self.plant.rig_state
        assert pressures == (4.0, 5.0)
        self.log.append(("note", time))

    def _advance(self, rig: Any, states: Any, *inputs: Any) -> tuple[np.ndarray, np.ndarray]:
        assert inputs == ("voltage", "speed", "limit", "parameters", "effects", 0.25, 6)
        self.log.append(("advance",))
        return rig + 1.0, states + 1.0

    def run_real_time(self, tick: int, most: int, count: int = 0, owed: int = 0) -> tuple[int, ...]:
        done: tuple[int, ...] = self.module.run_real_time(
            self.beats, [self.line], "inbox", count, tuple(self.plant), tick, most, 7, owed
        )
        return done

    def run_lockstep(self, tick: int, most: int) -> tuple[int, ...]:
        done: tuple[int, ...] = self.module.run_lockstep(
            self.beats, [self.line], "inbox", tuple(self.plant), tick, most, 7
        )
        return done

    def list_calls(self, *names: str) -> list[tuple[Any, ...]]:
        return [call for call in self.log if call[0] in names]


def sample(tick: int, rig: float, states: list[float]) -> list[tuple[Any, ...]]:
    """Calls that make and send a sample of the rig in this state."""
    return [("begin", tick, 3), ("show", 0, tick, rig, states), ("note", tick * 0.25), ("send", 0, 3)]


# --- the rig ---------------------------------------------------------------------------------------------------------


def test_a_rig_moves_in_its_place(plant_turn: ModuleType) -> None:
    turns = PlantTurns(plant_turn)
    rig, states = turns.plant.rig_state, turns.plant.states
    plant_turn.move(turns.plant.interfaces, rig, states, "parameters", "effects", 0.25, 6)
    assert (rig.tolist(), states.tolist()) == ([2.0], [3.0, 4.0])


# --- in real time ----------------------------------------------------------------------------------------------------


def test_a_turn_waits_advances_takes_and_shows(plant_turn: ModuleType) -> None:
    turns = PlantTurns(plant_turn)
    turns.waits, turns.counts = [0], [9]
    assert turns.run_real_time(tick=5, most=1, count=4) == (1, 0, 9, 3, 3 * TARGETS)
    assert turns.log == [
        ("wait",), ("advance",), ("gather", 0, 4, 4), ("take", 9), ("skip", 0), *sample(5, 2.0, [3.0, 4.0]),
    ]  # fmt: skip


def test_turns_of_one_call_are_recorded_but_the_last(plant_turn: ModuleType) -> None:
    turns = PlantTurns(plant_turn)
    turns.waits, turns.counts = [0, 0, 0], [6, 2, 1]
    assert turns.run_real_time(tick=5, most=3, count=4) == (3, 0, 1, 3, 3 * TARGETS)
    assert turns.list_calls("gather", "settled") == [
        ("gather", 0, 4, 4), ("settled", 4, 6, 3, 3 * TARGETS), ("gather", 0, 0, 0), ("settled", 0, 2, 3, 3 * TARGETS),
        ("gather", 0, 0, 0),
    ]  # fmt: skip
    assert [call[1] for call in turns.list_calls("begin")] == [5, 6, 7]
    assert turns.list_calls("record", "write") == 2 * [("record", "row", 7)]


def test_samples_that_are_owed_do_not_wait_nor_look_at_the_bus(plant_turn: ModuleType) -> None:
    """The first ones of the call, and those of slots that a wait has missed; then the controller may answer."""
    turns = PlantTurns(plant_turn)
    turns.waits, turns.counts = [1, 0], [8, 4, 0]
    assert turns.run_real_time(tick=5, most=5, count=2, owed=2) == (5, 0, 0, 3, 3 * TARGETS)
    names = "wait", "gather", "take", "skip", "write", "record", "settled"
    settled = ("settled", 0, 0, 3, 3 * TARGETS)
    assert turns.list_calls(*names) == [
        ("settled", 2, 2, 3, 3 * TARGETS), ("write", "row", 7, 0),  # owed: 1 more
        settled, ("record", "row", 7), ("gather", PERIOD // 2, 0, 0),  # the last one owed: it waits for an answer
        ("wait",), ("gather", 0, 8, 8), ("take", 4), ("skip", 1), ("settled", 0, 4, 3, 3 * TARGETS), ("write", "row", 7, 0),
        settled, ("record", "row", 7), ("gather", PERIOD // 2, 0, 0),
        ("wait",), ("gather", 0, 0, 0), ("take", 0), ("skip", 0),
    ]  # fmt: skip
    assert turns.list_calls("advance") == 5 * [("advance",)]


def test_a_plant_that_is_in_time_waits_for_no_answer(plant_turn: ModuleType) -> None:
    turns = PlantTurns(plant_turn)
    turns.waits = [2, 0, 0]
    assert turns.run_real_time(tick=0, most=5)[:2] == (5, 0)
    assert [call[1] for call in turns.list_calls("gather")] == [0, PERIOD // 2, 0, 0]


def test_after_a_last_sample_that_was_owed_an_answer_is_awaited(plant_turn: ModuleType) -> None:
    turns = PlantTurns(plant_turn)
    turns.waits = [0]
    assert turns.run_real_time(tick=0, most=2, owed=1)[:2] == (2, 0)
    assert turns.list_calls("gather") == [("gather", PERIOD // 2, 0, 0), ("gather", 0, 0, 0)]


def test_what_is_still_owed_is_told(plant_turn: ModuleType) -> None:
    turns = PlantTurns(plant_turn)
    assert turns.run_real_time(tick=0, most=1, owed=3) == (1, 2, 0, 3, 3 * TARGETS)
    turns.waits = [4]
    assert turns.run_real_time(tick=0, most=2)[:2] == (2, 3)


def test_a_frame_that_is_refused_ends_a_call_without_a_sample(plant_turn: ModuleType) -> None:
    for why in (1, 2, -1):
        turns = PlantTurns(plant_turn)
        turns.waits, turns.counts, turns.whys = [0, 2], [3, 5], [0, why]
        assert turns.run_real_time(tick=0, most=9) == (2, 2, 5, -why, 0)
        assert len(turns.list_calls("send")) == 1
        assert turns.log[-1] == ("take", 5)


def test_turns_end_when_python_has_something_to_do(plant_turn: ModuleType) -> None:
    for called, settled, samples in (([False, True], [], 2), ([], [True, False], 2), ([], [], 4)):
        turns = PlantTurns(plant_turn)
        turns.waits, turns.called, turns.settled = [0] * 9, called, settled
        assert turns.run_real_time(tick=0, most=4)[0] == samples
        assert len(turns.list_calls("record")) == samples - 1


# --- in lock-step ----------------------------------------------------------------------------------------------------


def test_in_step_a_sample_is_sent_and_its_answer_awaited(plant_turn: ModuleType) -> None:
    """The rig advances while the controller answers. The row is written before the wait, with the time then."""
    turns = PlantTurns(plant_turn)
    turns.counts, turns.answers = [2, 5], [MASK, 0]  # the tick of an answer has 10 bits
    assert turns.run_lockstep(tick=MASK, most=3) == (3, 0, 3, 3 * TARGETS)
    settled = ("settled", 0, 0, 3, 3 * TARGETS)
    assert turns.log == [
        *sample(MASK, 1.0, [2.0, 3.0]), ("advance",), settled, ("write", "row", 7, 10_006),
        ("gather_marked", 200_000_000, 0, 0), ("take", 2),
        *sample(MASK + 1, 2.0, [3.0, 4.0]), ("advance",), settled, ("write", "row", 7, 10_015),
        ("gather_marked", 200_000_000, 0, 0), ("take", 5),
        *sample(MASK + 2, 3.0, [4.0, 5.0]), ("advance",),
    ]  # fmt: skip
    assert turns.line.taken == 107


def test_in_step_an_answer_that_has_come_is_not_awaited(plant_turn: ModuleType) -> None:
    turns = PlantTurns(plant_turn, answered=7)
    turns.answers = [8]
    assert turns.run_lockstep(tick=7, most=3)[0] == 3
    assert len(turns.list_calls("gather_marked")) == 1
    assert [call[1] for call in turns.list_calls("begin")] == [7, 8, 9]


def test_in_step_a_call_ends_without_an_answer(plant_turn: ModuleType) -> None:
    for answer, changed in ((6, False), (-1, False), (7, True)):
        turns = PlantTurns(plant_turn)
        turns.counts, turns.answers, turns.line.changed = [4], [answer], changed
        assert turns.run_lockstep(tick=7, most=9) == (1, 4, 0, 0)
        assert len(turns.list_calls("write")) == 1
        assert turns.line.taken == 100  # the caller counts them


def test_in_step_a_frame_that_is_refused_ends_a_call(plant_turn: ModuleType) -> None:
    for why in (1, 2, -1):
        turns = PlantTurns(plant_turn)
        turns.counts, turns.answers, turns.whys = [4], [7], [why]
        assert turns.run_lockstep(tick=7, most=9) == (1, 4, -why, 0)


def test_in_step_a_call_ends_when_python_has_something_to_do(plant_turn: ModuleType) -> None:
    for called, settled in (([True], []), ([], [False])):
        turns = PlantTurns(plant_turn)
        turns.called, turns.settled = called, settled
        assert turns.run_lockstep(tick=7, most=9) == (1, 0, 3, 3 * TARGETS)
        assert turns.list_calls("write", "gather_marked") == []
