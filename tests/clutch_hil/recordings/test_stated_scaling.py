"""Factors and offsets that a file states beside whole numbers, and that no standard asks to apply, are asked about."""

from pathlib import Path

import h5py
import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest
from nptdms import ChannelObject, TdmsWriter
from scipy.io import savemat

from clutch_hil.recordings.stated_scaling import describe_scaling, describe_scaling_beside
from tests.clutch_hil.recordings.maps import find_refusal, import_by

ROWS = 60
TIME = 0.01 * np.arange(ROWS)
COUNTS = np.round(5000.0 + 900.0 * np.sin(TIME)).astype("i2")
SCALE, OFFSET = 0.02, -100.0


def write_hdf5(path: Path, stored: np.ndarray) -> None:
    with h5py.File(path, "w") as file:
        file["time"], file["torque"] = TIME, stored
        file["torque"].attrs.update({"gain": SCALE, "Offset": OFFSET, "sample_rate": 100.0})


def write_tdms(path: Path, stored: np.ndarray) -> None:
    with TdmsWriter(path) as writer:
        torque = ChannelObject("bench", "torque", stored, {"gain": SCALE, "Offset": OFFSET})
        writer.write_segment([ChannelObject("bench", "time", TIME), torque])


def write_parquet(path: Path, stored: np.ndarray) -> None:
    expected_text = {"gain": str(SCALE), "Offset": str(OFFSET)}
    fields = [
        pa.field("time", pa.float64()),
        pa.field("torque", pa.from_numpy_dtype(stored.dtype), metadata=expected_text),
    ]
    pq.write_table(pa.table([TIME, stored], schema=pa.schema(fields)), path)


def write_matlab(path: Path, stored: np.ndarray) -> None:
    with path.open("wb") as file:
        savemat(file, {"time": TIME, "torque": {"x": stored, "gain": SCALE, "Offset": OFFSET}})


WRITERS = {"HDF5": write_hdf5, "TDMS": write_tdms, "Parquet": write_parquet, "MATLAB": write_matlab}


def make_map(kind: str, entries: str = "") -> str:
    name = "torque.x" if kind == "MATLAB" else "torque"
    torque = f'torque_nm = {{ from = "{name}", unit = "Nm"{entries} }}'
    return f'[columns]\ntime_s = {{ from = "time", unit = "s" }}\n{torque}\n'


@pytest.mark.parametrize("kind", WRITERS)
def test_counts_beside_a_factor_are_not_taken_for_values(tmp_path: Path, kind: str) -> None:
    path = tmp_path / "recording"
    WRITERS[kind](path, COUNTS)
    sentence = find_refusal(tmp_path, path, make_map(kind))
    assert "has whole numbers, and the file states gain = 0.02, Offset = -100 of it, which is not applied" in sentence
    run = import_by(tmp_path, path, make_map(kind, f", scale = {SCALE}, offset = {OFFSET}"))
    np.testing.assert_allclose(run["torque_nm"], SCALE * COUNTS + OFFSET, rtol=1e-12)
    np.testing.assert_array_equal(import_by(tmp_path, path, make_map(kind, ", offset = 0.0"))["torque_nm"], COUNTS)


@pytest.mark.parametrize("kind", ["HDF5", "TDMS", "Parquet"])
def test_a_factor_beside_values_is_told(tmp_path: Path, kind: str) -> None:
    path = tmp_path / "recording"
    WRITERS[kind](path, np.sin(TIME))
    run = import_by(tmp_path, path, make_map(kind))
    np.testing.assert_array_equal(run["torque_nm"], np.sin(TIME))
    message = "torque: the file states gain = 0.02, Offset = -100, which is not applied"
    assert message in run.metadata["import"]["done"]


