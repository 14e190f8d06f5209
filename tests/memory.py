"""Memory growth of Python code, measured by tests."""

import gc
import tracemalloc
from collections.abc import Callable


def measure_growth(play: Callable[[int], object], first: int, count: int) -> int:
    """Return the growth of Python's memory (tracemalloc) [bytes] by `play(count)`, after `play(first)` and `play(100)`."""
    play(first)
    gc.collect()
    tracemalloc.start()
    try:
        play(100)
        before = tracemalloc.get_traced_memory()[0]
        play(count)
        return tracemalloc.get_traced_memory()[0] - before
    finally:
        tracemalloc.stop()
