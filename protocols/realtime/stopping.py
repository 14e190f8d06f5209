"""Stop: SIGINT, SIGTERM and SIGHUP ask a service to end at its next cycle, so that its last frames are the safe ones."""

import os
import signal
from contextlib import ExitStack
from types import FrameType
from typing import Any

from protocols.errors import InterruptionError
from protocols.kernels.starting import STARTING


class Stop:
    """While entered, SIGINT, SIGTERM and SIGHUP (a closed terminal) only set `asked`.

    The descriptor `wakes` is readable from then on: Python runs no handler while compiled code stays (`exchange.py`).
    Who goes on until he is stopped tells by himself what he does.
    """

    def __init__(self) -> None:
        self.asked = False
        self.wakes = self._told = self._told_before = -1
        self._before: dict[int, Any] = {}
        self._untold = ExitStack()

    def __enter__(self) -> "Stop":
        self._untold.enter_context(STARTING.told_by(str))  # no text
        self.wakes, self._told = os.pipe2(os.O_NONBLOCK | os.O_CLOEXEC)
        self._told_before = signal.set_wakeup_fd(self._told, warn_on_full_buffer=False)
        for number in (signal.SIGINT, signal.SIGTERM, signal.SIGHUP):
            self._before[number] = signal.signal(number, self._ask)
        return self

    def __exit__(self, *_: object) -> None:
        self._untold.close()
        for number, handler in self._before.items():
            signal.signal(number, handler)
        signal.set_wakeup_fd(self._told_before)
        os.close(self.wakes)
        os.close(self._told)

    def check(self, kept: str) -> None:
        """Raise InterruptionError when somebody has asked: there is no result, and `kept` says what there is."""
        if self.asked:
            raise InterruptionError(kept)

    def _ask(self, number: int, frame: FrameType | None) -> None:
        self.asked = True
