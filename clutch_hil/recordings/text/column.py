"""The cells of one column of a text file, as values."""

import re
from collections.abc import Callable
from dataclasses import replace
from math import nan
from pathlib import Path
from typing import NoReturn

import numpy as np
import pyarrow as pa
import pyarrow.compute as pc

from clutch_hil.recordings.channel import EXACT, Channel
from clutch_hil.recordings.text.cells import Cells, Parsed, show
from clutch_hil.recordings.text.clock import Clock
from clutch_hil.recordings.text.layout import Layout
from clutch_hil.recordings.text.marks import make_doubt, make_group_pattern
from protocols.errors import InputError
from protocols.files.arrow import TRUE

_MOST_BITS = 64


class ColumnReader:
    """Turns the cells of one column into values, and remembers what was missing."""

    def __init__(self, path: Path, channel: Channel, layout: Layout) -> None:
        self._path, self._channel = path, channel
        self._column = layout.columns[channel.number - 1]
        self._cells = self._column.choose_cells(layout.cells)
        if channel.states:
            self._cells = replace(self._cells, states=channel.states)
        written = self._column.time
        self._clock = Clock(written) if written and not channel.states else None
        self._missing, self._accounted = 0, False
        first = self._cells.read_number(layout.samples[0][channel.number - 1]) if channel.kind == "number" else nan
        self._whole: list[np.ndarray] | None = [] if first > EXACT else None
        plain = channel.kind == "number" and not (self._column.hexadecimal or channel.states)
        self._decimal = (
            DecimalDoubt(self._cells.decimal) if layout.unsure and plain and not self._column.decimal else None
        )
        found = plain and self._cells.thousands and layout.asks_thousands
        self._groups = _Groups(self._cells) if found and self._cells.thousands in ",." else None
        self._exponent = _Exponent(self._cells.decimal) if layout.asks_hexadecimal and plain else None
        self._bits = BitField() if plain else None

    @property
    def path(self) -> str:
        return self._channel.path

    @property
    def midnights(self) -> int:
        return self._clock.midnights if self._clock else 0

    def find_first(self) -> float:
        """The first time of day [s]."""
        return (self._clock.first or 0) / 1e9 if self._clock else nan

    def read(self, column: pa.Array, lines: Callable[[int], int]) -> np.ndarray:
        """Values (n,) of the cells. lines: gives the line of a row. Raises InputError for a word."""
        if self._channel.kind == "text" and not self._channel.states:
            return np.full(len(column), np.nan)
        if self._clock:
            missing = self._cells.find_missing(column)
            values, bad = self._clock.parse(column, missing)
            self._missing += pc.sum(missing).as_py() or 0
            if bad >= 0:
                what = f"no time ({self._clock.written.what})"
                self._refuse(
                    column[bad].as_py(), lines(bad), what, "correct it, or set time_format or missing in [file]"
                )
            return values
        if self._decimal:
            self._decimal.look(column)
        if self._groups:
            self._groups.look(column)
        if self._column.unit and not self._channel.states:
            column = pc.replace_substring_regex(column, rf"\s*{re.escape(self._column.unit)}\s*$", "")
        if self._exponent:
            self._exponent.look(column, lines)
        if self._bits:
            self._bits.look(column)
        parsed = self._parse(column)
        self._missing += parsed.missing
        self._accounted = self._accounted or parsed.accounted
        if parsed.row >= 0:
            self._refuse(parsed.word, lines(parsed.row), "no number", self._suggest(parsed.word))
        if self._whole is not None:
            try:
                self._whole.append(pc.utf8_trim_whitespace(column).cast(pa.int64()).to_numpy(zero_copy_only=False))
            except pa.ArrowInvalid:  # not all are whole numbers as they stand
                self._whole = None
        return parsed.values

    def _parse(self, column: pa.Array) -> Parsed:
        if self._channel.kind == "status" or self._channel.states:
            return self._cells.parse_flags(column)
        return self._cells.parse_hexadecimal(column) if self._column.hexadecimal else self._cells.parse(column)

    def join_whole(self) -> np.ndarray | None:
        """Whole numbers for `Signal.whole`, as of ns since 1970; None where float64 has all digits."""
        return np.concatenate(self._whole) if self._whole else None

    def _refuse(self, cell: str, line: int, what: str, remedy: str) -> NoReturn:
        name = self._channel.path
        raise InputError(
            f"recording {self._path}: column {name!r} holds {show(cell)} in line {line}, which is {what}; {remedy}"
        )

    def _suggest(self, word: str) -> str:
        if self._channel.states:
            return "give its number in `states` of the map"
        for mark in (",", ".", "'", " ", "\u00a0"):
            if (
                mark in word
                and mark not in (self._cells.decimal, self._cells.thousands)
                and any(c.isdigit() for c in word)
            ):
                return f"set decimal or thousands in [file] where {mark!r} is a mark in numbers"
        return "correct it, or set missing in [file] if it marks a missing value"

    def list_notes(self, rows: int) -> list[str]:
        """Notes after the last cells. Raises InputError where a mark in them can be one between thousands."""
        name, notes = self._channel.path, []
        if self._decimal and (cell := self._decimal.find_doubt()):
            raise make_doubt(self._path, cell, self._decimal.mark)
        if self._groups and (cells := self._groups.find_doubt()):
            raise InputError(
                f"recording {self._path}: column {name!r} holds {cells[0]!r} and {cells[1]!r}, of which each mark may be the"
                f" decimal one; correct it, or set thousands = {self._cells.thousands!r} in [file] where it parts thousands"
            )
        if self._column.decimal:
            notes.append(f"{name}: {self._column.decimal!r} is its decimal mark, unlike that of other columns")
        if self._exponent and (doubt := self._exponent.find_doubt()):
            raise InputError(
                f"recording {self._path}: column {name!r} holds {doubt[0]!r} in line {doubt[1]}, which may be hexadecimal, or"
                f" {float(doubt[0]):g}; set hexadecimal = {name!r} in [file], or hexadecimal = '' where no column is"
            )
        if self._bits and (cell := self._bits.find()):
            notes.append(BIT_FIELD.format(name, cell))
        if self._column.hexadecimal:
            notes.append(f"{name}: its whole numbers are hexadecimal")
        if self._clock:
            notes.append(f"{name}: times ({self._clock.written.what}), counted in s from the first")
            if self._clock.midnights:
                notes.append(f"{name}: passed midnight {self._clock.midnights} times, where a day was added")
        if self._accounted:
            notes.append(f"{name}: numbers in brackets, such as (0.5), or with a minus behind, 0.5-, are below 0")
        if self._missing:
            notes.append(f"{name}: {self._missing} of {rows} cells have no value")
        return notes


