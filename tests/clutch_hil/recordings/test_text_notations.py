"""Numbers and dates of text files in the notations of spreadsheets, bookkeepers, SAP and ISO 8601."""

from collections.abc import Callable
from datetime import UTC, datetime, timedelta
from pathlib import Path

import numpy as np
import pytest

from tests.clutch_hil.recordings.text_files import (
    MAP,
    ROWS,
    TIME,
    assert_right,
    convert_run,
    find_refusal,
    make_table,
    read,
    write_with_comma,
)


def write_bookkeeping(value: float) -> str:
    return f"({-value:,.4f})" if value < 0.0 else f"{value:,.4f}"


def write_sap(value: float) -> str:
    return write_with_comma(abs(value)) + ("-" if value < 0.0 else "")


NOTATIONS: dict[str, Callable[[float], str]] = {
    "formula": '="{:.4f}"'.format,
    "formula in quotes": '"=""{:.4f}"""'.format,
    "single quotes": "'{:.4f}'".format,
    "mark of text": "'{:.4f}".format,
    "mark of text, comma": lambda value: "'" + write_with_comma(value),
    "bookkeeping": write_bookkeeping,
    "minus behind": write_sap,
}


@pytest.mark.parametrize("name", NOTATIONS)
def test_numbers_are_read_in_each_notation(tmp_path: Path, name: str) -> None:
    run = read(tmp_path, make_table(";", write=NOTATIONS[name]))
    assert_right(run)
    below = "numbers in brackets, such as (0.5), or with a minus behind, 0.5-, are below 0"
    assert (below in convert_run(run)) == (name in ("bookkeeping", "minus behind"))


@pytest.mark.parametrize("first", ["'{:.4f}", "'{:.0f}"])
def test_a_mark_of_text_takes_no_cells_behind_a_comma(tmp_path: Path, first: str) -> None:
    times = [first.format(100.0 * t) for t in TIME]
    run = read(tmp_path, make_table(",", times=times), columns=MAP.replace('unit = "s"', 'unit = "s", scale = 0.01'))
    assert_right(run)


def test_names_in_single_quotes_are_without_them(tmp_path: Path) -> None:
    assert_right(read(tmp_path, make_table(",", "'time','torque','speed'", "'{:.4f}'".format)))


def test_brackets_around_all_numbers_of_a_column_are_no_signs(tmp_path: Path) -> None:
    text = make_table(";", write="({:.4f})".format, times=[f"{t:.4f}" for t in TIME]).replace("(-", "(")
    assert "column 'torque' for torque_nm holds text, such as '(0.0000)'" in find_refusal(tmp_path, text)


@pytest.mark.parametrize("word", ["1.#QNAN0", "-1.#IND00", "1.#J", "1,#INF"])
def test_no_numbers_of_microsoft_are_missing(tmp_path: Path, word: str) -> None:
    lines = make_table(";").splitlines()
    lines[11] = f"{TIME[10]:.4f};{word};30.25"
    sentence = find_refusal(tmp_path, "\n".join([*lines, ""]))
    assert "torque_nm is not a number in row 10, one of 1 such rows" in sentence


@pytest.mark.parametrize(("decimals", "told"), [(3, True), (2, False)])
def test_two_decimal_marks_in_one_column_are_refused(tmp_path: Path, decimals: int, told: bool) -> None:
    cells = [f"{5.125 + row:.{decimals}f}" for row in range(9)]
    mixed = [cell.replace(".", ",") if row % 2 else cell for row, cell in enumerate(cells)]
    text = "\n".join(["time;torque;speed", *(f"0.0{row};{cell};1.5" for row, cell in enumerate(mixed)), ""])
    sentence = find_refusal(tmp_path, text)
    assert ("column 'torque' holds '5.125' and '6,125', of which each mark may be the decimal one" in sentence) == told
    if told:
        run = read(tmp_path, text, 'thousands = ","')
        assert run["torque_nm"][:2].tolist() == [5.125, 6125.0]


@pytest.mark.parametrize("comma", ["time", "values"])
def test_a_column_may_have_another_decimal_mark_than_the_others(tmp_path: Path, comma: str) -> None:
    times = [(write_with_comma if comma == "time" else "{:.4f}".format)(t) for t in TIME]
    run = read(tmp_path, make_table(";", write="{:.4f}".format if comma == "time" else write_with_comma, times=times))
    assert_right(run)
    assert "is its decimal mark, unlike that of other columns" in convert_run(run)


def test_a_column_that_may_have_thousands_has_no_other_decimal_mark(tmp_path: Path) -> None:
    text = make_table(";", write="{:.3f}".format).replace(".", ",").replace("0,", "0.")
    assert "mark" in find_refusal(tmp_path, text)


BEGIN = datetime(2026, 11, 29, 10, 0, 0, tzinfo=UTC)
MOMENTS = [BEGIN + timedelta(seconds=float(t)) for t in TIME]
DATES = {
    "week": [f"{m:%G-W%V-%uT%H:%M:%S.%f}" for m in MOMENTS],
    "week, compact": [f"{m:%GW%V%uT%H%M%S.%f}" for m in MOMENTS],
    "day of the year": [f"{m:%Y-%jT%H:%M:%S.%f}" for m in MOMENTS],
}


