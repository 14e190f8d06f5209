"""Workbooks of Excel: one sheet is read as the rows that it shows; what is ambiguous, or has no values, is told or refused."""

import gc
import re
import zipfile
from collections.abc import Callable, Sequence
from datetime import datetime, time, timedelta
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from openpyxl import Workbook
from openpyxl.chart import LineChart
from openpyxl.utils.datetime import CALENDAR_MAC_1904

from clutch_hil.recordings.excel import sheet, workbook
from clutch_hil.recordings.format import open_recording
from protocols.errors import InputError
from tests.clutch_hil.recordings.maps import find_refusal, import_by
from tests.clutch_hil.recordings.text_files import MAP, ROWS, SPEED, TIME, TORQUE, assert_right, convert_run

BEGIN = datetime(2025, 3, 2, 10, 11, 12)
SHEET = "xl/worksheets/sheet1.xml"


pytestmark = pytest.mark.usefixtures("folder")  # conftest.py


def make_rows(*above: Sequence[Any], times: Sequence[Any] | None = None) -> list[list[Any]]:
    """The recording below the lines `above`, by default its names."""
    heads = [list(row) for row in above] or [["time", "torque", "speed"]]
    return [
        *heads,
        *([t, m, n] for t, m, n in zip(times or TIME.tolist(), TORQUE.tolist(), SPEED.tolist(), strict=True)),
    ]


def save(
    tmp_path: Path,
    rows: Sequence[Sequence[Any]],
    change: Callable[[Any, Any], None] | None = None,
    name: str = "a recording.xlsx",
) -> Path:
    """A workbook with these rows in its sheet Data; `change` gets it and the sheet."""
    book = Workbook()
    sheet = book.active
    sheet.title = "Data"
    for row in rows:
        sheet.append(list(row))
    if change:
        change(book, sheet)
    book.save(tmp_path / name)
    return tmp_path / name


def rewrite(path: Path, part: str, change: Callable[[str], str]) -> Path:
    """Change one part of a workbook, as programs write it that openpyxl is not."""
    with zipfile.ZipFile(path) as archive:
        parts = {name: archive.read(name) for name in archive.namelist()}
    before = parts[part].decode()
    parts[part] = change(before).encode()
    assert parts[part].decode() != before
    with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as archive:
        for name, content in parts.items():
            archive.writestr(name, content)
    return path


def write_with_comma(rows: Sequence[Sequence[Any]]) -> list[list[Any]]:
    return [[repr(v).replace(".", ",") if isinstance(v, float) else v for v in row] for row in rows]


ABOVE = [["Bench 7", "", "Clutch"], [], ["time", "torque", "speed"], ["s", "Nm", "rad/s"]]
FORMS: dict[str, list[list[Any]]] = {
    "plain": make_rows(),
    "title, names, units": make_rows(*ABOVE),
    "units in names": make_rows(["time [s]", "torque [Nm]", "speed (rad/s)"]),
    "names with line breaks": make_rows(["time\n[s]", "torque\n[Nm]", "speed\n[rad/s]"]),
    "from column C": [["", "", *row] for row in make_rows(*ABOVE)],
    "empty column within": [[row[0], None, *row[1:]] for row in make_rows()],
    "texts with decimal commas": write_with_comma(make_rows()),
    "one column of texts with commas": [[r[0], *write_with_comma([r])[0][1:2], r[2]] for r in make_rows()],
    "result to the right of the names": make_rows(["time", "torque", "speed", None, 12.5]),
    "remark beside": [[*row, *(["started late"] if n == 9 else [])] for n, row in enumerate(make_rows())],
    "escaped line ends": make_rows(["time", "torque_x000D_", "_x000D_speed"]),
    "quotes": make_rows(["time", "torque", "speed", 'pipe 1/2"']),
    "whole lines of CSV in column A": [[f"{a};{b};{c}"] for a, b, c in make_rows()],
    "whole lines with commas": [[";".join(map(str, row))] for row in write_with_comma(make_rows())],
    "datetimes": make_rows(times=[BEGIN + timedelta(seconds=t) for t in TIME]),
    "datetimes of ISO 8601": make_rows(times=[f"{BEGIN + timedelta(seconds=t)}" for t in TIME]),
    "times of day": make_rows(times=[time(10, 11, 12, round(1e6 * t)) for t in TIME]),
    "durations": make_rows(times=[timedelta(seconds=t) for t in TIME]),
}


