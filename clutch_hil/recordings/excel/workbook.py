"""A workbook, in a separate process: chooses the sheet with the measurement and writes its rows into a text file."""

import warnings
from collections.abc import Callable, Sequence
from itertools import islice
from pathlib import Path
from typing import IO, Any
from zipfile import ZipFile

from openpyxl import load_workbook

from clutch_hil.recordings.excel.sheet import Row, Sheet
from protocols.errors import InputError, suggest_closest

_SEARCHED, _FEWEST_ROWS = 2000, 10  # rows in which numbers are looked for; so many rows of numbers are a measurement
_FEWEST_NUMBERS = 2  # in a row of a measurement: the time and a signal
_MOST_TEXT = 1 << 30  # bytes of a sheet as text
_MOST_SHEET = 1 << 31  # bytes of a sheet as XML, which is read in parts: a million rows of 40 numbers
_MOST_PART = 1 << 27  # bytes of another part as XML, which is read at once: its objects take about five times as much
_MOST_NAMED = 10  # sheets in a message
_OPENING = "/worksheets/"  # in the name of a sheet's part


def serve(path: str, target: str, sheet: str, decimal: str) -> Callable[[Any], Any]:
    """Write a sheet of the workbook `path` to `target`. Return a function that gives its name, number of columns,
    whether numbers have a decimal mark, and notes.

    sheet: its name, "" for the only one with a measurement. decimal: mark of numbers.
    """
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # of parts of a workbook that have no numbers
            with Path(path).open("rb") as file:  # openpyxl would refuse a path by its suffix
                answer = _write_sheet(file, Path(path), Path(target), sheet, decimal)
    except (InputError, MemoryError):
        raise
    except Exception as error:  # openpyxl raises whatever its objects raise for a damaged part
        reason = " ".join(str(error).split())[:200] or type(error).__name__
        remedy = "; if Excel or LibreOffice can open it, save it there"
        raise InputError(f"recording {path} cannot be read as a workbook of Excel: {reason}{remedy}") from None
    return lambda question: answer


def _write_sheet(file: IO[bytes], path: Path, target: Path, wanted: str, decimal: str) -> list[Any]:
    never_computed = _check_parts(path)
    book = load_workbook(file, read_only=True, data_only=True, keep_links=False)
    chosen, notes = _choose_sheet(path, book, wanted, decimal)
    sheet = Sheet(path, chosen, decimal)
    first, last = _write_rows(path, sheet, target)
    _pad_rows(path, chosen.title, target, first, last)
    if first > 1:
        notes.append(f"its first {first - 1} columns are empty and do not count")
    if sheet.hidden:
        notes.append(f"{sheet.hidden} rows that are hidden in Excel were read as well")
    if sheet.valueless:
        notes.append(
            f"{sheet.valueless} formulas have no value, as no program has computed them: open the workbook in Excel or"
            " LibreOffice and save it"
        )
    elif never_computed and sheet.formulas and sheet.formulas == sheet.zeros:
        notes.append(
            f"all {sheet.formulas} formulas are 0, and the file asks Excel to compute them: open it there and save it"
        )
    return [chosen.title, last - first + 1, sheet.texts.has_fractions, notes]


def _check_parts(path: Path) -> bool:
    """Return whether the workbook asks Excel to compute its formulas. Raises InputError for a part that is too large.

    The sizes bound what is unpacked: zipfile unpacks no more than these.
    """
    with ZipFile(path) as archive:
        for part in archive.infolist():
            most = _MOST_SHEET if _OPENING in part.filename else _MOST_PART
            if part.filename.endswith((".xml", ".rels")) and part.file_size > most:
                raise InputError(
                    f"recording {path}: its part {part.filename} has {part.file_size / 1e6:.0f} MB when unpacked; allowed are"
                    f" {most / 1e6:.0f}; save the sheet as CSV"
                )
        names = [name for name in archive.namelist() if name.endswith("workbook.xml")]
        return any(b'fullCalcOnLoad="1"' in archive.read(name) for name in names)


