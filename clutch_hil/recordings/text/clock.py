"""TimeFormat: how a column writes dates and times of day, and their values in seconds.

Found by content: ISO 8601; day, month and year in any order that is certain; names of months; times of day, which may pass
midnight. Which of 03/02 is the day cannot be told: such columns are refused until `time_format` says it.
"""

import re
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from datetime import UTC, datetime, timedelta

import numpy as np
import pyarrow as pa
import pyarrow.compute as pc

from protocols.errors import InputError

_NS = 1_000_000_000  # in a second
_DAY = 86400 * _NS
_LONGEST = 64  # characters of a time: longer cells are text
_YEARS = (1700, 2250)  # that nanoseconds in 64 bits count from 1970
_MONTHS = {
    name: number
    for number, names in enumerate(
        (
            "jan ene gen",
            "feb fév fev",
            "mar mär mrz mrt",
            "apr avr abr",
            "may mai mag mei maj",
            "jun giu",
            "jul lug",
            "aug aoû aou ago",
            "sep set",
            "oct okt ott out",
            "nov",
            "dec dez déc dic",
        ),
        1,
    )  # by the first three letters, of European languages
    for name in names.split()
}
# The half of the day stands behind the hours or, in Korean, Chinese and Japanese, before them
_BEFORE, _BEHIND = r"(?:(?P<q>오[전후]|[上下]午|午[前後])\s*)?", r"(?:\s*(?P<p>[AaPp])\.?\s?[Mm]\.?)?"
_HMS = (
    rf"{_BEFORE}(?P<H>[0-9]{{1,2}}):(?P<M>[0-9]{{2}})(?::(?P<S>[0-9]{{1,2}})(?:[.,:;](?P<f>[0-9]{{1,9}}))?)?{_BEHIND}"
)
_AFTERNOON = ("p", "오후", "下午", "午後")
# Hours of the names of zones that are those of one zone: CST is American and Chinese
_ZONES = {
    "WET": 0, "WEST": 1, "CET": 1, "CEST": 2, "MEZ": 1, "MESZ": 2, "EET": 2, "EEST": 3, "EST": -5, "EDT": -4, "PST": -8,
    "PDT": -7, "JST": 9, "KST": 9,
}  # fmt: skip
# Zone of a time; Java adds [Europe/Berlin]
_ZONE = (
    rf"(?:\s*(?P<z>Z|z|(?:UTC|GMT)[+-][0-9]{{1,2}}(?::?[0-9]{{2}})?|UTC|GMT|[+-][0-9]{{2}}(?::?[0-9]{{2}})?|{'|'.join(_ZONES)})"
    r"(?:\[[A-Za-z_/]+\])?)?"
)
_CLOCK = rf"(?:(?:T|,?\s+|_){_HMS}{_ZONE})?"
_NAME = r"(?P<b>[A-Za-zäéû]{3,10})\.?"
_YEAR, _MONTH, _DATE = r"(?P<Y>[0-9]{4})", r"(?P<m>[0-9]{1,2})", r"(?P<d>[0-9]{1,2})"
_DIRECTIVES = {
    "Y": _YEAR, "y": r"(?P<y>[0-9]{2})", "m": _MONTH, "d": _DATE, "H": r"(?P<H>[0-9]{1,2})", "I": r"(?P<H>[0-9]{1,2})",
    "M": r"(?P<M>[0-9]{1,2})", "S": r"(?P<S>[0-9]{1,2})", "f": r"(?P<f>[0-9]{1,9})", "p": r"(?P<p>[AaPp])\.?[Mm]\.?",
    "b": _NAME, "B": _NAME, "z": r"(?P<z>Z|UTC|[+-][0-9]{2}:?[0-9]{2})", "j": r"(?P<j>[0-9]{1,3})", "%": "%",
    "G": r"(?P<G>[0-9]{4})", "V": r"(?P<V>[0-9]{2})", "u": r"(?P<u>[1-7])",
}  # fmt: skip
# ISO weeks, 2026-W48-7, and days of the year of this and the last century: 2026-333 may be a number of something else
_WEEK = r"(?P<G>[0-9]{4})-W(?P<V>[0-9]{2})-(?P<u>[1-7])"
_ORDINAL = r"(?P<Y>(?:19|20)[0-9]{2})-(?P<j>[0-3][0-9]{2})"


