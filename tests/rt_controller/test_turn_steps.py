"""Steps of a turn: what is received, run and sent, in which order, with which slots. Each test has the module as argument, so
that it can run on mutants (tests/mutation). It is the source of turn.py
without compilation: bus, clock and cycle are made up."""

from types import ModuleType, SimpleNamespace
from typing import Any

import numpy as np
import pytest

import rt_controller.loop.turn
from tests.mutation.mutants import load_mutant, parse_plain

PERIOD = 1000  # ns
TARGETS = 256  # positions a frame


@pytest.fixture
def turn() -> ModuleType:
    return load_mutant(parse_plain(rt_controller.loop.turn))


class TurnBench:
    """Memory of a turn, and made-up functions around it. `log` has their calls; the lists are what they return, in turn."""

    def __init__(self, module: ModuleType) -> None:
        self.module, self.log = module, list[tuple[Any, ...]]()
        self.now, self.times = 10_000, list[int]()  # ns: of the clock; and of its next readings
        self.waits, self.counts, self.sents = list[int](), list[int](), list[int]()
        self.called, self.settled = list[bool](), list[bool]()
        self.marked = list[bool]()  # whether a call to receive brings a sample
        self.line = SimpleNamespace(marks=5, changed=False, time="time", marked_ns=0)
        names = ("count", "slots", "woken", "arrived", "patience", "sent", "position")
        self.turn = SimpleNamespace(**dict.fromkeys(names, -7))
        self.states = [SimpleNamespace(late_cycles=-1)]
        self.node = SimpleNamespace(states=self.states, settings="settings", outbox="outbox", row="row")
        self.clock = SimpleNamespace(late=3, deadline=9_000, period=PERIOD, woken=0)
        self.beat = SimpleNamespace(clocks=[self.clock])
        for name in (
            "gather", "gather_marked", "run_cycle", "send_to_all", "read_clock", "is_called", "is_settled", "wait", "write",
            "record_cycle", "arrive", "follow",
        ):  # fmt: skip
            setattr(module, name, getattr(self, f"_{name}"))

    def _gather(self, lines: Any, timeout: int, inbox: str, first: int, count: int) -> int:
        self.log.append(("gather", timeout, first, count))
        self.line.marks += bool(self.marked.pop(0)) if self.marked else 0
        return self.counts.pop(0) if self.counts else count

    def _gather_marked(self, lines: Any, timeout: int, inbox: str, first: int, count: int) -> int:
        self.log.append(("gather_marked", timeout, first, count))
        self.line.marks += bool(self.marked.pop(0)) if self.marked else 0
        return self.counts.pop(0) if self.counts else count

    def _run_cycle(self, states: Any, settings: str, inbox: str, count: int, slots: int, outbox: str) -> int:
        assert (states, settings, inbox, outbox) == (self.states, "settings", "inbox", "outbox")
        self.log.append(("run", count, slots, states[0].late_cycles))
        return self.sents.pop(0) if self.sents else 2

    def _send_to_all(self, lines: Any, position: int, frames: str, count: int) -> int:
        assert frames == "outbox"
        self.log.append(("send", position, count))
        return TARGETS * count

    def _read_clock(self, clock: int, times: Any) -> int:
        assert times == "time"
        if self.times:
            self.now = self.times.pop(0)
        return self.now + (5_000_000 if clock == self.module.CLOCK_REALTIME else 0)

    def _is_called(self, line: Any, beat: Any) -> bool:
        return self.called.pop(0) if self.called else False

    def _is_settled(self, line: Any, first: int, count: int, sent: int, position: int) -> bool:
        self.log.append(("settled", first, count, sent, position))
        return self.settled.pop(0) if self.settled else True

    def _wait(self, beat: Any) -> int:
        return self.waits.pop(0)

    def _write(self, beat: Any, row: str, changes: int) -> None:
        self.log.append(("write", row, changes, self.clock.woken))

    def _record_cycle(self, beat: Any, row: str, changes: int) -> None:
        self.log.append(("record", row, changes))

    def _arrive(self, clocks: Any, woken: int, arrived: int, slots: int) -> None:
        self.log.append(("arrive", woken, arrived, slots))

    def _follow(self, clocks: Any, drifts: Any, complete: bool, arrived: int) -> None:
        self.log.append(("follow", bool(complete), arrived))

    def list_calls(self, *names: str) -> list[tuple[Any, ...]]:
        return [call for call in self.log if call[0] in names]


