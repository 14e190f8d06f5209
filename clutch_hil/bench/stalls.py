"""Stalls of a CPU: when the machine did not run it, seen by a loop of nothing on it, above all others.

Method          a thread of the process that asks sleeps from slot to slot in compiled code, without the GIL; a slot that it
                woke late for was lost to the machine, from the slot until it woke
Assumptions     nothing above its priority runs on that CPU; a stall that is shorter than from slot to slot may fall in between
Costs           some 10 us of the CPU a slot (measured at 4 kHz on a virtual machine)
References      Linux, Documentation/trace/hwlat_detector.rst: the same of a kernel, by spinning
"""

import threading
import time
from typing import Any

import numpy as np
from numba import njit

from protocols.buses.exchange import CLOCK_MONOTONIC, now
from protocols.realtime.beat import sleep_until
from protocols.realtime.rights import MEASURES, prepare

_SECOND = 1_000_000_000  # ns
_START_DELAY = 20_000_000  # ns to the first slot at least
_THREAD_MEASURES = tuple(
    m for m in MEASURES if m.name in ("bound to a CPU", "real-time priority")
)  # of a thread; others: a process's


class StallWatch:
    """Watches `cpu` with a priority of SCHED_FIFO in slots every `every_ns`, `phase_ns` behind whole ones, while entered.

    It ends by itself after `seconds` [s]. Where a right is missing it watches without.
    """

    def __init__(self, cpu: int, priority: int, every_ns: int, phase_ns: int, seconds: float) -> None:
        self._rights, self._every = (cpu, priority), every_ns
        self._first = (time.monotonic_ns() + _START_DELAY) // every_ns * every_ns + every_ns + phase_ns % every_ns
        self._woken = np.ones(round(seconds * _SECOND) // every_ns, np.int64)  # touched beforehand
        self._stop_flag = np.zeros(1, np.bool_)
        self._count = 0
        self._thread = threading.Thread(target=self._run, daemon=True)
        _watch(self._first, every_ns, self._woken[:0], self._stop_flag)  # compiled now

    def __enter__(self) -> "StallWatch":
        self._thread.start()
        return self

    def __exit__(self, *_: object) -> None:
        self._stop_flag[0] = True
        self._thread.join()

    @property
    def watched_span(self) -> tuple[int, int]:
        """First and last slot [ns of CLOCK_MONOTONIC]."""
        return self._first, self._first + self._every * (self._count - 1)

    def stalls(self, least_ns: float) -> np.ndarray:
        """Begin and end (n, 2) [ns of CLOCK_MONOTONIC] of every stall that was seen for more than `least_ns`."""
        slots = self._first + self._every * np.arange(self._count)
        woken = self._woken[: self._count]
        late = woken - slots > least_ns
        return np.column_stack([slots[late], woken[late]])

    def _run(self) -> None:
        prepare(*self._rights, _THREAD_MEASURES)
        self._count = _watch(self._first, self._every, self._woken, self._stop_flag)


@njit(cache=True, nogil=True)
def _watch(first: Any, every: Any, woken: Any, stop_flag: Any) -> Any:
    """Write when it woke for slot after slot [ns]; for those slept through, the same. Return for how many."""
    times, k = np.zeros(2, np.int64), 0
    while k < woken.size and not stop_flag[0]:
        slot = first + k * every
        sleep_until(slot, times)
        at = now(CLOCK_MONOTONIC, times)
        while k < woken.size and first + k * every <= at:
            woken[k] = at
            k += 1
    return k
