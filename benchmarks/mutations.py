"""Mutations: damaged copies of a good file. Each is read, or refused in one sentence, in bounded time and memory."""

import resource
import time
from collections.abc import Iterator
from pathlib import Path

import numpy as np

from clutch_hil.recordings.format import open_recording
from protocols.errors import InputError

LONGEST = 20.0  # s for one file
MOST_KIB = 1 << 20  # of memory more than before: 1 GiB
HUGE = (b"\xff" * 8, b"\xff\xff\xff\x7f\0\0\0\0", b"\0" * 8, b"\0\0\0\0\1\0\0\0", b"\xff\xff\xff\xff\xff\xff\xff\x7f")


def mutate(good: bytes, count: int, seed: int = 1) -> Iterator[bytes]:
    """`count` damaged copies: cut, bytes changed, numbers made huge or zero, a part taken out or written twice."""
    random = np.random.default_rng(seed)
    for _ in range(count):
        content = bytearray(good)
        kind = random.integers(5)
        if kind == 0:
            del content[int(random.integers(1, len(content))) :]
        elif kind == 1:
            for place in random.integers(len(content), size=random.integers(1, 9)):
                content[place] = random.integers(256)
        elif kind == 2:
            place = 8 * int(random.integers(len(content) // 8))
            content[place : place + 8] = HUGE[random.integers(len(HUGE))]
        elif kind == 3:
            place = int(random.integers(len(content)))
            del content[place : place + int(random.integers(1, 200))]
        else:
            place, source = random.integers(len(content), size=2)
            content[place:place] = content[source : source + int(random.integers(1, 200))]
        yield bytes(content)


def check_damaged(path: Path, good: bytes, count: int, seed: int = 1, whole: bool = True) -> tuple[int, int]:
    """Read `count` damaged copies of a file. Returns how many could be read, and how many were refused.

    whole: all rows that a channel is said to have are read; False for text, where damaged rows are left out and told.
    """
    read = refused = 0
    for content in mutate(good, count, seed):
        path.write_bytes(content)
        began, before = time.perf_counter(), resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
        try:
            recording = open_recording(path)
            for channel in recording.channels:
                if channel.kind != "text":
                    try:
                        (signal,) = recording.read([channel])
                    except InputError as error:
                        assert_sentence(error)
                        continue
                    rows = len(signal.values)
                    assert rows == channel.rows if whole else rows <= channel.rows
                    assert signal.time is None or len(signal.time) == rows
            read += 1
        except InputError as error:
            assert_sentence(error)
            refused += 1
        assert time.perf_counter() - began < LONGEST
        assert resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - before < MOST_KIB
    return read, refused


def assert_sentence(error: InputError) -> None:
    assert "\n" not in str(error)
    assert len(str(error)) < 1000
