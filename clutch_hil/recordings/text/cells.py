"""Cells: how the numbers and flags of a text file are written, and what counts as missing."""

import re
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
import pyarrow as pa
import pyarrow.compute as pc

from protocols.files.arrow import FALSE, TRUE, convert_numbers, from_texts

# what loggers, Excel, C libraries and people write where there is no value, in lower case
_MISSING = (
    "", "nan", "-nan", "+nan", "na", "n/a", "n.a.", "#n/a", "#nv", "#na", "null", "none", "nil", "-", "--", "---", "?", "*",
    "#value!", "#wert!", "#div/0!", "#num!", "#zahl!", "#ref!", "#bezug!", "#name?", "#null!",
    "nan(ind)", "-nan(ind)", "missing", "invalid", "no data", "nodata", "<na>", "nat", "undef", "\u2013", "\u2014",
    "\u2212", "----", "-----", "-.-", "-.--", "--.--", "---.--", "***", "****", "*****", "####", "#####", "########",
    "\u221e", "-\u221e", "+\u221e",
)  # fmt: skip
# What C of Microsoft writes where there is no number, with the places that were asked for: 1.#QNAN0, -1.#IND00, 1.#J
_OF_MICROSOFT = r"[+-]?1[.,]#[a-z]+0*"
_FLAGS = {
    **dict.fromkeys(("true", "yes", "on", "wahr", "ja", "ein", "vrai", "oui", "verdadero", "vero", "sí", "sì"), 1.0),
    **dict.fromkeys(("false", "no", "off", "falsch", "nein", "aus", "faux", "non", "falso"), 0.0),
}
# The same in one letter, which may mean anything else where its opposite does not occur: yes, ja, oui, sí; true, wahr, vero
_PAIRS_OF_INITIALS = [("y", "n"), ("j", "n"), ("o", "n"), ("s", "n"), ("t", "f"), ("w", "f"), ("v", "f")]
_HEXADECIMAL = re.compile(r"(?:0[xX])?[0-9A-Fa-f]{1,16}")  # of 64 bits
_BINARY = re.compile(r"0[bB][01]{1,64}")
_UNIT = r"[^\W\d_%°][\w%/·*.^-]{0,11}|[%°][A-Za-z]{0,2}"  # behind a number
_LONGEST_WITH_UNIT = 40  # characters of a number with its unit
# Letters behind a number that are no unit: noon, ordinal numbers, hexadecimal, Fortran and C
_NO_UNITS = ("am", "pm", "a.m.", "p.m.", "st", "nd", "rd", "th", "h", "d", "e", "f", "l", "x", "u", "b")
_MINUS = "\u2212"  # the sign of typesetters
_INFINITE = r"[+-]?[iI][nN][fF](?:[iI][nN][iI][tT][yY])?"
# A minus as bookkeepers write it, (0.5), and as SAP does, 0.5-; a plus in its place
_IN_BRACKETS, _SIGN_BEHIND = r"^\(\s*([0-9.,][^()+-]*)\)$", rf"^([0-9.,][^()+-]*)([+{_MINUS}-])$"
_ACCOUNTED = re.compile(f"{_IN_BRACKETS}|{_SIGN_BEHIND}")
GROUP_MARKS = (",", ".", "'", "\u2019", " ", "\u00a0", "\u202f", "_")  # that part thousands in some country


@dataclass(frozen=True)
class Parsed:
    """A column's values (n,), not-a-number where missing; how many are missing; first row with a word, -1 for none, and it.

    accounted: whether the sign of a number is behind it, or is a pair of brackets.
    """

    values: np.ndarray
    missing: int
    row: int = -1
    word: str = ""
    accounted: bool = False


