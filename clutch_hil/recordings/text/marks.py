"""Marks: which delimiter, decimal mark and mark between thousands a text file has: those that make most cells numbers."""

import re
from collections.abc import Mapping, Sequence
from itertools import pairwise
from pathlib import Path
from typing import Any

from clutch_hil.recordings.text.cells import GROUP_MARKS, Cells
from clutch_hil.recordings.text.clock import find_time_format
from clutch_hil.recordings.text.lines import RUNS, Line, split
from protocols.errors import InputError

_SCORED_LINES, _SCORED_CELLS = 100, 200  # that decide on the delimiter: 10^5 tries of a pattern in all
_SUSPICIOUS = re.compile(r"[0-9]\s*[;\t|, ]\s*[-+.]?[0-9]")  # a cell that a better delimiter would part
_SHOWN = 200  # characters of a cell in which this is looked for: the pattern takes the square of it
_EITHER = (",", ".")  # marks between thousands that are decimal marks elsewhere
_FRACTION = re.compile(r"[+-]?0[.,][0-9]+")
_WHOLES = re.compile(r"(?:[+-]?[0-9]+,[0-9]+,?)+(?<!,)")  # of a row: numbers that are fractions, perhaps
_TABBED = 0.9  # of the numbers that blanks and tabs part, which tabs alone part where they are the delimiter
_DELIMITERS = (";", "\t", "|", ",", RUNS)


def choose_marks(path: Path, lines: Sequence[Line], delimiter: str, options: Mapping[str, Any]) -> tuple[str, Cells]:
    """Delimiter and marks in numbers that make most cells of the last `lines` numbers. Raises InputError where two do."""
    lines = _drop_others(lines[-_SCORED_LINES:])
    missing = tuple(word.strip().lower() for word in options.get("missing", "").split(",") if word.strip())
    scores: list[tuple[float, int, str, Cells]] = []
    for mark in [delimiter] if delimiter else _DELIMITERS:
        rows = [split(line.text, mark)[:_SCORED_CELLS] for line in lines]
        quoted = any('"' in line.text for line in lines)
        for decimal in [options["decimal"]] if "decimal" in options else (".", ","):
            if decimal == mark and not quoted:
                continue
            groups = [options["thousands"]] if "thousands" in options else ["", *GROUP_MARKS]
            for thousands in groups:
                if thousands == decimal or (thousands == mark and not quoted):
                    continue
                cells = Cells(decimal, thousands, missing)
                if thousands and "thousands" not in options and not any(thousands in c for row in rows for c in row):
                    continue
                scores.append((_score(rows, cells), -len(scores), mark, cells))
    best = max(scores, key=lambda one: one[:2])
    tabbed = max((one for one in scores if one[2] == "\t"), key=lambda one: one[:2], default=best)
    if best[2] == RUNS and tabbed[0] >= _TABBED * best[0]:  # single words with blanks above the rows gave the rest
        best = tabbed
    if "thousands" not in options and best[3].thousands in _EITHER:
        _check_thousands(path, [split(line.text, best[2]) for line in lines], best[3])
    for other in scores:  # 1,234 in another reading: 1.234 or 1234
        one, two = best[3], other[3]
        if (
            other[0] == best[0] > 0
            and other[2] == best[2]
            and one.decimal != two.decimal
            and "," in one.thousands + two.thousands
        ):
            cell = next((c for line in lines for c in split(line.text, best[2]) if _is_either(c, one, two)), "")
            if cell:
                raise make_doubt(path, cell, ",")
    return best[2], best[3]


def _drop_others(lines: Sequence[Line]) -> Sequence[Line]:
    """The lines with tabs, where most have some: those above the rows do not tell that blanks part cells."""
    tabbed = [line for line in lines if "\t" in line.text.strip()]
    return tabbed if 2 * len(tabbed) > len(lines) else lines