# --- one turn --------------------------------------------------------------------------------------------------------


def test_an_answer_receives_runs_and_sends(turn: ModuleType) -> None:
    bench = TurnBench(turn)
    bench.counts, bench.sents = [9], [3]
    turn.answer([bench.line], "inbox", 4, 2, bench.node, [bench.turn])
    assert bench.log == [("gather", 0, 4, 4), ("run", 9, 2, -1), ("send", 0, 3)]
    result = bench.turn
    assert (result.count, result.slots, result.sent, result.position) == (9, 2, 3, 3 * TARGETS)


def test_a_refused_cycle_sends_nothing(turn: ModuleType) -> None:
    bench = TurnBench(turn)
    bench.sents = [-2]
    turn.answer([bench.line], "inbox", 0, 1, bench.node, [bench.turn])
    assert bench.list_calls("send") == [("send", 0, 0)]
    assert bench.turn.sent == -2


# --- turns by slots --------------------------------------------------------------------------------------------------


def answer_slots(bench: TurnBench, most: int, count: int = 0, drifts: int = 0) -> tuple[int, int]:
    return tuple(  # type: ignore[return-value]
        bench.module.answer_slots(
            bench.beat, [bench.line], "inbox", count, bench.node, [bench.turn], most, 6, np.zeros(drifts)
        )
    )


def test_a_turn_is_told_the_slots_that_were_slept_through(turn: ModuleType) -> None:
    bench = TurnBench(turn)
    bench.waits = [0, 1, 4]
    assert answer_slots(bench, 3) == (4, 3)
    assert bench.list_calls("run") == [("run", 0, 1, 3), ("run", 0, 2, 3), ("run", 0, 5, 3)]
    assert bench.list_calls("record") == 2 * [("record", "row", 6)]  # the last row is left
    assert bench.list_calls("follow") == []


def test_frames_before_a_first_slot_are_used_once(turn: ModuleType) -> None:
    bench = TurnBench(turn)
    bench.waits, bench.counts = [0, 0], [7, 3]
    answer_slots(bench, 2, count=4)
    assert bench.list_calls("gather") == [("gather", 0, 4, 4), ("gather", 0, 0, 0)]
    assert bench.list_calls("settled") == [("settled", 4, 7, 2, 2 * TARGETS)]


def test_a_wait_that_is_overrun_ends_before_a_cycle(turn: ModuleType) -> None:
    for missed in (-1, -2):
        bench = TurnBench(turn)
        bench.waits = [0, missed]
        assert answer_slots(bench, 5) == (missed, 1)
        assert len(bench.list_calls("run")) == 1


def test_turns_end_when_python_has_something_to_do(turn: ModuleType) -> None:
    for called, settled, runs in (([False, True], [], 2), ([], [True, False], 2), ([], [], 5)):
        bench = TurnBench(turn)
        bench.waits, bench.called, bench.settled = [0] * 9, called, settled
        assert answer_slots(bench, 5) == (0, runs)
        assert len(bench.list_calls("record")) == runs - 1


def test_a_grid_that_follows_is_told_the_arrival_of_a_sample(turn: ModuleType) -> None:
    for marked in (True, False):
        bench = TurnBench(turn)
        bench.waits, bench.marked = [0], [marked]
        bench.line.marked_ns = 5_000_000 + 9_400  # of the other clock: 600 ns ago
        answer_slots(bench, 1, drifts=1)
        assert bench.list_calls("follow") == [("follow", marked, 9_400)]


# --- turns by samples ------------------------------------------------------------------------------------------------


def answer_samples(bench: TurnBench, most: int, count: int = 0, patience: int = 0) -> int:
    return int(
        bench.module.answer_samples(
            bench.beat, [bench.line], "inbox", count, bench.node, [bench.turn], most, 6, patience
        )
    )


