"""Mutations: damaged copies of a good file. Each is read, or refused in one sentence, in bounded time and memory."""

import resource
import time
import warnings
from collections.abc import Callable, Iterator, Mapping
from enum import IntEnum
from pathlib import Path
from typing import Any

from clutch_hil.bench.faults.damage import mutate
from clutch_hil.recordings.channel import Recording
from clutch_hil.recordings.format import open_recording, recognise
from clutch_hil.recordings.import_map import load_map
from protocols.errors import InputError

LONGEST = 20.0  # s of computing for one file; other processes have limits of their own
MOST_KIB = 1 << 20  # of memory more than before: 1 GiB


class Reach(IntEnum):
    """How far a copy got."""

    REFUSED = 0  # when it was opened
    OPENED = 1  # then a channel was refused, or a run could not be made of it
    READ = 2  # every channel, and a run where there is a map


def read_recording(recording: Recording, whole: bool) -> Reach:
    """Read every channel of numbers. Refusals must be sentences, and channels must have the rows that they are said to have.

    whole: all of them; False for text, where damaged rows are left out and told.
    """
    reach = Reach.READ
    for channel in recording.channels:
        if channel.kind != "text":
            try:
                (signal,) = recording.read([channel])
            except InputError as error:
                assert_sentence(error)
                reach = Reach.OPENED
                continue
            rows = len(signal.values)
            assert rows == channel.rows if whole else rows <= channel.rows
            assert signal.time is None or len(signal.time) == rows
    return reach


def play_copy(
    copy: Path, options: Mapping[str, Any] | None = None, map_file: Path | None = None, whole: bool = True
) -> Reach:
    """Open a copy with `options`, read every channel, and make a run of it by a map."""
    try:
        whole = whole and recognise(copy).order < 2  # a damaged head may leave a text
        reach = read_recording(open_recording(copy, options), whole)
    except InputError as error:
        assert_sentence(error)
        return Reach.REFUSED
    if map_file:
        try:
            load_map(str(map_file)).read(copy)
        except InputError as error:
            assert_sentence(error)
            return Reach.OPENED
    return reach


def play_copies(
    path: Path,
    good: bytes,
    count: int,
    seed: int,
    play: Callable[[Path], Reach],
    damage: Callable[[bytes, int, int], Iterator[bytes]] = mutate,
) -> dict[Reach, int]:
    """`count` copies, damaged by `damage`, written to `path` in turn: how many got how far. Time and memory are bounded."""
    reached = dict.fromkeys(Reach, 0)
    for content in damage(good, count, seed):
        path.write_bytes(content)
        began, before = time.process_time(), resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
        with warnings.catch_warnings():
            warnings.simplefilter("error", RuntimeWarning)  # of NumPy: it would stand on the terminal
            reached[play(path)] += 1
        assert time.process_time() - began < LONGEST
        assert resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - before < MOST_KIB
    return reached


def check_damaged(path: Path, good: bytes, count: int, seed: int = 1, whole: bool = True) -> tuple[int, int]:
    """Read `count` damaged copies of a file. Returns how many could be opened, and how many were refused.

    whole: see `read_recording`.
    """
    reached = play_copies(path, good, count, seed, lambda copy: play_copy(copy, whole=whole))
    return count - reached[Reach.REFUSED], reached[Reach.REFUSED]


def assert_sentence(error: InputError) -> None:
    assert "\n" not in str(error)
    assert len(str(error)) < 1000
