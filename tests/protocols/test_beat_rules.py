"""How a beat waits, and what it records, to the nanosecond. Each test has the module as argument, so that it can run on mutants
(tests/mutation). It is the source of beat.py without compilation: time and sleep are made up."""

import ctypes
from types import ModuleType, SimpleNamespace
from typing import Any

import numpy as np
import pytest

import protocols.realtime.beat
from protocols.realtime.clock import CLOCK, Clock, Histogram
from protocols.realtime.mailbox import ANSWER_NUMBER, REQUEST_NUMBER, WORDS
from protocols.realtime.notify import PING
from protocols.realtime.overrun import find_overrun_policy
from protocols.realtime.waiting import SleepThenSpin
from tests.mutation.mutants import load_mutant, parse_plain

PERIOD = 1000  # ns
DUE = 7_000_000_000 + 10_000  # ns: the next slot; beyond seven seconds, as a sleep is told seconds and the rest
MARGIN = 2_000  # ns that a spin is longer than a sleep was late


@pytest.fixture
def beat() -> ModuleType:
    return load_mutant(parse_plain(protocols.realtime.beat))


class Time:
    """The time [ns], made up in `module`: after each reading it goes on by `step`. `sleeps`: ends of sleeps asked for.

    `late`: how late the next sleeps end; negative where a signal ends one before its time.
    """

    def __init__(self, module: ModuleType, now: int, step: int = 0, late: tuple[int, ...] = ()) -> None:
        self.now, self.step, self.late, self.sleeps, self.reads = now, step, list(late), list[int](), 0
        module.read_clock, module._clock_nanosleep = self.read, self.sleep  # type: ignore[attr-defined]
        # compiled code reads fields of records as attributes
        module.CLOCK = np.dtype((np.record, CLOCK))  # type: ignore[attr-defined]
        module._TIMING_RECORD = np.dtype((np.record, module._TIMING_RECORD))  # type: ignore[attr-defined]
        self.monotonic = module.CLOCK_MONOTONIC

    def read(self, clock: int, times: Any) -> int:
        assert clock == self.monotonic
        assert times.shape == (2,)
        self.reads += 1
        assert self.reads < 1000  # a loop that does not end
        self.now += self.step
        return self.now - self.step

    def sleep(self, clock: int, absolute: int, address: int, remaining: int) -> int:
        assert (clock, absolute, remaining) == (self.monotonic, 1, 0)
        seconds, nanoseconds = (ctypes.c_int64 * 2).from_address(address)
        assert 0 <= nanoseconds < 1_000_000_000
        self.sleeps.append(seconds * 1_000_000_000 + nanoseconds)
        assert len(self.sleeps) < 1000
        self.now = max(self.now, self.sleeps[-1] + (self.late.pop(0) if self.late else 0))
        return 0


def make_beat(module: ModuleType, policy: str = "skip", spins: tuple[int, int] = (0, 0)) -> Any:
    """A beat whose next slot is at DUE."""
    waiting = SleepThenSpin(0)
    waiting.words[0], waiting.words[1] = spins
    clock = Clock(PERIOD, waiting, find_overrun_policy(policy))
    clock.start(DUE)
    return module.Beat(clock)


def wait(module: ModuleType, time: Time, policy: str = "skip", spins: tuple[int, int] = (0, 0)) -> tuple[int, Any]:
    beat = make_beat(module, policy, spins)
    return int(module.wait(beat.memory)), beat.clock


# --- waiting for a slot ----------------------------------------------------------------------------------------------


def test_who_is_in_time_sleeps_until_the_slot(beat: ModuleType) -> None:
    for before, late in ((500, 0), (1, 30), (3_000_000_000, PERIOD - 1)):
        time = Time(beat, DUE - before, late=(late,))
        missed, clock = wait(beat, time)
        assert time.sleeps == [DUE]
        assert (missed, clock.run, clock.skipped) == (0, 1, 0)
        assert (clock.woken_ns, clock.lateness_ns, clock.deadline_ns) == (DUE + late, late, DUE)