@pytest.mark.parametrize("rows", FORMS.values(), ids=FORMS)
def test_rows_of_a_sheet_are_read_as_those_of_a_text_file(tmp_path: Path, rows: list[list[Any]]) -> None:
    assert_right(import_by(tmp_path, save(tmp_path, rows), MAP))


def test_numbers_keep_all_their_digits_and_are_in_no_doubt(tmp_path: Path) -> None:
    numbers = [1.125, 998.0, 12.5, 1.0 / 3.0, 1e-300, -1e17, 123456789.125, 5e20] + [1.0] * (ROWS - 8)
    rows = [
        [t, m, s] for t, m, s in zip(["time", *TIME.tolist()], ["torque", *numbers], ["speed", *SPEED], strict=True)
    ]
    text = MAP.replace('unit = "Nm"', 'unit = "Nm", missing = 5e20')
    run = import_by(tmp_path, save(tmp_path, rows), text.replace("[columns]", "[file]\nresample_hz = 100.0\n[columns]"))
    np.testing.assert_array_equal(run["torque_nm"][:7], numbers[:7])


def test_texts_with_marks_between_thousands_stand_beside_numbers(tmp_path: Path) -> None:
    rows = make_rows()
    for n, row in enumerate(rows[1:]):
        row[2] = f"1.{n:03d},25"
    path = save(tmp_path, rows)
    find_refusal(tmp_path, path, MAP)
    run = import_by(tmp_path, path, '[file]\nthousands = "."\n' + MAP)
    np.testing.assert_allclose(run["speed_rad_s"], 1000.25 + np.arange(ROWS))
    np.testing.assert_allclose(run["torque_nm"], TORQUE)


@pytest.mark.parametrize("epoch_1904", [False, True])
@pytest.mark.parametrize("digits", [17, 16, 15])
def test_a_time_is_exact_whatever_a_program_writes_of_its_days(tmp_path: Path, epoch_1904: bool, digits: int) -> None:
    """Excel writes 17 digits, openpyxl 16, others 15; openpyxl reads ms only, here are 0.1 ms."""
    begin = (datetime(2025, 3, 2, 10, 11, 12) - datetime(1904 if epoch_1904 else 1899, 1 if epoch_1904 else 12, 1)).days
    begin -= 0 if epoch_1904 else 29  # day 0 is 30 December 1899, or 1 January 1904
    steps = np.arange(ROWS) * 1e-4
    rows = make_rows(times=[BEGIN] * ROWS)

    def set_epoch(book: Any, sheet: Any) -> None:
        book.epoch = CALENDAR_MAC_1904 if epoch_1904 else book.epoch

    path = save(tmp_path, rows, set_epoch)

    def write_days(xml: str) -> str:
        for n, step in enumerate(steps):
            days = begin + (10 * 3600 + 11 * 60 + 12 + float(step)) / 86400.0
            place = xml.index(f'<c r="A{n + 2}"')
            start = xml.index("<v>", place)
            xml = xml[:start] + f"<v>{days:.{digits}g}</v>" + xml[xml.index("</c>", start) :]
        return xml

    run = import_by(tmp_path, rewrite(path, SHEET, write_days), MAP)
    np.testing.assert_allclose(run["time_s"], steps, rtol=0.0, atol=1e-9)
    assert f"recorded at {BEGIN.isoformat()}" in convert_run(run)


def test_a_date_beside_a_time_of_day_counts_its_days(tmp_path: Path) -> None:
    moments = [datetime(2025, 3, 2, 23, 59, 59, 700_000) + timedelta(hours=25, seconds=10 * t) for t in TIME]
    rows = make_rows()
    beside = [["date", *rows[0]]] + [[m.date(), m.time(), *row[1:]] for m, row in zip(moments, rows[1:], strict=True)]
    run = import_by(tmp_path, save(tmp_path, beside), MAP)
    np.testing.assert_allclose(run["time_s"], 10.0 * TIME, rtol=0.0, atol=1e-9)


