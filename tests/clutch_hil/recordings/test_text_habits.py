"""Text files as tools and people write them, in which a column, a row or a factor could be lost in silence."""

from pathlib import Path

import numpy as np
import pytest

from tests.clutch_hil.recordings.text_files import (
    MAP,
    NAMES,
    ROWS,
    TIME,
    TORQUE,
    TWO,
    assert_right,
    convert_run,
    find_refusal,
    make_rows,
    make_table,
    read,
    write_with_comma,
)


@pytest.mark.parametrize("number", ["-9999", "-9999.000", "1e37"])
def test_a_number_that_stands_for_no_value_counts_as_missing(tmp_path: Path, number: str) -> None:
    lines = make_table().splitlines()
    for row in (20, 21):
        lines[row + 1] = ",".join([lines[row + 1].split(",")[0], number, lines[row + 1].split(",")[2]])
    columns = MAP.replace('"Nm" }', f'"Nm", missing = {number} }}')
    text = "\n".join([*lines, ""])
    assert "torque_nm is not a number in row 20, one of 2 such rows" in find_refusal(tmp_path, text, columns=columns)
    run = read(tmp_path, text, "resample_hz = 100.0", columns)
    assert f"torque: 2 samples of {float(number):g}, which is no value" in convert_run(run)
    bridged = np.interp(TIME, np.delete(TIME, (20, 21)), np.delete(TORQUE, (20, 21)))
    np.testing.assert_allclose(run["torque_nm"], bridged, atol=1e-9)


# --- delimiters and marks ---------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    "above", ["Start 10:11:12", "Date: 05.03.2024 10:11:12", "T0=05.03.2024 10:11:12\tSR=100 Hz\tx"]
)
def test_a_clock_time_above_the_rows_does_not_part_cells(tmp_path: Path, above: str) -> None:
    rows = [f"{t:.2f}\t{'' if k % 3 else 1}\t{1000 + k}" for k, t in enumerate(TIME)]
    columns = '[columns]\ntime_s = { number = 1, unit = "s" }\nspeed_rad_s = { number = 3, unit = "rad/s" }\n'
    run = read(tmp_path, make_rows(above, *rows), "header = false", columns)
    np.testing.assert_array_equal(run["speed_rad_s"], 1000.0 + np.arange(ROWS))


def test_a_column_that_ends_before_the_others_ends_no_rows(tmp_path: Path) -> None:
    table = make_table("\t", header="time\ttorque\tspeed\ttemp")
    rows = [f"{line}\t{20.5 if k < 20 else ''}" if k else line for k, line in enumerate(table.splitlines())]
    assert_right(read(tmp_path, make_rows("Date: 05.03.2024 10:11:12", *rows)))


# --- words among numbers ----------------------------------------------------------------------------------------------


@pytest.mark.parametrize("where", [slice(0, 3), slice(-10, None), slice(-40, None), slice(20, 30)])
def test_a_word_in_a_column_that_nobody_asks_for_takes_no_row(tmp_path: Path, where: slice) -> None:
    words = np.zeros(ROWS, bool)
    words[where] = True
    lines = make_table().splitlines()
    rows = [f"{line},{'OVER' if words[k] else k + 0.5}" for k, line in enumerate(lines[1:])]
    assert_right(read(tmp_path, make_rows("time,torque,speed,aux", *rows)))


@pytest.mark.parametrize("row", [0, 30, ROWS - 1])
def test_a_word_in_a_column_that_is_asked_for_is_an_error_wherever_it_is(tmp_path: Path, row: int) -> None:
    lines = make_table().splitlines()
    cells = lines[row + 1].split(",")
    lines[row + 1] = f"{cells[0]},OVER,{cells[2]}"
    sentence = find_refusal(tmp_path, make_rows(*lines))
    assert f"column 'torque' holds 'OVER' in line {row + 2}" in sentence


def test_a_summary_below_the_rows_is_no_row(tmp_path: Path) -> None:
    run = read(tmp_path, make_table() + "Mean,0.1,2\nMax,1.0,n.a.\n1,of,1 pages\n")
    assert_right(run)
    assert "left out lines 62 to 64 at the end" in convert_run(run)


# --- names above groups, and names again ------------------------------------------------------------------------------


@pytest.mark.parametrize("groups", ["clutch,,motor", "clutch,clutch,motor"], ids=["merged", "repeated"])
def test_a_line_of_groups_above_the_names_is_none_of_names(tmp_path: Path, groups: str) -> None:
    run = read(tmp_path, make_table(header=f"{groups}\n{','.join(NAMES)}"))
    assert_right(run)
    assert f"above the names: {groups}" in convert_run(run)


