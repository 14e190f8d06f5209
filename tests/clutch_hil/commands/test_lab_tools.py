"""A command and a recording format of a user's package: that of CONTRIBUTING.md is found and used, with no edit elsewhere."""

import json
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest
from typer.testing import CliRunner, Result

import clutch_hil as ch
from clutch_hil.command import make_application
from clutch_hil.recordings.format import load_formats
from protocols.errors import InputError
from tests.packages import lay_out

FOLDER = Path(__file__).parents[3] / "docs" / "examples" / "lab_tools"
TIME = np.arange(0.0, 3.0, 0.01)  # s
TORQUE = 10.0 * np.sin(TIME)  # Nm
RESOLUTION = 1e-5  # of float32, of these values
MAP = """
[columns]
time_s = { from = "time", unit = "s" }
cylinder_pressure_bar = { from = "pressure" }
clutch_torque_nm = { from = "torque" }
"""


@pytest.fixture(autouse=True)
def installed(tmp_path_factory: pytest.TempPathFactory, monkeypatch: pytest.MonkeyPatch) -> Iterator[None]:
    """The package as pip would install it."""
    site = tmp_path_factory.mktemp("site")
    lay_out(FOLDER, site)
    monkeypatch.syspath_prepend(str(site))
    load_formats.cache_clear()
    yield
    load_formats.cache_clear()


@pytest.fixture
def recording(tmp_path: Path) -> Path:
    path = tmp_path / "a.bin"
    table = np.stack([1000.0 * TIME, np.full_like(TIME, 3.0), TORQUE], axis=1)
    path.write_bytes(b"LABLOG" + table.astype("<f4").tobytes())
    return path


def run_command(*words: object) -> Result:
    return CliRunner().invoke(make_application(), list(map(str, words)))


def import_it(recording: Path) -> Path:
    (recording.parent / "map.toml").write_text(MAP)
    run = recording.parent / "run.parquet"
    done = run_command("import", recording, "--map", recording.parent / "map.toml", "--out", run)
    assert done.exit_code == 0, done.output
    return run


def test_a_recording_becomes_a_run(recording: Path) -> None:
    run = ch.read_run(import_it(recording))
    np.testing.assert_allclose(run["time_s"], TIME, atol=RESOLUTION)
    np.testing.assert_allclose(run["clutch_torque_nm"], TORQUE, atol=RESOLUTION)


def test_its_channels_are_listed(recording: Path) -> None:
    done = run_command("import", recording, "--list", "--json")
    assert done.exit_code == 0, done.output
    assert [channel["name"] for channel in json.loads(done.stdout)["channels"]] == ["time", "pressure", "torque"]


def test_a_file_that_is_cut_is_told(recording: Path) -> None:
    recording.write_bytes(recording.read_bytes()[:-3])
    error = run_command("import", recording, "--list").exception
    assert isinstance(error, InputError)
    assert str(error) == f"recording {recording} ends within a row: it has 3597 bytes; a row has 12"


def test_its_command_reports_as_every_other(recording: Path) -> None:
    run = import_it(recording)
    assert run_command("peak", run).output.splitlines()[-1] == "verdict: highest torque 10.00 Nm"
    assert json.loads(run_command("peak", run, "--json").stdout)["peak_nm"] == pytest.approx(10.0, rel=1e-4)
    assert str(run_command("peak", "no.parquet").exception) == "run no.parquet does not exist"