def test_what_changes_nothing_or_is_no_number_is_no_scaling() -> None:
    expected_text = [
        ("gain", 1.0),
        ("offset", "0"),
        ("Scale", "linear"),
        ("slope", None),
        ("torque", 3.0),
        ("bias", "nan"),
    ]
    assert describe_scaling(expected_text) == ""
    assert describe_scaling([("Cal Factor", "2.5"), ("y_intercept", 3)]) == "Cal Factor = 2.5, y_intercept = 3"


def test_a_factor_called_as_the_channel_is_asked_about(tmp_path: Path) -> None:
    path = tmp_path / "recording"
    with h5py.File(path, "w") as file:
        file["time"], file["torque"], file["speed"] = TIME, COUNTS, COUNTS
        file.attrs["torque_scale"] = SCALE
    assert "the file states torque_scale = 0.02 of it" in find_refusal(tmp_path, path, make_map("HDF5"))
    run = import_by(tmp_path, path, make_map("HDF5", ', scale_by = "torque_scale"'))
    np.testing.assert_allclose(run["torque_nm"], SCALE * COUNTS, rtol=1e-12)
    speed = make_map("HDF5").replace('from = "torque"', 'from = "speed"')
    np.testing.assert_array_equal(import_by(tmp_path, path, speed)["torque_nm"], COUNTS)  # the factor is another's


@pytest.mark.parametrize("key", ["volts_per_count", "Units per Bit", "Coeffs", "YINCR", "vertical_gain", "data_scale"])
def test_factors_are_known_as_recorders_call_them(key: str) -> None:
    assert describe_scaling([(key, 0.02)]) == f"{key} = 0.02"
    assert describe_scaling([("coefficients", [0.0, 1.0])]) == ""


@pytest.mark.parametrize(
    ("value", "message"), [([0.01, 0.0], "scaling = 0.01, 0"), ([1.0], ""), ("two", ""), (["a"], "")]
)
def test_a_list_of_factors_is_told(value: object, message: str) -> None:
    assert describe_scaling([("scaling", value)]) == message


@pytest.mark.parametrize(
    ("name", "message"),
    [("torque_gain", "torque_gain = 2"), ("run/offset_torque", "run/offset_torque = 2"), ("torque_limit", ""),
     ("motor_torque_gain", ""), ("gain", "")],
)  # fmt: skip
def test_a_factor_belongs_to_what_its_name_says(name: str, message: str) -> None:
    assert describe_scaling_beside("torque", {name: 2.0}) == message


def test_counts_of_an_oscilloscope_are_asked_about(tmp_path: Path) -> None:
    """GW Instek writes counts of its converter below settings, of which one is their factor."""
    path = tmp_path / "recording.csv"
    settings = ("Format,2.0", "Vertical Units,V", "Vertical Scale,5.0E-01", "Firmware,V1.2", "Waveform Data")
    path.write_text("".join(f"{setting},\n" for setting in settings) + "".join(f"{count},\n" for count in COUNTS))
    columns = '[columns]\ntime_s = { rate_hz = 100.0 }\nvalve_v = { number = 1, unit = "V" }\n'
    assert "has whole numbers, and the file states Vertical Scale = 0.5 of it" in find_refusal(tmp_path, path, columns)
    run = import_by(tmp_path, path, columns.replace('"V" }', '"V", scale = 0.02 }'))
    np.testing.assert_allclose(run["valve_v"], 0.02 * COUNTS, rtol=1e-12)


@pytest.mark.parametrize("label", ["Factor;1;0.02", "Gain;1;0.02\nOffset;0;-100"])
def test_a_factor_whose_line_has_a_label_that_rows_lack_is_asked_about(tmp_path: Path, label: str) -> None:
    path = tmp_path / "recording.csv"
    rows = (f"{time:.2f};{count}" for time, count in zip(TIME, COUNTS, strict=True))
    path.write_text("\n".join([label, "time;torque", "s;Nm", *rows, ""]))
    columns = '[columns]\ntime_s = { from = "time" }\ntorque_nm = { from = "torque" }\n'
    assert "the file states" in find_refusal(tmp_path, path, columns)