# Note on a column and its first cell
BIT_FIELD = (
    "{}: numbers such as {} have the digits 0 and 1 only, and as many: bits, perhaps, read as decimal numbers; `states` of"
    " the map can give others"
)


class BitField:
    """Whether all cells of a column are digits 0 and 1, equally many, and some begin with 0, as 0101 and 0010 do."""

    def __init__(self) -> None:
        self._cell, self._ruled_out = "", False

    def look(self, column: pa.Array) -> None:
        """Look at some cells."""
        if self._ruled_out or not len(column):
            return
        cells = pc.utf8_trim_whitespace(column)
        digits = len(self._cell) or len(cells[0].as_py())
        alike = digits > 1 and pc.all(pc.match_substring_regex(cells, f"^[01]{{{min(digits, _MOST_BITS)}}}$")).as_py()
        self._ruled_out = not alike
        if not self._cell or self._cell[0] == "1":
            self._cell = _find_first(cells, pc.starts_with(cells, "0")) or self._cell or cells[0].as_py()

    def find(self) -> str:
        """The first cell that begins with 0, "" where the column is no such one."""
        return "" if self._ruled_out or self._cell[:1] != "0" else self._cell


class _Exponent:
    """Whether 1E5 is 100000 or hexadecimal: programs write 1E+05 or 1.0E5 where they mean 100000.

    It is a number in a column that has a fraction, a sign or another exponent somewhere.
    """

    def __init__(self, decimal: str) -> None:
        self._other = f"[{decimal}+eDd-]"
        self._cell, self._line = "", 0
        self._sure = False

    def look(self, column: pa.Array, lines: Callable[[int], int]) -> None:
        """Look at some cells. lines: gives the line of a row."""
        if self._sure:
            return
        self._sure = bool(pc.any(pc.match_substring_regex(column, self._other)).as_py())
        if not self._sure and not self._cell and pc.any(pc.match_substring(column, "E")).as_py():
            cells = pc.utf8_trim_whitespace(column)
            if (first := pc.index(pc.match_substring_regex(cells, "^[0-9]+E[0-9]+$"), TRUE).as_py()) >= 0:
                self._cell, self._line = cells[first].as_py(), lines(first)

    def find_doubt(self) -> tuple[str, int] | None:
        """A cell that may be either, and its line; None where there is none."""
        return (self._cell, self._line) if self._cell and not self._sure else None


