"""The writer of .rrd files on a disk that becomes full: rerun's own would block for ever in some of these cases."""

import os
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

from clutch_hil.live.viewer import rrd_writer
from clutch_hil.live.viewer.blueprint import build_blueprint
from clutch_hil.live.viewer.rrd_writer import RrdWriter
from protocols.errors import InputError
from protocols.node import Column
from protocols.telemetry.batch import Batch

MIB = 1 << 20  # bytes
ROWS = 100_000  # of two columns: 1.6 MB


@pytest.fixture
def free(monkeypatch: pytest.MonkeyPatch) -> dict[str, int]:
    """Bytes that are free on the disk, as the system tells them; `of` is changed by a test."""
    left = {"of": 100 * MIB}
    monkeypatch.setattr(rrd_writer.os, "statvfs", lambda file: SimpleNamespace(f_bavail=left["of"], f_frsize=1))
    return left


def make_batch() -> Batch:
    times = np.arange(ROWS) / 1000.0
    columns = (Column("time_s", "s", "time"), Column("plant_clock_s", "s", "clock"))
    return Batch("plant", 1, 0, 1000.0, 0.0, 0, columns, np.column_stack([times, times]))


def test_a_full_disk_is_told_before_anything_is_written(tmp_path: Path, free: dict[str, int]) -> None:
    free["of"] = 16 * MIB - 1
    with pytest.raises(InputError, match=r"x\.rrd cannot be written: No space left on device"):
        RrdWriter(tmp_path / "x.rrd", "x", build_blueprint())
    assert os.listdir(tmp_path) == []


def test_rows_that_the_disk_has_no_place_for_end_the_file(tmp_path: Path, free: dict[str, int]) -> None:
    def write() -> None:
        with RrdWriter(tmp_path / "x.rrd", "x", build_blueprint()) as writer:
            writer.put([make_batch()])
            free["of"] = 16 * MIB + 2 * make_batch().rows.nbytes - 1
            writer.put([make_batch()])

    with pytest.raises(InputError, match="No space left on device"):
        write()
    assert os.listdir(tmp_path) == []
