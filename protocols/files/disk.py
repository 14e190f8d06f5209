"""Disk: target of a recording. A hook before each write allows tests with disk faults."""

import errno
import os
import time
from collections.abc import Callable


def have_no_fault() -> None:
    """Do nothing: the operating system writes normally."""


def be_full() -> None:
    """Raise OSError as for a full disk."""
    raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))


def make_slow(delay: float) -> Callable[[], None]:
    """Return a fault by which each write takes `delay` [s] longer."""
    return lambda: time.sleep(delay)


class Disk:
    """A disk; `before_write` is called before each write, and raises OSError if the write is to fail."""

    def __init__(self) -> None:
        self.before_write: Callable[[], None] = have_no_fault
