"""Tables in HDF5 files whose rows have fields of fields or arrays; short matrices with a channel a row; labels of a group."""

from pathlib import Path
from typing import Any

import h5py
import numpy as np
import pytest

from clutch_hil.recordings.formats.hdf5 import open_hdf5
from tests.clutch_hil.recordings.hdf5_files import ROWS, Q, T, read_values, write
from tests.clutch_hil.recordings.maps import import_by

MAP = """
[columns]
time_s = {{ from = "{}", unit = "s" }}
torque_nm = {{ from = "{}", unit = "Nm" }}
"""


def fill_nested(rows: np.ndarray) -> None:
    rows["time"], rows["v"]["torque"] = T, Q


def fill_array(rows: np.ndarray) -> None:
    rows["time"], rows["v"][:, 1] = T, Q


def fill_deep(rows: np.ndarray) -> None:
    rows["time"], rows["v"]["torque"][:, 1] = T, Q


@pytest.mark.parametrize("shape", [(ROWS,), (ROWS, 1), (1, ROWS)])
@pytest.mark.parametrize(
    ("kind", "fill", "wanted"),
    [
        ([("torque", "f4")], fill_nested, "table/v/torque"),
        (("f8", (2,)), fill_array, "table/v[:,1]"),
        ([("torque", [("x", "f8")], (2,))], None, "table/v/torque[:,1]/x"),
        ([("torque", "f4", (3,))], fill_deep, "table/v/torque[:,1]"),
    ],
    ids=["fields", "array", "fields in an array", "array in fields"],
)
def test_fields_inside_a_field_are_columns(
    tmp_path: Path, shape: tuple[int, ...], kind: Any, fill: Any, wanted: str
) -> None:
    rows = np.zeros(ROWS, dtype=[("time", "f8"), ("v", *kind) if isinstance(kind, tuple) else ("v", kind)])
    if fill:
        fill(rows)
    else:
        rows["time"], rows["v"]["torque"]["x"][:, 1] = T, Q
    file = write(tmp_path, lambda content: content.create_dataset("table", data=rows.reshape(shape)))
    run = import_by(tmp_path, file, MAP.format("table/time", wanted))
    np.testing.assert_allclose(run["time_s"], T)
    stored = Q.astype("f4") if fill in (fill_nested, fill_deep) else Q
    np.testing.assert_allclose(run["torque_nm"], stored)


def test_a_single_row_of_arrays_is_told(tmp_path: Path) -> None:
    def fill(content: h5py.File) -> None:
        content["rec"] = np.zeros(1, dtype=[("time", "f8", (ROWS,)), ("torque", "f8", (ROWS,))])
        content["torque"] = Q

    told = "left out rec (a single row, with arrays in its fields: save one row a sample)"
    assert told in open_hdf5(write(tmp_path, fill)).notes


def test_a_table_of_too_many_fields_is_told(tmp_path: Path) -> None:
    """A type of a few hundred bytes can claim any number of them, without data."""
    kind = np.dtype([("x", np.dtype([("y", "i1", (100,))]), (100,)), ("z", "i1", (100,))])

    def fill(content: h5py.File) -> None:
        content.create_dataset("table", (3,), dtype=kind, chunks=(1,))
        content["torque"] = Q

    assert "left out table (rows of more than 10000 fields)" in open_hdf5(write(tmp_path, fill)).notes


@pytest.mark.parametrize("rows", [5, 20, 49])
def test_a_channel_a_row_is_found_in_a_short_recording(tmp_path: Path, rows: int) -> None:
    data = np.vstack([T[:rows], Q[:rows]])
    recording = open_hdf5(write(tmp_path, lambda content: content.create_dataset("data", data=data)))
    assert [channel.rows for channel in recording.channels] == [rows, rows]
    np.testing.assert_array_equal(read_values(recording, "data[1,:]"), Q[:rows])


@pytest.mark.parametrize("shape", [(12, 30), (30, 12), (200, 3), (3, 200)])
@pytest.mark.parametrize("axis", [0, 1])
def test_names_tell_which_axis_has_the_columns(tmp_path: Path, shape: tuple[int, int], axis: int) -> None:
    data = np.arange(shape[0] * shape[1], dtype=float).reshape(shape)
    names = [f"channel {number}" for number in range(shape[1 - axis])]

    def fill(content: h5py.File) -> None:
        content["data"] = data
        content["data"].attrs["columns"] = names

    recording = open_hdf5(write(tmp_path, fill))
    assert [channel.name for channel in recording.channels] == names
    np.testing.assert_array_equal(read_values(recording, names[1]), data.take(1, 1 - axis))


@pytest.mark.parametrize(
    ("names", "units"),
    [(["time", "torque"], ["ms", "kNm"]), ("time,torque", "ms,kNm"), ("time; torque", "ms; kNm")],
)
def test_names_and_units_of_columns_may_be_those_of_the_group(tmp_path: Path, names: Any, units: Any) -> None:
    def fill(content: h5py.File) -> None:
        group = content.create_group("rig")
        group["data"] = np.column_stack([1e3 * T, Q])
        group.attrs["channels"], group.attrs["units"] = names, units

    run = import_by(tmp_path, write(tmp_path, fill), MAP.format("time", "torque"))
    np.testing.assert_allclose(run["time_s"], T)
    np.testing.assert_allclose(run["torque_nm"], 1e3 * Q)
