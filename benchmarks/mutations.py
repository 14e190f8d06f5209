"""Mutations: damaged copies of a valid file. Each is read, or refused in one sentence, within limits of time and memory."""

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

LONGEST = 20.0  # s of CPU time for one file; child processes have separate limits
MOST_KIB = 1 << 20  # of additional memory: 1 GiB


class Reach(IntEnum):
    """How far the reading of a copy got."""

    REFUSED = 0  # when it was opened
    OPENED = 1  # then a channel was refused, or a run could not be made of it
    READ = 2  # every channel, and a run if there is a map


def read_recording(recording: Recording, whole: bool) -> Reach:
    """Read every numeric channel. Checks that refusals are sentences, and that channels have the declared number of rows.

    whole: all rows are required; False for text, where damaged rows are skipped and reported.
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
        whole = whole and recognise(copy).order < 2  # with a damaged header the file may count as text
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
    """Write `count` copies, damaged by `damage`, to `path` in turn and read them; return how many got how far.

    Time and memory are limited.
    """
    reached = dict.fromkeys(Reach, 0)
    for content in damage(good, count, seed):
        path.write_bytes(content)
        began, before = time.process_time(), resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
        with warnings.catch_warnings():
            warnings.simplefilter("error", RuntimeWarning)  # warnings of NumPy would be printed
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
