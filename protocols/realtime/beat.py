"""Beat: the clock of a loop for compiled code. It waits for a slot, and records the row and the timing of a cycle.

It works on the memory of a `Clock` and does what these do: `Clock.wait` with the policy "skip", `SleepThenSpin`,
`Clock.end_cycle`, `RingWriter.write`.

Method          clock_nanosleep(2) to the absolute time. The cycle follows in the same call, and one call makes several cycles.
                So no Python code, whose memory is out of the caches after a sleep, runs before a cycle
"""

from typing import Any

import numpy as np
from numba import njit, types

from protocols.buses.exchange import CLOCK_MONOTONIC, now, system
from protocols.realtime.clock import Clock, Histogram, Word
from protocols.realtime.mailbox import ANSWER_NUMBER, REQUEST_NUMBER, WORDS, Mailbox
from protocols.realtime.ring import RingWriter
from protocols.realtime.waiting import SPIN_DECAY_SLEEPS, WAKE_MARGIN_NS

OVERRUN, OVERSLEPT = -1, -2  # returned by `wait` where the clock's policy for overruns must decide
_ABSOLUTE = 1  # TIMER_ABSTIME of linux/time.h
_SECOND = 1_000_000_000  # ns
# ns, longest call of compiled code without a request: others wait ten seconds for the end of a service. Each return to Python
# costs 0.15 ms, as its memory is out of the caches. At 4 kHz and above that makes the next cycle late.
_LONGEST_CALL = 2_000_000_000
_BINS = Histogram.BINS
# places of a clock's words, as compiled code takes them
_PERIOD, _FIRST, _DEADLINE, _WOKEN, _LATENESS, _WORKED, _RUN, _SKIPPED, _LATE, _SPARE, _SKIPS, _WAKE = (
    int(word) for word in Word
)
_WORK = _WAKE + Histogram.WORDS

_clock_nanosleep = system("clock_nanosleep", types.int32, types.int32, types.int32, types.int64, types.int64)


class Beat:
    """`clock` for compiled code. Its `words`, and the `spins` of its waiting, are the same memory as the clock's.

    One call of compiled code makes up to `most` cycles. It writes all rows but the last to `ring`, and ends early where
    `mailbox` has a request (`is_called`). Without a ring it makes one cycle.
    """

    def __init__(self, clock: Clock, ring: RingWriter | None = None, mailbox: Mailbox | None = None) -> None:
        self.clock, self._ring, self._mailbox = clock, ring, mailbox
        self.words, self.spins = (np.frombuffer(kept, np.int64) for kept in (clock.words, clock.waiting.words))
        self.most = max(1, _LONGEST_CALL // clock.period_ns) if ring else 1

    @property
    def outlet(self) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Rows (capacity + 1, columns) and counts (1,) of the ring, and numbers (4,) of the mailbox."""
        rows, counts = (self._ring.rows, self._ring.counts) if self._ring else (np.zeros((1, 0)), np.zeros(1, np.int64))
        return rows, counts, self._mailbox.numbers if self._mailbox else np.zeros(WORDS, np.int64)

    def record_cycle(self, row: np.ndarray, changes: int) -> None:
        """End a cycle: write its row (columns,), with the number of parameter `changes` so far, and record its timing."""
        rows, counts, _ = self.outlet
        record_cycle(self.words, rows, counts, row, changes)

    def wake_up(self, how: int) -> int:
        """Begin the cycle after a `wait` that returned `how`, OVERRUN or OVERSLEPT; see `Clock.wake_up`."""
        return self.clock.wake_up(self.clock.woken_ns, how == OVERSLEPT)


def compile_record_cycle() -> None:
    """Compile `record_cycle`, or load it from disk, before the loop begins."""
    record_cycle(Beat(Clock(1)).words, np.zeros((1, 8)), np.zeros(1, np.int64), np.zeros(1), 0)


@njit(cache=True, nogil=True)
def wait(words: Any, spins: Any) -> Any:
    """Wait for the next slot, and return how many were left out since the last one.

    Where slots are over and the clock's policy is not "skip", return OVERRUN or OVERSLEPT, without a cycle begun.
    """
    words[_DEADLINE] += words[_PERIOD]
    due, times = words[_DEADLINE], words[_SPARE : _SPARE + 2]
    at = now(CLOCK_MONOTONIC, times)
    asleep = at < due
    if asleep:
        at = _wait_until(due, at, words, spins, times)
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
def _wait_until(due, at, words, spins, times):
    """Wait until `due` [ns of CLOCK_MONOTONIC]; return the time then [ns]."""
    spin, most = spins[0], spins[1]
    begin = due - spin
    if at < begin:
        while at < begin:  # a signal may end a sleep
            sleep_until(begin, times)
            at = now(CLOCK_MONOTONIC, times)
        if most > 0:
            needed = min(at - begin + WAKE_MARGIN_NS, most)
            spins[0] = needed if needed > spin else spin - (spin - needed) // SPIN_DECAY_SLEEPS
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
    """Begin a cycle at `woken` [ns] for a sample that `arrived` [ns], `slots` after the one before; move the grid with it."""
    words[_FIRST] += arrived - words[_DEADLINE] - slots * words[_PERIOD]
    words[_DEADLINE], words[_WOKEN], words[_LATENESS] = arrived, woken, woken - arrived
    words[_RUN] += 1
    words[_SKIPPED] += slots - 1


@njit
def is_called(line, numbers):
    """Whether Python has something to do: a signal has come, or the mailbox of `numbers` (4,) has a request."""
    return line.signalled or numbers[REQUEST_NUMBER] != numbers[ANSWER_NUMBER]


@njit(cache=True, nogil=True)
def record_cycle(words: Any, rows: Any, counts: Any, row: Any, changes: Any) -> None:
    """End a cycle: write its row, then record its timing as `Clock.end_cycle` does."""
    at = write(words, rows, counts, row, changes)
    words[_WORKED] = at - words[_WOKEN]
    _add_duration(words, _WAKE, words[_LATENESS])
    _add_duration(words, _WORK, words[_WORKED])
    if at > words[_DEADLINE] + words[_PERIOD] or words[_LATENESS] >= words[_PERIOD]:
        words[_LATE] += 1


@njit(cache=True, nogil=True)
def write(words: Any, rows: Any, counts: Any, row: Any, changes: Any) -> Any:
    """Write a row, `row` and the columns TIMING of `outlet.py`, to a ring; return the time then [ns]."""
    place, width = rows[counts[0] % rows.shape[0]], row.size
    for column in range(width):
        place[column] = row[column]
    place[width], place[width + 1] = words[_WOKEN] / 1e9, words[_LATENESS] / 1e3
    place[width + 2], place[width + 3], place[width + 4] = words[_WORKED] / 1e3, words[_LATE], changes
    at = now(CLOCK_MONOTONIC, words[_SPARE : _SPARE + 2])  # a call between: the count is stored after the row
    counts[0] += 1
    return at


@njit
def _add_duration(words, histogram, duration):
    """Count a `duration` [ns] in the histogram that begins at word `histogram`; see `Histogram.add`."""
    words[histogram + min(max(duration, 0) // 1000, _BINS)] += 1
    words[histogram + _BINS + 1] += 1
    words[histogram + _BINS + 2] = max(words[histogram + _BINS + 2], duration)