@pytest.mark.parametrize("name", DATES)
def test_weeks_and_days_of_the_year_are_dates(tmp_path: Path, name: str) -> None:
    run = read(tmp_path, make_table(times=DATES[name]))
    assert_right(run)
    assert "recorded at 2026-11-29T10:00:00" in convert_run(run)


@pytest.mark.parametrize("written", ["%G-W%V-%u", "%Y-%j"])
def test_days_over_new_year_follow_each_other(tmp_path: Path, written: str) -> None:
    days = [(BEGIN + timedelta(days=n)).strftime(written) for n in range(ROWS)]
    run = read(tmp_path, make_table(times=days))
    np.testing.assert_array_equal(run["time_s"], 86400.0 * np.arange(ROWS))
    other = [day.replace("-", "/") for day in days]
    asked = read(tmp_path, make_table(times=other), f'time_format = "{written.replace("-", "/")}"')
    np.testing.assert_array_equal(asked["time_s"], 86400.0 * np.arange(ROWS))


@pytest.mark.parametrize("wrong", ["2025-W53-1", "2026-W00-1", "2025-366", "2026-000"])
def test_a_day_that_no_year_has_is_refused(tmp_path: Path, wrong: str) -> None:
    days = [(BEGIN + timedelta(days=n)).strftime("%G-W%V-%u" if "W" in wrong else "%Y-%j") for n in range(ROWS)]
    days[30] = wrong
    assert f"column 'time' holds '{wrong}' in line 32, which is no time" in find_refusal(
        tmp_path, make_table(times=days)
    )


def test_a_part_of_a_week_is_no_time_format(tmp_path: Path) -> None:
    sentence = find_refusal(tmp_path, make_table(times=DATES["week"]), 'time_format = "%G-W%V"', MAP)
    assert "allowed is one of each of %Y %m %d, or none of them" in sentence


@pytest.mark.parametrize(
    "header",
    ["time;torque;speed", "time;;torque;speed", "time;time;torque;speed", "time;torque;speed\ns;Nm;rad/s"],
    ids=["one", "merged", "twice", "units"],
)
def test_date_and_time_in_two_columns_have_one_name(tmp_path: Path, header: str) -> None:
    begin = datetime(2026, 11, 29, 23, 59, 59, 700000, tzinfo=UTC)
    times = [f"{begin + timedelta(seconds=float(t)):%d.%m.%Y;%H:%M:%S.%f}" for t in TIME]
    for end in ("", ";"):
        run = read(tmp_path, make_table(";", header=header, times=times, end=end))
        assert_right(run)
        assert "recorded at 2026-11-29T23:59:59.700000" in convert_run(run)


@pytest.mark.parametrize("quote", ['"', ""])
def test_names_of_rows_have_none_in_a_short_file_of_r(tmp_path: Path, quote: str) -> None:
    rows = make_table(header="").splitlines()[:20]
    text = "\n".join(["time,torque,speed", *(f"{quote}{n}{quote},{row}" for n, row in enumerate(rows, 1)), ""])
    assert_right(read(tmp_path, text), slice(20))


def test_a_comma_behind_a_fraction_parts_cells(tmp_path: Path) -> None:
    text = "\n".join(["torque", *(f"{5.125 + row:.3f}," for row in range(ROWS)), ""])
    columns = '[columns]\ntime_s = { rate_hz = 100.0 }\ntorque_nm = { number = 1, unit = "Nm" }\n'
    np.testing.assert_array_equal(read(tmp_path, text, columns=columns)["torque_nm"], 5.125 + np.arange(ROWS))


@pytest.mark.parametrize("above", ["", "torque\n"])
@pytest.mark.parametrize("pairs", [1, 2])
def test_whole_numbers_that_may_be_fractions_are_asked_for(tmp_path: Path, above: str, pairs: int) -> None:
    values = [5.0 + 0.05 * (row % 30) for row in range(ROWS)]
    rows = [",".join([f"{value:.2f}".replace(".", ",")] * pairs) for value in values]
    columns = '[columns]\ntime_s = { rate_hz = 100.0 }\ntorque_nm = { number = 1, unit = "Nm" }\n'
    text = above + "\n".join([*rows, ""])
    assert "'5,00' can be a fraction or two cells, and no line of names tells" in find_refusal(
        tmp_path, text, "", columns
    )
    cells = read(tmp_path, text, 'delimiter = ","', columns)
    np.testing.assert_array_equal(cells["torque_nm"], np.floor(np.array(values) + 1e-9))
    if pairs == 1:
        np.testing.assert_allclose(read(tmp_path, text, 'decimal = ","', columns)["torque_nm"], values)


@pytest.mark.parametrize("rows", [["0,500", "1,510", "2,498"], ["7,500", "7,1510", "6,498"]], ids=["count", "lengths"])
def test_whole_numbers_that_are_no_fractions_are_read_without_names(tmp_path: Path, rows: list[str]) -> None:
    columns = '[columns]\ntime_s = { rate_hz = 100.0 }\ntorque_nm = { number = 2, unit = "Nm" }\n'
    run = read(tmp_path, "\n".join([*rows, ""]), columns=columns)
    assert run["torque_nm"].tolist() == [float(row.split(",")[1]) for row in rows]
