"""Starting: while a command loads its modules, compiles kernels or computes without a word, it says so on stderr."""

import sys
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from types import FrameType

from protocols.kernels.compiled import kept, lasting
from protocols.kernels.compiling import COMPILING

_FIRST = 2.0  # s of silence that nobody minds
_EVERY = 5.0  # s between lines
_IMPORT = "<frozen importlib._bootstrap>"  # the file of a frame in which a module is being loaded


class Starting:
    """While entered, a thread says every 5 s what is loaded, compiled or done; what takes less than 2 s is not told.

    `end` ends it before: beside a loop in real time there may be no other thread.
    """

    def __init__(self) -> None:
        self._ended = threading.Event()
        self._thread: threading.Thread | None = None
        self._watched = threading.get_ident()
        self._began = 0.0  # s of CLOCK_MONOTONIC
        self._describe = self._at_work

    def __enter__(self) -> "Starting":
        self._began = time.monotonic()
        self._ended.clear()
        self._watched = threading.get_ident()
        self._thread = threading.Thread(target=self._tell, daemon=True)
        self._thread.start()
        return self

    def __exit__(self, *_: object) -> None:
        self.end()

    def end(self) -> None:
        """No further line."""
        self._ended.set()
        if self._thread:
            self._thread.join()
            self._thread = None

    @contextmanager
    def told_by(self, describe: Callable[[], str]) -> Iterator[None]:
        """While entered, `describe` says what is done; an empty text where somebody else does.

        Who is entered within, a `Stop` in a command with a progress bar, changes nothing.
        """
        before = self._describe
        if before == self._at_work:
            self._describe = describe
        try:
            yield
        finally:
            self._describe = before

    def _at_work(self) -> str:
        return f"at work for {time.monotonic() - self._began:.0f} s"

    def _tell(self) -> None:
        pause, last = _FIRST, self._began
        while not self._ended.wait(pause):
            pause = 0.5  # s until the next look, where nothing is to be told
            if COMPILING.kernels:
                told = COMPILING.describe() + ("" if lasting() else f"; {kept()}")
            elif _loads(sys._current_frames().get(self._watched)):
                told = "loading modules"
            elif time.monotonic() - last >= _EVERY:
                told = self._describe()
            else:
                continue
            if told:
                print(told, file=sys.stderr, flush=True)
            last, pause = time.monotonic(), _EVERY


STARTING = Starting()


def starts(frame: FrameType | None) -> bool:
    """Whether this process compiles, or the thread at `frame` loads a module."""
    return bool(COMPILING.kernels) or _loads(frame)


def compile_first(warm: Callable[[], None]) -> None:
    """Compile what a service runs by `warm`, and say when that took time: who waits for the service counts from then on."""
    warm()
    if COMPILING.compiled:
        told = f"kernels are compiled: {COMPILING.compiled} in {COMPILING.seconds:.0f} s; {kept()}"
        print(told, file=sys.stderr, flush=True)


def _loads(frame: FrameType | None) -> bool:
    """Whether a thread is loading a module."""
    while frame is not None:
        if frame.f_code.co_filename == _IMPORT:
            return True
        frame = frame.f_back
    return False
