"""Run files in other formats: there and back, and what cannot be."""

from pathlib import Path

import numpy as np
import pytest

from clutch_hil.bench.in_process import Played
from clutch_hil.live.conversion import convert
from clutch_hil.live.run_replay import load_batches
from protocols.errors import InputError
from protocols.files import bounds
from protocols.files.run import Run
from protocols.files.runs import read_run, write_run
from protocols.files.stretch import Stretch
from tests.clutch_hil.live.scripted_bench import record_script, split_steps
from tests.processes import play_here


def test_a_run_is_converted_there_and_back(played: Played, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    first, middle, last = (tmp_path / name for name in ("a.parquet", "b.mf4", "c.parquet"))
    record_script(played, split_steps(played), first, monkeypatch)
    written = [len(convert(source, target)["time_s"]) for source, target in ((first, middle), (middle, last))]
    assert written == [len(played.plant)] * 2
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
        assert len(convert(tmp_path / "axis.parquet", tmp_path / target)["time_s"]) == 50
    for name in ("axis.csv", "axis.mf4"):
        read = read_run(tmp_path / name, ("time_s", "position_m", "motor_force_n"))
        assert np.array_equal(read["position_m"], columns["position_m"])
        (batch,) = load_batches(tmp_path / name)
        assert [column.name for column in batch.columns] == list(columns)


def test_capital_letters_of_a_suffix_are_as_good(tmp_path: Path) -> None:
    (tmp_path / "a.CSV").write_text("time_s,x\n0,1\n1,2\n")
    assert len(convert(tmp_path / "a.CSV", tmp_path / "b.CSV")["time_s"]) == 2
    assert (tmp_path / "b.CSV").read_text().startswith('"time_s"')


def test_a_run_is_converted_to_rrd(played: Played, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    record_script(played, split_steps(played), tmp_path / "a.parquet", monkeypatch)
    convert(tmp_path / "a.parquet", tmp_path / "a.rrd")
    assert (tmp_path / "a.rrd").read_bytes()[:3] == b"RRF"


@pytest.mark.parametrize(
    ("target", "sentence"),
    [
        ("run.xlsx", "run.xlsx has the suffix .xlsx; files that can be written end with .csv, .mf4, .parquet, .rrd"),
        ("run", "run has the suffix -; files that can be written end with .csv, .mf4, .parquet, .rrd"),
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


def make_ramp(path: Path, rows: int = 1000) -> Run:
    """A run of 10 s at 100 Hz."""
    run = Run({"time_s": np.arange(rows) / 100.0, "ramp": np.arange(rows) * 1.0}, {"rig": "position_axis"})
    write_run(run, path)
    return run


@pytest.mark.parametrize("source", ["a.parquet", "a.mf4", "a.csv"])
@pytest.mark.parametrize("target", ["part.parquet", "part.mf4", "part.csv"])
def test_a_part_has_the_rows_between_its_ends(tmp_path: Path, source: str, target: str) -> None:
    make_ramp(tmp_path / source)
    convert(tmp_path / source, tmp_path / target, stretch=Stretch(0.3, 5.1))  # 0.3 is no binary number
    part = read_run(tmp_path / target, ("time_s",))
    assert np.array_equal(part["ramp"], np.arange(30.0, 511.0))
    assert np.array_equal(part["time_s"], np.arange(30, 511) / 100.0)
    if not target.endswith("csv"):
        assert part.metadata["part"] == {"of": source, "from_s": 0.3, "to_s": 5.1}


def test_a_part_of_a_part_tells_what_it_was_cut_from(tmp_path: Path) -> None:
    make_ramp(tmp_path / "a.parquet")
    convert(tmp_path / "a.parquet", tmp_path / "b.parquet", stretch=Stretch(from_s=2.0))
    convert(tmp_path / "b.parquet", tmp_path / "c.parquet", stretch=Stretch(to_s=3.0))
    part = read_run(tmp_path / "c.parquet", ("time_s",))
    assert (part["time_s"][0], part["time_s"][-1]) == (2.0, 3.0)
    assert part.metadata["part"] == {"of": "b.parquet", "from_s": 2.0, "to_s": 3.0}


def test_of_a_run_too_long_for_memory_a_part_can_be_taken(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    make_ramp(tmp_path / "long.parquet")
    monkeypatch.setattr(bounds, "MOST_BYTES", 8 * 3 * 1500)  # a column and a half, with its copies
    with pytest.raises(InputError, match="GiB: clutch-hil convert RUN PART --from S --to S writes a part of it"):
        convert(tmp_path / "long.parquet", tmp_path / "whole.parquet")
    convert(tmp_path / "long.parquet", tmp_path / "part.parquet", stretch=Stretch(1.0, 4.0))
    assert len(read_run(tmp_path / "part.parquet", ("time_s",))["ramp"]) == 301


@pytest.mark.parametrize(
    ("ends", "sentence"),
    [
        (("5", "2"), "the part from 5 to 2 s is not possible; it must end after it begins"),
        (("nan", "2"), "the part from nan to 2 s is not possible; it must end after it begins"),
        (("20", "30"), "a.parquet has no row from 20 to 30 s; its rows are at 0 to 9.99 s"),
        (("-inf", "-1"), "a.parquet has no row from -inf to -1 s; its rows are at 0 to 9.99 s"),
        (("9.99", "30"), "a.parquet has 1 rows; at least 2 are needed"),
    ],
)
def test_a_part_that_cannot_be_is_refused(tmp_path: Path, ends: tuple[str, str], sentence: str) -> None:
    make_ramp(tmp_path / "a.parquet")
    words = ["convert", str(tmp_path / "a.parquet"), str(tmp_path / "b.parquet"), "--from", ends[0], "--to", ends[1]]
    played = play_here(*words)
    assert (played.returncode, played.stdout) == (2, "")
    assert played.stderr.rstrip().endswith(sentence)
    assert not (tmp_path / "b.parquet").exists()


def test_a_part_is_viewed(tmp_path: Path) -> None:
    make_ramp(tmp_path / "a.parquet")
    assert [len(batch.rows) for batch in load_batches(tmp_path / "a.parquet", Stretch(1.0, 2.0))] == [101]
    convert(tmp_path / "a.parquet", tmp_path / "a.rrd")
    with pytest.raises(
        InputError, match=r"a.rrd is a saved view, which can only be shown completely; a part can be taken from \.csv"
    ):
        load_batches(tmp_path / "a.rrd", Stretch(1.0, 2.0))


def test_a_part_of_the_running_bench_is_refused() -> None:
    played = play_here("view", "--from", "3")
    assert (played.returncode, played.stdout) == (2, "")
    assert "--from or --to was given without a run" in played.stderr


@pytest.mark.parametrize("name", ["view.rrd", "frames.log", "bare"])
def test_what_is_no_run_file_is_told_by_its_suffix(tmp_path: Path, name: str) -> None:
    (tmp_path / name).write_text("no Parquet")
    message = (
        rf"{name} has the suffix {Path(name).suffix or '-'}; files that can be read end with \.csv, \.mf4, \.parquet"
    )
    with pytest.raises(InputError, match=message):
        convert(tmp_path / name, tmp_path / "run.parquet")
