"""Cells of a workbook as text, as the reader of text files understands it, without a loss of digits.

Excel stores times as days, with a format that shows them as dates. A day of today has a resolution of 0.6 us (2^-37 of a day).
openpyxl would round times to ms, so they are converted here.
"""

import re
from collections.abc import Callable
from datetime import date, datetime, time, timedelta
from typing import Any

from openpyxl.styles.numbers import is_date_format

from clutch_hil.recordings.text.cells import Cells
from clutch_hil.recordings.unit_in_name import is_unit

_DAY_US = 86_400_000_000  # us
_DAY_NS = 1000 * _DAY_US
_LATEST_DURATION = 400.0  # days; below are durations and times of day, as the dates would be those of 1900
_LATEST_DAY = 2_958_466.0  # days of Excel; 1 January 10000
# us; a time that differs from a multiple of the first by less than the second is that one: files have 15, 16 or 17 digits of
# the days, which are 9, 0.9 or 0.6 us
_NEAR = ((100, 5.0), (10, 1.5))
_NO_VALUE = "#N/A"  # what the reader of text takes for no value; all errors of Excel are none
# A number format with a text behind the number: 0.00" Nm", or General\ "Nm" and 0.0\ \N\m, as Excel writes what people type
_SHOWN = re.compile(r'(?P<digits>[#0?.,]+|General)(?P<text>(?:"[^"]*"|\\.|_.|\s)+)', re.IGNORECASE)
_LITERAL = re.compile(r'"([^"]*)"|\\(.)|_.')  # `_x` is a gap as wide as x
_CONDITION = re.compile(r"\[[^\]]*\]")  # a colour, a condition or a language
_THOUSANDTHS = re.compile(r"(?<=[#0?]),+(?=\.|$)")  # commas behind the digits, each of which shows a thousandth: 0.0,
_CONTROL = dict.fromkeys([*range(32), 127], " ")
_ESCAPED = re.compile(r"_x00(?:[01][0-9A-F]|7F)_")  # characters that XML does not have


class CellTexts:
    """Texts of cells. decimal: mark of numbers. begin: day 0 of the workbook. find_format: number format of a style.

    has_fractions: whether a number so far has the mark.
    """

    def __init__(self, decimal: str, begin: datetime, find_format: Callable[[int], str]) -> None:
        self.has_fractions = False
        self._decimal, self._begin, self._find_format = decimal, begin, find_format
        self._writers: dict[int, Callable[[float], str]] = {}

    def write(self, value: Any, kind: str, style: int) -> str:
        """Return a cell as text. kind: of openpyxl; `n` are numbers, `e` errors. style: number of its style."""
        if kind == "e":
            return _NO_VALUE
        if isinstance(value, bool):
            return "true" if value else "false"
        if isinstance(value, int | float):
            if (writer := self._writers.get(style)) is None:
                writer = self._writers[style] = self._choose_writer(self._find_format(style))
            return writer(value)
        if isinstance(value, datetime | date | time):
            return value.isoformat()
        if isinstance(value, timedelta):
            return _write_duration(value / timedelta(days=1))
        return " ".join(_ESCAPED.sub(" ", str(value)).translate(_CONTROL).split())

    def _choose_writer(self, shown: str) -> Callable[[float], str]:
        """Return how numbers of a number format are written: what Excel shows counts, but for its rounding."""
        if is_date_format(shown):
            return self._write_time
        if "%" in _LITERAL.sub("", shown):
            return lambda value: f"{self._write_number(100.0 * value)} %"
        if unit := _SHOWN.fullmatch(_CONDITION.sub("", shown.split(";")[0])):
            text = _LITERAL.sub(r"\1\2", unit["text"]).strip()
            commas = _THOUSANDTHS.search(unit["digits"])
            divisor = 1000 ** len(commas[0]) if commas else 1
            if is_unit(text) and Cells().split_unit(f"1 {text}")[1] == text:  # else it would be taken for a word: 1 h
                return lambda value: f"{self._write_number(value / divisor if commas else value)} {text}"
        return self._write_number

    def _write_number(self, value: float) -> str:
        text = repr(value)
        if "." in text:
            self.has_fractions = True
            return text.replace(".", self._decimal)
        return text

    def _write_time(self, days: float) -> str:
        if not -_LATEST_DURATION < days < _LATEST_DAY:
            return self._write_number(days)
        if days < _LATEST_DURATION:
            return _write_duration(days)
        whole, rest = divmod(days, 1.0)
        part = rest * _DAY_US
        rounded = (step * round(part / step) for step, most in _NEAR if abs(part - step * round(part / step)) < most)
        us = next(rounded, round(part))
        moment = self._begin + timedelta(days=int(whole), microseconds=us)
        return moment.isoformat() if rest else moment.date().isoformat()


def _write_duration(days: float) -> str:
    """Return days as hours:minutes:seconds, in ns."""
    seconds, ns = divmod(round(abs(days) * _DAY_NS), 1_000_000_000)
    text = f"{seconds // 3600:02d}:{seconds // 60 % 60:02d}:{seconds % 60:02d}.{ns:09d}"
    return f"-{text}" if days < 0.0 else text
