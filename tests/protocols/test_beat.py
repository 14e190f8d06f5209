"""A clock in compiled code: the same slots, spins and account as the clock's own, on the same memory."""

import signal
import time
from pathlib import Path

import numpy as np
import pytest

from protocols.node import Column
from protocols.realtime.beat import OVERRUN, OVERSLEPT, TIMING, Beat, record_cycle, wait
from protocols.realtime.clock import CLOCK, Clock, Histogram
from protocols.realtime.overrun import OverrunError, find_overrun_policy
from protocols.realtime.ring import RingReader, RingWriter
from protocols.realtime.waiting import SleepThenSpin

PERIOD = 2_000_000  # ns
LONG = 3_600_000_000_000  # ns: a period in which nothing is late


def start_beat(period: int = PERIOD, **settings: object) -> Beat:
    beat = Beat(Clock(period, **settings))  # type: ignore[arg-type]
    # compiled, on a clock that was never started: it is late since the machine was, at any period shorter than that
    wait(Beat(Clock(PERIOD)).memory)
    beat.clock.start(time.monotonic_ns() + period)
    return beat


def wait_for_slot(beat: Beat) -> int:
    """As a turn waits: slots left out."""
    missed: int = wait(beat.memory)
    return beat.wake_up(missed) if missed < 0 else missed


def test_every_slot_is_run_or_skipped_and_none_begins_early() -> None:
    beat = start_beat()
    clock, start = beat.clock, beat.clock.deadline_ns + PERIOD
    left_out = 0
    for cycle in range(60):
        missed = wait_for_slot(beat)
        left_out += missed
        assert clock.woken_ns >= clock.deadline_ns
        assert (clock.deadline_ns - start) % PERIOD == 0
        assert clock.slots == clock.run + clock.skipped == cycle + 1 + left_out
        if cycle % 20 == 5:
            time.sleep(3.5 * PERIOD / 1e9)
    assert clock.skipped == left_out >= 6  # three times at least two, however late a machine wakes who sleeps


def test_what_a_wait_finds_is_told_apart() -> None:
    beat = start_beat(LONG, overrun=find_overrun_policy("catch-up"))
    clock, begin = beat.clock, time.monotonic_ns()
    clock.deadline_ns = begin - LONG - 5  # the slot began 5 ns before
    assert wait(beat.memory) == 0
    assert clock.run == 1
    assert clock.lateness_ns == clock.woken_ns - begin + 5
    clock.deadline_ns = begin - 2 * LONG
    assert wait(beat.memory) == OVERRUN
    assert clock.run == 1  # that is left to the clock
    clock.period_ns, clock.deadline_ns = 100, time.monotonic_ns() + 20_000_000  # nobody wakes within 100 ns
    assert wait(beat.memory) == OVERSLEPT


@pytest.mark.parametrize("slept", [False, True])
def test_slots_that_are_left_out_are_accounted_for_as_by_the_clock(slept: bool) -> None:
    """Where the cycle before took so long it is late for the present slot, where the machine slept for the one waited for."""
    beat, clock = start_beat(PERIOD), Clock(PERIOD)
    waits, left_out = (lambda: wait(beat.memory), clock.wait), []
    for of, waits_for in zip((beat.clock, clock), waits, strict=True):
        of.period_ns = 2_000 if slept else PERIOD  # nobody wakes within 2 us
        of.start(time.monotonic_ns() + (3_000_000 if slept else -round(3.4 * PERIOD)))
        slots = waits_for()
        left_out.append(slots)
        assert (of.run, of.skipped) == (1, slots)
        assert of.woken_ns - of.period_ns < of.deadline_ns <= of.woken_ns
        first = of.deadline_ns - slots * of.period_ns
        assert of.lateness_ns == of.woken_ns - (first if slept else of.deadline_ns)
    assert min(left_out) >= (1 if slept else 3)


