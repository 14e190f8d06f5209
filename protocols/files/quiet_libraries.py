"""Quiet libraries: what other people's readers print of a damaged file stays off the terminal, where one sentence is said.

They write to their logs, by `warnings` and `print`, and by exceptions in `__del__`. Those come whenever an object is collected,
also after the reader has gone, so they are kept away for the rest of the process.
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
    """A library at work: nothing that it prints, logs or warns of is seen."""
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
    """Ignore exceptions in `__del__` of a library's objects, from now on; those of others are told as before."""
    if not getattr(sys.unraisablehook, "ignores", None):
        sys.unraisablehook = _make_hook(sys.unraisablehook)


def _make_hook(before: Callable[[Any], Any]) -> Callable[[Any], Any]:
    def ignore(
        unraisable: Any, libraries: tuple[str, ...] = LIBRARIES
    ) -> None:  # names of its own: it runs at the exit, too
        if str(getattr(unraisable.object, "__module__", "")).partition(".")[0] not in libraries:
            before(unraisable)

    ignore.ignores = LIBRARIES  # type: ignore[attr-defined]
    return ignore
