"""The process in which a library that can crash reads a file: its end is told, and it ends with the recording."""

import os
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from clutch_hil.recordings.channel import Recording
from clutch_hil.recordings.format import open_recording
from clutch_hil.recordings.isolated import IsolatedRecording
from protocols.errors import InputError
from tests.clutch_hil.recordings.hdf5_files import write, write_logger


def abort(path: Path) -> Recording:
    os.abort()


def write_loop(path: Path) -> Recording:
    while True:
        pass


def eat(path: Path) -> Recording:
    return np.ones(1 << 40)  # type: ignore[return-value]


def refuse(path: Path) -> Recording:
    raise InputError(f"recording {path} is not liked")


@pytest.mark.parametrize(
    ("opener", "message"),
    [
        (abort, r"the library that reads it ended \(signal 6\)"),
        (write_loop, r"the library that reads it ended \(after 1 s of computing\)"),
        (eat, "needs more than 2 GiB of memory"),
        (refuse, "is not liked"),
    ],
)
def test_what_ends_the_other_process_is_told(opener: Callable[[Path], Recording], message: str) -> None:
    limit = 1 if opener is write_loop else 10
    with pytest.raises(InputError, match=message):
        IsolatedRecording(Path("some.h5"), f"{__name__}:{opener.__name__}", most_seconds=limit)


def test_the_other_process_ends_with_the_recording(tmp_path: Path) -> None:
    recording = open_recording(write(tmp_path, write_logger))
    assert isinstance(recording, IsolatedRecording)
    process = recording.child.process
    assert process.poll() is None
    del recording
    assert process.wait(timeout=10) is not None
