"""Bad run files are refused in one sentence, by name and row."""

import os
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest
from scipy.io import savemat

from protocols.errors import InputError
from protocols.files.matlab import read_mat
from protocols.files.runs import read_run
from tests.protocols.test_runs import RATE_HZ, RIG, SAMPLES, make_table, write, write_csv


def write_parquet(path: Path, columns: dict[str, Any]) -> None:
    pq.write_table(pa.table({name: list(values) for name, values in columns.items()}), path)


def find_refusal(path: Path) -> str:
    with pytest.raises(InputError) as refused:
        read_run(path)
    message = str(refused.value)
    assert str(path) in message
    assert "\n" not in message
    return message


FORMATS = {"csv": write_csv, "parquet": write_parquet}
each_format = pytest.mark.parametrize("kind", FORMATS)


@each_format
@pytest.mark.parametrize("name", RIG)
def test_a_missing_column_is_refused_by_name(tmp_path: Path, kind: str, name: str) -> None:
    path = tmp_path / f"run.{kind}"
    FORMATS[kind](path, {key: values for key, values in make_table().items() if key != name})
    assert find_refusal(path) == f"run {path} lacks the column {name}"


def test_a_run_without_times_is_refused_where_no_column_is_required(tmp_path: Path) -> None:
    write_csv(tmp_path / "run.csv", {key: values for key, values in make_table().items() if key != "time_s"})
    with pytest.raises(InputError, match=r"run\.csv lacks the column time_s"):
        read_run(tmp_path / "run.csv", ())


@each_format
@pytest.mark.parametrize("name", RIG)
@pytest.mark.parametrize("bad", [np.nan, np.inf, -np.inf, None])
def test_a_value_that_is_no_number_is_refused_by_column_and_first_row(
    tmp_path: Path, kind: str, name: str, bad: float | None
) -> None:
    path = tmp_path / f"run.{kind}"
    columns: dict[str, Any] = {key: list(values) for key, values in make_table().items()}
    absent: Any = "" if kind == "csv" and bad is None else bad
    columns[name][17] = columns[name][90] = absent
    FORMATS[kind](path, columns)
    assert find_refusal(path) == f"run {path}: {name} is not a number in row 17"


def test_a_word_among_numbers_is_refused_by_column_and_row(tmp_path: Path) -> None:
    columns: dict[str, Any] = {key: list(values) for key, values in make_table().items()}
    columns["clutch_torque_nm"][17] = "broken"
    write_csv(tmp_path / "run.csv", columns)
    assert "clutch_torque_nm is not a number in row 17" in find_refusal(tmp_path / "run.csv")


@each_format
@pytest.mark.parametrize("back", [0.0, 0.5, 3.0])
def test_time_that_does_not_increase_is_refused_by_first_row(tmp_path: Path, kind: str, back: float) -> None:
    path = tmp_path / f"run.{kind}"
    time = make_table()["time_s"]
    for row in (40, 70):
        time[row] = time[row - 1] - back / RATE_HZ
    FORMATS[kind](path, make_table() | {"time_s": time})
    assert find_refusal(path) == f"run {path}: time_s does not increase in row 40"


@each_format
def test_time_that_stands_still_throughout_is_refused(tmp_path: Path, kind: str) -> None:
    path = tmp_path / f"run.{kind}"
    FORMATS[kind](path, make_table() | {"time_s": np.zeros(SAMPLES)})
    assert find_refusal(path) == f"run {path}: time_s does not increase in row 1"


@each_format
@pytest.mark.parametrize("change", [1.0, 0.02, -0.02, -0.5])
def test_a_changing_sample_rate_is_refused_by_first_row(tmp_path: Path, kind: str, change: float) -> None:
    path = tmp_path / f"run.{kind}"
    steps = np.full(SAMPLES, 1.0 / RATE_HZ)
    steps[130:] *= 1.0 + change
    FORMATS[kind](path, make_table() | {"time_s": np.cumsum(steps)})
    refusal = find_refusal(path)
    assert refusal.startswith(
        f"run {path}: the sample rate changes in row 130; a run has equal steps, to 1 %: import it with"
    )


def test_a_sample_rate_that_changes_early_is_refused_where_it_changes(tmp_path: Path) -> None:
    steps = np.full(SAMPLES, 1.0 / RATE_HZ)
    steps[30:] *= 2.0
    write_csv(tmp_path / "run.csv", make_table() | {"time_s": np.cumsum(steps)})
    assert "the sample rate changes in row 30" in find_refusal(tmp_path / "run.csv")


