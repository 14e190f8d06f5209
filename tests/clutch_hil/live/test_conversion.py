"""Run files in other formats: there and back, and what cannot be."""

from pathlib import Path

import numpy as np
import pytest

from clutch_hil.bench.in_process import Played
from clutch_hil.live.conversion import convert
from clutch_hil.live.run_replay import load_batches
from protocols.errors import InputError
from protocols.files.run import Run
from protocols.files.runs import read_run, write_run
from tests.clutch_hil.live.scripted_bench import record_script, split_steps


def test_a_run_is_converted_there_and_back(played: Played, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    first, middle, last = (tmp_path / name for name in ("a.parquet", "b.mf4", "c.parquet"))
    record_script(played, split_steps(played), first, monkeypatch)
    assert convert(first, middle) == convert(middle, last) == len(played.plant)
    wanted, run = read_run(first), read_run(last)
    assert (run.metadata, run.describe_columns()) == (wanted.metadata, wanted.describe_columns())
    for name in wanted.columns:
        np.testing.assert_array_equal(run[name], wanted[name])


@pytest.mark.parametrize("metadata", [{}, {"rig": "position_axis"}])
def test_a_run_of_another_rig_is_converted_and_shown(tmp_path: Path, metadata: dict) -> None:
    time = np.arange(50) / 100.0
    columns = {"time_s": time, "position_m": np.sin(time), "motor_force_n": 3.0 * np.cos(time)}
    axis = Run(columns, metadata, {"position_m": "m", "motor_force_n": "N"})
    write_run(axis, tmp_path / "axis.parquet")
    for target in ("axis.csv", "axis.mf4", "axis.rrd"):
        assert convert(tmp_path / "axis.parquet", tmp_path / target) == 50
    for name in ("axis.csv", "axis.mf4"):
        read = read_run(tmp_path / name, ("time_s", "position_m", "motor_force_n"))
        assert np.array_equal(read["position_m"], columns["position_m"])
        (batch,) = load_batches(tmp_path / name)
        assert [column.name for column in batch.columns] == list(columns)


def test_capital_letters_of_a_suffix_are_as_good(tmp_path: Path) -> None:
    (tmp_path / "a.CSV").write_text("time_s,x\n0,1\n1,2\n")
    assert convert(tmp_path / "a.CSV", tmp_path / "b.CSV") == 2
    assert (tmp_path / "b.CSV").read_text().startswith('"time_s"')


def test_a_run_is_converted_to_rrd(played: Played, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    record_script(played, split_steps(played), tmp_path / "a.parquet", monkeypatch)
    convert(tmp_path / "a.parquet", tmp_path / "a.rrd")
    assert (tmp_path / "a.rrd").read_bytes()[:3] == b"RRF"


@pytest.mark.parametrize(
    ("target", "sentence"),
    [
        ("run.xlsx", "run.xlsx has the suffix .xlsx; what can be written ends with .csv, .mf4, .parquet, .rrd"),
        ("run", "run has the suffix -; what can be written ends with .csv, .mf4, .parquet, .rrd"),
        ("run.parquet", "run.parquet is read by this command and would be lost; give another name to write to"),
        ("other.mf4", "other.mf4 exists already; give another name, or --overwrite to replace it"),
        ("none/run.mf4", "none of run.mf4 does not exist"),
    ],
)
def test_a_conversion_that_cannot_be_is_refused(tmp_path: Path, target: str, sentence: str) -> None:
    for name in ("run.parquet", "other.mf4"):
        (tmp_path / name).write_text("before")
    with pytest.raises(InputError, match=sentence.replace(".", r"\.")):
        convert(tmp_path / "run.parquet", tmp_path / target)
    assert {path.name: path.read_text() for path in tmp_path.iterdir()} == {
        "run.parquet": "before",
        "other.mf4": "before",
    }


@pytest.mark.parametrize("name", ["view.rrd", "frames.log", "bare"])
def test_what_is_no_run_file_is_told_by_its_suffix(tmp_path: Path, name: str) -> None:
    (tmp_path / name).write_text("no Parquet")
    told = rf"{name} has the suffix {Path(name).suffix or '-'}; what can be read ends with \.csv, \.mf4, \.parquet"
    with pytest.raises(InputError, match=told):
        convert(tmp_path / name, tmp_path / "run.parquet")
