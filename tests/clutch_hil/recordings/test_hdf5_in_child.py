"""HDF5 is opened in a process of its own, and nowhere else: its library can end a process on a damaged file."""

import ast
from functools import cache
from pathlib import Path
from typing import Any, NoReturn

import h5py
import numpy as np
import pytest
from typer.testing import CliRunner

import clutch_hil
import plant_sim
import protocols
import rt_controller
from clutch_hil.command import make_application
from clutch_hil.recordings.format import open_recording
from protocols.errors import InputError
from protocols.files.runs import read_columns

ROWS = 400
TIME = 0.01 * np.arange(ROWS)
# Functions that open a file, and what calls them in the other process
OPENERS = {
    "clutch_hil/recordings/hdf5/file.py": "__enter__",  # of Hdf5File
    "protocols/files/matlab.py": "_read_level73",
}
# Functions that make a Hdf5File, each named as the opener of an IsolatedRecording
MAKERS = {
    "clutch_hil/recordings/formats/hdf5.py": "open_hdf5",
    "clutch_hil/recordings/formats/matlab.py": "open_level73",
}


def write_level73(path: Path, **columns: np.ndarray) -> Path:
    with h5py.File(path, "w", userblock_size=512) as file:
        for name, values in columns.items():
            data = file.create_dataset(name, data=np.asarray(values, float)[None, :], compression="gzip")
            data.attrs["MATLAB_class"] = np.bytes_("double")
    raw = bytearray(path.read_bytes())
    raw[:128] = b"MATLAB 7.3 MAT-file".ljust(124) + b"\x00\x02IM"
    path.write_bytes(raw)
    return path


@cache
def list_functions() -> list[tuple[str, str, set[str]]]:
    """File, name, and what is called in it, of every function of the packages."""
    result = []
    for package in (protocols, plant_sim, rt_controller, clutch_hil):
        folder = Path(str(package.__file__)).parent
        for file in sorted(folder.rglob("*.py")):
            place, nodes = str(file.relative_to(folder.parent)), ast.walk(ast.parse(file.read_text(encoding="utf-8")))
            result += [(place, node.name, list_called(node)) for node in nodes if isinstance(node, ast.FunctionDef)]
    return result


def find_calls(name: str) -> dict[str, list[str]]:
    """Functions of the packages in which `name` is called, by file."""
    result: dict[str, list[str]] = {}
    for file, function, called in list_functions():
        if name in called:
            result.setdefault(file, []).append(function)
    return result


def list_called(function: ast.FunctionDef) -> set[str]:
    """What is called in a function, with and without what stands before its last dot."""
    names = [ast.unparse(node.func) for node in ast.walk(function) if isinstance(node, ast.Call)]
    return {*names, *(name.rpartition(".")[2] for name in names)}


def test_a_file_is_opened_in_two_places_only() -> None:
    assert find_calls("h5py.File") == {file: [function] for file, function in OPENERS.items()}
    assert find_calls("Hdf5File") == {file: [function] for file, function in MAKERS.items()}
    assert find_calls("_read_level73") == {"protocols/files/matlab.py": ["serve_level73"]}
    for function in (*MAKERS.values(), "serve_level73"):
        assert find_calls(function) == {}  # they are named, for the other process


def test_no_library_that_opens_hdf5_by_itself_is_asked_to() -> None:
    for name in ("read_hdf", "HDFStore", "loadmat73", "as_hdf"):
        assert find_calls(name) == {}


@pytest.fixture
def no_hdf5_here(monkeypatch: pytest.MonkeyPatch) -> None:
    def refuse(*_: Any, **__: Any) -> NoReturn:
        raise AssertionError("HDF5 is opened in this process")

    monkeypatch.setattr(h5py, "File", refuse)


def test_every_reader_of_level_73_and_hdf5_works_without_the_library(
    tmp_path: Path, request: pytest.FixtureRequest
) -> None:
    matlab = write_level73(
        tmp_path / "run.mat", time_s=TIME, position_m=np.sin(TIME), motor_force_n=np.cos(TIME), gain=[2.0]
    )
    plain = tmp_path / "run.h5"
    with h5py.File(plain, "w") as file:
        file["time_s"], file["position_m"] = TIME, np.sin(TIME)
    request.getfixturevalue("no_hdf5_here")
    for path in (matlab, plain):
        recording = open_recording(path)
        signals = {s.channel.name: s.values for s in recording.read(recording.channels)}
        np.testing.assert_array_equal(signals["position_m"], np.sin(TIME))
    run = read_columns(matlab)
    np.testing.assert_array_equal(run["position_m"], np.sin(TIME))
    assert run.metadata == {"gain": 2.0}


@pytest.mark.parametrize(
    "command",
    [
        ["discrepancy", "RUN", "--rig", "position_axis", "--out", "OUT"],
        ["convert", "RUN", "OUT.csv"],
        ["view", "RUN", "--save", "OUT.rrd"],
        ["import", "--list", "RUN"],
        ["import", "--draft", "RUN"],
    ],
    ids=lambda command: " ".join(command[:2]),
)
def test_every_command_refuses_a_damaged_file_of_level_73_in_one_sentence(
    tmp_path: Path, no_hdf5_here: None, command: list[str]
) -> None:
    path = tmp_path / "run.mat"
    path.write_bytes(
        b"MATLAB 7.3 MAT-file".ljust(124) + b"\x00\x02IM" + bytes(384) + b"\x89HDF\r\n\x1a\n" + bytes(range(256))
    )
    words = [word.replace("RUN", str(path)).replace("OUT", str(tmp_path / "out")) for word in command]
    refused = CliRunner().invoke(make_application(), words).exception
    assert isinstance(refused, InputError)
    assert "\n" not in str(refused)
    assert str(path) in str(refused)
    assert [one for one in tmp_path.rglob("*") if one.is_file()] == [path]


def test_a_level_73_run_that_ends_the_library_is_told(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path = write_level73(tmp_path / "run.mat", time_s=TIME)
    monkeypatch.setattr("protocols.files.matlab.__name__", __name__)
    with pytest.raises(InputError, match=r"run .*run.mat is damaged, or too large: the library .* ended \(signal 6\)"):
        read_columns(path)


def serve_level73(path: str) -> NoReturn:
    """In the other process: as a library does that finds its heap damaged."""
    import os

    os.abort()
