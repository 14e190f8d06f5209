"""Beat: the clock of a loop in compiled code, on the clock's own memory: a slot waited for, a cycle's row and account.

Same as         Clock.wait where slots slept through are left out, SleepThenSpin, Clock.done, RingWriter.write
Method          clock_nanosleep(2) to the absolute time; nothing of Python, which is cold after a sleep, runs before the turn
                that follows in the same call, nor between turns, of which a call makes several
"""

from typing import Any

import numpy as np
from numba import njit, types

from protocols.buses.exchange import CLOCK_MONOTONIC, now, system
from protocols.realtime.clock import Clock, Histogram, Word
from protocols.realtime.mailbox import ANSWERED, ASKED, WORDS, Mailbox
from protocols.realtime.ring import RingWriter
from protocols.realtime.waiting import MARGIN, MEMORY

OVERRUN, OVERSLEPT = -1, -2  # what `wait` returns where the clock's policy for overruns is to be asked
_ABSOLUTE = 1  # TIMER_ABSTIME of linux/time.h
_SECOND = 1_000_000_000  # ns
# ns that compiled code stays at most, though nobody asks for anything: who waits for a service to end does so for ten seconds.
# What Python does in between costs 0.15 ms, as all of it is cold, which at 4 kHz and above makes the next cycle late
_STAY = 2_000_000_000
_BINS = Histogram.BINS
# as numbers, in the order in which they stand there
_PERIOD, _FIRST, _DEADLINE, _WOKEN, _LATENESS, _WORKED, _RUN, _SKIPPED, _LATE, _SPARE, _SKIPS, _WAKE = (
    int(word) for word in Word
)
_WORK = _WAKE + Histogram.WORDS

_clock_nanosleep = system("clock_nanosleep", types.int32, types.int32, types.int32, types.int64, types.int64)


