"""Packed numbers of netCDF and HDF5: factors, offsets, and numbers outside of the valid range."""

from pathlib import Path
from typing import Any

import h5py
import numpy as np
import pytest

from clutch_hil.recordings.format import open_recording
from tests.clutch_hil.recordings.hdf5_files import ROWS, read_values, write, write_packed


def test_packed_numbers_are_unpacked(tmp_path: Path) -> None:
    recording = open_recording(write(tmp_path, write_packed))
    expected = 5.0 + np.arange(ROWS)
    expected[3] = np.nan
    np.testing.assert_allclose(read_values(recording, "torque"), expected, rtol=1e-12)
    np.testing.assert_allclose(read_values(recording, "gap"), 100.0 * (expected - 5.0), atol=1e-9)


def read_packed(tmp_path: Path, stored: np.ndarray, attributes: dict[str, Any]) -> tuple[np.ndarray, list[str]]:
    """Values of a dataset with these numbers and attributes, and the notes after it was read."""

    def fill(file: h5py.File) -> None:
        file.create_dataset("q", data=stored).attrs.update(attributes)

    recording = open_recording(write(tmp_path, fill))
    return read_values(recording, "q"), recording.notes


@pytest.mark.parametrize("kind", ["i1", "i2", "i4"])
def test_numbers_that_are_said_to_be_unsigned_are(tmp_path: Path, kind: str) -> None:
    most = 2 ** (8 * np.dtype(kind).itemsize)
    numbers = np.array([0, 1, most // 2 - 1, most // 2, most - 2, most - 1])
    attributes = {"_Unsigned": "true", "scale_factor": 0.5, "add_offset": 3.0, "_FillValue": np.array(-1, kind)}
    values, notes = read_packed(tmp_path, numbers.astype(kind.replace("i", "u")).view(kind), attributes)
    np.testing.assert_array_equal(values, [*(3.0 + 0.5 * numbers[:-1]), np.nan])
    assert notes == []
    values, _ = read_packed(tmp_path, np.array([-1, 0, 1], kind), {"_Unsigned": "false"})
    np.testing.assert_array_equal(values, [-1, 0, 1])


@pytest.mark.parametrize(
    ("attributes", "kept"),
    [
        ({"valid_range": np.array([-100, 200], "i2")}, [-10.0, 0.0, 10.0, 20.0, np.nan]),
        ({"valid_min": np.int16(0)}, [np.nan, 0.0, 10.0, 20.0, 30.0]),
        ({"valid_max": np.int16(100), "valid_min": np.int16(-50)}, [np.nan, 0.0, 10.0, np.nan, np.nan]),
        ({"valid_max": 10.0}, [-10.0, 0.0, 10.0, np.nan, np.nan]),  # of another type than the numbers: of the values
        ({"valid_max": np.int16(100), "missing_value": np.int16(300)}, [-10.0, 0.0, 10.0, np.nan, np.nan]),
    ],
)
def test_what_is_outside_of_the_valid_range_is_missing(
    tmp_path: Path, attributes: dict[str, Any], kept: list[float]
) -> None:
    stored = np.array([-100, 0, 100, 200, 300], "i2")
    values, notes = read_packed(tmp_path, stored, {"scale_factor": 0.1, **attributes})
    np.testing.assert_allclose(values, kept)
    outside = np.count_nonzero(np.isnan(kept)) - ("missing_value" in attributes)
    assert notes == [f"q: {outside} of 5 samples are outside of its valid range, and count as missing"]


def test_a_range_of_unsigned_numbers_is_one(tmp_path: Path) -> None:
    stored = np.array([10, 200, 250], "u1").view("i1")
    values, _ = read_packed(tmp_path, stored, {"_Unsigned": "true", "valid_range": np.array([0, 240], "u1").view("i1")})
    np.testing.assert_array_equal(values, [10, 200, np.nan])


def test_a_number_of_32_bits_for_no_value_is_found(tmp_path: Path) -> None:
    fill = np.float32(9.9692099683868690e36)  # of netCDF
    values, _ = read_packed(tmp_path, np.array([1.5, fill], "f4"), {"_FillValue": fill})
    np.testing.assert_array_equal(values, [1.5, np.nan])