@dataclass(frozen=True)
class TimeFormat:
    """pattern: regular expression whose groups are named as strptime's directives. what: in words.

    doubt: why it cannot be read without `time_format`, "" where it can.
    """

    pattern: str
    what: str
    doubt: str = ""

    @property
    def has_date(self) -> bool:
        return any(f"(?P<{day}>" in self.pattern for day in "dju")

    @property
    def is_duration(self) -> bool:
        """Whether it is a duration of ISO 8601, which no time of day is."""
        return "(?P<s>" in self.pattern

    def matches(self, cell: str) -> bool:
        return len(cell) <= _LONGEST and re.fullmatch(self.pattern, cell) is not None


_PLAIN = (
    TimeFormat(rf"{_YEAR}[-/.]{_MONTH}[-/.]{_DATE}{_CLOCK}", "ISO 8601"),
    TimeFormat(rf"{_YEAR}\.\s?{_MONTH}\.\s?{_DATE}\.{_CLOCK}", "year. month. day."),  # Korean, Hungarian
    TimeFormat(
        r"(?P<Y>[0-9]{4})(?P<m>[0-9]{2})(?P<d>[0-9]{2})[T ](?P<H>[0-9]{2}):?(?P<M>[0-9]{2}):?"
        r"(?P<S>[0-9]{2})(?:[.,](?P<f>[0-9]{1,9}))?"
        + _ZONE,
        "ISO 8601",
    ),
    TimeFormat(rf"{_DATE}\.{_MONTH}\.{_YEAR}{_CLOCK}", "day.month.year"),
    TimeFormat(
        rf"{_DATE}\.{_MONTH}\.{_YEAR}\s+(?P<H>[0-9]{{1,2}})\.(?P<M>[0-9]{{2}})\.(?P<S>[0-9]{{2}})(?:[.,](?P<f>[0-9]{{1,9}}))?",
        "day.month.year hours.minutes.seconds",  # Finnish, Danish, Italian
    ),
    TimeFormat(rf"(?:[A-Za-z]{{2,9}}\.?,?\s+)?{_DATE}\.?[-\s/]*{_NAME}[-\s/,]*{_YEAR}{_CLOCK}", "day, name of the month, year"),
    TimeFormat(rf"(?:[A-Za-z]{{2,9}}\.?,?\s+)?{_NAME}\s+{_DATE},?\s+{_YEAR}{_CLOCK}", "name of the month, day, year"),
    TimeFormat(rf"[A-Za-z]{{2,9}}\.?\s+{_NAME}\s+{_DATE}\s+{_HMS}{_ZONE}\s+{_YEAR}", "as the C library writes it"),
    TimeFormat(rf"{_YEAR}[年년]\s?{_MONTH}[月월]\s?{_DATE}[日일]{_CLOCK}", "year, month, day"),
    TimeFormat(rf"'(?P<y>[0-9]{{2}})[-/]{_MONTH}[-/]{_DATE}{_CLOCK}", "'year, month, day"),  # HIOKI
    TimeFormat(rf"{_YEAR}[-:/](?P<j>[0-9]{{3}})[T :/-]{_HMS}{_ZONE}", "year, day of the year"),
    TimeFormat(rf"{_ORDINAL}{_CLOCK}", "year, day of the year"),
    TimeFormat(rf"{_WEEK}{_CLOCK}", "ISO 8601, year, week, day of the week"),
    TimeFormat(
        r"(?P<G>[0-9]{4})W(?P<V>[0-9]{2})(?P<u>[1-7])"
        r"(?:T(?P<H>[0-9]{2}):?(?P<M>[0-9]{2}):?(?P<S>[0-9]{2})(?:[.,](?P<f>[0-9]{1,9}))?"
        + _ZONE
        + ")?",
        "ISO 8601, year, week, day of the week",
    ),
    TimeFormat(
        r"(?P<D>[0-9]{1,3})[:/](?P<H>[0-9]{2}):(?P<M>[0-9]{2}):(?P<S>[0-9]{2})[.,](?P<f>[0-9]{1,9})",
        "days:hours:minutes:seconds",
    ),
    TimeFormat(
        r"(?:(?P<D>-?[0-9]{1,5}) days?,? )?(?P<n>[+-])?"  # of a duration, as Python and pandas write it, and before a trigger
        rf"{_BEFORE}(?P<H>[0-9]{{1,4}}):(?P<M>[0-9]{{2}}):(?P<S>[0-9]{{2}})(?:[.,:;](?P<f>[0-9]{{1,9}}))?{_BEHIND}",
        "hours:minutes:seconds",
    ),
    TimeFormat(  # of a duration, as .NET writes it: with days only where there are some
        r"(?:(?P<D>[0-9]{1,5})\.)?(?P<H>[0-9]{2}):(?P<M>[0-9]{2}):(?P<S>[0-9]{2})(?:\.(?P<f>[0-9]{1,9}))?",
        "days.hours:minutes:seconds",
    ),
    TimeFormat(r"(?P<M>[0-9]{1,4}):(?P<S>[0-9]{2})[.,](?P<f>[0-9]{1,9})", "minutes:seconds"),
    TimeFormat(  # also without the parts that are 0, and with more than 59 of each: PT0.5S, PT1H2M3S, P1DT90M
        r"(?P<n>[+-])?P(?:(?P<D>[0-9]{1,5})D)?T(?:(?P<H>[0-9]{1,6})H)?(?:(?P<M>[0-9]{1,8})M)?"
        r"(?:(?P<s>[0-9]{1,9})(?:[.,](?P<f>[0-9]{1,9}))?S)?",
        "ISO 8601, a duration",
    ),
    TimeFormat(
        r"(?P<H>[0-9]{1,2}):(?P<M>[0-9]{2})", "two numbers",
        "can be hours and minutes or minutes and seconds; set time_format = '%H:%M' or '%M:%S' in [file]",
    ),
)  # fmt: skip
_LIKE_A_DATE = re.compile(
    r"[0-9A-Za-z.,']+\s*[-/.\s]\s*[0-9A-Za-zäéû]+\s*[-/.,\s]+[0-9]+|[0-9]{8}[T ][0-9]{6}"
    r"|[0-9]{4}-?W[0-9]{2}|[0-9]{4}-[0-9]{3}(?![0-9])|[+-]?PT?[0-9]"
)  # three parts, a week, a day of the year, or a duration: quick to look for
_SLASHED = rf"([0-9]{{1,2}})([/-])([0-9]{{1,2}})[/-][0-9]{{4}}{_CLOCK}"
# Which number is the year is not told: the names of the groups say only that it is a date. 12-Mar-26 is from PI and Oracle
_SHORT_YEAR = rf"(?P<d>[0-9]{{1,2}})[./-](?P<m>[0-9]{{1,2}})[./-](?P<y>[0-9]{{2}}){_CLOCK}"
_SHORT_NAMED = rf"(?P<d>[0-9]{{1,2}})[-./ ]{_NAME}[-./ ]+(?P<y>[0-9]{{2}}){_CLOCK}"