class Beat:
    """`clock` for compiled code: `words` of it, and `spins` of its waiting, are the same memory.

    One call of compiled code may make `most` turns, whose rows but the last one's it writes to `ring`, and ends early where
    `mailbox` has a request (`called`); without them it makes one.
    """

    def __init__(self, clock: Clock, ring: RingWriter | None = None, mailbox: Mailbox | None = None) -> None:
        self.clock, self._ring, self._mailbox = clock, ring, mailbox
        self.words, self.spins = (np.frombuffer(kept, np.int64) for kept in (clock.words, clock.waiting.words))
        self.most = max(1, _STAY // clock.period_ns) if ring else 1

    @property
    def outlet(self) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Rows and counts of the ring and numbers of the mailbox, shapes (capacity + 1, columns), (1,) and (4,)."""
        rows, counts = (self._ring.rows, self._ring.counts) if self._ring else (np.zeros((1, 0)), np.zeros(1, np.int64))
        return rows, counts, self._mailbox.numbers if self._mailbox else np.zeros(WORDS, np.int64)

    def book(self, row: np.ndarray, changes: int) -> None:
        """The cycle has ended: write its row, with `changes` of parameters so far, and let the clock know, in one call."""
        rows, counts, _ = self.outlet
        book(self.words, rows, counts, row, changes)

    def woke(self, how: int) -> int:
        """What is left to do after a `wait` that began no cycle: see `Clock.woke`."""
        return self.clock.woke(self.clock.woken_ns, how == OVERSLEPT)


def warm_book() -> None:
    """Compile, or load from disk, what writes a row: now, not in the loop."""
    book(Beat(Clock(1)).words, np.zeros((1, 8)), np.zeros(1, np.int64), np.zeros(1), 0)


@njit(cache=True, nogil=True)
def wait(words: Any, spins: Any) -> Any:
    """Wait for the next slot. Returns how many were left out since the last one.

    Where slots are over, and the policy for overruns is not to leave them out: OVERRUN or OVERSLEPT, with no cycle begun.
    """
    words[_DEADLINE] += words[_PERIOD]
    due, times = words[_DEADLINE], words[_SPARE : _SPARE + 2]
    at = now(CLOCK_MONOTONIC, times)
    asleep = at < due
    if asleep:
        at = _until(due, at, words, spins, times)
    words[_WOKEN], missed = at, 0
    if at >= due + words[_PERIOD]:
        if words[_SKIPS] == 0:
            return OVERSLEPT if asleep else OVERRUN
        missed = (at - due) // words[_PERIOD]
        words[_DEADLINE] += missed * words[_PERIOD]
    words[_RUN] += 1
    words[_SKIPPED] += missed
    words[_LATENESS] = at - (due if asleep else words[_DEADLINE])
    return missed


@njit
def _until(due, at, words, spins, times):
    """Return once `due` has come; what the clock says then [ns]."""
    spin, most = spins[0], spins[1]
    begin = due - spin
    if at < begin:
        while at < begin:  # a signal may end a sleep
            sleep_until(begin, times)
            at = now(CLOCK_MONOTONIC, times)
        if most > 0:
            needed = min(at - begin + MARGIN, most)
            spins[0] = needed if needed > spin else spin - (spin - needed) // MEMORY
    while at < due:
        at = now(CLOCK_MONOTONIC, times)
    return at


@njit
def sleep_until(due, times):
    """Sleep until `due` of CLOCK_MONOTONIC [ns]; `times` (2,) is overwritten. Not 0 where a signal has ended it."""
    times[0], times[1] = due // _SECOND, due % _SECOND
    return _clock_nanosleep(CLOCK_MONOTONIC, _ABSOLUTE, times.ctypes.data, 0)


@njit(cache=True, nogil=True)
def arrive(words: Any, woken: Any, arrived: Any, slots: Any) -> None:
    """A cycle has begun, `woken` by a sample that `arrived` [ns], `slots` after the one before: the grid goes with it."""
    words[_FIRST] += arrived - words[_DEADLINE] - slots * words[_PERIOD]
    words[_DEADLINE], words[_WOKEN], words[_LATENESS] = arrived, woken, woken - arrived
    words[_RUN] += 1
    words[_SKIPPED] += slots - 1


@njit
def called(line, numbers):
    """Whether Python is to look: a signal has been seen, or there is a request to the mailbox of `numbers`."""
    return line.signalled or numbers[ASKED] != numbers[ANSWERED]


@njit(cache=True, nogil=True)
def book(words: Any, rows: Any, counts: Any, row: Any, changes: Any) -> None:
    """The cycle has ended: write its row, then the account of `Clock.done`."""
    at = write(words, rows, counts, row, changes)
    words[_WORKED] = at - words[_WOKEN]
    _add(words, _WAKE, words[_LATENESS])
    _add(words, _WORK, words[_WORKED])
    if at > words[_DEADLINE] + words[_PERIOD] or words[_LATENESS] >= words[_PERIOD]:
        words[_LATE] += 1


@njit(cache=True, nogil=True)
def write(words: Any, rows: Any, counts: Any, row: Any, changes: Any) -> Any:
    """A row, which is `row` and TIMING of `outlet.py`, to a ring; returns what the clock says then [ns]."""
    place, width = rows[counts[0] % rows.shape[0]], row.size
    for column in range(width):
        place[column] = row[column]
    place[width], place[width + 1] = words[_WOKEN] / 1e9, words[_LATENESS] / 1e3
    place[width + 2], place[width + 3], place[width + 4] = words[_WORKED] / 1e3, words[_LATE], changes
    at = now(CLOCK_MONOTONIC, words[_SPARE : _SPARE + 2])  # a call between: the count is stored after the row
    counts[0] += 1
    return at


@njit
def _add(words, histogram, duration):
    """As `Histogram.add`."""
    words[histogram + min(max(duration, 0) // 1000, _BINS)] += 1
    words[histogram + _BINS + 1] += 1
    words[histogram + _BINS + 2] = max(words[histogram + _BINS + 2], duration)
