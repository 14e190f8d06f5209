"""Times beside a column in its own group, as HDF5 and MATLAB files have them."""

from pathlib import Path

import h5py
import numpy as np
import pytest
from scipy.io import savemat

from clutch_hil.recordings.contents import draft_map
from clutch_hil.recordings.format import open_recording
from tests.clutch_hil.recordings.maps import find_refusal as find_map_refusal
from tests.clutch_hil.recordings.maps import import_by

TIME = 1e-3 * np.arange(400)


def write_groups(tmp_path: Path, kind: str, slow_time: np.ndarray, unit: str = "") -> Path:
    """Torque over `fast/time`, and speed, twice the time, over `slow/time`, which is in `unit`."""
    groups = {"fast": {"time": TIME, "torque": np.sin(TIME)}, "slow": {"time": slow_time, "speed": 2.0 * slow_time}}
    file = tmp_path / f"groups{kind}"
    if kind == ".mat":
        savemat(file, groups)
        return file
    with h5py.File(file, "w") as content:
        for group, arrays in groups.items():
            for name, values in arrays.items():
                content[f"{group}/{name}"] = values
        content["fast/time"].attrs["unit"] = "s" if unit else ""
        content["slow/time"].attrs["unit"] = unit
    return file


def map_groups(mark: str, file: str = "resample_hz = 1000.0") -> str:
    return f"""
[file]
{file}
[columns]
time_s = {{ from = "fast{mark}time", unit = "s" }}
torque_nm = {{ from = "fast{mark}torque", unit = "Nm" }}
speed_rad_s = {{ from = "slow{mark}speed", unit = "rad/s" }}
"""


@pytest.mark.parametrize("step", [1, 2], ids=["as many rows", "fewer rows"])
@pytest.mark.parametrize(("kind", "mark"), [(".h5", "/"), (".mat", ".")])
def test_a_column_has_the_times_that_stand_beside_it(tmp_path: Path, kind: str, mark: str, step: int) -> None:
    file = write_groups(tmp_path, kind, 2.0 * TIME[::step])
    run = import_by(tmp_path, file, map_groups(mark))
    np.testing.assert_allclose(run["speed_rad_s"], 2.0 * run["time_s"], atol=1e-6)
    assert f"speed_rad_s: at the times of 'slow{mark}time', which is next to it" in run.metadata["import"]["done"]
    assert "on different rasters" in find_map_refusal(tmp_path, file, map_groups(mark, ""))


def test_times_beside_a_column_are_in_their_own_unit_also_since_1970(tmp_path: Path) -> None:
    file = write_groups(tmp_path, ".h5", 1e3 * TIME, "ms")
    run = import_by(tmp_path, file, map_groups("/"))
    np.testing.assert_allclose(run["speed_rad_s"], 2e3 * run["time_s"], atol=1e-6)
    with h5py.File(file, "a") as content:
        content["fast/time"][:] = 1.7e9 + TIME
        content["slow/time"][:] = 1.7e12 + 1e3 * TIME
    run = import_by(tmp_path, file, map_groups("/"))
    np.testing.assert_allclose(run["speed_rad_s"], 2e3 * run["time_s"], atol=1e-2)  # a time of 1.7e9 s has 0.2 us


def test_equal_times_in_two_groups_are_one_raster(tmp_path: Path) -> None:
    run = import_by(tmp_path, write_groups(tmp_path, ".mat", TIME), map_groups(".", ""))
    np.testing.assert_array_equal(run["speed_rad_s"], 2.0 * TIME)


def test_columns_of_a_text_file_whose_times_are_called_alike_have_that_of_the_map(tmp_path: Path) -> None:
    file = tmp_path / "twice.csv"
    rows = [f"{t},{t},{t},{2.0 * t}" for t in TIME.tolist()]
    file.write_text("\n".join(["time [s],torque,time [s],speed", *rows, ""]), encoding="utf-8")
    text = map_groups("").replace('"fasttime"', '"time [s] (column 1)"')
    run = import_by(tmp_path, file, text.replace("fasttorque", "torque").replace("slowspeed", "speed"))
    np.testing.assert_allclose(run["speed_rad_s"], 2.0 * run["time_s"], atol=1e-6)
    assert not [note for note in run.metadata["import"]["done"] if "is next to it" in note]


