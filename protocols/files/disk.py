"""Disk: what a recording is written to. It is asked before each write, so that a fault of it can be played."""

import errno
import os
import time
from collections.abc import Callable


def have_no_fault() -> None:
    """Write as the operating system does."""


def be_full() -> None:
    """Refuse a write as a full disk does."""
    raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))


def make_slow(delay: float) -> Callable[[], None]:
    """Return a fault by which each write takes `delay` [s] longer."""
    return lambda: time.sleep(delay)


class Disk:
    """A disk; `before_write` is called before each write, and raises OSError where the write fails."""

    def __init__(self) -> None:
        self.before_write: Callable[[], None] = have_no_fault
