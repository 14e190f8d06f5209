"""Drafts of import maps: the unit that a column of a run gets, and the import by the draft as it is."""

import tomllib
from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest

from clutch_hil.recordings.contents import draft_map
from clutch_hil.recordings.format import open_recording
from protocols.errors import InputError
from protocols.files.runs import REQUIRED
from tests.clutch_hil.recordings.maps import find_refusal as find_map_refusal
from tests.clutch_hil.recordings.maps import import_by
from tests.clutch_hil.recordings.text_files import (
    SPEED,
    TIME,
    TORQUE,
    make_rows,
    make_table,
)

RPM = np.pi / 30.0  # rad/s


@pytest.mark.parametrize("unit", ["1/min", "min-1", "min^-1", "/min", "rpm", "U/min"])
def test_a_draft_makes_a_speed_of_turns_in_a_minute(tmp_path: Path, unit: str) -> None:
    file = tmp_path / "recording.csv"
    file.write_text(make_table(header=f"time,torque [Nm],speed [{unit}]"))
    draft = draft_map(file, open_recording(file, {}))
    np.testing.assert_allclose(import_by(tmp_path, file, draft)["speed_rad_s"], RPM * SPEED, rtol=1e-12)


def test_a_draft_takes_numbers_times_and_flags_as_text(tmp_path: Path) -> None:
    times = [f"2026-11-30T10:11:{12.0 + t:06.3f}" for t in TIME]
    columns = {
        "time": times, "speed [rpm]": [f"{value:.2f}" for value in SPEED], "valve": ["on", "off"] * 30,
        "remark": ["a word"] * 60,
    }  # fmt: skip
    file = tmp_path / "recording.parquet"
    pq.write_table(pa.table(columns), file)
    draft = draft_map(file, open_recording(file))
    assert "remark" not in draft.partition("[columns]")[2].partition("# A run")[0]
    run = import_by(tmp_path, file, draft)
    np.testing.assert_allclose(run["time_s"], TIME, atol=1e-9)
    np.testing.assert_allclose(run["speed_rpm_rad_s"], RPM * SPEED, rtol=1e-9)
    np.testing.assert_array_equal(run["valve_1"], [1.0, 0.0] * 30)


def test_a_draft_of_a_single_column_has_the_rate_of_the_file(tmp_path: Path) -> None:
    file = tmp_path / "scope.csv"
    rows = "".join(f"{value}\n" for value in SPEED)
    file.write_text(f"#CHANNEL:CH1\n#CLOCK=10.0mS\n#SIZE=60\n#UNITS:V\n\n{rows}")
    run = import_by(tmp_path, file, draft_map(file, open_recording(file)))
    np.testing.assert_allclose(run["time_s"], TIME, atol=1e-12)
    np.testing.assert_array_equal(run["channel_ch1_v"], SPEED)
    file.write_text(f"value\n{rows}")
    with pytest.raises(InputError, match="has no two columns of numbers to map"):
        draft_map(file, open_recording(file))


@pytest.mark.parametrize(
    ("unit", "remedy"),
    [
        ("1/min", "set unit = 'rpm' where these are turns a minute"),
        ("Hz", "set unit = 'rps' where these are turns a second"),
        ("kHz", "set unit, unit_from = 'map' and scale where these are turns"),
    ],
)
def test_a_frequency_for_a_speed_is_refused_with_a_unit_that_fits(tmp_path: Path, unit: str, remedy: str) -> None:
    file = tmp_path / "recording.csv"
    file.write_text(make_table(header=f"time,torque [Nm],speed [{unit}]"))
    columns = '[columns]\ntime_s = { from = "time", unit = "s" }\nspeed_rad_s = { from = "speed" }\n'
    assert remedy in find_map_refusal(tmp_path, file, columns)
    if unit == "Hz":
        run = import_by(tmp_path, file, columns.replace('"speed"', '"speed", unit = "rps"'))
        np.testing.assert_allclose(run["speed_rad_s"], 2.0 * np.pi * SPEED, rtol=1e-12)


@pytest.mark.parametrize(
    ("header", "time"),
    [
        ("T/Nm,t/s,n/min-1", "t/s"), ("T (Nm),t (s),n (1/min)", "t"), ("T,t,n/U/min", "t"), ("T/°C,Zeit/ms,n/1/min", "Zeit/ms"),
        ("T [degC],t,n_rpm", "t"),
    ],
)  # fmt: skip
def test_a_draft_takes_no_torque_and_no_temperature_for_the_time(tmp_path: Path, header: str, time: str) -> None:
    """DIN and ISO write t/s and T/Nm."""
    file = tmp_path / "recording.csv"
    cells = zip(TORQUE, TIME, SPEED, strict=True)
    file.write_text(make_rows(header, *(f"{torque:.4f},{time:.2f},{speed:.2f}" for torque, time, speed in cells)))
    draft = draft_map(file, open_recording(file))
    assert f'\ntime_s = {{ from = "{time}"' in draft
    run = import_by(tmp_path, file, draft)
    np.testing.assert_allclose(run["time_s"], TIME * (1e-3 if "ms" in time else 1.0), atol=1e-12)
    np.testing.assert_allclose(run["n_rad_s"], RPM * SPEED, rtol=1e-12)


