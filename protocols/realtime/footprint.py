"""Footprint: page faults, garbage collections, threads and preemptions of a loop while it ran; in steady state all are 0.

Assumptions     called by the thread of the loop
References      getrusage(2), RUSAGE_THREAD
"""

import gc
import os
import resource


class Footprint:
    """Counts since the object was created."""

    def __init__(self) -> None:
        self._threads = _count_threads()
        self._collections = _count_collections()
        self._usage = resource.getrusage(resource.RUSAGE_THREAD)

    def summarise(self) -> dict[str, int]:
        """Return `minor_faults` and `major_faults` (from disk) of the loop's thread, `collections`, threads `begun`, and
        `preemptions`: times that the CPU was taken away."""
        now, before = resource.getrusage(resource.RUSAGE_THREAD), self._usage
        return {
            "minor_faults": now.ru_minflt - before.ru_minflt,
            "major_faults": now.ru_majflt - before.ru_majflt,
            "preemptions": now.ru_nivcsw - before.ru_nivcsw,
            "collections": _count_collections() - self._collections,
            "threads_begun": _count_threads() - self._threads,
        }


def _count_collections() -> int:
    return sum(int(generation["collections"]) for generation in gc.get_stats())


def _count_threads() -> int:
    return len(os.listdir("/proc/self/task"))
