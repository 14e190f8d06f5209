"""Compiling: each kernel is compiled by one process, the others wait and load it; and what is going on can be asked.

Numba's cache has no lock. Two processes that compile one function for different types at once can give both the same file, and
the next to load it would run the code of the other type; two that compile it for the same types do the work twice. So whoever
does not find a kernel on disk locks it, looks again, and compiles it. Kernels call each other without a circle, so no two
processes wait for each other. Numba calls `install` before it compiles or loads anything (entry point `numba_extensions`).
"""

import fcntl
import os
import time
from collections.abc import Callable
from typing import Any

_UNLOCKED = -1  # where there can be no lock


class Compiling:
    """What this process compiles: `kernels` begun and not ended, the innermost last, and how many have been `compiled`.

    `waits` while another process compiles the innermost; `seconds` have gone into kernels that have ended.
    """

    def __init__(self) -> None:
        self.kernels: list[str] = []
        self.compiled = 0
        self.waits = False
        self.seconds = 0.0  # s
        self._began = 0.0  # s of CLOCK_MONOTONIC, of the outermost
        # by the path of a kernel's index: None while it is looked for on disk, then the descriptor of its lock
        self._locks: dict[str, int | None] = {}

    def describe(self) -> str:
        """What is going on, for people."""
        kernels = list(self.kernels)
        now = self.seconds + (time.monotonic() - self._began if kernels else 0.0)
        what = f"compiling kernels: {self.compiled} done"
        if kernels:
            what += f", {'waiting for another process that compiles' if self.waits else 'now'} {kernels[-1]}"
        return f"{what}, {now:.0f} s"

    def begin(self, path: str) -> bool:
        """A kernel is asked for whose index is at `path`; False where it is being compiled already, by this process."""
        if path in self._locks:
            return False
        self._locks[path] = None
        return True

    def missed(self, path: str, name: str) -> None:
        """It is not on disk: wait until nobody else compiles it."""
        if self._locks.get(path, 0) is not None:
            return
        if not self.kernels:
            self._began = time.monotonic()
        self._locks[path] = _UNLOCKED  # first: whoever is interrupted from here on ends it
        self.kernels.append(name)
        try:
            os.makedirs(os.path.dirname(path), exist_ok=True)
            lock = os.open(f"{path}.lock", os.O_RDWR | os.O_CREAT | os.O_CLOEXEC, 0o666)
        except OSError:  # where nothing can be written nobody saves a kernel either
            return
        self._locks[path], self.waits = lock, True
        fcntl.flock(lock, fcntl.LOCK_EX)
        self.waits = False

    def end(self, path: str) -> None:
        """The kernel is on disk, or cannot be compiled."""
        lock = self._locks.pop(path)
        if lock is None:  # it was on disk
            return
        del self.kernels[-1:]
        self.compiled += 1
        if not self.kernels:
            self.seconds += time.monotonic() - self._began
        if lock != _UNLOCKED:
            os.close(lock)


COMPILING = Compiling()


def install() -> None:
    """Let Numba compile each cached function in one process at a time."""
    from numba.core.caching import Cache
    from numba.core.ccallback import CFunc
    from numba.core.dispatcher import Dispatcher

    load = Cache.load_overload

    def load_or_lock(cache: Any, sig: Any, context: Any) -> Any:
        found = load(cache, sig, context)
        if found is None and cache._enabled:
            COMPILING.missed(cache._cache_file._index_path, cache._py_func.__name__)
            found = load(cache, sig, context)
        return found

    Cache.load_overload = load_or_lock  # type: ignore[method-assign]
    for kind in (Dispatcher, CFunc):  # whatever compiles has a cache
        kind.compile = _alone(kind.compile)  # type: ignore[method-assign]


def _alone(compile_one: Callable[..., Any]) -> Callable[..., Any]:
    """`compile_one` of Numba, which ends what its cache's miss has begun."""

    def compiled(function: Any, *signature: Any) -> Any:
        file = getattr(function._cache, "_cache_file", None)
        if file is None or not COMPILING.begin(file._index_path):
            return compile_one(function, *signature)
        try:
            return compile_one(function, *signature)
        finally:
            COMPILING.end(file._index_path)

    return compiled