def find_time_format(cells: Sequence[str]) -> TimeFormat | None:
    """How all of `cells` write times, None where they hold none, or different ones."""
    if not cells or len(cells[0]) > _LONGEST or not (":" in cells[0] or _LIKE_A_DATE.match(cells[0])):
        return None
    for one in _PLAIN:
        if all(one.matches(cell) for cell in cells):
            return one
    for pattern, month in ((_SHORT_YEAR, "%m"), (_SHORT_NAMED, "%b")):
        dates = [re.fullmatch(pattern, cell) for cell in cells]
        if all(date and (month == "%m" or date["b"].lower()[:3] in _MONTHS) for date in dates):
            mark = cells[0].lstrip("0123456789")[0]
            written = f"%d{mark}{month}{mark}%y{_write_clock(cells[0])}"
            return TimeFormat(
                pattern,
                "a date",
                f"does not tell which number is the year; set time_format, such as '{written}', in [file]",
            )
    parts = [re.fullmatch(_SLASHED, cell) for cell in cells]
    if not all(parts):
        return None
    first, second = ([int(part[number]) for part in parts if part] for number in (1, 3))
    mark = parts[0][2] if parts[0] else "/"
    day_first = rf"{_DATE}[/-]{_MONTH}[/-]{_YEAR}{_CLOCK}"
    month_first = rf"{_MONTH}[/-]{_DATE}[/-]{_YEAR}{_CLOCK}"
    if first == second or max(first) > 12:
        return TimeFormat(day_first, f"day{mark}month{mark}year")
    if max(second) > 12:
        return TimeFormat(month_first, f"month{mark}day{mark}year")
    either = [f"'%{a}{mark}%{b}{mark}%Y{_write_clock(cells[0])}'" for a, b in ("dm", "md")]
    return TimeFormat(
        day_first,
        "a date",
        f"can begin with the day or the month; set time_format = {either[0]} or {either[1]} in [file]",
    )