def test_days_as_numbers_are_asked_about_also_where_a_row_follows_every_ten_minutes(tmp_path: Path) -> None:
    for step in (1.0, 60.0, 600.0, 1800.0):
        days = [45718.25 + step * n / 86400.0 for n in range(ROWS)]
        sentence = find_refusal(tmp_path, save(tmp_path, make_rows(times=days)), MAP)
        assert "'time' counts days of a spreadsheet, perhaps; set unit = 'd' then" in sentence, step
        run = import_by(tmp_path, save(tmp_path, make_rows(times=days)), MAP.replace('"s"', '"d"'))
        np.testing.assert_allclose(run["time_s"], step * np.arange(ROWS), rtol=0.0, atol=1e-5)


def test_durations_in_days_are_asked_about(tmp_path: Path) -> None:
    """As pandas writes a column of time deltas: numbers, from 0, without a format."""
    path = save(tmp_path, make_rows(times=[t / 86400.0 for t in TIME]))
    assert "'time' counts days of a spreadsheet, perhaps; set unit = 'd' then" in find_refusal(tmp_path, path, MAP)
    assert_right(import_by(tmp_path, path, MAP.replace('"s"', '"d"')))
    fast = save(tmp_path, make_rows(times=[1e-5 * t for t in TIME]))
    assert_right(import_by(tmp_path, fast, MAP.replace('"s" }', '"s", scale = 1e5 }', 1)))
    np.testing.assert_allclose(import_by(tmp_path, fast, MAP)["time_s"], 1e-5 * TIME, atol=1e-15)


def test_an_elapsed_time_goes_on_above_24_hours(tmp_path: Path) -> None:
    def format_elapsed(book: Any, sheet: Any) -> None:
        for n in range(ROWS):
            sheet.cell(n + 2, 1, 0.9999 + n * 0.00001).number_format = "[h]:mm:ss.000"

    run = import_by(tmp_path, save(tmp_path, make_rows(), format_elapsed), MAP)
    np.testing.assert_allclose(run["time_s"], 0.864 * np.arange(ROWS), rtol=0.0, atol=1e-8)


def test_what_a_format_shows_behind_a_number_counts(tmp_path: Path) -> None:
    """0.5 in a cell that shows 50 % is 50 %, and the unit of 0.00" kNm" is kNm."""

    def format_cells(book: Any, sheet: Any) -> None:
        for n in range(ROWS):
            sheet.cell(n + 2, 2).number_format = '0.00" kNm"'
            sheet.cell(n + 2, 3, 0.01 * n).number_format = "0.0%"

    path = save(tmp_path, make_rows(["time", "torque", "duty"]), format_cells)
    assert [channel.unit for channel in open_recording(path).channels] == ["", "kNm", "%"]
    text = MAP.replace("speed_rad_s", "duty_1").replace('from = "speed", unit = "rad/s"', 'from = "duty", unit = "1"')
    run = import_by(tmp_path, path, text.replace('"torque", unit = "Nm"', '"torque"'))
    np.testing.assert_allclose(run["torque_nm"], 1000.0 * TORQUE, atol=1e-9)
    np.testing.assert_allclose(run["duty_1"], 0.01 * np.arange(ROWS), atol=1e-12)


