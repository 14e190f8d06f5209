"""Dates, epochs and days in text files: the times of rows, and what could be misread."""

from collections.abc import Callable
from datetime import datetime, timedelta
from pathlib import Path

import numpy as np
import pytest

from clutch_hil.recordings.contents import draft_map
from clutch_hil.recordings.format import open_recording
from clutch_hil.recordings.import_map import load_map
from tests.clutch_hil.recordings.text_files import (
    MAP,
    ROWS,
    TIME,
    TWO,
    assert_right,
    convert_run,
    find_refusal,
    make_rows,
    make_table,
    read,
)


def test_a_date_beside_the_time_of_day_is_its_date(tmp_path: Path) -> None:
    rows = [f"05.03.2024;10:11:{12 + k};{k}" for k in range(10)]
    file = tmp_path / "apart.csv"
    file.write_text(make_rows("date;time;torque", *rows), encoding="utf-8")
    recording = open_recording(file)
    assert recording.start == "2024-03-05T10:11:12"
    assert 'time_s = { from = "time" }' in draft_map(file, recording)


def make_two_days(second: str, date: str) -> str:
    """20 rows from 16:00:00 on 5 March, and 20 from the time `second` on, which have the `date`."""
    hour, minute, first = map(int, second.split(":"))
    rows = [f"05.03.2024;16:00:{k:02d};{k}" for k in range(20)]
    return make_rows(
        "date;time;torque", *rows, *(f"{date};{hour:02d}:{minute:02d}:{first + k:02d};{k}" for k in range(20))
    )


@pytest.mark.parametrize(
    ("second", "date", "gap"),
    [
        ("08:00:00", "06.03.2024", 16 * 3600.0), ("16:00:20", "06.03.2024", 86400.0 + 20.0),
        ("16:05:00", "08.03.2024", 3 * 86400.0 + 300.0),
    ],
    ids=["earlier the next day", "later the next day", "days later"],
)  # fmt: skip
def test_days_between_rows_are_those_of_the_dates(tmp_path: Path, second: str, date: str, gap: float) -> None:
    text = make_two_days(second, date)
    columns = TWO + 'speed_rad_s = { from = "torque", unit = "rad/s" }\n'
    (tmp_path / "map.toml").write_text(f"[file]\nlongest_gap_s = 5.0\n{columns}", encoding="utf-8")
    (tmp_path / "days.csv").write_text(text, encoding="utf-8")
    one, other = load_map(str(tmp_path / "map.toml")).read_runs(tmp_path / "days.csv")
    np.testing.assert_array_equal(one["time_s"], np.arange(20.0))
    np.testing.assert_array_equal(other["time_s"], gap + np.arange(20.0))
    assert "time: its days are those of 'date'" in convert_run(one)


@pytest.mark.parametrize(
    ("clock", "written"),
    [("%I:%M:%S.%f %p", "%I:%M:%S %p"), ("%I:%M %p", "%I:%M %p"), ("%H:%M", "%H:%M"), ("%H:%M:%S.%f", "%H:%M:%S")],
)
def test_a_format_that_is_proposed_for_a_date_reads_it(tmp_path: Path, clock: str, written: str) -> None:
    step = timedelta(minutes=1) if clock.count(":") == 1 else timedelta(seconds=0.01)
    first = datetime(2024, 3, 5, 11, 59, 30)
    text = make_table(times=[(first + row * step).strftime(f"%m/%d/%Y {clock}") for row in range(ROWS)])
    told = find_refusal(tmp_path, text, columns=TWO)
    proposed = f"%m/%d/%Y {written}"
    assert f"or '{proposed}' in [file]" in told
    np.testing.assert_allclose(
        read(tmp_path, text, f"time_format = {proposed!r}", TWO)["time_s"], step.total_seconds() * np.arange(ROWS)
    )


@pytest.mark.parametrize("second", ["08:00:00", "17:00:00"], ids=["earlier", "later"])
def test_days_between_rows_of_dates_that_can_be_misread_are_asked_for(tmp_path: Path, second: str) -> None:
    text = make_two_days(second, "03/06/2024").replace("05.03.2024", "03/05/2024")
    assert "set time_format = '%d/%m/%Y' or '%m/%d/%Y' in [file]" in find_refusal(tmp_path, text, columns=TWO)
    run = read(tmp_path, text, 'time_format = "%m/%d/%Y"\nresample_hz = 1.0\nlongest_gap_s = 1e5', TWO)
    assert run["time_s"][-1] == 86400.0 + 3600.0 * (int(second[:2]) - 16) + 19.0


def test_dates_that_can_be_misread_do_not_matter_where_the_clock_passes_midnight(tmp_path: Path) -> None:
    rows = [
        f"03/{5 if k < 10 else 6:02d}/2024;{23 if k < 10 else 0:02d}:{59 if k < 10 else 0:02d}:{(50 + k) % 60:02d};{k}"
        for k in range(20)
    ]
    run = read(tmp_path, make_rows("date;time;torque", *rows), columns=TWO)
    np.testing.assert_array_equal(run["time_s"], np.arange(20.0))


