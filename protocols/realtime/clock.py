"""The clock of a service: an absolute grid of deadlines, counts of late cycles, and distributions of their lateness.

Slot k begins at start + k period. A cycle is late if it ends after its slot, or begins after the slot that it waited for.
Slots that end before a cycle begins are skipped and counted with that cycle: the cycle before took too long, or the machine
stood still. So slots = cycles run + slots skipped at any time, and the phase of the grid is never lost.
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
# A clock's memory, which compiled code shares (`beat.py`); times in ns, counts of slots. first: slot of the grid; spare: for
# compiled code; skips: whether missed slots are skipped without calling the overrun policy
CLOCK = np.dtype(
    [("period", "i8"), ("first", "i8"), ("deadline", "i8"), ("woken", "i8"), ("lateness", "i8"), ("worked", "i8"),
     ("run", "i8"), ("skipped", "i8"), ("late", "i8"), ("spare", "i8", (2,)), ("skips", "i8"), ("wake", HISTOGRAM),
     ("work", HISTOGRAM)]
)  # fmt: skip


def _place(layout: np.dtype, name: str) -> int:
    """Return the index of a field's first 8-byte word in a record of `layout`."""
    assert layout.fields
    return int(layout.fields[name][1]) // 8


_TOTAL, _MAXIMUM = _place(HISTOGRAM, "total"), _place(HISTOGRAM, "maximum")


class Histogram:
    """Counts of durations in bins of 1 us up to 20 ms, for percentiles. Its memory is constant: bins, total and maximum.

    Longer durations share the last bin: a percentile in that bin is given as 20 ms. The maximum is exact.
    """

    def __init__(self, words: memoryview | None = None) -> None:
        self._words = memoryview(array("q", bytes(HISTOGRAM.itemsize))) if words is None else words

    @property
    def total(self) -> int:
        """Number of counted durations."""
        return self._words[_TOTAL]

    @property
    def maximum_ns(self) -> int:
        """Longest duration [ns]; 0 if there is none."""
        return self._words[_MAXIMUM]

    def add(self, duration_ns: int) -> None:
        """Count a duration [ns]."""
        self._words[min(max(duration_ns, 0) // 1000, _BINS)] += 1
        self._words[_TOTAL] += 1
        if duration_ns > self._words[_MAXIMUM]:
            self._words[_MAXIMUM] = duration_ns

    def compute_percentile(self, percent: float) -> float:
        """Return the upper edge of the bin that contains the percentile `percent` [us]; 0 without durations."""
        wanted, reached = self.total * percent / 100.0, 0
        for microseconds, count in enumerate(self._words[:_TOTAL]):
            reached += count
            if count and reached >= wanted:
                return min(microseconds + 1.0, self.maximum_ns / 1000.0)
        return 0.0

    def summarise(self) -> dict[str, float]:
        """Return p50, p99, p99.9 and maximum [us]."""
        values = {f"p{percent:g}_us": self.compute_percentile(percent) for percent in (50.0, 99.0, 99.9)}
        return values | {"max_us": self.maximum_ns / 1000.0}


class _StoredWord:
    """Attribute of a clock that is stored in its memory: the field `name` of CLOCK."""

    def __init__(self, name: str) -> None:
        self._word = _place(CLOCK, name)

    def __get__(self, clock: "Clock", kind: type) -> int:
        return clock.words[self._word]

    def __set__(self, clock: "Clock", value: int) -> None:
        clock.words[self._word] = value


class Clock:
    """Absolute deadlines every `period_ns` on CLOCK_MONOTONIC.

    waiting: waits until a deadline. overrun: returns how many of the missed slots are skipped.

    run: cycles begun. skipped: slots skipped. slots: both, counted by the grid. late: cycles that ended, or began, after the
    slot they waited for. wake, work: histograms of the lateness of wake-ups and of the duration of cycles. woken_ns (of
    CLOCK_MONOTONIC), lateness_ns, work_ns: of the last cycle. All of it is stored in `words`, the memory of a CLOCK.
    """

    period_ns, _first_ns, deadline_ns = _StoredWord("period"), _StoredWord("first"), _StoredWord("deadline")
    woken_ns, lateness_ns, work_ns = _StoredWord("woken"), _StoredWord("lateness"), _StoredWord("worked")
    run, skipped, late, _skips = _StoredWord("run"), _StoredWord("skipped"), _StoredWord("late"), _StoredWord("skips")

    def __init__(self, period_ns: int, waiting: Waiting | None = None, overrun: Callable[[int], int] = skip) -> None:
        self.words = array(
            "q", bytes(CLOCK.itemsize)
        )  # an element of it is read ten times as fast as a field of a record
        view, wake, work = memoryview(self.words), _place(CLOCK, "wake"), _place(CLOCK, "work")
        self.wake, self.work = Histogram(view[wake:work]), Histogram(view[work:])
        self.waiting, self._overrun = waiting or Sleep(), overrun
        self._skips = overrun is skip
        self.period_ns = self._first_ns = period_ns  # as if no slot had come

    def start(self, first_deadline_ns: int) -> None:
        """Set the grid: the first slot begins at `first_deadline_ns` of CLOCK_MONOTONIC."""
        self._first_ns = first_deadline_ns
        self.deadline_ns = first_deadline_ns - self.period_ns

    @property
    def slots(self) -> int:
        """Slots from the first to the present one, both included: cycles run plus slots skipped."""
        return round((self.deadline_ns - self._first_ns) / self.period_ns) + 1

    def wait(self) -> int:
        """Wait until the next slot; return how many slots were skipped since the last one."""
        self.deadline_ns += self.period_ns
        due, now = self.deadline_ns, time.monotonic_ns()
        asleep = now < due
        return self.wake_up(self.waiting(now, due) if asleep else now, asleep)

    def wake_up(self, now_ns: int, asleep: bool) -> int:
        """Begin the cycle of the present slot, or of a later one after missed slots, at `now_ns`; return the skipped slots.

        asleep: whether the loop waited for the slot; False if it came too late. This is the second half of `wait`.
        """
        due, missed = self.deadline_ns, 0
        if now_ns >= due + self.period_ns:
            missed = self._overrun((now_ns - due) // self.period_ns)
            self.deadline_ns += missed * self.period_ns
        self.begin_cycle(now_ns, missed, now_ns - (due if asleep else self.deadline_ns))
        return missed

    def begin_cycle(self, now_ns: int, missed: int, lateness_ns: int) -> None:
        """Begin the cycle of the slot at `deadline_ns`, at `now_ns`, after `missed` skipped slots.

        lateness_ns: time since the slot that it waited for, which may be one of the skipped slots.
        """
        self.run += 1
        self.skipped += missed
        self.woken_ns, self.lateness_ns = now_ns, lateness_ns

    def end_cycle(self) -> None:
        """End the cycle: record its timing."""
        now = time.monotonic_ns()
        self.work_ns = now - self.woken_ns
        self.wake.add(self.lateness_ns)
        self.work.add(self.work_ns)
        if now > self.deadline_ns + self.period_ns or self.lateness_ns >= self.period_ns:
            self.late += 1

    def summarise(self) -> dict[str, Any]:
        """Return the counts and distributions of the run, for JSON."""
        return {
            "period_us": self.period_ns / 1000.0,
            "slots": self.slots,
            "cycles": self.run,
            "skipped": self.skipped,
            "late": self.late,
            "wake": self.wake.summarise(),
            "work": self.work.summarise(),
        }
