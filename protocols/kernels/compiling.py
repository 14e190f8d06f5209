"""Compiling: each kernel is compiled by one process; other processes wait and load it. Progress can be queried.

Numba's cache has no lock. Two processes that compile one function for different types at the same time can give both the same
file name; the next process to load it would run the code for the wrong type. Two that compile it for the same types do the work
twice. So a process that does not find a kernel on disk locks it, checks again, and then compiles it. Kernels do not call each
other in a circle, so two processes never wait for each other. Numba calls `install` first (entry point `numba_extensions`).
"""

import fcntl
import os
import sys
import time
from collections.abc import Callable
from typing import Any

_UNLOCKED = -1  # no lock is possible


class Compiling:
    """Progress of compilation in this process.

    kernels: names of those being compiled, the innermost last. compiled: number of finished kernels. waits: whether another
    process compiles the innermost one. seconds: time spent on finished kernels.
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
        """Return the progress as a sentence for messages."""
        kernels = list(self.kernels)
        now = self.seconds + (time.monotonic() - self._began if kernels else 0.0)
        what = f"compiling kernels: {self.compiled} done"
        if kernels:
            what += f", {'waiting for another process that compiles' if self.waits else 'now'} {kernels[-1]}"
        return f"{what}, {now:.0f} s"

    def begin(self, path: str) -> bool:
        """Begin to load or compile the kernel with the index file `path`; return False if this process already compiles it."""
        if path in self._locks:
            return False
        self._locks[path] = None
        return True

    def lock_missing(self, path: str, name: str) -> None:
        """Lock a kernel that is not on disk: wait until no other process compiles it."""
        if self._locks.get(path, 0) is not None:
            return
        if not self.kernels:
            self._began = time.monotonic()
        self._locks[path] = _UNLOCKED  # set first, so that `end` works after an interruption
        self.kernels.append(name)
        try:
            os.makedirs(os.path.dirname(path), exist_ok=True)
            lock = os.open(f"{path}.lock", os.O_RDWR | os.O_CREAT | os.O_CLOEXEC, 0o666)
        except OSError:  # if nothing can be written, no process saves a kernel either
            return
        self._locks[path], self.waits = lock, True
        fcntl.flock(lock, fcntl.LOCK_EX)
        self.waits = False

    def end(self, path: str) -> None:
        """Release the lock of a kernel: it is on disk, or cannot be compiled."""
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
    """Let Numba compile each cached function in one process at a time, and load no more than it needs."""
    _load_array_functions()
    _load_types()
    from numba.core.caching import Cache
    from numba.core.ccallback import CFunc
    from numba.core.dispatcher import Dispatcher

    load = Cache.load_overload

    def load_or_lock(cache: Any, sig: Any, context: Any) -> Any:
        loaded = load(cache, sig, context)
        if loaded is None and cache._enabled:
            COMPILING.lock_missing(cache._cache_file._index_path, cache._py_func.__name__)
            loaded = load(cache, sig, context)
        return loaded

    Cache.load_overload = load_or_lock  # type: ignore[method-assign]
    for kind in (Dispatcher, CFunc):  # both kinds of compiled functions have a cache
        kind.compile = _compile_alone(kind.compile)  # type: ignore[method-assign]


def _load_array_functions() -> None:
    """Load Numba's array functions without SciPy's linear algebra: 0.2 s and 55 MB in each service, and no kernel needs it.

    Numba imports it here only to find out whether `np.dot` can be compiled. A kernel with a matrix product loads it later.
    """
    from numba.np import linalg

    ensure_blas = linalg.ensure_blas
    linalg.ensure_blas = lambda: None
    try:
        from numba.np import arraymath  # noqa: F401
    finally:
        linalg.ensure_blas = ensure_blas


def _load_types() -> None:
    """Load Numba's types without those of cffi, which no kernel of the bench has: 0.1 s for a parser of C in each service.

    An effect of a user whose law calls a function of cffi must import cffi before Numba compiles anything.
    """
    if "cffi" in sys.modules:
        return
    sys.modules["cffi"] = None  # type: ignore[assignment]
    try:
        from numba.core.typing import cffi_utils  # noqa: F401
    finally:
        del sys.modules["cffi"]


def keep_in_memory() -> None:
    """Let Numba compile cached functions without a cache in this process, because no folder can be written."""
    from numba.core.ccallback import CFunc
    from numba.core.dispatcher import Dispatcher

    for kind in (Dispatcher, CFunc):
        kind.enable_caching = lambda function: None  # type: ignore[method-assign]


def _compile_alone(compile_one: Callable[..., Any]) -> Callable[..., Any]:
    """Wrap `compile_one` of Numba, so that the lock of a kernel is released after it."""

    def compile_locked(function: Any, *signature: Any) -> Any:
        file = getattr(function._cache, "_cache_file", None)
        if file is None or not COMPILING.begin(file._index_path):
            return compile_one(function, *signature)
        try:
            return compile_one(function, *signature)
        finally:
            COMPILING.end(file._index_path)

    return compile_locked