def test_a_sample_begins_a_turn(turn: ModuleType) -> None:
    bench = TurnBench(turn)
    bench.marked, bench.counts = [True], [8]
    bench.line.marked_ns = 5_000_000 + 9_900
    bench.clock.deadline = 8_000  # two periods before
    assert answer_samples(bench, 1, count=3) == 1
    assert bench.list_calls("gather_marked") == [("gather_marked", 500, 3, 3)]
    assert bench.list_calls("run", "send", "arrive") == [
        ("run", 8, 2, 3), ("send", 0, 2), ("arrive", 10_000, 9_900, 2)
    ]  # fmt: skip
    assert bench.turn.position == 2 * TARGETS


def test_a_stamp_of_the_future_is_taken_as_now(turn: ModuleType) -> None:
    bench = TurnBench(turn)
    bench.marked = [True]
    bench.line.marked_ns = 5_000_000 + 10_700
    answer_samples(bench, 1)
    assert bench.list_calls("arrive") == [("arrive", 10_000, 10_000, 1)]


def test_the_usual_end_of_waiting_is_half_a_period_after_the_slot(turn: ModuleType) -> None:
    for deadline, given, waited in (
        (9_600, 0, 1_100),
        (9_000, 0, 500),
        (5_000, 0, 500),
        (9_600, 10_300, 300),
        (9_000, 1, 0),
    ):
        bench = TurnBench(turn)
        bench.clock.deadline, bench.marked, bench.times = deadline, [True], [10_000, 10_000, 10_500]
        bench.line.marked_ns = 5_000_000 + 10_000
        answer_samples(bench, 1, patience=given)
        assert bench.list_calls("gather_marked") == [("gather_marked", waited, 0, 0)], (deadline, given)


def test_without_a_sample_a_turn_begins_at_the_end_of_waiting(turn: ModuleType) -> None:
    bench = TurnBench(turn)
    bench.times = [10_000, 10_000, 10_500]  # begin, wait, end
    bench.line.marked_ns = 5_000_000 + 9_950  # an older one
    assert answer_samples(bench, 1) == 1
    assert bench.list_calls("run", "arrive") == [("run", 0, 1, 3), ("arrive", 10_500, 10_000, 1)]


def test_a_wait_that_is_over_is_not_negative(turn: ModuleType) -> None:
    bench = TurnBench(turn)
    bench.times = [10_000, 10_200, 10_300]
    answer_samples(bench, 1, patience=10_100)
    assert bench.list_calls("gather_marked") == [("gather_marked", 0, 0, 0)]


def test_who_joins_or_leaves_ends_a_wait_without_a_cycle(turn: ModuleType) -> None:
    bench = TurnBench(turn)
    bench.line.changed = True
    bench.counts = [2]
    assert answer_samples(bench, 1) == 0
    assert bench.list_calls("run", "send", "arrive") == []
    assert (bench.turn.slots, bench.turn.count) == (0, 2)


def test_a_computer_that_has_stopped_waits_once_more(turn: ModuleType) -> None:
    bench = TurnBench(turn)
    bench.times = [10_000, 10_000, 14_000, 14_500]
    assert answer_samples(bench, 1) == 1
    assert bench.list_calls("gather_marked") == [("gather_marked", 500, 0, 0)] * 2
    assert bench.list_calls("run") == [("run", 0, 5, 3)]


def test_several_samples_are_turns_of_one_call(turn: ModuleType) -> None:
    for called, settled, runs in (([], [], 3), ([False, True], [], 2), ([], [True, False], 2)):
        bench = TurnBench(turn)
        bench.marked, bench.called, bench.settled, bench.counts = [True] * 3, called, settled, [5, 2, 2]
        bench.line.marked_ns = 5_000_000 + 10_000
        assert answer_samples(bench, 3, count=1, patience=10_900) == runs
        waits = [("gather_marked", 900, 1, 1), ("gather_marked", 500, 0, 0), ("gather_marked", 500, 0, 0)]
        assert bench.list_calls("gather_marked") == waits[:runs]
        assert bench.list_calls("settled")[0] == ("settled", 1, 5, 2, 2 * TARGETS)
        assert bench.list_calls("record") == [("record", "row", 6)] * (runs - 1)


def test_a_refused_sample_sends_nothing(turn: ModuleType) -> None:
    bench = TurnBench(turn)
    bench.marked, bench.sents = [True], [-1]
    bench.line.marked_ns = 5_000_000 + 10_000
    answer_samples(bench, 1)
    assert bench.list_calls("send") == [("send", 0, 0)]