def test_who_is_late_for_a_slot_does_not_sleep(beat: ModuleType) -> None:
    for late in (0, 30, PERIOD - 1):
        time = Time(beat, DUE + late)
        missed, clock = wait(beat, time)
        assert time.sleeps == []
        assert (missed, clock.run, clock.skipped) == (0, 1, 0)
        assert (clock.woken_ns, clock.lateness_ns, clock.deadline_ns) == (DUE + late, late, DUE)


def test_slots_that_are_over_are_left_out(beat: ModuleType) -> None:
    """Who overran is late for the present slot, who slept too long for the one waited for."""
    for late, missed in ((PERIOD, 1), (PERIOD + 1, 1), (2 * PERIOD - 1, 1), (7 * PERIOD + 20, 7)):
        for slept in (True, False):
            time = Time(beat, DUE - 1 if slept else DUE + late, late=(late,))
            result, clock = wait(beat, time)
            assert (result, clock.run, clock.skipped) == (missed, 1, missed)
            assert clock.deadline_ns == DUE + missed * PERIOD
            assert clock.woken_ns == DUE + late
            assert clock.lateness_ns == (late if slept else late - missed * PERIOD)


def test_a_policy_that_must_decide_is_asked(beat: ModuleType) -> None:
    for slept, sentence in ((True, -2), (False, -1)):
        for late, asked in ((PERIOD - 1, False), (PERIOD, True), (5 * PERIOD, True)):
            time = Time(beat, DUE - 1 if slept else DUE + late, late=(late,))
            result, clock = wait(beat, time, "catch-up")
            assert result == (sentence if asked else 0)
            assert (clock.run, clock.skipped) == (0 if asked else 1, 0)
            assert (clock.woken_ns, clock.deadline_ns) == (DUE + late, DUE)


def test_the_clock_begins_the_cycle_after_that(beat: ModuleType) -> None:
    for how, lateness in ((beat.OVERSLEPT, 3 * PERIOD + 5), (beat.OVERRUN, 5)):
        one = make_beat(beat)
        one.clock.deadline_ns, one.clock.woken_ns = DUE, DUE + 3 * PERIOD + 5
        assert one.wake_up(how) == 3
        assert one.clock.lateness_ns == lateness


# --- sleeping, spinning ----------------------------------------------------------------------------------------------


def test_a_signal_does_not_end_a_sleep(beat: ModuleType) -> None:
    time = Time(beat, DUE - 900, late=(-500, -1, 0))
    missed, clock = wait(beat, time)
    assert time.sleeps == 3 * [DUE]
    assert (missed, clock.woken_ns) == (0, DUE)


def test_a_spin_begins_before_the_slot_and_ends_at_it(beat: ModuleType) -> None:
    """The slot is not waited for any longer than it is there."""
    for step, woken in ((10, DUE), (7, DUE + 5)):
        time = Time(beat, DUE - 900, step, late=(0,))
        _, clock = wait(beat, time, spins=(100, 4000))
        assert time.sleeps == [DUE - 100]
        assert clock.woken_ns == woken


def test_at_the_beginning_of_a_spin_nobody_sleeps(beat: ModuleType) -> None:
    for before in (100, 1):
        time = Time(beat, DUE - before, 1)
        _, clock = wait(beat, time, spins=(100, 4000))
        assert time.sleeps == []
        assert clock.woken_ns == DUE
        assert list(clock.waiting.words) == [100, 4000]


def test_a_spin_is_as_long_as_sleeps_are_late(beat: ModuleType) -> None:
    """It becomes longer at once, shorter by one part of 256, and not longer than it may be."""
    for late, spin, most, then in (
        (500, 100, 4000, 500 + MARGIN),
        (0, 100, 4000, MARGIN),
        (500, MARGIN + 499, 4000, 500 + MARGIN),
        (500, MARGIN + 500, 4000, 500 + MARGIN),
        (500, MARGIN + 500 + 255, 4000, MARGIN + 500 + 255),
        (500, MARGIN + 500 + 256, 4000, MARGIN + 500 + 255),
        (500, MARGIN + 500 + 1024, 4000, MARGIN + 500 + 1020),
        (2500, 100, 4000, 4000),
        (500, 0, 1, 1),
        (500, 512, 0, 512),  # none is to be adapted
    ):
        Time(beat, DUE - 50_000, 1000, (late,))
        one = make_beat(beat, spins=(spin, most))
        beat.wait(one.memory)
        assert list(one.clock.waiting.words) == [then, most], (late, spin, most)