@pytest.mark.parametrize(
    ("shown", "unit", "factor"),
    [
        ('0.00\\ "kNm"', "kNm", 1.0), ('General" kNm"', "kNm", 1.0), ('#,##0.00" kNm"', "kNm", 1.0),
        (r"0.0\ \k\N\m", "kNm", 1.0), ('[Red]0.0" kNm";-0.0" kNm"', "kNm", 1.0), ('0.0" kNm"_)', "kNm", 1.0),
        ('0.00," kNm"', "kNm", 1e-3), ('#,##0,,.0\\ "kNm"', "kNm", 1e-6), (r"0.0\%", "%", 1.0), ('0.0" %"', "%", 1.0),
        (r"0.0\ %", "%", 100.0), ("0.00,", "", 1.0), ('0.0" pieces"', "", 1.0), ('0.0" h"', "", 1.0), ("0.00E+00", "", 1.0),
    ],
)  # fmt: skip
def test_number_formats_as_excel_writes_them(tmp_path: Path, shown: str, unit: str, factor: float) -> None:
    """Two commas show millionths. What is no unit changes nothing; `h` behind a number would be hexadecimal."""

    def format_cells(book: Any, sheet: Any) -> None:
        for n in range(ROWS):
            sheet.cell(n + 2, 3).number_format = shown

    recording = open_recording(save(tmp_path, make_rows(), format_cells))
    channel = recording.channels[2]
    assert (channel.unit, channel.kind) == (unit, "number")
    np.testing.assert_allclose(recording.read([channel])[0].values, factor * SPEED, rtol=1e-15)


def test_a_format_that_contradicts_the_unit_above_is_told(tmp_path: Path) -> None:
    def format_cells(book: Any, sheet: Any) -> None:
        for n in range(ROWS):
            sheet.cell(n + 2, 2).number_format = '0.00" kNm"'

    notes = open_recording(save(tmp_path, make_rows(["time", "torque [Nm]", "speed"]), format_cells)).notes
    assert "torque [Nm]: its unit is Nm by its name or the line of units, kNm behind its numbers counts" in notes
    agreeing = open_recording(save(tmp_path, make_rows(["time", "torque [kN·m]", "speed"]), format_cells)).notes
    assert not any("kNm" in note for note in agreeing)


def test_booleans_are_on_and_off_and_errors_are_no_values(tmp_path: Path) -> None:
    rows = make_rows(["time", "torque", "speed", "valid"])
    rows = [rows[0], *([*row, n > 20] for n, row in enumerate(rows[1:]))]
    for n, error in enumerate(["#N/A", "#DIV/0!", "#SPILL!", "#VALUE!"], 10):
        rows[n][1] = error

    def mark_errors(book: Any, sheet: Any) -> None:
        for n in range(10, 14):
            sheet.cell(n + 1, 2).data_type = "e"

    path = save(tmp_path, rows, mark_errors)
    text = MAP + 'valid_1 = { from = "valid", unit = "1" }\n'
    assert "torque_nm is not a number in row" in find_refusal(tmp_path, path, text)
    run = import_by(tmp_path, path, text.replace("[columns]", "[file]\nresample_hz = 100.0\n[columns]"))
    assert "torque: 4 of 60 cells have no value" in convert_run(run)
    np.testing.assert_array_equal(run["valid_1"], np.arange(ROWS) > 20)


def test_merged_titles_stand_above(tmp_path: Path) -> None:
    def merge(book: Any, sheet: Any) -> None:
        sheet.insert_rows(1, 2)
        sheet["A1"] = "Run 12 of the clutch"
        sheet.merge_cells("A1:C1")
        sheet["B2"] = "Clutch"
        sheet.merge_cells("B2:C2")

    assert_right(import_by(tmp_path, save(tmp_path, make_rows(), merge), MAP))


def test_formulas_without_values_are_refused(tmp_path: Path) -> None:
    rows = make_rows()
    for n, row in enumerate(rows[1:], 2):
        row[1] = f"=C{n}*2"
    path = save(tmp_path, rows)
    assert "'formula without a value'" in find_refusal(tmp_path, path, MAP)
    notes = open_recording(path).notes
    assert f"{ROWS} formulas have no value, as no program has computed them: open the workbook in Excel or" in notes[1]
    without = MAP.replace('torque_nm = { from = "torque", unit = "Nm" }\n', "")
    np.testing.assert_allclose(import_by(tmp_path, path, without)["speed_rad_s"], SPEED)
    zeros = rewrite(path, SHEET, lambda xml: re.sub("</f><v ?/?>(</v>)?", "</f><v>0</v>", xml))
    assert f"all {ROWS} formulas are 0, and the file asks Excel to compute them" in open_recording(zeros).notes[1]
    computed = rewrite(path, SHEET, lambda xml: xml.replace("<v>0</v></c><c", "<v>0.5</v></c><c"))
    assert not any("formula" in note for note in open_recording(computed).notes)


