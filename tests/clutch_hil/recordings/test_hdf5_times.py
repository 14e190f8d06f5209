"""Times in HDF5 files: since a date, in ns since 1970, in words."""

from pathlib import Path

import h5py
import numpy as np
import pytest

from tests.clutch_hil.recordings.hdf5_files import ROWS, Q, T, write, write_packed
from tests.clutch_hil.recordings.maps import find_refusal, import_by


def test_times_since_a_date_are_times_of_day(tmp_path: Path) -> None:
    text = '[columns]\ntime_s = { from = "time" }\ntorque_nm = { from = "torque" }\n[file]\nresample_hz = 100.0\n'
    run = import_by(tmp_path, write(tmp_path, write_packed), text)
    np.testing.assert_allclose(run["time_s"], 0.01 * np.arange(len(run["time_s"])), atol=1e-6)
    assert run.metadata["import"]["start"] == "2024-03-05T10:11:12+00:00"


@pytest.mark.parametrize(
    ("unit", "seconds"), [("hours", 3600.0), ("msec", 1e-3), ("microseconds", 1e-6), ("days", 86400.0)]
)
def test_times_since_a_date_need_be_no_axis(tmp_path: Path, unit: str, seconds: float) -> None:
    steps = 0.01 * np.arange(ROWS)

    def fill(file: h5py.File) -> None:
        file["time"], file["q"] = steps / seconds, Q
        file["time"].attrs["units"] = f"{unit} since 2024-03-05 10:11:12"

    text = '[columns]\ntime_s = { from = "time", unit = "s" }\ntorque_nm = { from = "q", unit = "Nm" }\n'
    run = import_by(tmp_path, write(tmp_path, fill), text)
    np.testing.assert_allclose(run["time_s"], steps, rtol=0.0, atol=1e-6)
    assert run.metadata["import"]["start"] == "2024-03-05T10:11:12+00:00"


def test_whole_ns_since_1970_keep_their_digits(tmp_path: Path) -> None:
    steps = 1000 * np.arange(ROWS) + np.arange(ROWS) % 7

    def fill(file: h5py.File) -> None:
        file["t"], file["q"] = 1_711_850_000_000_000_123 + steps, Q

    text = '[columns]\ntime_s = { from = "t", unit = "ns" }\ntorque_nm = { from = "q", unit = "Nm" }\n'
    run = import_by(tmp_path, write(tmp_path, fill), text)
    np.testing.assert_allclose(run["time_s"], 1e-9 * steps, rtol=0.0, atol=1e-15)


def test_a_time_in_words_is_refused_without_an_entry_that_hdf5_does_not_know(tmp_path: Path) -> None:
    def fill(file: h5py.File) -> None:
        file["time"] = [f"at {t:06.3f} o'clock" for t in T]
        file["torque"] = Q

    columns = '[columns]\ntime_s = { from = "time" }\ntorque_nm = { from = "torque", unit = "Nm" }\n'
    sentence = find_refusal(tmp_path, write(tmp_path, fill), columns)
    assert sentence.endswith("allowed are columns of numbers, also of numbers, times or on and off as text")