@pytest.mark.parametrize(("policy", "skipped"), [("skip", 4), ("catch-up", 0)])
def test_the_policy_is_the_clocks(policy: str, skipped: int) -> None:
    beat = start_beat(LONG // 10, overrun=find_overrun_policy(policy))
    beat.clock.start(time.monotonic_ns() - 4 * (LONG // 10))
    assert wait_for_slot(beat) == skipped
    assert (beat.clock.run, beat.clock.skipped, beat.clock.slots) == (1, skipped, 1 + skipped)


def test_a_fault_is_raised() -> None:
    beat = start_beat(LONG, overrun=find_overrun_policy("fault"))
    beat.clock.start(time.monotonic_ns() - 2 * LONG)
    with pytest.raises(OverrunError, match="2 cycles were missed"):
        wait_for_slot(beat)


def test_a_spin_is_that_of_the_waiting() -> None:
    """It begins as long as it may be, gets shorter over good sleeps, and the slot is never missed by a sleep's lateness."""
    spin = SleepThenSpin(500_000)
    beat = start_beat(waiting=spin)
    for _ in range(50):
        wait_for_slot(beat)
        assert beat.clock.woken_ns >= beat.clock.deadline_ns
        assert 0 < spin.spin_ns <= 500_000
    assert beat.memory.spins[0] == spin.spin_ns
    before = spin.spin_ns
    now = time.monotonic_ns()
    spin(now, now + PERIOD)  # the waiting itself goes on with it
    assert spin.spin_ns != before or before == 500_000


def test_a_signal_does_not_end_the_wait() -> None:
    beat, asked = start_beat(100_000_000), []
    signal.signal(signal.SIGALRM, lambda *_: asked.append(time.monotonic_ns()))
    signal.setitimer(signal.ITIMER_REAL, 0.03)
    try:
        assert wait_for_slot(beat) == 0
    finally:
        signal.signal(signal.SIGALRM, signal.SIG_DFL)
    assert beat.clock.woken_ns >= beat.clock.deadline_ns
    time.sleep(0)  # its handler runs as soon as Python does
    assert asked


def test_the_account_of_a_cycle_is_the_clocks() -> None:
    beat, wake, work = Beat(Clock(PERIOD)), Histogram(), Histogram()
    clock, generator, late = beat.clock, np.random.default_rng(1), 0
    memory = beat.memory._replace(rows=np.zeros((1, len(TIMING))))
    for _ in range(500):
        clock.woken_ns = time.monotonic_ns() - int(generator.exponential(PERIOD / 2))
        clock.lateness_ns = int(generator.exponential(PERIOD / 3))
        clock.deadline_ns = clock.woken_ns - clock.lateness_ns
        record_cycle(memory, np.zeros(0), 0)
        wake.add(clock.lateness_ns)
        work.add(clock.work_ns)
        ended = clock.woken_ns + clock.work_ns
        late += ended > clock.deadline_ns + PERIOD or clock.lateness_ns >= PERIOD
    assert clock.late == late > 50
    assert clock.wake.summarise() == wake.summarise()
    assert clock.work.summarise() == work.summarise()
    assert (clock.wake.total, clock.work.total) == (500, 500)


def test_a_row_is_that_of_the_ring(tmp_path: Path) -> None:
    """One that is overwritten, too; with what the cycle before took, and what had been late by then."""
    ring = RingWriter(tmp_path / "ring", [Column("a", "", ""), Column("b", "", ""), *TIMING], 3)
    reader, beat = RingReader(tmp_path / "ring"), Beat(Clock(LONG), ring)
    expected = []
    for number in range(5):
        clock = beat.clock
        clock.woken_ns, clock.lateness_ns, clock.deadline_ns = 10**15 + number, 1500 + number, 10**15 - LONG
        expected.append(
            (number, 0.5, (10**15 + number) / 1e9, (1500 + number) / 1e3, clock.work_ns / 1e3, clock.late, 7)
        )
        record_cycle(beat.memory, np.array([number, 0.5]), 7)
    assert ring.row_count == 5
    np.testing.assert_array_equal(reader.read(), expected[2:])
    assert reader.lost == 2
    ring.write([9.0, 9.0], [0.0] * 5)  # by parts it goes on behind
    assert reader.read()[:, 0].tolist() == [9.0]
    ring.close()


def test_a_clocks_memory_is_its_own() -> None:
    assert 8 * len(Clock(1).words) == CLOCK.itemsize
    first, second = Beat(Clock(1)), Beat(Clock(1))
    first.memory.clocks["late"] = 1
    assert (first.clock.late, second.clock.late) == (1, 0)
