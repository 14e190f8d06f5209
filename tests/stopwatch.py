"""How long something of this process took, had every thread that wanted a CPU been given one."""

import time
from contextlib import suppress
from pathlib import Path

_TASKS = Path("/proc/self/task")
_WAITED = 1  # of a thread's schedstat: ns that it was ready and another had the CPU


class Stopwatch:
    """Runs from where it is made. On a machine that is not full it shows what any clock does.

    Where it is full, what the threads of this process waited for a CPU is taken off: of all of them, as one that has no CPU
    may hold what another waits for.
    """

    def __init__(self) -> None:
        self._began = time.monotonic()
        # after the clock: a wait between the two would be taken off, and not be in the time
        self._waited = _read_waited()

    def read_seconds(self) -> float:
        """Since then [s], 0 at least."""
        waited = _read_waited() - self._waited  # before the clock, for the same reason
        return max(0.0, time.monotonic() - self._began - max(0, waited) * 1e-9)


def _read_waited() -> int:
    """What the threads of this process have waited for a CPU [ns]; 0 where the kernel does not count it."""
    waited = 0
    for task in _TASKS.iterdir():
        with suppress(OSError):  # the thread has ended
            waited += int((task / "schedstat").read_text().split()[_WAITED])
    return waited