def test_rows_that_are_hidden_are_read_and_told(tmp_path: Path) -> None:
    def hide(book: Any, sheet: Any) -> None:
        for n in range(5, 15):
            sheet.row_dimensions[n].hidden = True

    run = import_by(tmp_path, save(tmp_path, make_rows(), hide), MAP)
    assert_right(run)
    assert "10 rows that are hidden in Excel were read as well" in convert_run(run)


def add_sheets(book: Any, sheet: Any) -> None:
    book.create_sheet("Info", 0).append(["gain", 3.5])
    hidden = book.create_sheet("Old")
    for row in make_rows():
        hidden.append([*row[:1], *row[:2]])
    hidden.sheet_state = "hidden"
    book.create_chartsheet("Chart").add_chart(LineChart())


def add_second(book: Any, sheet: Any) -> None:
    second = book.create_sheet("Run 2")
    for row in make_rows():
        second.append([*row[:2], row[2] if row[2] == "speed" else 2.0 * row[2]])


def test_the_sheet_with_the_rows_of_numbers_is_the_measurement(tmp_path: Path) -> None:
    run = import_by(tmp_path, save(tmp_path, make_rows(), add_sheets), MAP)
    assert_right(run)
    assert "sheet 'Data'; not read are 'Info', 'Old'" in convert_run(run)


def test_of_several_sheets_the_map_chooses_one(tmp_path: Path) -> None:
    path = save(tmp_path, make_rows(), add_second)
    sentence = find_refusal(tmp_path, path, MAP)
    assert (
        "has 2 sheets with rows of numbers: 'Data', 'Run 2'; choose one by sheet = 'Data' in [file] of a map"
        in sentence
    )
    run = import_by(tmp_path, path, '[file]\nsheet = "Run 2"\n' + MAP)
    np.testing.assert_allclose(run["speed_rad_s"], 2.0 * SPEED)
    assert "has no sheet 'run'" in find_refusal(tmp_path, path, '[file]\nsheet = "run"\n' + MAP)


def test_a_workbook_without_a_sheet_of_numbers_is_refused(tmp_path: Path) -> None:
    def remove_cells(book: Any, sheet: Any) -> None:
        book.create_chartsheet("Chart").add_chart(LineChart())
        book.remove(sheet)

    sentence = find_refusal(tmp_path, save(tmp_path, [], remove_cells), MAP)
    assert "has no sheet with cells, only 1 with charts" in sentence
    assert "has no sheet with numbers or text in its cells" in find_refusal(tmp_path, save(tmp_path, []), MAP)
    words = save(tmp_path, [["a", "b"]] * 20)
    sentence = find_refusal(tmp_path, words, MAP)
    assert "(Data) has no rows of numbers; row 20 is" in sentence
    assert "set decimal, skip_lines or sheet in [file]" in sentence


def test_a_word_among_numbers_is_refused_by_its_row(tmp_path: Path) -> None:
    rows = make_rows(*ABOVE)
    rows[20][1] = "broken"
    path = save(tmp_path, rows)
    assert f"recording {path} (Data): column 'torque' holds 'broken' in row 21" in find_refusal(tmp_path, path, MAP)


def test_a_number_that_excel_took_for_a_date_is_no_number(tmp_path: Path) -> None:
    """1.5 becomes 1 May in a German Excel."""
    rows = make_rows()
    rows[20][1] = datetime(2026, 5, 1)
    assert "'torque' holds '2026-05-01' in row 21, which is no number" in find_refusal(
        tmp_path, save(tmp_path, rows), MAP
    )