def test_a_line_that_describes_the_columns_stands_below_the_names(tmp_path: Path) -> None:
    assert_right(read(tmp_path, make_table(header="time,torque,speed\nof the rig,of the clutch,of the motor")))
    twice = make_table(header="time,torque,speed,speed\nof the rig,of the clutch,of the motor,of the brake", end=",1")
    assert_right(read(tmp_path, twice, columns=MAP.replace('from = "speed"', "number = 3")))


@pytest.mark.parametrize(
    "header",
    [
        "time,torque,speed\n,T40B,encoder\n,SN 123,SN 456\ns,Nm,rad/s", "run,clutch,motor\ntime,torque,speed\ns,Nm,rad/s",
        ",1,2\ntime,torque,speed\ns,Nm,rad/s", "0,1,2\ntime,torque,speed",
    ],
    ids=["sensors below", "groups above", "channels above", "numbers above"],
)  # fmt: skip
def test_names_are_found_among_lines_of_sensors_groups_and_channels(tmp_path: Path, header: str) -> None:
    assert_right(read(tmp_path, make_table(header=header)))


# --- no time at all ---------------------------------------------------------------------------------------------------

BY_ROW = '[columns]\ntime_s = { rate_hz = 100.0 }\ntorque_nm = { from = "torque", unit = "Nm" }\n'


def test_rows_at_a_stated_rate_need_no_column_of_time(tmp_path: Path) -> None:
    run = read(tmp_path, make_rows("torque,p", *(f"{q},1" for q in TORQUE)), columns=BY_ROW)
    np.testing.assert_allclose(run["time_s"], TIME, rtol=1e-12)
    np.testing.assert_array_equal(run["torque_nm"], TORQUE)
    assert "time_s is the number of the row over 100 Hz" in convert_run(run)


def test_a_time_too_coarse_to_increase_is_told_with_the_way_out(tmp_path: Path) -> None:
    table = make_rows("time,torque", *(f"{t:.1f},{q}" for t, q in zip(TIME, TORQUE, strict=True)))
    assert "where the rows are evenly spaced, time_s = { rate_hz = ... }" in find_refusal(tmp_path, table, columns=TWO)
    np.testing.assert_array_equal(read(tmp_path, table, columns=BY_ROW)["torque_nm"], TORQUE)


@pytest.mark.parametrize(
    ("columns", "message"),
    [
        (BY_ROW.replace("100.0", "0.0"), "time_s.rate_hz is 0; allowed is above 0"),
        (BY_ROW.replace("100.0", "-1.0"), "time_s.rate_hz is -1; allowed is above 0"),
        (BY_ROW.replace("100.0", "1e12"), "time_s.rate_hz is 1e+12; allowed is above 0"),
        (BY_ROW.replace("100.0", '100.0, unit = "s"'), "it is allowed only as the single entry of time_s"),
        (BY_ROW.replace('from = "torque", unit = "Nm"', "rate_hz = 5.0"), "torque_nm has rate_hz"),
        ("[columns]\ntime_s = { rate_hz = 100.0 }\n", "has no column except time_s"),
    ],
)
def test_a_wrong_rate_of_rows_is_refused(tmp_path: Path, columns: str, message: str) -> None:
    assert message in find_refusal(tmp_path, make_rows("torque,p", "1,2", "2,3", "3,4"), columns=columns)


# --- tools ------------------------------------------------------------------------------------------------------------


def test_labview_gives_rows_no_cell_for_the_last_name(tmp_path: Path) -> None:
    header = "LabVIEW Measurement\t\nDate\t2024/03/05\nTime\t09:47:02.1010842323\n***End_of_Header***\t\n\t\n"
    header += "Channels\t1\t\nY_Unit_Label\tVolts\t\nDelta_X\t0.01\t\n***End_of_Header***\t\t\n"
    assert_right(read(tmp_path, header + make_table("\t", header="time\ttorque\tspeed\tComment")))


def test_catman_writes_a_line_of_entries_below_the_names(tmp_path: Path) -> None:
    above = "HBM_CATMAN_DATAFILE_VERSION 5.0\n\nDATE=05.03.2024 10:11:12\nSEPARATOR=9\n"
    names = "time\ttorque\tspeed\nT0=05.03.2024 10:11:12\tSR=100 Hz\tSR=100 Hz\ns\tNm\trad/s"
    assert_right(read(tmp_path, above + make_table("\t", header=names, write=write_with_comma)))


def test_turns_a_minute_may_be_written_without_what_is_counted(tmp_path: Path) -> None:
    rows = [f"{0.01 * n:.2f},{n}" for n in range(60)]
    text = make_rows("time,N_DYNO", "s,1/min", *rows)
    columns = '[columns]\ntime_s = { from = "time" }\nslip_speed_rad_s = { from = "N_DYNO" }\n'
    assert "set unit = 'rpm' where these are turns a minute" in find_refusal(tmp_path, text, columns=columns)
    run = read(tmp_path, text, columns=columns.replace('"N_DYNO" }', '"N_DYNO", unit = "rpm" }'))
    assert run["slip_speed_rad_s"][30] == pytest.approx(np.pi)