@pytest.mark.parametrize(
    ("torque_time", "speed_time"),
    [
        ("torque_time", "speed_time"),
        ("time_torque", "time_speed"),
        ("torqueTime", "speedTime"),
        ("t_torque", "t_speed"),
    ],
)
@pytest.mark.parametrize("step", [1, 2], ids=["as many rows", "fewer rows"])
def test_a_column_has_the_times_that_are_called_as_it(
    tmp_path: Path, torque_time: str, speed_time: str, step: int
) -> None:
    file = tmp_path / "channels.mat"
    slow = 2.0 * TIME[::step]
    savemat(file, {"torque": np.sin(TIME), torque_time: TIME, "speed": 2.0 * slow, speed_time: slow})
    text = map_groups("_").replace("fast_time", torque_time).replace("fast_torque", "torque")
    run = import_by(tmp_path, file, text.replace("slow_speed", "speed"))
    np.testing.assert_allclose(run["speed_rad_s"], 2.0 * run["time_s"], atol=1e-6)
    np.testing.assert_allclose(run["torque_nm"], np.sin(run["time_s"]), atol=1e-6)


MATRICES = map_groups("").replace('"fasttime"', '"M(:,1)"').replace('"fasttorque"', '"M(:,2)"')
MATRICES = MATRICES.replace('"slowspeed"', '"n(:,2)"')


@pytest.mark.parametrize("step", [1, 2], ids=["as many rows", "fewer rows"])
def test_a_column_has_the_times_in_the_first_column_of_its_matrix(tmp_path: Path, step: int) -> None:
    """As CANape writes, and blocks of Simulink read them."""
    file = tmp_path / "matrices.mat"
    slow = 2.0 * TIME[::step]
    savemat(file, {"M": np.column_stack([TIME, np.sin(TIME)]), "n": np.column_stack([slow, 2.0 * slow])})
    run = import_by(tmp_path, file, MATRICES)
    np.testing.assert_allclose(run["speed_rad_s"], 2.0 * run["time_s"], atol=1e-6)


def test_a_first_column_that_does_not_rise_is_no_time(tmp_path: Path) -> None:
    file = tmp_path / "matrices.mat"
    savemat(file, {"M": np.column_stack([TIME, np.sin(TIME)]), "n": np.column_stack([np.cos(9.0 * TIME), 2.0 * TIME])})
    np.testing.assert_allclose(import_by(tmp_path, file, MATRICES)["speed_rad_s"], 2.0 * TIME, atol=1e-6)


SCOPE = """
[file]
resample_hz = 1000.0
[columns]
time_s = { from = "Scope.time" }
torque_nm = { from = "torque", unit = "Nm" }
speed_rad_s = { from = "speed", unit = "rad/s" }
"""


def write_scope(tmp_path: Path, **vectors: np.ndarray) -> Path:
    """A scope of Simulink with the torque over TIME, and `vectors` beside it."""
    file = tmp_path / "scope.mat"
    signals = np.array([(np.sin(TIME)[:, None], 1, "torque")], [("values", "O"), ("dimensions", "O"), ("label", "O")])
    scope = {"time": TIME[:, None], "signals": signals, "blockName": "model/Scope"}
    savemat(file, {"Scope": scope, **{name: values[:, None] for name, values in vectors.items()}})
    return file


@pytest.mark.parametrize("name", ["tout", "time_s"])
def test_a_vector_beside_a_scope_has_the_times_that_are_a_vector(tmp_path: Path, name: str) -> None:
    slow = 2.0 * TIME[::2]
    run = import_by(
        tmp_path,
        write_scope(tmp_path, speed=2.0 * slow, **{name: slow}),
        SCOPE.replace('"Scope.time"', '"Scope.time", unit = "s"'),
    )
    np.testing.assert_allclose(run["speed_rad_s"], 2.0 * run["time_s"], atol=1e-6)


def test_the_draft_of_a_scope_and_its_tout_is_read(tmp_path: Path) -> None:
    file = write_scope(tmp_path, speed_rad_s=2.0 * TIME, tout=TIME)
    draft = draft_map(file, open_recording(file)).replace("resample_hz = 100.0", "resample_hz = 1000.0")
    np.testing.assert_allclose(import_by(tmp_path, file, draft)["speed_rad_s"], 2.0 * TIME, atol=1e-6)


def test_tout_alone_is_the_time(tmp_path: Path) -> None:
    file = tmp_path / "vectors.mat"
    savemat(file, {"tout": TIME[:, None], "speed_rad_s": 2.0 * TIME[:, None]})
    draft = draft_map(file, open_recording(file))
    assert 'time_s = { from = "tout" }' in draft
    np.testing.assert_allclose(import_by(tmp_path, file, draft)["speed_rad_s"], 2.0 * TIME, atol=1e-12)


def test_vectors_without_times_beside_a_scope_are_refused(tmp_path: Path) -> None:
    file = write_scope(tmp_path, speed=2.0 * TIME)
    assert "no time axis of its own" in find_map_refusal(tmp_path, file, SCOPE)
    file = write_scope(tmp_path, speed=2.0 * TIME, time_a=TIME, time_b=TIME)
    assert "no time axis of its own" in find_map_refusal(tmp_path, file, SCOPE), "two that could be it"
