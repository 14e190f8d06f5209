"""Quiet libraries: messages of other libraries about a damaged file are suppressed; the command prints one sentence instead.

They write to their logs, by `warnings` and `print`, and by exceptions in `__del__`. The latter occur whenever an object is
collected, even after reading has ended, so they are suppressed for the rest of the process.
"""

import io
import logging
import sys
import warnings
from collections.abc import Callable, Iterator
from contextlib import contextmanager, redirect_stderr, redirect_stdout
from typing import Any

LIBRARIES = ("asammdf", "nptdms", "h5py", "can", "cantools", "pyarrow", "scipy")


@contextmanager
def quiet() -> Iterator[None]:
    """Suppress what a library prints, logs or warns of in a `with` block."""
    _ignore_late_remarks()
    before = logging.root.manager.disable
    logging.disable(logging.CRITICAL)
    try:
        with warnings.catch_warnings(), redirect_stderr(io.StringIO()), redirect_stdout(io.StringIO()):
            warnings.simplefilter("ignore")
            yield
    finally:
        logging.disable(before)


def _ignore_late_remarks() -> None:
    """Ignore exceptions in `__del__` of a library's objects from now on; those of other objects are reported as before."""
    if not getattr(sys.unraisablehook, "ignores", None):
        sys.unraisablehook = _make_hook(sys.unraisablehook)


def _make_hook(before: Callable[[Any], Any]) -> Callable[[Any], Any]:
    def ignore(
        unraisable: Any, libraries: tuple[str, ...] = LIBRARIES
    ) -> None:  # default arguments, as it also runs at exit, when globals are gone
        if str(getattr(unraisable.object, "__module__", "")).partition(".")[0] not in libraries:
            before(unraisable)

    ignore.ignores = LIBRARIES  # type: ignore[attr-defined]
    return ignore