def _write_clock(cell: str) -> str:
    """The directives of the time of day in a cell, "" where it has none."""
    clock = re.search(r":[0-9]{2}(?P<seconds>:[0-9]{2})?", cell)
    if not clock:
        return ""
    half = re.search(r"[AaPp]\.?[Mm]\b", cell)
    return f" %{'I' if half else 'H'}:%M{':%S' if clock['seconds'] else ''}{' %p' if half else ''}"


def read_time_format(text: str) -> TimeFormat:
    """The `time_format` of an import map, in strptime's directives. Raises InputError."""
    pattern, rest, joined = "", iter(text), False
    for letter in rest:
        if letter == "%":
            directive = next(rest, "")
            if directive not in _DIRECTIVES:
                allowed = " ".join("%" + name for name in _DIRECTIVES)
                raise InputError(
                    f"import map: file.time_format is {text!r}; %{directive} is unknown, allowed are {allowed}"
                )
            # Numbers that follow each other without a mark have all their digits, but for the first one: 93015 is 09:30:15
            pattern += _DIRECTIVES[directive].replace("{1,2}", "{2}" if joined else "{1,2}")
            joined = directive != "%"
            if directive == "S" and "%f" not in text:
                pattern += r"(?:[.,](?P<f>[0-9]{1,9}))?"
        else:
            pattern += r"\s+" if letter.isspace() else re.escape(letter)
            joined = False
    try:
        names = re.compile(pattern).groupindex
    except re.error:  # a group twice
        names = {}
    year, month, day = "Y" in names or "y" in names, "m" in names or "b" in names, "d" in names
    dated = (year, month, day) == (True, True, True) or (year and "j" in names and not month and not day)
    parts_of_date = {*"YymbdjGVu"} & {*names}
    dated = dated or parts_of_date == {*"GVu"}
    if not ("S" in names or "M" in names or dated) or not (dated or not parts_of_date):
        raise InputError(
            f"import map: file.time_format is {text!r}; allowed is one of each of %Y %m %d, or none of them, and of %H %M %S"
        )
    return TimeFormat(pattern, f"as time_format says, {text!r}")


