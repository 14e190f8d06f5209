"""The memory that this process takes for a while, with that of C libraries; tracemalloc makes a reader ten times slower."""

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

_STATUS, _FORGET = Path("/proc/self/status"), Path("/proc/self/clear_refs")  # see proc(5)


def _read(what: str) -> int:
    """VmRSS, the memory now [bytes], or VmHWM, the most of it since it was forgotten."""
    (line,) = (one for one in _STATUS.read_text(encoding="ascii").splitlines() if one.startswith(f"{what}:"))
    return 1024 * int(line.split()[1])


@contextmanager
def less_memory_than(most: int) -> Iterator[None]:
    """Assert that never so much [bytes] more is taken than at the beginning. What was given back before may be taken unseen.

    A kernel that does not forget the most (gVisor) shows only what exceeds the most of the whole process.
    """
    try:
        _FORGET.write_text("5", encoding="ascii")
        before = _read("VmRSS")
    except OSError:
        before = _read("VmHWM")
    yield
    assert _read("VmHWM") - before < most