# --- lock-step -------------------------------------------------------------------------------------------------------


def answer_in_step(bench: TurnBench, most: int, count: int = 0) -> tuple[int, bool, int]:
    return tuple(  # type: ignore[return-value]
        bench.module.answer_in_step(bench.beat, [bench.line], "inbox", count, bench.node, [bench.turn], most, 6)
    )


def test_in_step_each_sample_is_one_slot(turn: ModuleType) -> None:
    bench = TurnBench(turn)
    bench.marked, bench.counts = [False, True, False], [6, 4, 4]
    assert answer_in_step(bench, 2, count=2) == (2, False, 6)
    assert bench.log == [
        ("gather", 0, 2, 2), ("run", 6, 1, -1), ("send", 0, 2), ("settled", 2, 6, 2, 2 * TARGETS),
        ("write", "row", 6, 10_000), ("gather_marked", 200_000_000, 0, 0),
        ("gather", 0, 4, 4), ("run", 4, 1, -1), ("send", 0, 2),
    ]  # fmt: skip


def test_in_step_frames_are_settled_from_the_first(turn: ModuleType) -> None:
    bench = TurnBench(turn)
    bench.marked, bench.counts = [False, True, False, True, False], [6, 4, 4, 3, 3]
    assert answer_in_step(bench, 3, count=2) == (3, False, 7)
    assert bench.list_calls("settled") == [("settled", 2, 6, 2, 512), ("settled", 0, 4, 2, 512)]
    assert bench.list_calls("gather") == [("gather", 0, 2, 2), ("gather", 0, 4, 4), ("gather", 0, 3, 3)]


def test_in_step_a_wait_ends_without_a_sample_or_when_somebody_comes(turn: ModuleType) -> None:
    for marked, changed in ((False, False), (True, True), (False, True)):
        bench = TurnBench(turn)
        bench.marked, bench.line.changed, bench.counts = [False, marked], changed, [0, 3]
        assert answer_in_step(bench, 9) == (1, True, 5)
        assert bench.turn.count == 3


def test_in_step_turns_end_when_python_has_something_to_do(turn: ModuleType) -> None:
    for called, settled in (([True], []), ([], [False])):
        bench = TurnBench(turn)
        bench.called, bench.settled = called, settled
        assert answer_in_step(bench, 9) == (1, False, 5)
        assert bench.list_calls("write") == []


# --- which slot begins -----------------------------------------------------------------------------------------------


def test_a_sample_begins_the_slot_it_arrives_in(turn: ModuleType) -> None:
    for before, arrived, at, slots in (
        (0, 499, 499, 0), (0, 500, 500, 1), (0, 1, 499, 0), (0, 1, 500, 1), (0, 1499, 1499, 1), (0, 1500, 1500, 2),
        (0, 7000, 7000, 7), (4000, 6600, 6700, 3), (4000, 4400, 4400, 0),
    ):  # fmt: skip
        assert turn.choose_slot(before, PERIOD, arrived, at, 77, False) == (slots, arrived, 77)
        assert turn.count_slots(before, arrived, at, PERIOD) == slots


def test_the_wait_goes_on_until_its_end(turn: ModuleType) -> None:
    for at, result in (
        (1499, (0, 0, 1500)),
        (1500, (1, 1000, 1500)),
        (1999, (1, 1000, 1500)),
        (2000, (0, 0, 2500)),  # the computer has stopped: once more
        (8300, (0, 0, 8800)),
    ):
        assert turn.choose_slot(0, PERIOD, 0, at, 1500, False) == result, at


def test_a_wait_is_extended_once(turn: ModuleType) -> None:
    for at, slots in ((2000, 2), (2100, 2), (2600, 2), (8300, 8), (1600, 1), (1500, 1)):
        assert turn.choose_slot(0, PERIOD, 0, at, 1500, True) == (slots, slots * PERIOD, 1500), at


def test_at_least_one_slot_has_passed(turn: ModuleType) -> None:
    assert turn.choose_slot(0, PERIOD, 0, 400, 300, False) == (1, PERIOD, 300)
    assert turn.choose_slot(5000, PERIOD, 0, 6500, 6500, False) == (1, 6000, 6500)