def _choose_sheet(path: Path, book: Any, wanted: str, decimal: str) -> tuple[Any, list[str]]:
    """Return the sheet of the name `wanted`, or else the one with rows of numbers. Raises InputError for none, or several."""
    sheets = {sheet.title: sheet for sheet in book.worksheets}
    if wanted:
        if wanted not in sheets:
            raise InputError(f"recording {path} has no sheet {wanted!r}; {suggest_closest(wanted, sheets)}")
        return sheets[wanted], [f"sheet {wanted!r}, as `sheet` in [file] says"]
    if not sheets:
        charts = f", only {len(book.chartsheets)} with charts" if book.chartsheets else ""
        raise InputError(f"recording {path} has no sheet with cells{charts}; save the data that they show in a sheet")
    visible = [title for title, sheet in sheets.items() if sheet.sheet_state == "visible"]
    hidden = [title for title in sheets if title not in visible]
    for titles in (visible, hidden):
        found = [title for title in titles if _count_numbers(path, sheets[title], decimal) >= _FEWEST_ROWS]
        if len(found) > 1:
            raise InputError(
                f"recording {path} has {len(found)} sheets with rows of numbers: {_list_names(found)}; choose one by"
                f" sheet = {found[0]!r} in [file] of a map, which --list and --draft take, too"
            )
        if found:
            return sheets[found[0]], _describe_choice(found[0], sheets, hidden)
    filled = [title for title in sheets if any(True for _ in Sheet(path, sheets[title], decimal).read())]
    if len(filled) != 1:
        what = (
            f"no sheet with {_FEWEST_ROWS} rows of numbers" if filled else "no sheet with numbers or text in its cells"
        )
        choice = f"; choose one of {_list_names(filled)} by sheet = {filled[0]!r} in [file] of a map" if filled else ""
        raise InputError(f"recording {path} has {what}{choice}")
    return sheets[filled[0]], _describe_choice(filled[0], sheets, hidden)


def _describe_choice(chosen: str, sheets: Any, hidden: Sequence[str]) -> list[str]:
    others = [title for title in sheets if title != chosen]
    left = f"; not read are {_list_names(others)}" if others else ""
    return [f"sheet {chosen!r}{', which is hidden' if chosen in hidden else ''}{left}"]


def _list_names(titles: Sequence[str]) -> str:
    names = ", ".join(map(repr, titles[:_MOST_NAMED]))
    return names if len(titles) <= _MOST_NAMED else f"{names} and {len(titles) - _MOST_NAMED} more"


def _count_numbers(path: Path, sheet: Any, decimal: str) -> int:
    """Return how many of the first rows have numbers, until these are enough."""
    rows = islice(Sheet(path, sheet, decimal).read(), _SEARCHED)
    return sum(1 for _ in islice((row for row in rows if row.numbers >= _FEWEST_NUMBERS), _FEWEST_ROWS))


def _write_rows(path: Path, sheet: Sheet, target: Path) -> tuple[int, int]:
    """Write a line for each row from the first, from column 1 to its last cell. Return the first and last columns, from 1."""
    first, last, number, size = 1 << 20, 0, 0, 0
    with target.open("w", encoding="utf-8", errors="replace", newline="\n") as out:
        for row in sheet.read():
            line = _join(row)
            size += len(line) + row.number - number
            if size > _MOST_TEXT:
                raise _refuse_size(path)
            out.write("\n" * (row.number - number - 1) + line + "\n")
            first, last, number = min(first, row.cells[0][0]), max(last, row.cells[-1][0]), row.number
    return first, last


def _join(row: Row) -> str:
    """Return the cells of a row between tabs; a cell with quotes is quoted."""
    parts: list[str] = []
    column = 1
    for place, text in row.cells:
        quoted = '"' + text.replace('"', '""') + '"' if '"' in text else text
        parts.append("\t" * (place - column) + quoted)
        column = place
    return "".join(parts)


def _pad_rows(path: Path, title: str, target: Path, first: int, last: int) -> None:
    """Give each row all cells from the column `first` to `last`."""
    raw = target.with_suffix(".raw")
    target.rename(raw)
    size = 0
    with raw.open("rb") as rows, target.open("wb") as out:
        for line in rows:
            cells = line[first - 1 : -1]
            if cells:
                cells += b"\t" * (last - first - cells.count(b"\t"))
            size += len(cells) + 1
            if size > _MOST_TEXT:
                raise _refuse_size(path)
            out.write(cells + b"\n")
    raw.unlink()


def _refuse_size(path: Path) -> InputError:
    return InputError(
        f"recording {path}: the sheet has more than {_MOST_TEXT >> 30} GiB as text; remove cells far to the right, or save it"
        " as CSV"
    )
