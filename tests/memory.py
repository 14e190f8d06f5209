"""Memory that Python keeps, as tests measure it."""

import gc
import tracemalloc
from collections.abc import Callable


def measure_growth(play: Callable[[int], object], first: int, count: int) -> int:
    """Bytes of Python's memory (tracemalloc) that `count` calls in `play(count)` keep, after `first` and 100 others."""
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