@pytest.mark.parametrize("date", ["05.03.2024", "", "06.03."], ids=["of the start", "of the first rows", "damaged"])
def test_dates_that_tell_no_days_leave_the_clock_alone(tmp_path: Path, date: str) -> None:
    rows = [f"05.03.2024;23:59:{50 + k};{k}" for k in range(10)]
    rows += [f"{date if k == 5 or date != '06.03.' else '06.03.2024'};00:00:{k:02d};{k}" for k in range(10)]
    run = read(tmp_path, make_rows("date;time;torque", *rows), columns=TWO)
    np.testing.assert_array_equal(run["time_s"], np.arange(20.0))


@pytest.mark.parametrize(("ticks", "unit"), [(1_000, "ms"), (1_000_000, "us"), (1_000_000_000, "ns")])
def test_an_epoch_keeps_its_digits(tmp_path: Path, ticks: int, unit: str) -> None:
    step = {"ms": 1, "us": 10, "ns": 10_000}[unit]  # 1 kHz, 100 kHz
    rows = [f"{1709683197 * ticks + step * k},{k}" for k in range(ROWS)]
    run = read(tmp_path, make_rows("time,torque", *rows), columns=TWO.replace(', unit = "s"', ""))
    np.testing.assert_allclose(run["time_s"], step * np.arange(ROWS) / ticks, rtol=1e-14)
    assert run.metadata["import"]["start"] == "2024-03-05T23:59:57+00:00"


@pytest.mark.parametrize(("first", "unit"), [(45356.5, "d"), (3.79e9, "s"), (739_000.5, "d"), (2_460_760.5, "d")])
def test_days_of_a_spreadsheet_and_other_epochs_are_no_date_of_ours(tmp_path: Path, first: float, unit: str) -> None:
    step = 1.0 if unit == "s" else 1.0 / 86400.0
    rows = [f"{first + step * k:.9f},{k}" for k in range(ROWS)]
    run = read(tmp_path, make_rows("time,torque", *rows), columns=TWO.replace('"s"', f'"{unit}"'))
    np.testing.assert_allclose(run["time_s"], np.arange(ROWS), atol=1e-4)
    assert "start" not in run.metadata["import"]


@pytest.mark.parametrize(
    ("first", "message"),
    [
        (45356.5, True),
        (739_000.5, True),
        (60_759.5, True),
        (2_460_760.5, True),
        (0.59, True),
        (45356.5, False),
        (12.5, False),
    ],
)
def test_days_that_are_taken_for_seconds_are_refused(tmp_path: Path, first: float, message: bool) -> None:
    step = 0.1 / 86400.0 if message else 0.1
    rows = [f"{first + step * k:.12f},{k}" for k in range(ROWS)]
    doubt = "'time' counts days of a spreadsheet, perhaps; set unit = 'd' then"
    resampled = f"resample_hz = {0.5 / step}"
    if message:
        assert doubt in find_refusal(tmp_path, make_rows("time,torque", *rows), resampled, TWO)
    sure = TWO.replace('unit = "s"', 'unit = "s", unit_from = "map"')
    done = convert_run(read(tmp_path, make_rows("time,torque", *rows), resampled, sure))
    assert (doubt in done) is message


@pytest.mark.parametrize("first", [45356.5, 0.59])
@pytest.mark.parametrize("step", [2, 5, 10, 60])
def test_days_of_a_slow_logger_are_refused_as_seconds(tmp_path: Path, first: float, step: int) -> None:
    rows = [f"{first + step * k / 86400.0:.10f},{k}" for k in range(ROWS)]
    text = make_rows("time,torque", *rows)
    assert "'time' counts days of a spreadsheet, perhaps; set unit = 'd' then" in find_refusal(
        tmp_path, text, columns=TWO
    )
    run = read(tmp_path, text, f"resample_hz = {1.0 / step}", TWO.replace('unit = "s"', 'unit = "d"'))
    np.testing.assert_allclose(run["time_s"] - run["time_s"][0], step * np.arange(len(run["time_s"])), atol=1e-4)
    assert "hhmmss" not in convert_run(run)


@pytest.mark.parametrize("rate", [1000.0, 9600.0, 10_000.0])
def test_a_usual_rate_late_in_a_recording_is_in_seconds(tmp_path: Path, rate: float) -> None:
    rows = [f"{45356.5 + k / rate:.9f},{k}" for k in range(ROWS)]
    assert "days" not in convert_run(read(tmp_path, make_rows("time,torque", *rows), columns=TWO))


@pytest.mark.parametrize("first", [0.0, -0.3, 1e-5])
def test_a_fast_recording_that_begins_near_its_trigger_is_in_seconds(tmp_path: Path, first: float) -> None:
    rows = [f"{first + 1e-6 * k:.9f},{k}" for k in range(ROWS)]
    assert "days" not in convert_run(read(tmp_path, make_rows("time,torque", *rows), columns=TWO))