# --- account of a cycle ----------------------------------------------------------------------------------------------


def test_a_sample_begins_a_cycle_and_moves_the_grid(beat: ModuleType) -> None:
    for arrived, slots, shift in ((DUE, 1, 0), (DUE + 30, 1, 30), (DUE - 40 + 2 * PERIOD, 3, -40)):
        Time(beat, 0)
        one = make_beat(beat)
        one.clock.run, one.clock.skipped = 5, 7
        before = one.clock.slots
        beat.arrive(one.memory.clocks, arrived + 11, arrived, slots)
        assert (one.clock.woken_ns, one.clock.lateness_ns, one.clock.deadline_ns) == (arrived + 11, 11, arrived)
        assert (one.clock.run, one.clock.skipped) == (6, 7 + slots - 1)
        assert one.clock.slots == before + slots
        assert one.memory.clocks[0].first == DUE + shift


def test_python_is_called_by_a_signal_or_a_request(beat: ModuleType) -> None:
    for signalled, asked, answered, called in (
        (False, 3, 3, False), (True, 3, 3, True), (False, 4, 3, True), (False, 3, 4, True), (True, 4, 3, True),
    ):  # fmt: skip
        numbers = [0] * WORDS
        numbers[REQUEST_NUMBER], numbers[ANSWER_NUMBER] = asked, answered
        assert bool(beat.is_called(SimpleNamespace(signalled=signalled), SimpleNamespace(numbers=numbers))) is called


def record(module: ModuleType, beat: Any, row: list[float], rows: np.ndarray, counts: np.ndarray) -> None:
    module.record_cycle(beat.memory._replace(rows=rows, counts=counts), np.array(row), 9)


def test_a_cycle_is_recorded_with_its_timing(beat: ModuleType) -> None:
    """What the row says of work and late cycles is of the cycles before."""
    Time(beat, DUE + 700)
    one, rows, counts = make_beat(beat), np.full((3, 8), -1.0), np.array([4])
    clock = one.clock
    clock.deadline_ns, clock.woken_ns, clock.lateness_ns, clock.work_ns, clock.late = DUE, DUE + 200, 150, 4_000, 6
    record(beat, one, [0.5, 0.25], rows, counts)
    assert rows[1].tolist() == [0.5, 0.25, (DUE + 200) / 1e9, 0.15, 4.0, 6.0, 9.0, -1.0]
    assert (rows[[0, 2]] == -1.0).all()
    assert counts[0] == 5
    assert (clock.work_ns, clock.late) == (500, 6)
    record(beat, one, [0.5, 0.25], rows, counts)
    assert (rows[2, 4], counts[0]) == (0.5, 6)
    assert (clock.wake.total, clock.wake.maximum_ns, clock.work.total, clock.work.maximum_ns) == (2, 150, 2, 500)


def test_systemd_is_told_when_that_is_due(beat: ModuleType) -> None:
    """At the end of the first cycle that began at or after that time, and again after the period."""
    for woken, sentence in ((DUE - 1, False), (DUE, True), (DUE + 7, True)):
        time, sent, ping = Time(beat, DUE + 700), list[tuple[int, ...]](), np.array([(DUE, 50, 8, 4711, 18)], PING)

        def send(*arguments: int, time: Time = time, sent: list[tuple[int, ...]] = sent) -> int:
            sent.append(arguments)
            time.now += 5
            return 18

        beat._send = send  # type: ignore[attr-defined]
        one = beat.Beat(Clock(PERIOD), ping=ping)
        one.clock.woken_ns = woken
        for _ in range(2):
            record(beat, one, [], np.zeros((1, 5)), np.zeros(1, np.int64))
        # by send(2) with MSG_DONTWAIT and MSG_NOSIGNAL: nothing waits
        assert sent == ([(8, 4711, 18, 0x40 | 0x4000)] if sentence else [])
        assert ping["due"] == (woken + 50 if sentence else DUE)
        assert one.clock.work_ns == DUE + 700 + (5 if sentence else 0) - woken  # it is of the cycle's work


