"""What Python does around the compiled calls of a turn: the class `Turn` and the warming. Each test has the module as argument,
so that it can run on mutants (tests/mutation). Compiled functions, bus and node are made up."""

from collections.abc import Callable
from types import ModuleType, SimpleNamespace
from typing import Any

import numpy as np
import pytest

import rt_controller.loop.turn
from protocols.errors import InputError
from rt_controller.loop.cycle import ControllerMemory
from tests.mutation.mutants import load_mutant, parse_plain

COMPILED = "answer", "answer_slots", "answer_samples", "answer_in_step", "follow"
CALL = "lines", "inbox"  # the bus in a call
SENT = ("finish_send", "outbox", 12, 13), ("discard_used", 11)  # what is left to do after a turn of `TurnCalls.fill`
SLOTS = 99  # of a turn that the call has left as it was


@pytest.fixture
def turn() -> ModuleType:
    return load_mutant(parse_plain(rt_controller.loop.turn))


class TurnCalls:
    """A Turn on a made-up bus. `log` has the calls; `results` are what the next compiled ones return.

    `marked` says of each compiled call whether a sample comes.
    """

    def __init__(self, module: ModuleType) -> None:
        self.log, self.results, self.marked = list[tuple[Any, ...]](), list[Any](), list[bool]()
        self.slots = list[int]()  # that the calls leave in the turn
        module.warm = lambda node: self.log.append(("warm", node))  # type: ignore[attr-defined]
        for name in COMPILED:
            setattr(module, name, self._make(name))
        self.line = SimpleNamespace(lines="lines", inbox="inbox", count=4, marks=5)
        for name in ("refresh", "count_settled", "finish_send", "discard_used", "accept"):
            setattr(self.line, name, self._note(name))
        self.node: Any = SimpleNamespace(memory="memory", outbox="outbox", check_sent=self._check_sent)
        samples: Any = SimpleNamespace(line=self.line, find_arrival_ns=lambda: 777)
        self.beat: Any = SimpleNamespace(memory=SimpleNamespace(clocks="clocks"), most=8, wake_up=self._wake_up)
        self.turn = module.Turn(samples, self.node)
        assert self.log.pop() == ("warm", self.node)
        assert (self.turn.samples, self.turn.node) == (samples, self.node)

    def _note(self, name: str) -> Callable[..., None]:
        def note(*arguments: Any) -> None:
            self.log.append((name, *arguments))
            if name == "accept":
                self.line.count = arguments[0]
            elif name == "count_settled":
                self.line.count = 0

        return note

    def _make(self, name: str) -> Callable[..., Any]:
        def call(*arguments: Any) -> Any:
            turns = [one for one in arguments if isinstance(one, np.ndarray) and one.dtype.names]
            self.log.append((name, *(one for one in arguments if not isinstance(one, np.ndarray))))
            for turn in turns:
                assert turn.shape == (1,)
                self.fill(turn)
            self.line.marks += bool(self.marked.pop(0)) if self.marked else 0
            return self.results.pop(0) if self.results else None

        return call

    def fill(self, turn: np.ndarray) -> None:
        turn["count"], turn["sent"], turn["position"], turn["patience"] = 11, 12, 13, 14
        turn["slots"] = self.slots.pop(0) if self.slots else SLOTS

    def _check_sent(self, sent: int) -> int:
        if sent < 0:
            raise InputError("refused")
        return sent

    def _wake_up(self, how: int) -> int:
        self.log.append(("wake_up", how))
        return 3


# --- a turn that Python begins ---------------------------------------------------------------------------------------


def test_an_answer_is_finished_by_python(turn: ModuleType) -> None:
    for marked in (True, False):
        calls = TurnCalls(turn)
        calls.marked = [marked]
        assert calls.turn.answer(2) is marked
        assert calls.log == [("refresh",), ("answer", *CALL, 4, 2, "memory"), *SENT]


def test_a_refused_turn_is_raised_and_nothing_is_sent(turn: ModuleType) -> None:
    calls = TurnCalls(turn)

    def fill(one: np.ndarray) -> None:
        one["sent"] = -2

    calls.fill = fill  # type: ignore[method-assign]
    with pytest.raises(InputError):
        calls.turn.answer(1)
    assert calls.log[2:] == []


# --- by slots --------------------------------------------------------------------------------------------------------


def test_turns_by_slots_leave_the_last_one_to_python(turn: ModuleType) -> None:
    """Frames of the turns before it are counted, where there are any."""
    begun = [("refresh",), ("answer_slots", SimpleNamespace(clocks="clocks"), *CALL, 4, "memory", 8, 6)]
    for missed, runs, counted in ((0, 1, False), (0, 2, True), (3, 1, False), (3, 8, True)):
        calls = TurnCalls(turn)
        calls.results = [(missed, runs)]
        assert calls.turn.answer_slots(calls.beat, 6) == missed
        assert calls.log == [*begun, *[("count_settled",)] * counted, *SENT]


def test_a_wait_that_is_overrun_is_left_to_the_clock_and_its_turn_follows(turn: ModuleType) -> None:
    for how, runs, counted in ((-1, 0, False), (-2, 0, False), (-1, 1, True), (-2, 5, True)):
        calls = TurnCalls(turn)
        calls.results = [(how, runs)]
        assert calls.turn.answer_slots(calls.beat, 6) == 3
        count = 0 if counted else 4
        assert calls.log[2:] == [
            *[("count_settled",)] * counted, ("wake_up", how), ("refresh",), ("answer", *CALL, count, 4, "memory"), *SENT,
        ]  # fmt: skip


