"""The clock of a service: an absolute grid of deadlines, what was late, and the distribution of how late.

Slot k begins at start + k period. A cycle that ends after its slot, or begins after the one it waited for, is late; slots that
are over before a cycle begins, as the one before took too long or the machine stood still, are skipped and counted with that
cycle, so that elapsed slots = cycles run + cycles skipped, always: the grid's phase is never lost.
"""

import time
from array import array
from collections.abc import Callable
from typing import Any

import numpy as np

from protocols.realtime.overrun import skip
from protocols.realtime.waiting import Sleep, Waiting

_BINS = 20_000  # of a histogram: 1 us each
# bins: counts of durations, the last of those beyond; total: their sum; maximum [ns]
HISTOGRAM = np.dtype([("bins", "i8", (_BINS + 1,)), ("total", "i8"), ("maximum", "i8")])
# A clock's memory, which compiled code shares (`beat.py`); times in ns, counts of slots. first: slot of the grid; spare: of
# compiled code; skips: whether slots slept through are just left out, and nobody is to be asked
CLOCK = np.dtype(
    [("period", "i8"), ("first", "i8"), ("deadline", "i8"), ("woken", "i8"), ("lateness", "i8"), ("worked", "i8"),
     ("run", "i8"), ("skipped", "i8"), ("late", "i8"), ("spare", "i8", (2,)), ("skips", "i8"), ("wake", HISTOGRAM),
     ("work", HISTOGRAM)]
)  # fmt: skip


def _place(layout: np.dtype, name: str) -> int:
    """The number of a field's first word, of 8 bytes, in a record of `layout`."""
    assert layout.fields
    return int(layout.fields[name][1]) // 8


_TOTAL, _MAXIMUM = _place(HISTOGRAM, "total"), _place(HISTOGRAM, "maximum")


class Histogram:
    """Counts of durations in bins of 1 us up to 20 ms, for percentiles; constant memory: bins, those beyond, total, maximum.

    Longer ones share the last bin: a percentile that falls there reads 20 ms, the maximum is exact.
    """

    def __init__(self, words: memoryview | None = None) -> None:
        self._words = memoryview(array("q", bytes(HISTOGRAM.itemsize))) if words is None else words

    @property
    def total(self) -> int:
        """Durations counted."""
        return self._words[_TOTAL]

    @property
    def maximum_ns(self) -> int:
        """The longest one [ns]; 0 when there are none."""
        return self._words[_MAXIMUM]

    def add(self, duration_ns: int) -> None:
        """Count a duration [ns]."""
        self._words[min(max(duration_ns, 0) // 1000, _BINS)] += 1
        self._words[_TOTAL] += 1
        if duration_ns > self._words[_MAXIMUM]:
            self._words[_MAXIMUM] = duration_ns

    def percentile(self, percent: float) -> float:
        """Upper edge of the bin in which `percent` of the durations are reached [us]; 0 when there are none."""
        wanted, reached = self.total * percent / 100.0, 0
        for microseconds, count in enumerate(self._words[:_TOTAL]):
            reached += count
            if count and reached >= wanted:
                return min(microseconds + 1.0, self.maximum_ns / 1000.0)
        return 0.0

    def summary(self) -> dict[str, float]:
        """p50, p99, p99.9 and maximum [us]."""
        values = {f"p{percent:g}_us": self.percentile(percent) for percent in (50.0, 99.0, 99.9)}
        return values | {"max_us": self.maximum_ns / 1000.0}


class _Kept:
    """A number of a clock that lies in its memory: the field `name` of CLOCK."""

    def __init__(self, name: str) -> None:
        self._word = _place(CLOCK, name)

    def __get__(self, clock: "Clock", kind: type) -> int:
        return clock.words[self._word]

    def __set__(self, clock: "Clock", value: int) -> None:
        clock.words[self._word] = value


class Clock:
    """Absolute deadlines every `period_ns` on CLOCK_MONOTONIC.

    `waiting` spends the time to a deadline, `overrun` says how many of the slots slept through are left out.

    `run` cycles begun, `skipped` slots slept through, `slots` both, counted with the grid,
    `late` cycles that ended, or began, after the slot they waited for,
    `wake` lateness of wake-ups and `work` durations of cycles; `woken_ns` (of CLOCK_MONOTONIC), `lateness_ns` and
    `work_ns` are the last ones. All that lies in `words`, the memory of a CLOCK.
    """

    period_ns, _first_ns, deadline_ns = _Kept("period"), _Kept("first"), _Kept("deadline")
    woken_ns, lateness_ns, work_ns = _Kept("woken"), _Kept("lateness"), _Kept("worked")
    run, skipped, late, _skips = _Kept("run"), _Kept("skipped"), _Kept("late"), _Kept("skips")

    def __init__(self, period_ns: int, waiting: Waiting | None = None, overrun: Callable[[int], int] = skip) -> None:
        self.words = array(
            "q", bytes(CLOCK.itemsize)
        )  # an element of it is read ten times as fast as a field of a record
        view, wake, work = memoryview(self.words), _place(CLOCK, "wake"), _place(CLOCK, "work")
        self.wake, self.work = Histogram(view[wake:work]), Histogram(view[work:])
        self.waiting, self._overrun = waiting or Sleep(), overrun
        self._skips = overrun is skip
        self.period_ns = self._first_ns = period_ns  # no slot has come

    def start(self, first_deadline_ns: int) -> None:
        """Set the grid: the first slot begins at `first_deadline_ns` of CLOCK_MONOTONIC."""
        self._first_ns = first_deadline_ns
        self.deadline_ns = first_deadline_ns - self.period_ns

    @property
    def slots(self) -> int:
        """Periods from the first slot to the present one, and one: what run and skipped must add up to."""
        return round((self.deadline_ns - self._first_ns) / self.period_ns) + 1

    def wait(self) -> int:
        """Wait until the next slot; return how many slots were left out since the last one."""
        self.deadline_ns += self.period_ns
        due, now = self.deadline_ns, time.monotonic_ns()
        asleep = now < due
        return self.woke(self.waiting(now, due) if asleep else now, asleep)

    def woke(self, now_ns: int, asleep: bool) -> int:
        """The cycle of the slot waited for, `asleep` or in vain, or of a later one, begins `now_ns`; the rest of `wait`."""
        due, missed = self.deadline_ns, 0
        if now_ns >= due + self.period_ns:
            missed = self._overrun((now_ns - due) // self.period_ns)
            self.deadline_ns += missed * self.period_ns
        self.begin(now_ns, missed, now_ns - (due if asleep else self.deadline_ns))
        return missed

    def begin(self, now_ns: int, missed: int, lateness_ns: int) -> None:
        """The cycle of the slot at `deadline_ns` begins `now_ns`; `missed` slots before it were left out.

        It begins `lateness_ns` after the slot that it waited for, be it one of those left out.
        """
        self.run += 1
        self.skipped += missed
        self.woken_ns, self.lateness_ns = now_ns, lateness_ns

    def done(self) -> None:
        """The work of the cycle has ended."""
        now = time.monotonic_ns()
        self.work_ns = now - self.woken_ns
        self.wake.add(self.lateness_ns)
        self.work.add(self.work_ns)
        if now > self.deadline_ns + self.period_ns or self.lateness_ns >= self.period_ns:
            self.late += 1

    def summary(self) -> dict[str, Any]:
        """Counts and distributions, for the end of a run."""
        return {
            "period_us": self.period_ns / 1000.0,
            "slots": self.slots,
            "cycles": self.run,
            "skipped": self.skipped,
            "late": self.late,
            "wake": self.wake.summary(),
            "work": self.work.summary(),
        }