class _Groups:
    """Whether the mark between thousands of a file may be a second decimal mark of a column, as in 5.399, 5,399.

    It parts thousands in a column that has a number with both marks, 1,234.5, or has no decimal mark at all.
    """

    def __init__(self, cells: Cells) -> None:
        self._decimal, self._thousands = cells.decimal, cells.thousands
        self._both = False
        self._fraction = self._group = ""  # the first cell with either mark alone

    def look(self, column: pa.Array) -> None:
        """Look at some cells."""
        if self._both:
            return
        parted, broken = (pc.match_substring(column, mark) for mark in (self._thousands, self._decimal))
        self._both = bool(pc.any(pc.and_(parted, broken)).as_py())
        self._fraction = self._fraction or _find_first(column, pc.and_not(broken, parted))
        self._group = self._group or _find_first(column, pc.and_not(parted, broken))

    def find_doubt(self) -> tuple[str, str] | None:
        """A cell with a decimal mark and one with a mark that may be one; None where there is no doubt."""
        return (self._fraction, self._group) if self._fraction and self._group and not self._both else None


def _find_first(column: pa.Array, chosen: pa.Array) -> str:
    """The first of the `chosen` cells, "" for none."""
    row = pc.index(chosen, TRUE).as_py()
    return column[row].as_py().strip() if row >= 0 else ""


class DecimalDoubt:
    """Whether `mark` is a decimal mark in a column whose samples do not tell: it is in 998, 999, 1.25, not in 998, 999, 1.000.

    A column in which all numbers have three decimals is taken as such: so programs write.
    """

    def __init__(self, mark: str) -> None:
        self.mark = mark
        self._group = f"^{make_group_pattern(mark)}$"
        self._cell = ""  # the first that may have a mark between thousands
        self._plain = self._sure = False

    def look(self, column: pa.Array) -> None:
        """Look at some cells."""
        if self._sure:
            return
        cells = pc.utf8_trim_whitespace(column)
        marked = pc.match_substring(cells, self.mark)
        grouped = pc.match_substring_regex(cells, self._group)
        self._sure = bool(pc.any(pc.and_(marked, pc.invert(grouped))).as_py()) or bool(
            pc.any(pc.match_substring_regex(cells, "^[+-]?[0-9]{4,}$")).as_py()
        )
        self._plain = self._plain or bool(pc.any(pc.match_substring_regex(cells, "^[+-]?[0-9]{1,3}$")).as_py())
        if not self._cell and (first := pc.index(grouped, TRUE).as_py()) >= 0:
            self._cell = cells[first].as_py()

    def find_doubt(self) -> str:
        """A cell that may have a mark between thousands, "" where there is none."""
        return self._cell if self._plain and not self._sure else ""
