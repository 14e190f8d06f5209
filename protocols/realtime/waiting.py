"""Waiting: how a loop spends the time to its next deadline, which decides on how late it wakes.

After ros2_control's sleeping policies; what each is worth here: docs/timing.md.
"""

import time
from array import array
from typing import Protocol

from protocols.errors import InputError

MOST_SPIN_US = 200.0  # a FIFO loop that is busy for longer than 95 % of a second is taken off the CPU by the kernel
MARGIN = 2_000  # ns between the latest sleep that is expected and the deadline
MEMORY = 256  # sleeps over which a late one is forgotten


class Waiting(Protocol):
    """Wait until a deadline. In `words`, shared with compiled code (`beat.py`): how long it spins now, and at most [ns]."""

    words: "array[int]"

    def __call__(self, now_ns: int, deadline_ns: int) -> int:
        """Return once `deadline_ns` of CLOCK_MONOTONIC, after `now_ns`, has come; what the clock says then [ns]."""
        ...


class Sleep:
    """Sleep to the deadline: the CPU is free, the wake-up is as late as the kernel's."""

    def __init__(self) -> None:
        self.words = array("q", (0, 0))

    def __call__(self, now_ns: int, deadline_ns: int) -> int:
        """See `Waiting`."""
        time.sleep((deadline_ns - now_ns) / 1e9)
        return time.monotonic_ns()


class SleepThenSpin:
    """Sleep until shortly before the deadline, then look at the clock until it has come.

    The spin begins as early as sleeps have been late of late: at once longer after a late one, shorter again over some hundred
    good ones, at most `most_ns`.
    """

    def __init__(self, most_ns: int) -> None:
        self.words = array("q", (most_ns, most_ns))

    @property
    def spin_ns(self) -> int:
        """How long it spins at present [ns]."""
        return self.words[0]

    def __call__(self, now_ns: int, deadline_ns: int) -> int:
        """See `Waiting`."""
        (spin, most), now = self.words, now_ns
        begin = deadline_ns - spin
        if now < begin:
            time.sleep((begin - now) / 1e9)
            now = time.monotonic_ns()
            needed = min(now - begin + MARGIN, most)
            self.words[0] = needed if needed > spin else spin - (spin - needed) // MEMORY
        while now < deadline_ns:
            now = time.monotonic_ns()
        return now


def waiting(spin_us: float, period_ns: int) -> Waiting:
    """Sleep, and for the last at most `spin_us` and tenth of a period spin: the CPU is others', too."""
    return SleepThenSpin(min(round(spin_us * 1000.0), period_ns // 10)) if spin_us > 0.0 else Sleep()


def checked_spin(spin_us: float) -> float:
    """`spin_us` when a loop may spin for so long. Raises InputError."""
    if not 0.0 <= spin_us <= MOST_SPIN_US:
        raise InputError(f"spin of {spin_us:g} us is not possible; allowed are 0 to {MOST_SPIN_US:g} us")
    return spin_us
