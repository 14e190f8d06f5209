"""Stalls of a CPU: times in which a process gets no CPU time, found by an empty loop of the highest priority.

Method          a thread sleeps from slot to slot in compiled code, without the GIL. Where it wakes late, the time from the
                slot to the wake-up was lost to the machine
Assumptions     nothing of a higher priority runs on that CPU. A stall between two slots is not found
Costs           about 10 us of the CPU for each slot (measured at 4 kHz on a virtual machine)
References      Linux, Documentation/trace/hwlat_detector.rst: the same measurement in the kernel, by spinning
"""

import threading
import time
from typing import Any

import numpy as np
from numba import njit

from protocols.buses.exchange import CLOCK_MONOTONIC, read_clock
from protocols.realtime.beat import sleep_until
from protocols.realtime.rights import MEASURES, prepare

_SECOND = 1_000_000_000  # ns
_START_DELAY = 20_000_000  # ns, least time to the first slot
_THREAD_MEASURES = tuple(
    m for m in MEASURES if m.name in ("bound to a CPU", "real-time priority")
)  # of a thread; others: a process's


class StallWatch:
    """Watch `cpu` while entered, in slots every `every_ns` [ns], `phase_ns` [ns] after whole multiples of that.

    priority: of SCHED_FIFO. The watch ends by itself after `seconds` [s]. Where the process may not set priority or CPU, it
    watches without them.
    """

    def __init__(self, cpu: int, priority: int, every_ns: int, phase_ns: int, seconds: float) -> None:
        self._rights, self._every = (cpu, priority), every_ns
        self._first = (time.monotonic_ns() + _START_DELAY) // every_ns * every_ns + every_ns + phase_ns % every_ns
        self._woken = np.ones(round(seconds * _SECOND) // every_ns, np.int64)  # allocates the memory now
        self._stop_flag = np.zeros(1, np.bool_)
        self._count = 0
        self._thread = threading.Thread(target=self._run, daemon=True)
        _watch(self._first, every_ns, self._woken[:0], self._stop_flag)  # compiles it before the thread starts

    def __enter__(self) -> "StallWatch":
        self._thread.start()
        return self

    def __exit__(self, *_: object) -> None:
        self._stop_flag[0] = True
        self._thread.join()

    @property
    def watched_span(self) -> tuple[int, int]:
        """Return the first and the last watched slot [ns of CLOCK_MONOTONIC]."""
        return self._first, self._first + self._every * (self._count - 1)

    def list_stalls(self, least_ns: float) -> np.ndarray:
        """Return begin and end (n, 2) [ns of CLOCK_MONOTONIC] of every stall longer than `least_ns` [ns]."""
        slots = self._first + self._every * np.arange(self._count)
        woken = self._woken[: self._count]
        late = woken - slots > least_ns
        return np.column_stack([slots[late], woken[late]])

    def _run(self) -> None:
        prepare(*self._rights, _THREAD_MEASURES)
        self._count = _watch(self._first, self._every, self._woken, self._stop_flag)


@njit(cache=True, nogil=True)
def _watch(first: Any, every: Any, woken: Any, stop_flag: Any) -> Any:
    """Write the wake-up time of every slot to `woken` (n,) [ns]; return the number of slots.

    Slots during a sleep get the time of the next wake-up.
    """
    times, k = np.zeros(2, np.int64), 0
    while k < woken.size and not stop_flag[0]:
        slot = first + k * every
        sleep_until(slot, times)
        at = read_clock(CLOCK_MONOTONIC, times)
        while k < woken.size and first + k * every <= at:
            woken[k] = at
            k += 1
    return k
