"""Stopwatch that leaves out the time in which threads of this process waited for a CPU."""

import time
from contextlib import suppress
from pathlib import Path

_TASKS = Path("/proc/self/task")
_WAITED = 1  # field of a thread's schedstat: time in which it was ready but had no CPU [ns]


class Stopwatch:
    """A stopwatch that starts when it is made. On an idle machine it shows the same time as a clock.

    On a busy machine it subtracts the time in which threads of this process waited for a CPU. All threads count, because a
    thread without a CPU may hold a lock that another one needs.
    """

    def __init__(self) -> None:
        self._began = time.monotonic()
        # read after the clock: a wait between the two readings would be subtracted without being in the time
        self._waited = _read_waited()

    def read_seconds(self) -> float:
        """Return the time since the start [s], at least 0."""
        waited = _read_waited() - self._waited  # read before the clock, for the same reason
        return max(0.0, time.monotonic() - self._began - max(0, waited) * 1e-9)


def _read_waited() -> int:
    """Return the time in which threads of this process waited for a CPU [ns]; 0 if the kernel does not measure it."""
    waited = 0
    for task in _TASKS.iterdir():
        with suppress(OSError):  # the thread has ended
            waited += int((task / "schedstat").read_text().split()[_WAITED])
    return waited