@dataclass(frozen=True)
class Cells:
    """How cells are written. decimal: mark of the fraction. thousands: mark between thousands, "" for none.

    missing: further words that count as missing, in lower case. states: words of a column with their numbers.
    """

    decimal: str = "."
    thousands: str = ""
    missing: tuple[str, ...] = ()
    states: tuple[tuple[str, float], ...] = ()

    def is_missing(self, cell: str) -> bool:
        low = cell.strip().lower()
        return low in self.absent or ("#" in low and re.fullmatch(_OF_MICROSOFT, low) is not None)

    def find_missing(self, column: pa.Array) -> pa.Array:
        """Which cells of a column stand for no value."""
        low = pc.utf8_lower(pc.utf8_trim_whitespace(column))
        return pc.or_(pc.is_in(low, from_texts(self.absent)), pc.match_substring_regex(low, f"^{_OF_MICROSOFT}$"))

    def is_number(self, cell: str) -> bool:
        """Whether the cell is a number without, or with the agreed, marks between thousands."""
        if cell.endswith((")", "+", "-", _MINUS)) and (accounted := _ACCOUNTED.fullmatch(cell)):
            cell = accounted[1] or accounted[2]
        return bool(self._plain.fullmatch(cell) or (self._grouped and self._grouped.fullmatch(cell)))

    def is_accounted(self, cell: str) -> bool:
        """Whether the cell is a number in brackets, as bookkeepers write one below zero."""
        return cell.startswith("(") and self.is_number(cell)

    def is_hexadecimal(self, cell: str) -> bool:
        """Whether the cell can be a hexadecimal number, marked as one or not."""
        return bool(_HEXADECIMAL.fullmatch(cell))

    def is_marked_hexadecimal(self, cell: str) -> bool:
        """Whether the cell is a hexadecimal number, as 0x1F is."""
        return cell[:2] in ("0x", "0X") and self.is_hexadecimal(cell)

    def is_marked_binary(self, cell: str) -> bool:
        """Whether the cell is a binary number, as 0b101 is."""
        return _BINARY.fullmatch(cell) is not None

    def split_unit(self, cell: str) -> tuple[str, str]:
        """Number and unit of a cell such as `12.5 Nm`; both "" for others. Whether there is such a unit is not asked."""
        match = self._with_unit.fullmatch(cell) if len(cell) <= _LONGEST_WITH_UNIT else None
        if not match or match["unit"].lower() in _NO_UNITS or self.is_hexadecimal(cell):
            return "", ""
        return match["number"], match["unit"]

    def is_flag(self, cell: str) -> bool:
        return cell.lower() in _FLAGS

    def is_state(self, cell: str) -> bool:
        """Whether the cell is one of the `states`."""
        return cell.lower() in [word for word, _ in self.states]

    def read_number(self, cell: str) -> float:
        """The number in a cell, not-a-number where it holds none."""
        return float(self.parse(from_texts([cell])).values[0])

    def parse(self, column: pa.Array) -> Parsed:
        """The numbers of a column of text."""
        text = pc.utf8_trim_whitespace(column)
        try:
            return _count(self._simplify_marks(text).cast(pa.float64()))
        except pa.ArrowInvalid:
            pass  # something is no number as it stands
        accounted = pc.any(pc.match_substring_regex(text, _ACCOUNTED.pattern)).as_py() is True
        if accounted:
            text = pc.replace_substring_regex(text, _IN_BRACKETS, "-\\1")
            text = pc.replace_substring_regex(text, _SIGN_BEHIND, "\\2\\1")
        text = pc.if_else(self.find_missing(column), pa.NULL, self._simplify_marks(text))
        text = pc.replace_substring(
            pc.replace_substring_regex(text, "([0-9.])[dD]([+-]?[0-9]+)$", "\\1e\\2"), "\u2212", "-"
        )
        text = pc.replace_substring_regex(text, "^([+-]) +", "\\1")
        words = pc.invert(pc.match_substring_regex(text, f"^(?:{_make_number_pattern('.')}|{_INFINITE})$"))
        words = pc.coalesce(words, FALSE)
        text = pc.if_else(words, pa.NULL, text)
        row = pc.index(words, TRUE).as_py()
        word = column[row].as_py() if row >= 0 else ""
        try:
            parsed = _count(text.cast(pa.float64()))
        except pa.ArrowInvalid:  # more digits than Arrow takes
            parsed = _count(
                pa.array([None if cell is None else float(cell) for cell in text.to_pylist()], pa.float64())
            )
        return Parsed(parsed.values, parsed.missing, row, word, accounted)

    def parse_hexadecimal(self, column: pa.Array) -> Parsed:
        """The whole numbers of a column that is hexadecimal."""
        text, missing = pc.utf8_trim_whitespace(column), self.find_missing(column)
        right = pc.match_substring_regex(text, f"^(?:{_HEXADECIMAL.pattern})$")
        row = pc.index(pc.or_(missing, right), FALSE).as_py()
        good = pc.if_else(right, text, pa.NULL).to_pylist()
        parsed = _count(pa.array([None if cell is None else float(int(cell, 16)) for cell in good], pa.float64()))
        return Parsed(parsed.values, parsed.missing, row, column[row].as_py() if row >= 0 else "")

    def parse_flags(self, column: pa.Array) -> Parsed:
        """The values of a column of the `states`, or else of true and false, 1 and 0."""
        text = pc.utf8_trim_whitespace(column)
        flags = {word.strip().lower(): value for word, value in self.states} or _FLAGS
        names = from_texts(list(flags))
        numbers = from_texts([repr(value).replace(".", self.decimal) for value in flags.values()])
        return self.parse(pc.coalesce(pc.take(numbers, pc.index_in(pc.utf8_lower(text), names)), text))

    def _simplify_marks(self, text: pa.Array) -> pa.Array:
        """Cells without marks between thousands, and with a point as decimal mark."""
        if self.thousands:
            text = self._ungroup(text)
        if self.decimal != ".":
            text = pc.replace_substring(pc.replace_substring(text, ".", "?"), self.decimal, ".")
        return text

    def _ungroup(self, text: pa.Array) -> pa.Array:
        """Cells without the marks between thousands, where these stand as they must."""
        marked = pc.match_substring(text, self.thousands)
        if not pc.any(marked).as_py():
            return text
        right = pc.and_(
            marked, pc.match_substring_regex(text, f"^(?:{_make_grouped_pattern(self.decimal, self.thousands)})$")
        )
        wrong = pc.and_not(marked, right)
        text = pc.if_else(right, pc.replace_substring(text, self.thousands, ""), text)
        return pc.if_else(wrong, pc.binary_join_element_wise("?", text, ""), text)  # a word, that no number comes of it

    @cached_property
    def absent(self) -> list[str]:
        """All cells that stand for no value, in lower case."""
        return [*_MISSING, *self.missing]

    @cached_property
    def _with_unit(self) -> re.Pattern[str]:
        return re.compile(rf"(?P<number>{_make_number_pattern(self.decimal)})\s*(?P<unit>{_UNIT})")

    @cached_property
    def _plain(self) -> re.Pattern[str]:
        return re.compile(f"{_make_number_pattern(self.decimal)}|{_INFINITE}")

    @cached_property
    def _grouped(self) -> re.Pattern[str] | None:
        return re.compile(_make_grouped_pattern(self.decimal, self.thousands)) if self.thousands else None


