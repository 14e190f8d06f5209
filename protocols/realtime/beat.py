"""Beat: the clock of a loop in compiled code, on the clock's own memory: a slot waited for, a cycle's row and account.

Same as         Clock.wait where slots slept through are left out, SleepThenSpin, Clock.done, RingWriter.write
Method          clock_nanosleep(2) to the absolute time; nothing of Python, which is cold after a sleep, runs before the turn
                that follows in the same call, nor between turns, of which a call makes several
"""

from typing import Any, NamedTuple

import numpy as np
from numba import njit, types

from protocols.buses.exchange import CLOCK_MONOTONIC, now, system
from protocols.node import Column, record_type
from protocols.realtime.clock import CLOCK, Clock
from protocols.realtime.mailbox import ANSWERED, ASKED, WORDS, Mailbox
from protocols.realtime.ring import RingWriter
from protocols.realtime.waiting import MARGIN, MEMORY

OVERRUN, OVERSLEPT = -1, -2  # what `wait` returns where the clock's policy for overruns is to be asked
_ABSOLUTE = 1  # TIMER_ABSTIME of linux/time.h
_SECOND = 1_000_000_000  # ns
# ns that compiled code stays at most, though nobody asks for anything: who waits for a service to end does so for ten seconds.
# What Python does in between costs 0.15 ms, as all of it is cold, which at 4 kHz and above makes the next cycle late
_STAY = 2_000_000_000
# What a row has of its cycle beside the node's record
TIMING = (
    Column("clock_s", "s", "CLOCK_MONOTONIC when the cycle began"),
    Column("wake_us", "us", "lateness of the cycle's wake-up"),
    Column("work_us", "us", "duration of the cycle before"),
    Column("late_cycles", "1", "cycles that ended after their slot, total"),
    Column("parameter_changes", "1", "parameters changed while running, total"),
)
_TIMING_RECORD, _TIMES = record_type(TIMING), len(TIMING)

_clock_nanosleep = system("clock_nanosleep", types.int32, types.int32, types.int32, types.int64, types.int64)


class BeatMemory(NamedTuple):
    """What compiled code works on of a Beat: the memory of its clock, waiting, ring and mailbox.

    clocks (1,) of CLOCK; spins (2,) of `Waiting`; rows (capacity + 1, columns) and counts (1,) of `RingWriter`; numbers (4,)
    of `Mailbox`.
    """

    clocks: np.ndarray
    spins: np.ndarray
    rows: np.ndarray
    counts: np.ndarray
    numbers: np.ndarray