def test_a_grid_that_follows_is_moved_after_that_turn_too(turn: ModuleType) -> None:
    for marked in (True, False):
        calls, drifts, seen = TurnCalls(turn), np.zeros(1), list[np.ndarray]()

        def follow(clocks: str, drifts: np.ndarray, complete: bool, at: int, seen: list[np.ndarray] = seen) -> None:
            seen.append(drifts)
            calls.log.append(("follow", clocks, complete, at))  # noqa: B023  # used in this turn of the loop

        turn.follow = follow  # type: ignore[attr-defined]
        calls.results, calls.marked = [(-1, 0)], [False, marked]
        calls.turn.answer_slots(calls.beat, 6, drifts)
        assert calls.log[-1] == ("follow", "clocks", marked, 777)
        assert [one is drifts for one in seen] == [True]


# --- by samples ------------------------------------------------------------------------------------------------------


def name_samples(count: int, patience: int = 0) -> tuple[Any, ...]:
    return "answer_samples", SimpleNamespace(clocks="clocks"), *CALL, count, "memory", 8, 6, patience


def test_turns_by_samples_leave_the_last_one_to_python(turn: ModuleType) -> None:
    for runs, slots, counted in ((1, 1, False), (2, 1, True), (1, 4, False), (8, 4, True)):
        calls = TurnCalls(turn)
        calls.results, calls.slots = [runs], [slots]
        assert calls.turn.answer_samples(calls.beat, 6) == slots - 1
        assert calls.log == [("refresh",), name_samples(4), *[("count_settled",)] * counted, *SENT]


def test_who_joins_during_a_wait_is_admitted_and_the_wait_goes_on(turn: ModuleType) -> None:
    """With its patience. Frames before it are new in the inbox, but for those of turns that are complete."""
    for runs, first in ((0, 4), (1, 0), (3, 0)):
        calls = TurnCalls(turn)
        calls.results, calls.slots = [runs, 1], [0, 2]
        assert calls.turn.answer_samples(calls.beat, 6) == 1
        assert calls.log == [
            ("refresh",), name_samples(4), *[("count_settled",)] * (runs > 0), ("accept", 11, first),
            ("refresh",), name_samples(11, 14), *SENT,
        ]  # fmt: skip


# --- in lock-step ----------------------------------------------------------------------------------------------------


def test_turns_in_step_leave_the_last_one_to_python(turn: ModuleType) -> None:
    called = ("answer_in_step", SimpleNamespace(clocks="clocks"), *CALL, 4, "memory", 8, 6)
    for runs, counted in ((1, False), (2, True), (8, True)):
        calls = TurnCalls(turn)
        calls.results = [(runs, False, 5)]
        assert calls.turn.answer_in_step(calls.beat, 6) == (False, False)
        assert calls.log == [("refresh",), called, *[("count_settled",)] * counted, *SENT]


def test_turns_in_step_that_end_in_a_wait_are_counted(turn: ModuleType) -> None:
    for runs in (1, 2):
        calls = TurnCalls(turn)
        calls.results = [(runs, True, 5)]
        assert calls.turn.answer_in_step(calls.beat, 6) == (True, False)
        assert calls.log[2:] == [("count_settled",), ("accept", 11, 0)]


def test_in_step_the_next_sample_is_complete_where_it_was_marked(turn: ModuleType) -> None:
    """After the last answer: until then the marks are those of samples that were answered."""
    for waited in (True, False):
        for before, complete in ((5, True), (6, False)):
            calls = TurnCalls(turn)
            calls.results, calls.marked = [(1, waited, before)], [True]
            assert calls.turn.answer_in_step(calls.beat, 6) == (waited, complete)


# --- warming ---------------------------------------------------------------------------------------------------------


def test_warming_plays_each_kind_of_turn_once_on_a_copy(turn: ModuleType) -> None:
    """Nothing is received or sent, no wait is long, and the node stays as it is."""
    log = dict[str, tuple[Any, ...]]()
    for name in COMPILED:
        setattr(turn, name, lambda *arguments, name=name: log.update({name: arguments}))
    memory = ControllerMemory(*(np.arange(3) for _ in ControllerMemory._fields))
    turn.warm(SimpleNamespace(memory=memory))
    lines, inbox, count, slots, copy, turns = log["answer"]
    assert lines["polls"]["fd"].max() == -1  # no socket
    assert (len(inbox), count, slots, turns.shape) == (1, 0, 1, (1,))
    assert isinstance(copy, ControllerMemory)
    for part, of in zip(copy, memory, strict=True):
        np.testing.assert_array_equal(part, of)
        assert not np.shares_memory(part, of)
    beat = log["answer_slots"][0]
    assert beat.clocks["period"] == 1000  # ns: it waits for no slot
    assert [len(part) for part in (beat.rows, beat.counts)] == [1, 1]
    common = beat, lines, inbox, 0, copy, turns, 1, 0
    for name, more in (("answer_slots", (turn.GRID,)), ("answer_samples", (0,)), ("answer_in_step", ())):
        assert len(log[name]) == len(common) + len(more)
        for result, expected in zip(log[name], (*common, *more), strict=True):
            assert result is expected or (isinstance(result, int) and result == expected), name
    clocks, drifts, complete, arrived = log["follow"]
    assert np.shares_memory(clocks, beat.clocks)
    assert (drifts.tolist(), complete, arrived) == ([0.0], False, 0)


def test_an_absolute_grid_has_no_drift(turn: ModuleType) -> None:
    assert turn.GRID.shape == (0,)