def find_initials(cells: Sequence[str]) -> tuple[tuple[str, float], ...]:
    """The states of a column of both flags of a pair of letters, such as Y and N, and nothing else; none for another one."""
    if not cells or len(cells[0]) > 1:
        return ()
    found = {cell.lower() for cell in cells}
    return next((((one, 1.0), (other, 0.0)) for one, other in _PAIRS_OF_INITIALS if found == {one, other}), ())


def _make_number_pattern(decimal: str) -> str:
    """Pattern of a number; loggers write `+  25.3`, with the sign apart. A comma behind the last digit parts cells."""
    mark, least = re.escape(decimal), "+" if decimal == "," else "*"
    return rf"(?:[+{_MINUS}-] *)?(?:[0-9]+(?:{mark}[0-9]{least})?|{mark}[0-9]+)(?:[eEdD][+-]?[0-9]+)?"


def _make_grouped_pattern(decimal: str, thousands: str) -> str:
    """Pattern of a number with marks between thousands; with commas also as in India, 12,34,567."""
    mark = re.escape(thousands)
    whole = rf"[1-9][0-9]{{0,2}}(?:{mark}[0-9]{{3}})+"
    if thousands == ",":
        whole = rf"(?:{whole}|[1-9][0-9]?(?:,[0-9]{{2}})+,[0-9]{{3}})"
    return rf"[+{_MINUS}-]?{whole}(?:{re.escape(decimal)}[0-9]{'+' if decimal == ',' else '*'})?"


def _count(numbers: pa.Array) -> Parsed:
    values = convert_numbers(pa.chunked_array([numbers]))
    return Parsed(values, int(np.count_nonzero(np.isnan(values))))


def show(text: Sequence[str] | str) -> str:
    """A cell or a line in a message: in quotes, on one line, at most 40 characters."""
    one = text if isinstance(text, str) else ", ".join(text)
    return repr(one if len(one) <= 40 else one[:37] + "...")