class Beat:
    """`clock` for compiled code, which works on the same `memory`.

    One call of compiled code may make `most` turns, whose rows but the last one's it writes to `ring`, and ends early where
    `mailbox` has a request (`called`); without them it makes one.
    """

    def __init__(self, clock: Clock, ring: RingWriter | None = None, mailbox: Mailbox | None = None) -> None:
        self.clock, self._ring, self._mailbox = clock, ring, mailbox
        self.most = max(1, _STAY // clock.period_ns) if ring else 1

    @property
    def memory(self) -> BeatMemory:
        """Made anew for each call: whoever keeps it keeps the ring's file open."""
        clock, waits = np.frombuffer(self.clock.words, CLOCK), np.frombuffer(self.clock.waiting.words, np.int64)
        rows, counts = (self._ring.rows, self._ring.counts) if self._ring else (np.zeros((1, 0)), np.zeros(1, np.int64))
        return BeatMemory(
            clock, waits, rows, counts, self._mailbox.numbers if self._mailbox else np.zeros(WORDS, np.int64)
        )

    def book(self, row: np.ndarray, changes: int) -> None:
        """The cycle has ended: write its row, with `changes` of parameters so far, and let the clock know, in one call."""
        book(self.memory, row, changes)

    def woke(self, how: int) -> int:
        """What is left to do after a `wait` that began no cycle: see `Clock.woke`."""
        return self.clock.woke(self.clock.woken_ns, how == OVERSLEPT)


def warm_book() -> None:
    """Compile, or load from disk, what writes a row: now, not in the loop."""
    book(Beat(Clock(1)).memory._replace(rows=np.zeros((1, 1 + _TIMES))), np.zeros(1), 0)


@njit(cache=True, nogil=True)
def wait(beat: Any) -> Any:
    """Wait for the next slot of a BeatMemory. Returns how many were left out since the last one.

    Where slots are over, and the policy for overruns is not to leave them out: OVERRUN or OVERSLEPT, with no cycle begun.
    """
    clock = beat.clocks[0]
    clock.deadline += clock.period
    due = clock.deadline
    at = now(CLOCK_MONOTONIC, clock.spare)
    asleep = at < due
    if asleep:
        at = _until(due, at, clock, beat.spins)
    clock.woken, missed = at, 0
    if at >= due + clock.period:
        if clock.skips == 0:
            return OVERSLEPT if asleep else OVERRUN
        missed = (at - due) // clock.period
        clock.deadline += missed * clock.period
    clock.run += 1
    clock.skipped += missed
    clock.lateness = at - (due if asleep else clock.deadline)
    return missed


@njit
def _until(due, at, clock, spins):
    """Return once `due` has come; what the clock says then [ns]."""
    spin, most = spins[0], spins[1]
    begin = due - spin
    if at < begin:
        while at < begin:  # a signal may end a sleep
            sleep_until(begin, clock.spare)
            at = now(CLOCK_MONOTONIC, clock.spare)
        if most > 0:
            needed = min(at - begin + MARGIN, most)
            spins[0] = needed if needed > spin else spin - (spin - needed) // MEMORY
    while at < due:
        at = now(CLOCK_MONOTONIC, clock.spare)
    return at


@njit
def sleep_until(due, times):
    """Sleep until `due` of CLOCK_MONOTONIC [ns]; `times` (2,) is overwritten. Not 0 where a signal has ended it."""
    times[0], times[1] = due // _SECOND, due % _SECOND
    return _clock_nanosleep(CLOCK_MONOTONIC, _ABSOLUTE, times.ctypes.data, 0)


@njit(cache=True, nogil=True)
def arrive(clocks: Any, woken: Any, arrived: Any, slots: Any) -> None:
    """A cycle has begun, `woken` by a sample that `arrived` [ns], `slots` after the one before: the grid goes with it."""
    clock = clocks[0]
    clock.first += arrived - clock.deadline - slots * clock.period
    clock.deadline, clock.woken, clock.lateness = arrived, woken, woken - arrived
    clock.run += 1
    clock.skipped += slots - 1


@njit
def called(line, beat):
    """Whether Python is to look: a signal has been seen, or there is a request to the mailbox of a BeatMemory."""
    return line.signalled or beat.numbers[ASKED] != beat.numbers[ANSWERED]


@njit(cache=True, nogil=True)
def book(beat: Any, row: Any, changes: Any) -> None:
    """The cycle has ended: write its row, then the account of `Clock.done`."""
    at, clock = write(beat, row, changes), beat.clocks[0]
    clock.worked = at - clock.woken
    _add(clock.wake, clock.lateness)
    _add(clock.work, clock.worked)
    if at > clock.deadline + clock.period or clock.lateness >= clock.period:
        clock.late += 1


@njit(cache=True, nogil=True)
def write(beat: Any, row: Any, changes: Any) -> Any:
    """Write a row, which is `row` and TIMING, to the ring of a BeatMemory; returns what the clock says then [ns]."""
    clock, place, width = beat.clocks[0], beat.rows[beat.counts[0] % beat.rows.shape[0]], row.size
    for column in range(width):
        place[column] = row[column]
    timing = place[width : width + _TIMES].view(_TIMING_RECORD)[0]
    timing.clock_s, timing.wake_us = clock.woken / 1e9, clock.lateness / 1e3
    timing.work_us, timing.late_cycles, timing.parameter_changes = clock.worked / 1e3, clock.late, changes
    at = now(CLOCK_MONOTONIC, clock.spare)  # a call between: the count is stored after the row
    beat.counts[0] += 1
    return at


@njit
def _add(histogram, duration):
    """As `Histogram.add`."""
    histogram.bins[min(max(duration, 0) // 1000, histogram.bins.size - 1)] += 1
    histogram.total += 1
    histogram.maximum = max(histogram.maximum, duration)
