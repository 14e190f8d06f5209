"""Cells of the lines above the rows of a text file, each parted as the rows are, or as it is itself."""

import re
from collections.abc import Collection, Sequence
from dataclasses import dataclass
from pathlib import Path

from clutch_hil.recordings.text.cells import Cells
from clutch_hil.recordings.text.clock import find_time_format
from clutch_hil.recordings.text.date_names import name_date_and_time
from clutch_hil.recordings.text.index_name import name_index
from clutch_hil.recordings.text.lines import RUNS, Line, split
from clutch_hil.recordings.text.stated_numbers import take_numbers_beside
from clutch_hil.recordings.unit_in_name import split_unit
from protocols.errors import InputError

_FEWEST_ROWS = 10  # lines of numbers in one that follow each other and are a recording: fewer are a table of a preamble
_NAMES_APART = re.compile(r"[^\s\[(]+(?:\s?[\[(][^\])\s]*[\])])?")  # `time (s) torque (Nm)`
# Of a column that counts rows
_ROW_NAME = re.compile(
    r"(samples?|index|row|no\.?|(lfd\.?\s*)?nr\.?|n|i|id|count(er)?|point|scan|record|step|zeile|messpunkt|zähler|#)"
    r"([\s_]*(no|nr|number|index)\.?)?",
    re.IGNORECASE,
)
_UNUSED_NAME = "Comment"  # the last name of LabVIEW's .lvm, for which most rows have no cell


@dataclass(frozen=True)
class HeadingRows:
    """Cells of the lines above the rows, by the index of their line; as many as a row has, none where a line has others.

    beside: single numbers with a name, of cells beside those of the columns. with_numbers: lines that had such cells.
    """

    cells: dict[int, list[str]]
    beside: dict[str, float]
    with_numbers: Collection[int]


def split_rows(
    path: Path, above: Sequence[Line], widths: tuple[int, int], delimiter: str, cells: Cells, counted: bool, date: int
) -> HeadingRows:
    """Return the cells of the lines `above` the rows; arguments of `headings.find_headings`.

    Raises InputError where these lines are rows themselves.
    """
    width, top = widths[1], len(above)
    _check_no_rows(path, above, widths[0], delimiter, cells)
    rows = {number: _split_cells(line, widths, delimiter) for number, line in enumerate(above)}
    for row in rows.values():  # numbers to the right of all rows, as a result in a spreadsheet, are no names
        row[widths[0] :] = ["" if cells.is_number(cell) else cell for cell in row[widths[0] :]]
    if date >= 0:
        rows = {n: name_date_and_time(row, above[n], delimiter, widths, date) for n, row in rows.items()}
    rows = name_index(rows, above)
    filled = widths[0] == width  # else the missing name is that of the empty last column
    if counted and top and filled and (row := _add_name_of_rows(above[-1], width, delimiter)):
        rows[top - 1] = row  # R gives the names of the rows none
    beside, others = take_numbers_beside(above, widths[0], delimiter, cells)
    rows |= {number: [*row, *[""] * (width - len(row))] for number, row in others.items()}
    return HeadingRows(rows, beside, others.keys())


def _add_name_of_rows(line: Line, width: int, delimiter: str) -> list[str]:
    """The cells of a line that has one too few, as the first column has no name; none for another line."""
    row = [" ".join(cell.split()) for cell in split(line.text, delimiter)]
    return ["", *row] if len(row) == width - 1 and all(row) and not _ROW_NAME.fullmatch(split_unit(row[0])[0]) else []


def _check_no_rows(path: Path, above: Sequence[Line], width: int, delimiter: str, cells: Cells) -> None:
    """Raise InputError where many of the lines above the rows are rows themselves, of a table with other columns."""
    counts = [_count_values(line, delimiter, cells) for line in above]
    for number in range(len(above) - _FEWEST_ROWS + 1):
        if counts[number] > 1 and len(set(counts[number : number + _FEWEST_ROWS])) == 1:
            last = max(n for n, count in enumerate(counts) if count == counts[number])
            raise InputError(
                f"recording {path} has two tables: rows of {counts[number]} cells from line {above[number].number} to"
                f" {above[last].number}, of {width} below; set skip_lines = {above[last].number} in [file] for the second"
                " one, or split the file"
            )


def _count_values(line: Line, delimiter: str, cells: Cells) -> int:
    """How many cells a line has, where all are numbers or times and it is no comment; else 0."""
    row = [] if line.comment else split(line.text, delimiter)
    return len(row) if all(cells.is_number(cell) or find_time_format([cell]) for cell in row) else 0


def _split_cells(line: Line, widths: tuple[int, int], delimiter: str) -> list[str]:
    """The cells of a line above the rows, as many as a row has; empty where it has others."""
    least, width = widths
    row = [" ".join(cell.split()) for cell in split(line.text, delimiter)]
    if delimiter == RUNS and len(row) > 1 and len(marks := {cell[-1:] for cell in row[:-1]} & {",", ";"}) == 1:
        row = [cell.rstrip(*marks) for cell in row] if all(cell[-1:] in marks for cell in row[:-1]) else row
    if len(row) == width + 1 and row[-1] == _UNUSED_NAME:
        del row[-1]
    if least == 1 < width and any(row[1:]):
        return []  # `Vertical Scale,0.5,` above `17,` of GW Instek: a setting
    if len(row) >= least and not any(row[width:]):
        return [*row, *[""] * width][:width]
    for mark in ("\t", ";", ",", "|"):  # names may be parted otherwise than numbers are
        row = split(line.text, mark)
        if len(row) == width and all(row):
            return row
    text = line.text.strip()
    for row in (re.split(r"\s\s+", text), _NAMES_APART.findall(text) if delimiter == RUNS else []):
        if len(row) == width > 1:
            return row
    return []