def test_ms_since_1970_are_not_taken_for_seconds(tmp_path: Path) -> None:
    rows = [f"{1709683197000 + 10 * k},{k}" for k in range(ROWS)]
    columns = TWO.replace('unit = "s"', 'unit = "s", unit_from = "map"')
    sentence = find_refusal(tmp_path, make_rows("time,torque", *rows), columns=columns)
    assert "begins at 1.70968e+12 s, which no clock shows" in sentence


@pytest.mark.parametrize(
    "write",
    [lambda t: f"1 days {t}", lambda t: f'"1 day, {t}"', lambda t: f"{t}"],
    ids=["of pandas", "of Python", "without days"],
)
def test_durations_of_python_are_times(tmp_path: Path, write: Callable[[str], str]) -> None:
    times = [write(f"23:59:59.{700000 + round(1e6 * t)}") if t < 0.295 else "" for t in TIME]
    times = [
        cell or f"{2 if 'day' in times[0] else 0} days 00:00:00.{round(1e6 * t) - 300000:06d}"
        for cell, t in zip(times, TIME, strict=True)
    ]
    assert_right(read(tmp_path, make_table(times=times)))


def test_a_duration_of_net_goes_on_over_a_day(tmp_path: Path) -> None:
    times = [f"{'1.' if row >= 30 else ''}{(23 + row // 30) % 24:02d}:{(row + 30) % 60:02d}:00" for row in range(ROWS)]
    times[3] += ".5000000"
    run = read(tmp_path, make_table(times=times), "resample_hz = 0.1", TWO)
    assert (run["time_s"][0], run["time_s"][-1]) == (0.0, 60.0 * (ROWS - 1))


@pytest.mark.parametrize(
    "write",
    [
        lambda t: f"PT{t:.2f}S",
        lambda t: f"PT{90 + t:.2f}S".replace(".", ","),
        lambda t: f"P1DT2H75M{t:.3f}S",
        lambda t: "PT2H" if t == 0.0 else f"PT2H{t:.3f}S",
        lambda t: f"PT{(100 * t - 30) / 100:.2f}S".replace("PT-", "-PT"),
    ],
)
def test_durations_of_iso_8601_are_times(tmp_path: Path, write: Callable[[float], str]) -> None:
    run = read(tmp_path, make_table(";", times=[write(t) for t in TIME]))
    assert_right(run)
    assert "recorded at" not in convert_run(run)


def test_a_name_that_could_be_a_duration_is_a_name(tmp_path: Path) -> None:
    run = read(tmp_path, make_table(header="time,PT1H,speed"), columns=MAP.replace('"torque"', '"PT1H"'))
    assert_right(run)


def test_a_short_year_behind_the_name_of_a_month_is_asked_about(tmp_path: Path) -> None:
    """As the historian PI and Oracle write it."""
    table = make_table(times=[f"12-Mar-26 14:05:{7.0 + t:06.3f}" for t in TIME])
    sentence = find_refusal(tmp_path, table)
    assert "does not tell which number is the year; set time_format, such as '%d-%b-%y %H:%M:%S', in [file]" in sentence
    assert_right(read(tmp_path, table, 'time_format = "%d-%b-%y %H:%M:%S"'))
    words = make_table(header="time,torque,speed,sensor", end=",12-oil-26")
    assert_right(read(tmp_path, words))


def test_days_by_dates_with_a_short_year_do_not_pass_in_silence(tmp_path: Path) -> None:
    """From the 30th row on it is the next day, and the clock alone shows 10 ms more."""
    dates = ["12.03.26" if n < 30 else "13.03.26" for n in range(ROWS)]
    rows = make_table(
        ";", header="", times=[f"{date};14:05:{7.0 + t:06.3f}" for date, t in zip(dates, TIME, strict=True)]
    )
    table = "date;time;torque;speed\n" + rows
    assert "set time_format, such as '%d.%m.%y', in [file]" in find_refusal(tmp_path, table)
    columns = "[columns]\ntime_s = { from = 'time' }\ntorque_nm = { from = 'torque', unit = 'Nm' }\n"
    path = tmp_path / "days.csv"
    path.write_text(table)
    recording = open_recording(path, {"time_format": "%d.%m.%y"})
    (time,) = recording.read([channel for channel in recording.channels if channel.name == "time"])
    np.testing.assert_allclose(time.values, TIME + 86400.0 * (np.arange(ROWS) >= 30), atol=1e-9)
    same = table.replace("13.03.26", "12.03.26")
    np.testing.assert_allclose(read(tmp_path, same, columns=columns)["time_s"], TIME, atol=1e-9)


@pytest.mark.parametrize("line", ["t={0:.2f} {2}={1}", "t:{0:.2f},{2}:{1}"])
def test_names_before_each_number_that_change_are_told(tmp_path: Path, line: str) -> None:
    rows = [line.format(t, 1.5, "torque" if n % 2 else "speed") for n, t in enumerate(TIME)]
    assert "has a name before each number, as in line 60, " in find_refusal(tmp_path, make_rows(*rows))
