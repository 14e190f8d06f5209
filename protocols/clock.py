"""The clock of a service: an absolute grid of deadlines, what was late, and the distribution of how late.

Slot k begins at start + k period. A cycle that ends after its slot, or begins after the one it waited for, is late; slots that
are over before a cycle begins, as the one before took too long or the machine stood still, are skipped and counted with that
cycle, so that elapsed slots = cycles run + cycles skipped, always: the grid's phase is never lost.
"""

import time
from collections.abc import Callable
from typing import Any

from protocols.overrun import skip
from protocols.waiting import Sleep, Waiting


class Histogram:
    """Counts of durations in bins of 1 us up to 20 ms, for percentiles; constant memory.

    Longer ones share the last bin: a percentile that falls there reads 20 ms, the maximum is exact.
    """

    BINS = 20_000

    def __init__(self) -> None:
        self._counts = [0] * (self.BINS + 1)
        self.total = 0
        self.maximum_ns = 0

    def add(self, duration_ns: int) -> None:
        """Count a duration [ns]."""
        self._counts[min(max(duration_ns, 0) // 1000, self.BINS)] += 1
        self.total += 1
        if duration_ns > self.maximum_ns:
            self.maximum_ns = duration_ns

    def percentile(self, percent: float) -> float:
        """Upper edge of the bin in which `percent` of the durations are reached [us]; 0 when there are none."""
        wanted, reached = self.total * percent / 100.0, 0
        for microseconds, count in enumerate(self._counts):
            reached += count
            if count and reached >= wanted:
                return min(microseconds + 1.0, self.maximum_ns / 1000.0)
        return 0.0

    def summary(self) -> dict[str, float]:
        """p50, p99, p99.9 and maximum [us]."""
        values = {f"p{percent:g}_us": self.percentile(percent) for percent in (50.0, 99.0, 99.9)}
        return values | {"max_us": self.maximum_ns / 1000.0}


class Clock:
    """Absolute deadlines every `period_ns` on CLOCK_MONOTONIC.

    `waiting` spends the time to a deadline, `overrun` says how many of the slots slept through are left out.

    `run` cycles begun, `skipped` slots slept through, `slots` both, counted with the grid,
    `late` cycles that ended, or began, after the slot they waited for,
    `wake` lateness of wake-ups and `work` durations of cycles; `woken_ns` (of CLOCK_MONOTONIC), `lateness_ns` and
    `work_ns` are the last ones.
    """

    def __init__(self, period_ns: int, waiting: Waiting | None = None, overrun: Callable[[int], int] = skip) -> None:
        self.period_ns = period_ns
        self._waiting, self._overrun = waiting or Sleep(), overrun
        self.run = self.skipped = self.late = 0
        self.wake, self.work = Histogram(), Histogram()
        self.deadline_ns = self.woken_ns = 0
        self._first_ns = period_ns  # no slot has come
        self.lateness_ns = self.work_ns = 0

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
        due, now, missed = self.deadline_ns, time.monotonic_ns(), 0
        asleep = now < due
        if asleep:
            now = self._waiting(now, due)
        if now >= due + self.period_ns:
            missed = self._overrun((now - due) // self.period_ns)
            self.deadline_ns += missed * self.period_ns
        self.begin(now, missed, now - (due if asleep else self.deadline_ns))
        return missed

    def begin(self, now_ns: int, missed: int, lateness_ns: int) -> None:
        """The cycle of the slot at `deadline_ns` begins `now_ns`; `missed` slots before it were left out.

        It begins `lateness_ns` after the slot that it waited for, be it one of those left out.
        """
        self.run += 1
        self.skipped += missed
        self.woken_ns, self.lateness_ns = now_ns, lateness_ns

    def shift(self, by_ns: int) -> None:
        """Move the grid, from the present slot on: it follows another clock. What was accounted for stays so."""
        self.deadline_ns += by_ns
        self._first_ns += by_ns

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
