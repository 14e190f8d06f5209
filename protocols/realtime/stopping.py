"""Stop: SIGINT, SIGTERM and SIGHUP ask a service to end at its next cycle, so that its last frames are the safe ones."""

import os
import signal
from contextlib import ExitStack
from types import FrameType
from typing import Any

from protocols.errors import InterruptionError
from protocols.kernels.progress_notice import PROGRESS_NOTICE

_ENDING = (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)


def list_heeded_signals() -> list[signal.Signals]:
    """Return the signals that ask a process to end, except those it was started to ignore."""
    return [number for number in _ENDING if signal.getsignal(number) is not signal.SIG_IGN]


class Stop:
    """While entered, SIGINT, SIGTERM and SIGHUP (a closed terminal) only set `asked`.

    SIGHUP stays ignored if the process was started so, as by `nohup`. SIGINT is handled even if a script started the service
    with `&`, which ignores it. The descriptor `wakes` becomes readable, because Python runs no signal handler during a call of
    compiled code (`exchange.py`). Progress notices (`progress_notice.py`) are off: a command that runs until it is stopped
    reports by itself.
    """

    def __init__(self) -> None:
        self.asked = False
        self.wakes = self._wake_writer = self._former_wake_writer = -1
        self._former_handlers: dict[int, Any] = {}
        self._quiet = ExitStack()

    def __enter__(self) -> "Stop":
        self._quiet.enter_context(PROGRESS_NOTICE.describe_by(str))  # no text
        self.wakes, self._wake_writer = os.pipe2(os.O_NONBLOCK | os.O_CLOEXEC)
        self._former_wake_writer = signal.set_wakeup_fd(self._wake_writer, warn_on_full_buffer=False)
        for number in {signal.SIGINT, signal.SIGTERM, *list_heeded_signals()}:
            self._former_handlers[number] = signal.signal(number, self._handle_signal)
        return self

    def __exit__(self, *_: object) -> None:
        self._quiet.close()
        for number, handler in self._former_handlers.items():
            signal.signal(number, handler)
        signal.set_wakeup_fd(self._former_wake_writer)
        os.close(self.wakes)
        os.close(self._wake_writer)

    def check(self, kept: str) -> None:
        """Raise InterruptionError after a signal: there is no result, and `kept` names what is kept."""
        if self.asked:
            raise InterruptionError(kept)

    def _handle_signal(self, number: int, frame: FrameType | None) -> None:
        self.asked = True
