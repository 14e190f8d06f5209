"""Waiting: how a loop waits for its next deadline, which determines how late it wakes up.

After the sleeping policies of ros2_control; docs/timing.md compares them here.
"""

import time
from array import array
from typing import Protocol

from protocols.errors import InputError

LONGEST_SPIN_US = 200.0  # a FIFO loop that is busy for longer than 95 % of a second is taken off the CPU by the kernel
WAKE_MARGIN_NS = 2_000  # ns between the latest expected end of a sleep and the deadline
SPIN_DECAY_SLEEPS = 256  # sleeps over which the spin becomes shorter again after a late one


class Waiting(Protocol):
    """Waits until a deadline. words: present and longest spin [ns], shared with compiled code (`beat.py`)."""

    words: "array[int]"

    def __call__(self, now_ns: int, deadline_ns: int) -> int:
        """Wait until `deadline_ns` of CLOCK_MONOTONIC, which is after `now_ns`; return the time then [ns]."""
        ...


class Sleep:
    """Sleeps until the deadline. The CPU is free, and the wake-up is as late as the kernel makes it."""

    def __init__(self) -> None:
        self.words = array("q", (0, 0))

    def __call__(self, now_ns: int, deadline_ns: int) -> int:
        """See `Waiting`."""
        time.sleep((deadline_ns - now_ns) / 1e9)
        return time.monotonic_ns()


class SleepThenSpin:
    """Sleeps until shortly before the deadline, then reads the clock until the deadline.

    The spin is as long as recent sleeps were late, at most `most_ns`. It becomes longer at once after a late sleep, and shorter
    again over some hundred punctual ones.
    """

    def __init__(self, most_ns: int) -> None:
        self.words = array("q", (most_ns, most_ns))

    @property
    def spin_ns(self) -> int:
        """Length of the spin at present [ns]."""
        return self.words[0]

    def __call__(self, now_ns: int, deadline_ns: int) -> int:
        """See `Waiting`."""
        (spin, most), now = self.words, now_ns
        begin = deadline_ns - spin
        if now < begin:
            time.sleep((begin - now) / 1e9)
            now = time.monotonic_ns()
            needed = min(now - begin + WAKE_MARGIN_NS, most)
            self.words[0] = needed if needed > spin else spin - (spin - needed) // SPIN_DECAY_SLEEPS
        while now < deadline_ns:
            now = time.monotonic_ns()
        return now


def choose_waiting(spin_us: float, period_ns: int) -> Waiting:
    """Return the waiting with a spin of at most `spin_us` and a tenth of `period_ns`; 0 only sleeps.

    The limit leaves CPU time to other processes.
    """
    return SleepThenSpin(min(round(spin_us * 1000.0), period_ns // 10)) if spin_us > 0.0 else Sleep()


def check_spin(spin_us: float) -> float:
    """Return `spin_us` if a loop may spin for so long. Raises InputError."""
    if not 0.0 <= spin_us <= LONGEST_SPIN_US:
        raise InputError(f"spin of {spin_us:g} us is not possible; allowed are 0 to {LONGEST_SPIN_US:g} us")
    return spin_us
