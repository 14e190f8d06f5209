"""Several tables in one text file: beside each other, below each other, and one that a logger began again."""

from pathlib import Path

import numpy as np
import pytest

from tests.clutch_hil.recordings.text_files import (
    ROWS,
    SPEED,
    TIME,
    TORQUE,
    TWO,
    assert_right,
    convert_run,
    find_refusal,
    make_rows,
    make_table,
    read,
)

HEADERS = {
    "names": "time,torque,speed",
    "names and units": "time,torque,speed\ns,Nm,rad/s",
    "in quotes": '"time","torque","speed"',
    "remarks": "Recorder,bench 7\nSampling,100 Hz\ntime,torque,speed",
    "a mark": "\ufefftime,torque,speed",
}


@pytest.mark.parametrize("name", HEADERS)
def test_names_that_stand_again_between_the_rows_are_left_out(tmp_path: Path, name: str) -> None:
    lines = make_table(header=HEADERS[name]).splitlines()
    count = len(lines) - ROWS
    run = read(tmp_path, make_rows(*lines[: count + 30], *lines[:count], *lines[count + 30 :]))
    assert_right(run)
    message = f"left out {count} lines between the rows that repeat those above them, the first is line {count + 31}"
    assert message in convert_run(run)


def test_other_names_between_the_rows_are_refused(tmp_path: Path) -> None:
    lines = make_table().splitlines()
    text = make_rows(*lines[:31], "time,speed,torque", *lines[31:])
    assert "column 'time' holds 'time' in line 32, which is no number" in find_refusal(tmp_path, text)


def test_a_word_that_also_stands_above_the_rows_is_no_heading_in_a_column_of_words(tmp_path: Path) -> None:
    rows = [f"{'idle' if k < 30 else 'phase'},{t:.2f},{TORQUE[k]}" for k, t in enumerate(TIME)]
    run = read(tmp_path, make_rows("phase,time,torque", *rows), columns=TWO)
    np.testing.assert_array_equal(run["torque_nm"], TORQUE)


def test_segments_of_labview_that_go_on_are_one_recording(tmp_path: Path) -> None:
    lines = make_table("\t", header="time\ttorque\tspeed\tComment").splitlines()
    segment = "Channels\t2\nSamples\t30\t30\nTime\t09:47:{:02d}.10\t09:47:02.10\n***End_of_Header***\t\t\n" + lines[0]
    text = make_rows(segment.format(2), *lines[1:31], "", segment.format(3), *lines[31:])
    assert_right(read(tmp_path, "LabVIEW Measurement\t\n***End_of_Header***\t\n\t\n" + text))


def test_two_recordings_in_one_file_are_refused_where_the_second_begins(tmp_path: Path) -> None:
    sentence = find_refusal(tmp_path, make_table() + make_table())
    assert "does not increase in row 60" in sentence
    assert "repeat those above them, the first is line 62" in sentence


SIDE_BY_SIDE = """
[columns]
time_s = { from = "time 1" }
torque_nm = { from = "torque", unit = "Nm" }
speed_rad_s = { from = "speed", unit = "rad/s" }
"""


def make_side_by_side(unit: str = "s", factor: float = 1.0) -> str:
    """Torque at each time, and speed at every second one: a shorter table beside the first, in another `unit`."""
    rows = [
        f"{t:.2f};{TORQUE[k]};" + (f"{factor * TIME[2 * k]:.2f};{SPEED[2 * k]}" if 2 * k < ROWS else ";")
        for k, t in enumerate(TIME)
    ]
    return make_rows(f"time 1 [s];torque;time 2 [{unit}];speed", *rows)


@pytest.mark.parametrize(("unit", "factor"), [("s", 1.0), ("ms", 1e3)])
def test_tables_side_by_side_have_each_its_own_time(tmp_path: Path, unit: str, factor: float) -> None:
    run = read(tmp_path, make_side_by_side(unit, factor), "resample_hz = 100.0", SIDE_BY_SIDE)
    assert_right(run, slice(0, ROWS - 1))
    assert "has several axes of time, 'time 1 [s]'" in convert_run(run)


def test_tables_side_by_side_are_not_joined_unasked(tmp_path: Path) -> None:
    sentence = find_refusal(tmp_path, make_side_by_side(), columns=SIDE_BY_SIDE)
    assert "torque_nm and speed_rad_s on different rasters" in sentence


@pytest.mark.parametrize("other", ["time since start [ms]", "Time of flight [s]", "time left [s]", "times"])
def test_a_further_time_of_the_same_rows_is_no_axis(tmp_path: Path, other: str) -> None:
    """In other units, constant, or running back: it is not another clock."""
    value = {"time since start [ms]": lambda t: 1e3 * t + 7.0, "time left [s]": lambda t: 9.0 - t}.get(
        other, lambda t: 0.2
    )
    lines = make_table(header=f"time [s],{other},torque,speed").splitlines()
    rows = [
        f"{line.partition(',')[0]},{value(t):.3f},{line.partition(',')[2]}"
        for t, line in zip(TIME, lines[1:], strict=True)
    ]
    assert_right(read(tmp_path, make_rows(lines[0], *rows)))


@pytest.mark.parametrize("names", ["X_Value,torque,X_Value,speed", "t1,torque,t2,speed", "X,torque,X,speed"])
def test_two_tables_whose_times_tell_no_unit_are_not_put_on_one_time(tmp_path: Path, names: str) -> None:
    rows = [f"{0.01 * n:.2f},{n},{0.02 * n:.2f},{n}" for n in range(60)]
    both = '[columns]\ntime_s = { number = 1, unit = "s" }\ntorque_nm = { number = 2, unit = "Nm" }\n'
    text = make_rows(names, *rows)
    assert "both rise, and differently, as times of two tables beside each other do" in find_refusal(
        tmp_path, text, columns=both + 'speed_rad_s = { number = 4, unit = "rad/s" }\n'
    )
    assert read(tmp_path, text, columns=both)["time_s"][1] == pytest.approx(0.01)
    second = '[columns]\ntime_s = { number = 3, unit = "s" }\nspeed_rad_s = { number = 4, unit = "rad/s" }\n'
    assert read(tmp_path, text, columns=second)["time_s"][1] == pytest.approx(0.02)
    with_units = make_rows(names, "s,Nm,s,rad/s", *rows)
    run = read(tmp_path, with_units, "resample_hz = 50.0", both + "speed_rad_s = { number = 4 }\n")
    assert run["speed_rad_s"][10] == pytest.approx(run["time_s"][10] / 0.02, abs=1e-6)