@each_format
def test_a_lost_row_is_refused(tmp_path: Path, kind: str) -> None:
    path = tmp_path / f"run.{kind}"
    FORMATS[kind](path, {name: np.delete(values, 60) for name, values in make_table().items()})
    assert f"run {path}: the sample rate changes in row 60;" in find_refusal(path)


def test_a_run_of_one_row_is_refused(tmp_path: Path) -> None:
    write_csv(tmp_path / "run.csv", {name: values[:1] for name, values in make_table().items()})
    assert "has 1 rows; at least 2 are needed" in find_refusal(tmp_path / "run.csv")


def test_unequal_lengths_are_refused_by_row(tmp_path: Path) -> None:
    path = tmp_path / "run.csv"
    write_csv(path, make_table())
    lines = path.read_text().splitlines()
    lines[5] = "1,2,3"
    path.write_text("\n".join(lines))
    assert "Expected 10 columns, got 3: 1,2,3" in find_refusal(path)


def test_a_column_that_stands_twice_is_refused_by_name(tmp_path: Path) -> None:
    path = tmp_path / "run.csv"
    write_csv(path, make_table())
    lines = path.read_text().splitlines()
    path.write_text("\n".join(line + "," + line.split(",")[-1] for line in lines))
    assert "truth_x_m" in find_refusal(path)


UNREADABLE: dict[str, Callable[[Path], object]] = {
    "missing.parquet": lambda path: None,
    "missing.csv": lambda path: None,
    "folder.parquet": lambda path: path.mkdir(),
    "folder.csv": lambda path: path.mkdir(),
    "empty.parquet": lambda path: path.touch(),
    "empty.csv": lambda path: path.touch(),
    "garbage.parquet": lambda path: path.write_bytes(bytes(range(256)) * 8),
    "garbage.csv": lambda path: path.write_bytes(bytes(range(256)) * 8),
    "csv.parquet": lambda path: write_csv(path, make_table()),
}


@pytest.mark.parametrize("name", UNREADABLE)
def test_an_unreadable_file_is_refused_by_name(tmp_path: Path, name: str) -> None:
    path = tmp_path / name
    UNREADABLE[name](path)
    find_refusal(path)


def test_a_file_that_only_begins_as_one_of_matlab_is_not_called_one(tmp_path: Path) -> None:
    (tmp_path / "junk.bin").write_bytes(b"\0\0\0\0abc")
    assert "junk.bin is not a table of numbers: it begins with" in find_refusal(tmp_path / "junk.bin")
    (tmp_path / "junk.mat").write_bytes(b"\0\0\0\0abc")
    assert "junk.mat cannot be read: " in find_refusal(tmp_path / "junk.mat")


def test_a_file_cut_off_is_refused_by_name(tmp_path: Path) -> None:
    path = tmp_path / "run.parquet"
    write(path, {})
    path.write_bytes(path.read_bytes()[:-100])
    find_refusal(path)


@pytest.mark.parametrize("name", ["a.parquet", "a.mf4", "a.mat", "a.csv", "a"])
@pytest.mark.parametrize(
    ("make", "sentence"),
    [(os.mkfifo, "is a pipe or a device"), (os.mkdir, "is a folder"), (lambda path: Path(path).touch(), "is empty")],
)
def test_what_is_no_file_is_refused_in_a_sentence(tmp_path: Path, name: str, make: Any, sentence: str) -> None:
    make(tmp_path / name)
    with pytest.raises(InputError, match=f"run {tmp_path / name} cannot be read: it {sentence}"):
        read_run(tmp_path / name)


def test_more_rows_than_memory_are_refused_before_they_are_read(tmp_path: Path) -> None:
    path = tmp_path / "run.csv"
    path.write_bytes(b"time_s,x\n" + b"1,2\n" * 30_000_000)
    with pytest.raises(InputError, match=r"has 6e\+07 rows; allowed are"):
        read_run(path)


def test_a_mat_file_is_read_in_another_process(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Whose end, by a damaged file, ends no command."""

    def end(path: Path) -> None:
        raise SystemExit(f"{path} was read in this process")

    savemat(tmp_path / "run.mat", {"time_s": np.arange(5.0), "torque_nm": np.arange(5.0), "gain": 3.0, "note": "text"})
    monkeypatch.setattr("protocols.files.matlab._read_level5", end)
    run = read_mat(tmp_path / "run.mat")
    np.testing.assert_array_equal(run["torque_nm"], np.arange(5.0))
    assert (list(run.columns), run.metadata) == (["time_s", "torque_nm"], {"gain": 3.0})