def test_names_of_files_do_not_matter_and_macros_are_not_read(tmp_path: Path) -> None:
    path = save(tmp_path, make_rows(), name="macros.csv")
    main = "application/vnd.openxmlformats-officedocument.spreadsheetml.sheet.main+xml"
    rewrite(
        path,
        "[Content_Types].xml",
        lambda xml: xml.replace(main, "application/vnd.ms-excel.sheet.macroEnabled.main+xml"),
    )
    assert_right(import_by(tmp_path, path, MAP))


@pytest.mark.parametrize("method", [zipfile.ZIP_STORED, zipfile.ZIP_DEFLATED])
def test_a_workbook_in_an_archive_is_read(tmp_path: Path, method: int) -> None:
    with zipfile.ZipFile(tmp_path / "runs.zip", "w", method) as archive:
        archive.write(save(tmp_path, make_rows()), "runs/1.xlsx")
    assert_right(import_by(tmp_path, tmp_path / "runs.zip", MAP))


def test_a_claim_of_many_rows_or_columns_takes_no_memory(tmp_path: Path) -> None:
    path = save(tmp_path, make_rows())
    rewrite(path, SHEET, lambda xml: xml.replace('ref="A1:C61"', 'ref="A1:XFD16000000"'))
    assert_right(import_by(tmp_path, path, MAP))
    far = rewrite(path, SHEET, lambda xml: xml.replace('r="61"', 'r="16000000"').replace('"A61"', '"A16000000"'))
    assert "has row 16000000 after row 60; allowed are rows from 1 to 1048576" in find_refusal(tmp_path, far, MAP)
    wide = save(tmp_path, make_rows(), lambda book, sheet: sheet.cell(3, 16384, "x"), "wide.xlsx")
    assert "has 16384 columns; allowed are 10000" in find_refusal(tmp_path, wide, MAP)


def test_a_part_that_unpacks_to_more_than_is_allowed_is_refused(tmp_path: Path) -> None:
    path = save(tmp_path, make_rows())
    with zipfile.ZipFile(path, "a", zipfile.ZIP_DEFLATED) as archive, archive.open("xl/big.xml", "w") as file:
        for _ in range(130):
            file.write(bytes(1 << 20))
    assert "its part xl/big.xml has 136 MB when unpacked; allowed are 134" in find_refusal(tmp_path, path, MAP)


def test_text_of_a_sheet_is_bounded(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(workbook, "_MOST_TEXT", 10_000)
    path = save(tmp_path, [["x", *[None] * 200, "y"], *[[n] for n in range(80)]])
    with pytest.raises(InputError, match="GiB as text; remove cells far to the right"):
        workbook.serve(str(path), str(tmp_path / "text"), "", ".")


def test_cells_are_bounded(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """A small file can unpack to any number of cells, each of which takes time."""
    monkeypatch.setattr(sheet, "_MOST_CELLS", 100)
    path = save(tmp_path, make_rows())
    with pytest.raises(InputError, match="'Data' has more than 0 million cells, which is the most that is allowed"):
        workbook.serve(str(path), str(tmp_path / "text"), "Data", ".")


def test_damaged_workbooks_are_refused_in_a_sentence(tmp_path: Path) -> None:
    path = save(tmp_path, make_rows())
    cut = rewrite(path, SHEET, lambda xml: xml[: len(xml) // 2])
    assert "cannot be read as a workbook of Excel: " in find_refusal(tmp_path, cut, MAP)
    other = rewrite(save(tmp_path, make_rows()), SHEET, lambda xml: xml.replace("<v>0.25</v>", "<v>0.25x</v>"))
    assert "cannot be read as a workbook of Excel: " in find_refusal(tmp_path, other, MAP)
    whole = save(tmp_path, make_rows()).read_bytes()
    for size in (30, 1000, len(whole) - 30):
        path.write_bytes(whole[:size])
        find_refusal(tmp_path, path, MAP)


def test_the_text_is_removed(tmp_path: Path, folder: Path) -> None:
    recording = open_recording(save(tmp_path, make_rows()))
    assert len(list(folder.iterdir())) == 1
    del recording
    gc.collect()
    assert not list(folder.iterdir())