@dataclass
class Clock:
    """Reads a column of times, block by block: seconds from the first one.

    first [ns]: from 1970, or from midnight where the cells have no date; None before it is known. midnights: passed so far.
    """

    written: TimeFormat
    first: int | None = None
    midnights: int = 0
    _last: int | None = field(default=None, repr=False)
    zoned: bool = False

    def parse(self, column: pa.Array, missing: pa.Array) -> tuple[np.ndarray, int]:
        """Values (n,) in s of the cells, not-a-number where `missing`; and the first row that is no time, -1 for none."""
        text = pc.utf8_trim_whitespace(column)
        parts = pc.extract_regex(text, pattern=f"^(?:{self.written.pattern})$")
        fields = {name: parts.field(name) for name in (f.name for f in parts.type)}
        absent = missing.to_numpy(zero_copy_only=False)
        known = parts.is_valid().to_numpy(zero_copy_only=False)
        value, right = _convert_to_nanoseconds(fields, len(column))
        if "z" in fields:
            self.zoned = self.zoned or pc.any(pc.not_equal(fields["z"], "")).as_py() is True
        bad = np.flatnonzero(~absent & ~(known & right))
        good = known & right & ~absent
        counted = value[good]
        if not self.written.has_date and len(counted):
            counted = self._pass_midnight(counted)
        if self.first is None and len(counted):
            self.first = int(counted[0])
        seconds = np.full(len(column), np.nan)
        seconds[good] = (counted - (self.first or 0)) / _NS
        return seconds, int(bad[0]) if len(bad) else -1

    def _pass_midnight(self, value: np.ndarray) -> np.ndarray:
        """Times of day (n,) with a day added wherever midnight passed: a fall of more than half a day."""
        before = np.concatenate([[value[0] if self._last is None else self._last], value[:-1]])
        days = self.midnights + np.cumsum(value - before < -_DAY // 2)
        self.midnights, self._last = int(days[-1]), int(value[-1])
        return value + days * _DAY

    @property
    def start(self) -> str:
        """The first time as ISO 8601, "" where not known."""
        if self.first is None:
            return ""
        first = datetime(1970, 1, 1, tzinfo=UTC if self.zoned else None) + timedelta(microseconds=self.first // 1000)
        if self.written.has_date:
            return first.isoformat()
        in_a_day = "(?P<H>" in self.written.pattern and not self.written.is_duration
        return first.time().isoformat() if in_a_day else ""


def _convert_to_nanoseconds(fields: dict[str, pa.Array], rows: int) -> tuple[np.ndarray, np.ndarray]:
    """Time (n,) in ns, and whether its parts are in their ranges."""

    def read_number(name: str, otherwise: int = 0) -> np.ndarray:
        if name not in fields:
            return np.full(rows, otherwise, dtype=np.int64)
        text = pc.fill_null(fields[name], "")
        text = pc.if_else(pc.equal(text, ""), str(otherwise), text)
        return np.asarray(text.cast(pa.int64()).to_numpy(zero_copy_only=False))

    hour, minute, second = read_number("H"), read_number("M"), read_number("S")
    right = ((minute < 60) | ("H" not in fields) | ("s" in fields)) & (second < 61)
    second = second + read_number("s")  # of a duration, which may have any
    for name in fields.keys() & {"p", "q"}:
        half = pc.fill_null(pc.utf8_lower(fields[name]), "").to_numpy(zero_copy_only=False)
        named = half != ""
        right &= ~named | ((hour >= 1) & (hour <= 12))
        hour = np.where(named, hour % 12 + np.where(np.isin(half, _AFTERNOON), 12, 0), hour)
    fraction = np.zeros(rows, dtype=np.int64)
    if "f" in fields:
        fraction = pc.utf8_rpad(pc.fill_null(fields["f"], ""), 9, "0").cast(pa.int64()).to_numpy(zero_copy_only=False)
    value = ((hour * 60 + minute) * 60 + second) * _NS + fraction
    if "n" in fields:
        value = np.where(pc.fill_null(pc.equal(fields["n"], "-"), False).to_numpy(zero_copy_only=False), -value, value)
    value = read_number("D") * _DAY + value
    if fields.keys() & {"d", "j", "u"}:
        right &= hour < 25
        days, exists = _count_days(read_number, fields)
        value, right = value + days * _DAY, right & exists
    if "z" in fields:
        value = value - _parse_offset(fields["z"], rows)
    return value, right


def _count_days(number: Callable[..., np.ndarray], fields: dict[str, pa.Array]) -> tuple[np.ndarray, np.ndarray]:
    """Days since 1970 (n,) and whether there is such a day."""
    year = number("G" if "G" in fields else "Y", 1970)
    if "y" in fields:
        year = number("y")
        year = year + np.where(year < 69, 2000, 1900)  # as POSIX has it
    exists = (year >= _YEARS[0]) & (year <= _YEARS[1])
    year = np.where(exists, year, 1970)
    first = (year - 1970).astype("datetime64[Y]").astype("datetime64[D]")
    if "j" in fields:
        days = first.astype(np.int64) + number("j", 1) - 1
        return days, exists & _are_in(days, year)
    if "u" in fields:
        fourth = first.astype(np.int64) + 3  # 4 January is in week 1; 1 January 1970 was a Thursday
        days = fourth - (fourth + 3) % 7 + 7 * (number("V", 1) - 1) + number("u", 1) - 1
        return days, exists & _are_in(days - (days + 3) % 7 + 3, year)  # a week is of the year of its Thursday
    if "b" in fields:
        name = pc.utf8_lower(pc.fill_null(fields["b"], ""))
        name = pc.replace_substring(pc.replace_substring(name, "juin", "jun"), "juil", "jul")
        name = pc.utf8_slice_codeunits(name, 0, 3)
        numbers = pa.array(list(_MONTHS.values()), pa.int64())
        month = pc.fill_null(pc.take(numbers, pc.index_in(name, pa.array(list(_MONTHS)))), 0).to_numpy(
            zero_copy_only=False
        )
    else:
        month = number("m", 1)
    day = number("d", 1)
    exists &= (month >= 1) & (month <= 12) & (day >= 1)
    months = ((year - 1970) * 12 + np.where(exists, month, 1) - 1).astype("datetime64[M]")
    dates = months.astype("datetime64[D]") + (day - 1).astype("timedelta64[D]")
    exists &= dates.astype("datetime64[M]") == months
    return dates.astype(np.int64), exists


def _are_in(days: np.ndarray, year: np.ndarray) -> np.ndarray:
    """Whether days (n,) since 1970 are in their years (n,)."""
    return np.asarray(days.astype("datetime64[D]").astype("datetime64[Y]").astype(np.int64) + 1970 == year)


def _parse_offset(zone: pa.Array, rows: int) -> np.ndarray:
    """Zones (n,), such as +01:00 or CET, in ns."""
    names = pa.array(list(_ZONES))
    hours = pa.array([f"{hours:+03d}" for hours in _ZONES.values()])
    zone = pc.coalesce(pc.take(hours, pc.index_in(zone, names)), zone)
    parts = pc.extract_regex(pc.fill_null(zone, ""), r"^(?:UTC|GMT)?(?P<s>[+-])(?P<h>[0-9]{1,2}):?(?P<m>[0-9]{2})?$")
    if parts.null_count == rows:
        return np.zeros(rows, dtype=np.int64)
    sign = np.where(pc.fill_null(parts.field("s"), "+").to_numpy(zero_copy_only=False) == "-", -1, 1)
    hours, minutes = (
        pc.if_else(pc.equal(text, ""), "0", text).cast(pa.int64()).to_numpy(zero_copy_only=False)
        for text in (pc.fill_null(parts.field(name), "0") for name in ("h", "m"))
    )
    return sign * (hours * 60 + minutes) * 60 * _NS
