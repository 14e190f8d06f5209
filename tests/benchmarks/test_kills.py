"""Kills in small: the command kills two benches and judges what is left."""

from pathlib import Path

import numpy as np
import pytest

from benchmarks.kills import _read_run_end, measure_kills, tabulate_kills
from protocols.files.runs import REQUIRED, RunWriter
from protocols.node import Column

RATE = 1000


def write(path: Path, ticks: np.ndarray, first_clock: float = 0.0) -> Path:
    """A run with rows at `ticks`, of which tick 0 was at `first_clock` [s]."""
    columns = [Column(name, "1", "a value") for name in (*REQUIRED, "plant_clock_s")]
    rows = np.ones((len(ticks), len(columns)))
    rows[:, 0], rows[:, -1] = ticks / RATE, first_clock + ticks / RATE
    with RunWriter(path, columns) as writer:
        writer.append(rows)
        writer.finish({"sample_rate_hz": RATE})
    return path


def test_a_few_kills_leave_readable_recordings_and_nothing_else() -> None:
    said: list[str] = []
    targets, document = measure_kills(2, 1, said.append)
    assert [target.name for target in targets if not target.is_met] == [], said
    assert len(document["kills"]) == len(said) == 2
    killed = {kill["plan"]["victim"] for kill in document["kills"]}
    assert {row[0] for row in tabulate_kills(document)[1:] if row[1] != "0"} == killed


def test_what_a_recording_lacks_is_seen(tmp_path: Path) -> None:
    ticks = np.arange(2000)
    assert _read_run_end(write(tmp_path / "a.parquet", ticks, 50.0)) == pytest.approx((1.999, 51.999, 0))
    assert _read_run_end(write(tmp_path / "b.parquet", np.delete(ticks, [700, 701, 900]), 50.0))[2] == 2