def test_a_cycle_is_late_that_ends_after_its_slot_or_begins_a_period_late(beat: ModuleType) -> None:
    for ended, lateness, late in (
        (PERIOD, 0, False), (PERIOD + 1, 0, True), (0, PERIOD - 1, False), (0, PERIOD, True), (PERIOD + 1, PERIOD, True),
    ):  # fmt: skip
        Time(beat, DUE + ended)
        one = make_beat(beat)
        one.clock.deadline_ns = one.clock.woken_ns = DUE
        one.clock.lateness_ns, one.clock.late = lateness, 6
        record(beat, one, [], np.zeros((1, 5)), np.zeros(1, np.int64))
        assert one.clock.late == 6 + late


def test_a_duration_is_counted_as_by_a_histogram(beat: ModuleType) -> None:
    """In bins of 1 us, the last of which is for all that are longer; a negative one is in the first."""
    Time(beat, 0)
    for durations in ((999, 1000), (-5, -2000), (19_999_999, 20_000_000), (20_999_999, 21_000_000), (5, 3, 5), (-7,)):
        one, expected = make_beat(beat), Histogram()
        for duration in durations:
            beat._add_duration(one.memory.clocks[0].wake, duration)
            expected.add(duration)
        assert list(one.clock.wake._words) == list(expected._words)


# --- memory ----------------------------------------------------------------------------------------------------------


def test_a_beat_without_a_ring_makes_one_cycle_a_call(beat: ModuleType) -> None:
    one = beat.Beat(Clock(PERIOD))
    assert one.most == 1
    assert (one.memory.rows.shape, one.memory.counts.tolist()) == ((1, 0), [0])
    assert one.memory.numbers.tolist() == [0] * WORDS
    assert one.memory.pings["due"] > 2**61  # never


def test_a_beat_with_a_ring_makes_cycles_for_2_s_a_call(beat: ModuleType) -> None:
    ring: Any = SimpleNamespace(rows=np.ones((4, 9)), counts=np.array([7]))
    mailbox: Any = SimpleNamespace(numbers=np.array([1, 2, 3, 4]))
    for period, most in (
        (1, 2_000_000_000),
        (1_000_000, 2000),
        (300_000_000, 6),
        (2_000_000_000, 1),
        (3_000_000_000, 1),
    ):
        assert beat.Beat(Clock(period), ring, mailbox).most == most
    memory = beat.Beat(Clock(1), ring, mailbox).memory
    assert (memory.rows is ring.rows, memory.counts is ring.counts, memory.numbers is mailbox.numbers) == (True,) * 3


def test_a_beat_works_on_the_memory_of_its_clock(beat: ModuleType) -> None:
    one = make_beat(beat, spins=(3, 4))
    one.memory.clocks["late"], one.memory.spins[0] = 5, 2
    assert (one.clock.late, list(one.clock.waiting.words)) == (5, [2, 4])


def test_python_records_a_cycle_by_the_same_function(beat: ModuleType) -> None:
    Time(beat, 0)
    calls = list[tuple[Any, ...]]()
    beat.record_cycle = lambda *arguments: calls.append(arguments)  # type: ignore[attr-defined]
    one = make_beat(beat)
    one.record_cycle("row", 7)
    ((memory, *rest),) = calls
    assert np.shares_memory(memory.clocks, np.frombuffer(one.clock.words, np.int64))
    assert rest == ["row", 7]


def test_a_cycle_is_recorded_once_to_compile_it(beat: ModuleType) -> None:
    calls = list[tuple[Any, ...]]()
    beat.record_cycle = lambda *arguments: calls.append(arguments)  # type: ignore[attr-defined]
    beat.compile_record_cycle()
    ((memory, row, changes),) = calls
    assert memory.rows.shape == (1, 1 + len(beat.TIMING))  # there is room for the row
    assert (memory.clocks["period"], row.shape, changes) == (1, (1,), 0)
