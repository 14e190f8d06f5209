"""Text files that can be read in two ways, one of them wrong in silence: times of day as digits, numbers for no value."""

from pathlib import Path

import numpy as np
import pytest

from tests.clutch_hil.recordings.text_files import (
    MAP,
    NAMES,
    ROWS,
    SPEED,
    TIME,
    TORQUE,
    convert_run,
    find_refusal,
    make_table,
    read,
    write_with_comma,
)


def test_several_numbers_may_stand_for_no_value(tmp_path: Path) -> None:
    lines = make_table().splitlines()
    for row, number in ((20, "9.9E+37"), (21, "-9.9E+37"), (22, "9.91E+37")):
        lines[row + 1] = ",".join([lines[row + 1].split(",")[0], number, lines[row + 1].split(",")[2]])
    text = "\n".join([*lines, ""])
    columns = MAP.replace('"Nm" }', '"Nm", missing = [9.9e37, -9.9e37, 9.91e37] }')
    assert "torque_nm is not a number in row 20, one of 3 such rows" in find_refusal(tmp_path, text, columns=columns)
    columns = MAP.replace('"Nm" }', '"Nm", missing = [9.9e37, "OVER"] }')
    assert "torque_nm.missing is 'OVER'; allowed is a number" in find_refusal(tmp_path, text, columns=columns)


@pytest.mark.parametrize("file", ["low_pass_hz = 20.0", "resample_hz = 50.0"])
def test_a_number_that_stands_for_no_value_is_told_before_a_filter_spreads_it(tmp_path: Path, file: str) -> None:
    text = make_table().replace(f",{TORQUE[20]:.4f},", ",-9999,")
    assert "torque_nm is -9999 in 1 row" in convert_run(read(tmp_path, text, file))
    assert "away from all other values" not in convert_run(read(tmp_path, make_table(), file))


def test_a_column_with_another_decimal_mark_is_told_as_such(tmp_path: Path) -> None:
    lines = [
        f"{write_with_comma(time)};{torque + 2.0:.3f};{write_with_comma(speed)}"
        for time, torque, speed in zip(TIME, TORQUE, SPEED, strict=True)
    ]
    sentence = find_refusal(tmp_path, "\n".join([";".join(NAMES), *lines, ""]), 'decimal = ","\nthousands = ""')
    assert (
        "holds text, such as '2.000', whose decimal mark is not ',' as in other columns; allowed are numbers"
        in sentence
    )


def write_digits(start: float, step: float) -> list[str]:
    """Times of day as NMEA writes them, without the zeros that a spreadsheet takes away."""
    days = (start + step * np.arange(ROWS)).tolist()
    return [f"{int(s // 3600)}{int(s // 60 % 60):02d}{s % 60:05.2f}" for s in days]


@pytest.mark.parametrize(("start", "step"), [(9 * 3600 + 59.7, 0.01), (12 * 3600 - 0.3, 0.01), (10 * 3600 + 5.0, 1.0)])
def test_times_of_day_as_digits_are_asked_about(tmp_path: Path, start: float, step: float) -> None:
    text = make_table(times=write_digits(start, step))
    assert "is hhmmss, perhaps, as NMEA writes it; set time_format = '%H%M%S'" in find_refusal(tmp_path, text)
    run = read(tmp_path, text, 'time_format = "%H%M%S"')
    np.testing.assert_allclose(run["time_s"], step * np.arange(ROWS), atol=1e-9)
    taken = MAP.replace('unit = "s"', 'unit = "s", unit_from = "map"')
    assert "jumps by 4" in find_refusal(tmp_path, text, columns=taken) or step == 1.0


@pytest.mark.parametrize(
    ("first", "told"), [(101530.25, True), (101500, True), (96530.25, False), (101570.0, False), (530.25, False)]
)
def test_times_of_day_within_a_minute_are_told(tmp_path: Path, first: float, told: bool) -> None:
    run = read(tmp_path, make_table(times=[f"{first + time:.2f}" for time in TIME]))
    np.testing.assert_allclose(run["time_s"], first + TIME, atol=1e-9)
    assert ("'time' is a time of day as hhmmss, perhaps" in convert_run(run)) == told


@pytest.mark.parametrize("step", [20, 50, 100])
def test_even_ms_are_no_times_of_day(tmp_path: Path, step: int) -> None:
    text = make_table(times=[f"{step * row}" for row in range(ROWS)])
    run = read(tmp_path, text, columns=MAP.replace('unit = "s"', 'unit = "ms"'))
    np.testing.assert_allclose(run["time_s"], 1e-3 * step * np.arange(ROWS), atol=1e-9)


def test_an_entry_for_logs_is_refused_with_the_beginning_of_the_text(tmp_path: Path) -> None:
    sentence = find_refusal(tmp_path, "t100811\nt100822\n", 'dbc = "car.dbc"')
    assert "file.dbc is not an option of" in sentence
    assert "it is one of bus log, MDF, compressed file, and the file begins with b't100811\\nt100822\\n'" in sentence