@pytest.mark.parametrize(
    "words", [("on", "off"), ("WAHR", "FALSCH"), ("ein", "aus"), ("Ja", "Nein"), ("VRAI", "FAUX"), ("oui", "non")]
)
def test_flags_of_other_languages_are_a_status(tmp_path: Path, words: tuple[str, str]) -> None:
    rows = [f"{0.01 * k:.2f};{words[0] if k < 30 else words[1]}" for k in range(ROWS)]
    columns = '[columns]\ntime_s = { from = "time", unit = "s" }\nvalve_1 = { from = "valve", unit = "1" }\n'
    run = read(tmp_path, make_rows("time;valve", *rows), columns=columns)
    np.testing.assert_array_equal(run["valve_1"], np.arange(ROWS) < 30)


@pytest.mark.parametrize("mark", [".", ","])
def test_a_sign_that_stands_apart_is_one(tmp_path: Path, mark: str) -> None:
    """As loggers of Graphtec write."""
    table = make_table(";", write=lambda value: f"{'-' if value < 0.0 else '+'} {abs(value):9.4f}".replace(".", mark))
    assert_right(read(tmp_path, table))


def test_text_in_a_column_is_shown_with_what_to_do(tmp_path: Path) -> None:
    text = make_rows("time,torque", *(f"2024-03-31_01h59m{n:02d}s,{n}" for n in range(60)))
    message = find_refusal(tmp_path, text, columns=TWO)
    assert "such as '2024-03-31_01h59m00s'" in message
    assert "set time_format in [file]" in message


def test_a_scale_of_zero_is_refused(tmp_path: Path) -> None:
    columns = TWO.replace('"Nm" }', '"Nm", scale = 0 }')
    assert "torque_nm.scale is 0; allowed is any other number" in find_refusal(tmp_path, make_table(), columns=columns)


def test_true_and_false_need_no_unit(tmp_path: Path) -> None:
    rows = [f"{0.01 * k:.2f},{'TRUE' if k % 2 else 'FALSE'}" for k in range(ROWS)]
    columns = '[columns]\ntime_s = { from = "time", unit = "s" }\nenabled_1 = { from = "on" }\n'
    run = read(tmp_path, make_rows("time,on", *rows), columns=columns)
    np.testing.assert_array_equal(run["enabled_1"], np.arange(ROWS) % 2)


@pytest.mark.parametrize("header", ["s,kNm,rpm\nt,M,n", "t,M,n\ns,kNm,rpm", "s,kNm,rpm\nt,M,n\n"])
def test_names_that_could_be_units_are_told_from_these(tmp_path: Path, header: str) -> None:
    columns = MAP.replace('"time"', '"t"').replace('"torque"', '"M"').replace('"speed"', '"n"')
    run = read(tmp_path, make_table(header=header), columns=columns)
    np.testing.assert_allclose(run["time_s"], TIME)
    np.testing.assert_allclose(run["torque_nm"], 1e3 * TORQUE)


def quote_lines(text: str) -> str:
    return "".join('"' + line.replace('"', '""') + '"\n' for line in text.splitlines())


@pytest.mark.parametrize("delimiter", [",", ";", "\t"])
@pytest.mark.parametrize("header", ["time{0}torque{0}speed", '"time"{0}"torque"{0}"speed"'])
@pytest.mark.parametrize("last", ["", "\n"])
def test_lines_that_are_one_quoted_cell_are_read(tmp_path: Path, delimiter: str, header: str, last: str) -> None:
    """As spreadsheets save a text that was opened in one column."""
    text = quote_lines(make_table(delimiter, header=header.format(delimiter)))
    assert_right(read(tmp_path, text.removesuffix("\n") + last))


def test_a_quoted_column_with_a_decimal_comma_stays_one_column(tmp_path: Path) -> None:
    text = quote_lines("torque\n" + "".join(f"{torque:.4f}\n".replace(".", ",") for torque in TORQUE))
    columns = '[columns]\ntime_s = { rate_hz = 100.0 }\ntorque_nm = { number = 1, unit = "Nm" }\n'
    np.testing.assert_allclose(read(tmp_path, text, columns=columns)["torque_nm"], TORQUE, atol=1e-12)


@pytest.mark.parametrize("delimiter", [",", ";", "\t", "|"])
@pytest.mark.parametrize("note", ['say ""hi""{} ok', '5"" pipe', '""', "a{}b"])
def test_quotes_in_a_quoted_cell_part_no_cells(tmp_path: Path, delimiter: str, note: str) -> None:
    header = delimiter.join([*NAMES, "note"])
    text = make_table(delimiter, header, end=f'{delimiter}"{note.format(delimiter)}"')
    run = read(tmp_path, text)
    assert_right(run)
    assert "left out" not in convert_run(run)