def _check_thousands(path: Path, rows: Sequence[Sequence[str]], cells: Cells) -> None:
    """Raise InputError for a column in which every number may be a fraction of three digits, as 1,234 or 12.500."""
    mark = cells.thousands
    width = max(map(len, rows))
    for column in range(width):
        numbers = [row[column] for row in rows if column < len(row) and any(c in "123456789" for c in row[column])]
        numbers = [cell for cell in numbers if cells.is_number(cell) or _FRACTION.fullmatch(cell)]
        marked = [cell for cell in numbers if mark in cell]
        if marked and all(cell.count(mark) == 1 and cells.decimal not in cell for cell in marked) and marked == numbers:
            raise make_doubt(path, marked[0], mark)


def check_no_fractions(path: Path, rows: Sequence[Sequence[str]], options: Mapping[str, Any]) -> None:
    """Raise InputError for rows without names that commas part into whole numbers, which may be fractions, as 5,05 is.

    They are no fractions in a single pair of cells whose first one rises in every row, as a time or a count does, and in pairs
    whose second cells have different lengths.
    """
    width = len(rows[0])
    if (
        width % 2
        or {"decimal", "delimiter"} & options.keys()
        or not all(_WHOLES.fullmatch(",".join(row)) for row in rows)
    ):
        return
    behind = [[row[number] for row in rows] for number in range(1, width, 2)]
    even = all(len({*map(len, cells)}) == 1 for cells in behind)
    padded = any(len(cell) > 1 and cell[0] == "0" for cells in behind for cell in cells)
    first = [int(row[0]) for row in rows]
    rises = all(one < other for one, other in pairwise(dict.fromkeys(first)))
    counts = rises and len({*first}) == len({*map(tuple, rows)})
    if even and len(behind[0][0]) > 1 and (padded or (width == 2 and not counts)):
        cell = ",".join(next((row[:2] for row in rows if row[1][0] == "0"), rows[0][:2]))
        raise InputError(
            f"recording {path}: {cell!r} can be a fraction or two cells, and no line of names tells; set decimal = ',' or"
            " delimiter = ',' in [file]"
        )


def make_group_pattern(mark: str) -> str:
    """Pattern of a number that may be below 1000 with three decimals, or have `mark` between thousands, as 1.234."""
    return rf"[+-]?[1-9][0-9]{{0,2}}{re.escape(mark)}[0-9]{{3}}"


def tells_decimal(rows: Sequence[Sequence[str]], cells: Cells) -> bool:
    """Whether a number in `rows` is sure to have a decimal mark, as 0.5, 1.25 or 1.2345 has."""
    group = re.compile(make_group_pattern(cells.decimal))
    return any(
        cells.decimal in cell and cells.is_number(cell) and not group.fullmatch(cell.strip())
        for row in rows
        for cell in row
    )


def make_doubt(path: Path, cell: str, mark: str) -> InputError:
    return InputError(
        f"recording {path}: cells such as {cell!r} can be a fraction or have a mark between thousands; set"
        f" decimal = {mark!r} or thousands = {mark!r} in [file]"
    )


def _is_either(cell: str, one: Cells, two: Cells) -> bool:
    return "," in cell and one.is_number(cell) and two.is_number(cell)


def _score(rows: Sequence[Sequence[str]], cells: Cells) -> float:
    """How many words are, or are in, numbers and times, less those in cells that another delimiter would part.

    Counted are rows of one length, that which gives most: a clock time above the rows says nothing about them.
    """
    totals: dict[int, float] = {}
    for row in rows:
        total = 0.0
        for cell in row:
            if cells.is_number(cell) or cells.split_unit(cell)[1] or (len(cell) > 4 and find_time_format([cell])):
                total += 1.0 + (cell.count(" ") if len(row) > 1 else 0)  # blanks in it are no delimiters
            elif len(cell) > 2 and _SUSPICIOUS.search(cell[:_SHOWN]):
                total -= 2.0
        totals[len(row)] = totals.get(len(row), 0.0) + total
    return max(totals.values(), default=0.0)
