"""`clutch-hil import` of several recordings: one map, one folder, and what becomes of those that are refused."""

import json
from pathlib import Path

import pytest
from typer.testing import CliRunner, Result

from clutch_hil.command import make_application
from protocols.errors import InputError
from protocols.files.runs import read_run

MAP = """[columns]
time_s = { from = "t", unit = "s" }
cylinder_pressure_bar = { from = "p", unit = "bar" }
"""


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """The current folder, with a map, two recordings, and one that is none."""
    monkeypatch.chdir(tmp_path)
    Path("map.toml").write_text(MAP)
    for name, pressure in (("one", 2.0), ("two", 3.0)):
        rows = [f"{0.01 * k:.2f},{pressure + 0.01 * k:.2f}" for k in range(50)]
        Path(f"{name}.csv").write_text("\n".join(["t,p", *rows]))
    Path("none.csv").write_text("garbage\n")
    return tmp_path


def run(*words: str) -> Result:
    return CliRunner().invoke(make_application(), ["import", *words, "--map", "map.toml"])


@pytest.mark.usefixtures("folder")
def test_each_recording_is_written_under_its_name() -> None:
    result = run("one.csv", "two.csv", "--out", "runs/new")
    assert (result.exit_code, result.exception) == (0, None)
    assert result.output.splitlines()[-1] == "verdict: 2 of 2 recordings imported"
    assert [read_run(Path(f"runs/new/{n}.parquet"), ())["cylinder_pressure_bar"][0] for n in ("one", "two")] == [
        2.0,
        3.0,
    ]


@pytest.mark.usefixtures("folder")
def test_one_that_is_refused_keeps_none_of_the_others() -> None:
    result = run("one.csv", "none.csv", "two.csv", "--out", "runs", "--json")
    document = json.loads(result.stdout)
    assert result.exit_code == 2
    assert [one["wrote"] for one in document["imported"]] == [["runs/one.parquet"], ["runs/two.parquet"]]
    assert list(document["refused"]) == ["none.csv"]
    assert document["verdict"] == "2 of 3 recordings imported"


def test_where_none_is_imported_no_folder_is_left(folder: Path) -> None:
    result = run("none.csv", "missing.csv", "--out", "runs/new")
    assert result.exit_code == 2
    assert "refused missing.csv: " in result.output
    assert not (folder / "runs").exists()


def test_a_file_that_exists_is_kept(folder: Path) -> None:
    (folder / "runs").mkdir()
    (folder / "runs/one.parquet").write_text("mine")
    assert run("one.csv", "two.csv", "--out", "runs").exit_code == 2
    assert (folder / "runs/one.parquet").read_text() == "mine"
    assert (folder / "runs/two.parquet").exists()
    assert run("one.csv", "--out", "runs", "--overwrite").exit_code == 0
    assert len(read_run(folder / "runs/one.parquet", ())["time_s"]) == 50


@pytest.mark.parametrize(
    ("words", "sentence"),
    [
        (("one.csv", "two.csv", "--out", "runs.parquet"), "--out is runs.parquet, and 2 recordings are given"),
        (("one.csv", "two.csv", "--out", "none"), "--out is none, which is a file"),
        (("one.csv", "one.csv", "--out", "runs"), "one.csv was given twice"),
        (("one.csv", "sub/one.csv", "--out", "runs"), "one.csv and sub/one.csv would both be written to runs/one.parquet"),
        (("one.csv", "two.csv", "--draft"), "--draft was given with 2 recordings; it allows only one"),
        (("one.csv", "two.csv", "--list"), "--list was given with 2 recordings; it allows only one"),
    ],
)  # fmt: skip
def test_what_cannot_be_done_is_refused_before_anything_is_written(
    folder: Path, words: tuple[str, ...], sentence: str
) -> None:
    Path("none").write_text("a file")
    result = run(*words)
    assert isinstance(result.exception, InputError)
    assert sentence in str(result.exception)
    assert not (folder / "runs").exists()
