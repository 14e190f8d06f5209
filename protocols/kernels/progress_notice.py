"""Progress notice: messages on stderr while a command loads modules, compiles kernels or computes without output."""

import sys
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from types import FrameType

from protocols.kernels.compiling import COMPILING
from protocols.kernels.kernel_cache import are_kept, describe_keeping

_QUIET_SECONDS = 2.0  # s before the first line: a shorter command prints none
_REPORT_PERIOD = 5.0  # s between lines
_REPEAT_PERIOD = 30.0  # s until the same line is repeated, to show that the work continues
_IMPORT = "<frozen importlib._bootstrap>"  # the file of a frame in which a module is being loaded


class ProgressNotice:
    """While entered, a thread prints every 5 s what is being loaded, compiled or computed, first after 2 s.

    The description of a computation is printed again after 30 s if it has not changed.

    `end` stops it early: beside a real-time loop no other thread may run.
    """

    def __init__(self) -> None:
        self._ended = threading.Event()
        self._thread: threading.Thread | None = None
        self._watched = threading.get_ident()
        self._began = 0.0  # s of CLOCK_MONOTONIC
        self._describe = self._describe_work

    def __enter__(self) -> "ProgressNotice":
        self._began = time.monotonic()
        self._ended.clear()
        self._watched = threading.get_ident()
        self._thread = threading.Thread(target=self._report, daemon=True)
        self._thread.start()
        return self

    def __exit__(self, *_: object) -> None:
        self.end()

    def end(self) -> None:
        """Stop the thread: no further line is printed."""
        self._ended.set()
        if self._thread:
            self._thread.join()
            self._thread = None

    @contextmanager
    def describe_by(self, describe: Callable[[], str]) -> Iterator[None]:
        """While entered, print what `describe` returns; nothing for an empty text.

        Only the outermost description is used: a `Stop` in a command with a progress bar changes nothing.
        """
        before = self._describe
        if before == self._describe_work:
            self._describe = describe
        try:
            yield
        finally:
            self._describe = before

    def _describe_work(self) -> str:
        return f"working for {time.monotonic() - self._began:.0f} s"

    def _report(self) -> None:
        pause, last, printed = _QUIET_SECONDS, self._began, ""
        while not self._ended.wait(pause):
            pause = 0.5  # s until the next check, if there is nothing to print
            if COMPILING.kernels:
                text = COMPILING.describe() + ("" if are_kept() else f"; {describe_keeping()}")
            elif _is_loading(sys._current_frames().get(self._watched)):
                text = "loading modules"
            elif time.monotonic() - last >= _REPORT_PERIOD:
                text = self._describe()
                if text == printed and time.monotonic() - last < _REPEAT_PERIOD:
                    continue
            else:
                continue
            if text:
                print(text, file=sys.stderr, flush=True)
            last, pause, printed = time.monotonic(), _REPORT_PERIOD, text


PROGRESS_NOTICE = ProgressNotice()


def is_starting(frame: FrameType | None) -> bool:
    """Return whether this process compiles, or the thread at `frame` loads a module."""
    return bool(COMPILING.kernels) or _is_loading(frame)


def compile_first(warm: Callable[[], None]) -> None:
    """Compile the kernels of a service by calling `warm`, and print a line if something was compiled.

    A caller that waits for the service measures its time from this line on.
    """
    warm()
    if COMPILING.compiled:
        text = f"kernels are compiled: {COMPILING.compiled} in {COMPILING.seconds:.0f} s; {describe_keeping()}"
        print(text, file=sys.stderr, flush=True)


def _is_loading(frame: FrameType | None) -> bool:
    """Return whether a thread is loading a module."""
    while frame is not None:
        if frame.f_code.co_filename == _IMPORT:
            return True
        frame = frame.f_back
    return False
