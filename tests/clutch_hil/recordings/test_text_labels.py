"""Text whose lines name each number, or are in brackets, as small programs print them."""

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from clutch_hil.recordings.format import open_recording
from tests.clutch_hil.recordings.text_files import (
    MAP,
    ROWS,
    SPEED,
    TIME,
    TORQUE,
    assert_right,
    convert_run,
    find_refusal,
    make_table,
    read,
)


def write_lines(line: str, write: Callable[[float], str] = repr) -> list[str]:
    """The recording, each row in the form of `line`."""
    numbers = (map(write, column.tolist()) for column in (np.round(TIME, 2), TORQUE, SPEED))
    return [line.format(*row) for row in zip(*numbers, strict=True)]


def join(*lines: str) -> str:
    return "\n".join([*lines, ""])


@pytest.mark.parametrize(
    "line",
    [
        "time:{0},torque:{1},speed:{2}", "time: {0}, torque: {1}, speed: {2},", "time={0}\ttorque={1}\tspeed={2}",
        "time:{0} torque:{1} speed:{2}", "time: {0}   torque: {1}   speed: {2}", "time = {0} torque = {1} speed = {2}",
        "time: {0} s, torque: {1} Nm, speed: {2} rad/s", "time: {0} s torque: {1} Nm speed: {2} rad/s",
        "time [s]: {0}; torque [Nm]: {1}; speed [rad/s]: {2}", "  time:{0},\ttorque:{1},\tspeed:{2}",
    ],
)  # fmt: skip
def test_names_before_each_number_are_those_of_the_columns(tmp_path: Path, line: str) -> None:
    run = read(tmp_path, join(*write_lines(line)))
    assert_right(run)
    assert "names before each number are those of the columns" in convert_run(run)
    assert_right(read(tmp_path, join("Connecting ...", "bench 7: ready", *write_lines(line))))


def test_a_decimal_comma_stays_one(tmp_path: Path) -> None:
    for line in ("time:{0};torque:{1};speed:{2}", "time:{0} torque:{1} speed:{2}"):
        assert_right(read(tmp_path, join(*write_lines(line, lambda value: repr(value).replace(".", ",")))))
    unclear = join(*write_lines("time:{0},torque:{1},speed:{2}", lambda value: repr(value).replace(".", ",")))
    find_refusal(tmp_path, unclear)


def test_a_number_without_a_value_is_missing(tmp_path: Path) -> None:
    lines = write_lines("time:{0},torque:{1},speed:{2}")
    lines[9], lines[12] = lines[9].partition(",speed")[0] + ",speed:nan", lines[12].partition(",speed")[0] + ",speed:"
    run = read(tmp_path, join(*lines), "resample_hz = 100.0")
    assert "speed: 2 of 60 cells have no value" in convert_run(run)


def test_cells_before_the_first_name_are_columns_of_their_own(tmp_path: Path) -> None:
    lines = [f"{2 * n},{line}" for n, line in enumerate(write_lines("time:{0},torque:{1},speed:{2}"))]
    assert_right(read(tmp_path, join(*lines)))
    run = read(tmp_path, join(*lines), columns=MAP.replace('"time", unit = "s"', '"column 1", unit = "ms"'))
    np.testing.assert_allclose(run["time_s"], 2e-3 * np.arange(ROWS))


def test_the_times_of_arrival_stand_before_the_names(tmp_path: Path) -> None:
    for line in ("time:{0},torque:{1},speed:{2}", "time: {0} torque: {1} speed: {2}"):
        lines = [f"14:05:07.{10 * n:03d} -> {text}" for n, text in enumerate(write_lines(line))]
        assert_right(read(tmp_path, join(*lines)))
        run = read(tmp_path, join(*lines), columns=MAP.replace('"time"', '"arrival_time"'))
        np.testing.assert_allclose(run["time_s"], TIME, atol=1e-9)


@pytest.mark.parametrize("line", ["ts={0} torque={1} speed={2}", "ts: {0}, torque: {1}, speed: {2}"])
def test_a_time_of_day_may_have_a_name(tmp_path: Path, line: str) -> None:
    moments = [f"2025-03-02T10:11:{12.0 + t:06.3f}Z" for t in TIME]
    lines = [line.format(*row) for row in zip(moments, TORQUE, SPEED, strict=True)]
    run = read(tmp_path, join(*lines), columns=MAP.replace('"time", unit = "s"', '"ts"'))
    assert_right(run)
    assert "recorded at 2025-03-02T10:11:12+00:00" in convert_run(run)


def test_a_line_with_other_names_is_not_read_as_a_row(tmp_path: Path) -> None:
    """Where the names change their places, numbers of two signals would be in one column."""
    lines = write_lines("time:{0},torque:{1},speed:{2}")
    time, torque, speed = lines[30].split(",")
    lines[30] = f"{time},{speed},{torque}"
    assert "holds 'time:0.3' in line 31, which is no number" in find_refusal(tmp_path, join(*lines))
    lines[30] = "sensor lost"
    run = read(tmp_path, join(*lines), "resample_hz = 100.0")
    assert "left out 1 line of words, the first is line 31: 'sensor lost'" in convert_run(run)
    mixed = [text if n % 2 else ",".join(reversed(text.split(","))) for n, text in enumerate(lines)]
    find_refusal(tmp_path, join(*mixed))


def test_lines_above_have_no_names_where_each_number_has_one(tmp_path: Path) -> None:
    """The first line is damaged by zero bytes, and has as many cells as the others."""
    lines = write_lines("time: {0}, torque: {1}Nm, speed: {2}rad/s")
    run = read(tmp_path, join("PuTTY log 2022.03.27 13:18:46", f"{bytes(20).decode()}{lines[0]}", *lines))
    assert_right(run)
    assert "above the names: PuTTY log 2022.03.27 13:18:46; time: 0.0, torque: 0.0Nm, speed: 0.25rad/s" in convert_run(
        run
    )


def test_a_single_name_is_a_remark(tmp_path: Path) -> None:
    path = tmp_path / "remarks.csv"
    path.write_text(join("time,torque,state", *(f"{t},1.5,gear:{n}" for n, t in enumerate(TIME))))
    assert [channel.kind for channel in open_recording(path).channels] == ["number", "number", "text"]


@pytest.mark.parametrize(
    "line", ["({0}, {1}, {2})", "[{0}, {1}, {2}]", "[{0}, {1}, {2}],", "[{0} {1} {2}]", "[ {0}  {1}  {2}]"]
)
@pytest.mark.parametrize("names", ["time,torque,speed", "('time', 'torque', 'speed')", '["time", "torque", "speed"]'])
def test_tuples_and_lists_of_python_are_rows(tmp_path: Path, line: str, names: str) -> None:
    if "," not in line:
        names = names.replace(",", " ")
    assert_right(read(tmp_path, join(names, *write_lines(line))))


def test_rows_that_are_lists_need_no_names(tmp_path: Path) -> None:
    numbered = MAP
    for number, name in enumerate(("time", "torque", "speed"), 1):
        numbered = numbered.replace(f'from = "{name}"', f"number = {number}")
    assert_right(read(tmp_path, join(*write_lines("[{0}, {1}, {2}]")), columns=numbered))


def test_numbers_below_zero_in_brackets_stay_below_zero(tmp_path: Path) -> None:
    """As bookkeepers write them, and with brackets around the first and the last one of a row."""
    table = make_table(write=lambda value: f"({-value:.4f})" if value < 0.0 else f"{value:.4f}")
    assert_right(read(tmp_path, table))
