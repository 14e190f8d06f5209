"""Kinds of the columns of a text file, by their cells, and whether a line is a row of such columns."""

import re
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise

from clutch_hil.recordings.text.cells import Cells, find_initials
from clutch_hil.recordings.text.clock import TimeFormat, find_time_format
from clutch_hil.recordings.text.marks import tells_decimal
from clutch_hil.recordings.unit_in_name import is_unit

_TIME_SHARE = 0.9  # of the cells of a time column; the others are told when it is read


@dataclass(frozen=True)
class Column:
    """kind: as of a Channel. time: how a column of kind "time" is written. unit: behind each number, as in `12.5 Nm`.

    hexadecimal: whether its whole numbers are written so; of a column of text, whether they may be. decimal: its decimal mark,
    where it is not that of the file, else "". states: its letters, such as Y and N, with their numbers.
    """

    kind: str
    time: TimeFormat | None = None
    unit: str = ""
    hexadecimal: bool = False
    decimal: str = ""
    states: tuple[tuple[str, float], ...] = ()

    def choose_cells(self, cells: Cells) -> Cells:
        """How the cells of this column are written, where those of the file are `cells`."""
        own = replace(cells, decimal=self.decimal, thousands="") if self.decimal else cells
        return replace(own, states=self.states) if self.states else own


def judge_columns(rows: Sequence[Sequence[str]], width: int, cells: Cells, wanted: TimeFormat | None) -> list[Column]:
    """What the columns of `rows` are. wanted: how the first column that fits it writes times."""
    columns = []
    for number in range(width):
        present = [row[number] for row in rows if not cells.is_missing(row[number])]
        if wanted and present and sum(map(wanted.matches, present)) >= _TIME_SHARE * len(present):
            columns.append(Column("time", wanted))
            wanted = None
        else:
            columns.append(_judge(present, len(rows), cells))
    return columns


def _judge(present: Sequence[str], rows: int, cells: Cells) -> Column:
    """What a column with these cells, none of them missing, is. rows: of all cells.

    Words and numbers in a few rows are remarks beside the rows, as Tektronix has its settings beside the first ones.
    """
    numbers = sum(map(cells.is_number, present))
    if present and all(map(cells.is_accounted, present)):
        return Column("text")  # brackets around all numbers are no signs, perhaps
    if present and all(map(cells.is_marked_hexadecimal, present)):
        return Column("number", hexadecimal=True)
    if _may_be_hexadecimal(present, cells):
        return Column("text", hexadecimal=True)
    if numbers < len(present) and all(cells.is_flag(value) or value in ("0", "1") for value in present):
        return Column("status")
    if states := find_initials(present):
        return Column("status", states=states)
    if 2 * numbers >= len(present) and (numbers == len(present) or 2 * len(present) > rows):
        return Column("number")
    if unit := _find_unit(present, cells):
        return Column("number", unit=unit)
    written = find_time_format(present) or _count_most_times(present)
    if not written and (mark := _find_other_mark(present, cells)):
        return Column("number", decimal=mark)
    return Column("time", written) if written else Column("text")


def _find_other_mark(present: Sequence[str], cells: Cells) -> str:
    """The decimal mark of a column in which every cell is a number with another mark than the file's, "" for no such column.

    It is none where all may be numbers with a mark between thousands, as 1,234.
    """
    other = replace(cells, decimal="," if cells.decimal == "." else ".", thousands="")
    sure = present and all(map(other.is_number, present)) and tells_decimal([present], other)
    return other.decimal if sure else ""


def _count_most_times(present: Sequence[str]) -> TimeFormat | None:
    """How nearly all cells write times, where single ones are damaged."""
    for cell in present[:3]:
        written = find_time_format([cell])
        if written and not written.doubt and sum(map(written.matches, present)) >= _TIME_SHARE * len(present):
            return written
    return None


def is_date(column: Column, cells: Iterable[str]) -> bool:
    """Whether a column, which has these `cells`, has dates without a time of day."""
    written = column.time
    if not written or not written.has_date:
        return False
    return not any((match := re.fullmatch(written.pattern, cell)) and match.groupdict().get("H") for cell in cells)


def find_date_before_time(columns: Sequence[Column], rows: Sequence[Sequence[str]]) -> int:
    """Index of the first column of dates beside which the next one has the times of day, -1 for none."""
    for n, (one, after) in enumerate(pairwise(columns)):
        if after.time and not after.time.has_date and is_date(one, (row[n] for row in rows)):
            return n
    return -1


def is_row(row: Sequence[str], width: int, columns: Sequence[Column], cells: Cells) -> bool:
    """Whether a line is a row: it has the cells, of the kinds of the columns, and one of them is no text."""
    if len(row) != width:
        return False
    values = 0
    for cell, column in zip(row, columns, strict=True):
        if column.kind == "text" or cells.is_missing(cell):
            continue
        if not _fits(cell, column, cells):
            return False
        values += 1
    return values > 0


def _fits(cell: str, column: Column, cells: Cells) -> bool:
    """Whether a cell is of the kind of its column; any cell is text, and may be missing."""
    if column.kind == "text" or cells.is_missing(cell):
        return True
    if column.kind == "time":
        return column.time is not None and column.time.matches(cell)
    if column.hexadecimal:
        return cells.is_hexadecimal(cell)
    if column.unit:
        return cells.split_unit(cell)[1] == column.unit
    return column.choose_cells(cells).is_number(cell) or (
        column.kind == "status" and (cells.is_flag(cell) or column.choose_cells(cells).is_state(cell))
    )


def _may_be_hexadecimal(present: Sequence[str], cells: Cells) -> bool:
    """Whether all cells can be hexadecimal, and some, with digits in most of them or as long as all others, are not decimal."""
    others = [cell for cell in present if not cells.is_number(cell)]
    if not others or not all(map(cells.is_hexadecimal, present)):
        return False
    if all(map(cells.is_marked_binary, present)):
        return False
    even = len(others) < len(present) and len(set(map(len, present))) == 1
    return even or 2 * sum(any(c.isdigit() for c in cell) for cell in others) > len(others)


def _find_unit(present: Sequence[str], cells: Cells) -> str:
    """The known unit that stands behind every number, "" where there is none."""
    first = cells.split_unit(present[0])[1] if present else ""
    return first if first and all(cells.split_unit(cell)[1] == first for cell in present) and is_unit(first) else ""


def has_words(row: Sequence[str], width: int, columns: Sequence[Column], cells: Cells) -> bool:
    """Whether a line is a row in which words stand for numbers, but for its first cell, mostly the time, and half of all."""
    if len(row) != width or columns[0].kind == "text" or cells.is_missing(row[0]):
        return False
    fits = [_fits(cell, column, cells) for cell, column in zip(row, columns, strict=True)]
    return fits[0] and 2 * sum(fits) >= width


def follows(row: Sequence[str], before: Sequence[str], columns: Sequence[Column], cells: Cells) -> bool:
    """Whether the first number of a row is above that of the row `before`; of times of day this is not asked."""
    cells = columns[0].choose_cells(cells)
    return columns[0].kind == "time" or cells.read_number(row[0]) > cells.read_number(before[0])