def test_a_draft_imports_a_quantity_for_which_runs_have_no_ending(tmp_path: Path) -> None:
    file = tmp_path / "recording.csv"
    file.write_text(make_table(header="time [s],torque [Nm],acceleration [g]"))
    draft = draft_map(file, open_recording(file))
    assert "# in g, for which no ending of a name exists" in draft
    np.testing.assert_array_equal(import_by(tmp_path, file, draft)["acceleration_1"], SPEED)


def test_a_draft_names_a_signal_of_inca_and_not_its_device(tmp_path: Path) -> None:
    file = tmp_path / "recording.csv"
    file.write_text(make_table(header="time,torque\\ETKC:1,plant\\speed"))
    draft = draft_map(file, open_recording(file))
    assert "\ntorque_1 = " in draft
    assert "\nspeed_1 = " in draft


def test_a_draft_names_a_column_that_rises_as_a_time_perhaps(tmp_path: Path) -> None:
    """Hantek writes times without a name and a unit."""
    file = tmp_path / "scope.csv"
    rows = "".join(f"{time:.5E},{torque:.3f}\n" for time, torque in zip(TIME, TORQUE, strict=True))
    file.write_text(f"#timebase=2000000000(ps)\n,#voltbase=5000000(uV)\n#size=60\n{rows}")
    draft = draft_map(file, open_recording(file))
    assert '\n# time_s = { from = "column 1", unit = "s" }  # no column has the name' in draft
    run = import_by(tmp_path, file, draft.replace("# time_s", "time_s"))
    np.testing.assert_allclose(run["time_s"], TIME, atol=1e-12)


def test_a_draft_names_the_first_column_that_rises_wherever_it_stands(tmp_path: Path) -> None:
    """pandas calls it axis1 in HDF5, FAMOS `torque_time`."""
    file = tmp_path / "recording.parquet"
    pq.write_table(pa.table({"remark": ["a", "b"] * 30, "torque": TORQUE, "axis1": TIME, "speed": SPEED}), file)
    assert '\n# time_s = { from = "axis1", unit = "s" }' in draft_map(file, open_recording(file))


def test_a_draft_makes_no_time_of_another_column(tmp_path: Path) -> None:
    file = tmp_path / "no time.csv"
    file.write_text(make_rows("position [mm],torque [Nm]", "0,1", "2,3", "4,5"), encoding="utf-8")
    draft = draft_map(file, open_recording(file))
    assert "\ntime_s" not in draft
    assert '# time_s = { from = ""' in draft
    assert 'position_m = { from = "position" }' in draft


def test_a_draft_names_the_columns_of_a_wet_clutch_that_it_lacks(tmp_path: Path) -> None:
    file = tmp_path / "rig.csv"
    file.write_text(make_rows("time [s],clutch torque [Nm]", "0,1", "1,3", "2,5"), encoding="utf-8")
    draft = draft_map(file, open_recording(file))
    assert 'clutch_torque_nm = { from = "clutch torque" }' in draft
    *_, names, instead = draft.splitlines()
    assert "formula" in instead
    lacking = names.removeprefix("# ").split(", ")
    assert lacking == [name for name in REQUIRED if name not in ("time_s", "clutch_torque_nm")]
    tomllib.loads(draft)


def test_a_column_of_words_for_no_value_is_left_out(tmp_path: Path) -> None:
    path = tmp_path / "recording.csv"
    path.write_text(make_table(header="time,torque,speed,note", end=",NULL"))
    assert "# left out, with no value in the first and last rows: note" in draft_map(path, open_recording(path))


def test_a_unit_at_the_end_of_a_name_is_not_written_twice(tmp_path: Path) -> None:
    path = tmp_path / "recording.csv"
    path.write_text(make_table(header="Zeit_s,torque_nm [Nm],speed_rad_s [rpm]"))
    text = draft_map(path, open_recording(path))
    assert 'time_s = { from = "Zeit_s", unit = "s" }' in text
    assert 'torque_nm = { from = "torque_nm" }' in text
    assert 'speed_rad_s = { from = "speed_rad_s" }' in text
