"""Layout: how a text file is arranged, found in its first and last lines: delimiter, marks in numbers, names, units, rows.

The rows decide: of all delimiters and decimal marks, those that make most cells numbers are the file's. The first row is the
first line whose cells are of the same kinds as those of the lines that follow. Names and units stand above it.
"""

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from math import isclose
from pathlib import Path
from typing import Any

import numpy as np

from clutch_hil.recordings.text.cells import GROUP_MARKS, Cells, show
from clutch_hil.recordings.text.clock import TimeFormat, find_time_format, read_time_format
from clutch_hil.recordings.text.column_kind import (
    Column,
    find_date_before_time,
    follows,
    has_words,
    is_row,
    judge_columns,
)
from clutch_hil.recordings.text.footer import find_end, read_tail
from clutch_hil.recordings.text.heading_lines import are_names
from clutch_hil.recordings.text.headings import Headings, find_headings
from clutch_hil.recordings.text.lines import COMMENT, RUNS, Line, TextFile, split
from clutch_hil.recordings.text.marks import check_no_fractions, choose_marks, tells_decimal
from protocols.errors import InputError
from protocols.files.arrow import from_texts

# At least two, as in `t=0.01 torque=1.5`, `torque:1.5,speed:3`
_NAMED_NUMBERS = re.compile(r"(?:[^\d\W]\w*\s?[=:]\s?[+-]?[0-9][0-9.]*(?:[eE][+-]?[0-9]+)?(?:[\s,;]+|$)){2}")
_MOST_COLUMNS = 10_000  # more than any logger has channels
_NUMBERED_ROWS = re.compile(
    r"#\s*[,;\t]\s*[^\W\d]"
)  # names, of which the first is that of the number of the row: `#,CH1`
_STARTS_WITH_NUMBER = re.compile(r"\s*[0-9]+\s*[,;\t]")
_HEAD_LINES = 2000  # that are looked at; a preamble is shorter
_EVEN = 0.5  # by which steps of a time may differ: a clock that is read by a program
_COUNTED = 50  # rows of which it is looked at whether the first column counts them
_JUDGED = 50  # rows that tell which columns are times
_MOST_NAMED = 20  # columns in a message
_FEWEST_LYING = 20  # cells in a row of a table that lies on its side: a run has more rows
_FOLLOW, _FOLLOWING = 10, 0.8  # lines after the first row, and the share of them that must be rows too


@dataclass(frozen=True)
class Layout:
    """delimiter: RUNS for blanks. columns: by content, in the order of the file. first, last: lines of these rows, from 1.

    headings: names, units and what stands above them. samples: cells of rows. notes: what was found, a sentence each.
    unsure: whether nothing in the samples tells the decimal mark from a mark between thousands. asks_thousands,
    asks_hexadecimal: whether the map leaves open the mark between thousands, and which columns are hexadecimal.
    """

    delimiter: str
    cells: Cells
    columns: Sequence[Column]
    first: int
    last: int
    headings: Headings
    samples: Sequence[Sequence[str]]
    notes: list[str] = field(default_factory=list)
    unsure: bool = False
    asks_thousands: bool = True
    asks_hexadecimal: bool = True


def find_layout(file: TextFile, options: Mapping[str, Any]) -> Layout:
    """The layout of a file. options: entries of [file] that set a part of it. Raises InputError where there are no rows."""
    options = _check_options(options)
    lines, delimiter = _list_lines(file, options.get("skip_lines", 0))
    if "delimiter" in options:
        delimiter = options["delimiter"]
    content = [line for line in lines if not line.comment]
    if not content:
        raise InputError(f"recording {file.path} has no line of text{_list_after(options)}")
    delimiter, cells = choose_marks(file.path, content, delimiter, options)
    wanted = read_time_format(options["time_format"]) if options.get("time_format") else None
    rows = _find_rows(file.path, content, delimiter, cells, wanted, options)
    tail = read_tail(file, delimiter, rows.first)
    last, notes = find_end(file, rows.columns, tail, delimiter, cells)
    ends = [values for line in tail if line.number <= last and len(values := split(line.text, delimiter)) == rows.width]
    samples: Sequence[Sequence[str]] = [*rows.samples, *ends]
    columns = judge_columns(samples, rows.width, cells, wanted)  # with the last rows: a date may be certain there only
    if wanted and not any(column.time is wanted for column in columns):
        raise InputError(
            f"recording {file.path}: time_format {options['time_format']!r} fits no column; the first row is"
            f" {show(rows.samples[0])}"
        )
    samples = _strip_units(samples, columns, cells)
    above = [line for line in lines if line.number < rows.first]
    if names := file.form.names:  # other lines above are remarks
        above = [replace(line, comment=True) for line in above] + [Line(rows.first, delimiter.join(names))]
    spare = _count_empty(samples, rows.width)
    counted = _counts_rows(rows.samples, cells)
    date = find_date_before_time(columns, samples)
    headings = find_headings(
        file.path, above, (rows.width - spare, rows.width), delimiter, cells, options, counted, date
    )
    if not any(name != f"column {number}" for number, name in enumerate(headings.names, 1)):
        if delimiter == ",":
            check_no_fractions(file.path, samples, options)
        _check_upright(file.path, rows, columns, last)
    columns = _mark_hexadecimal(file.path, columns, headings, samples, cells, options)
    if columns[0].kind == "text":  # in which any word may be
        headings = replace(headings, firsts={})
    return Layout(
        delimiter,
        cells,
        columns,
        rows.first,
        last,
        headings,
        samples,
        [*_describe(file, delimiter, cells, headings), *notes],
        not ({"decimal", "thousands"} & options.keys() or cells.thousands or tells_decimal(samples, cells)),
        "thousands" not in options,
        "hexadecimal" not in options,
    )


def _check_upright(path: Path, rows: "_Rows", columns: Sequence[Column], last: int) -> None:
    """Raise InputError for a table without names on its side: few rows, each the name of a signal and then its numbers."""
    lies = rows.width >= _FEWEST_LYING and last - rows.first + 1 < rows.width and columns[0].kind == "text"
    if lies and all(column.kind in ("number", "time") for column in columns[1:]):
        raise InputError(
            f"recording {path} lies on its side: line {rows.first} has {show(rows.samples[0][0])} and then"
            f" {rows.width - 1} numbers; turn it, so that each signal is a column"
        )


@dataclass(frozen=True)
class _Rows:
    """Line of the first row, cells in a row, what the columns are, and the cells of the first rows."""

    first: int
    width: int
    columns: Sequence[Column]
    samples: Sequence[Sequence[str]]


def _check_options(options: Mapping[str, Any]) -> dict[str, Any]:
    """Entries of [file] for text files. Raises InputError for what makes no sense."""
    given = dict(options)
    if (mark := given.get("delimiter")) is not None:
        if mark in ("\\t", "tab"):
            given["delimiter"] = mark = "\t"
        if len(mark) != 1 or not mark.isascii() or mark.isalnum() or mark in '"\n\r+-.\0':
            raise InputError(
                f"import map: file.delimiter is {mark!r}; allowed is one character such as , ; or \\t, or a blank"
            )
    if (mark := given.get("decimal")) is not None and mark not in (".", ","):
        raise InputError(f"import map: file.decimal is {mark!r}; allowed are . and ,")
    if mark := given.get("thousands", ""):
        if mark not in GROUP_MARKS or mark == given.get("decimal", "." if mark == "," else ""):
            raise InputError(
                f"import map: file.thousands is {mark!r}; allowed are {' '.join(map(repr, GROUP_MARKS))}, no decimal mark"
            )
        given.setdefault("decimal", "," if mark == "." else ".")
    for key in ("skip_lines", "units_row"):
        if given.get(key, 0) < 0:
            raise InputError(f"import map: file.{key} is {given[key]}; allowed is 0 or more")
    return given


def _list_lines(file: TextFile, skip: int) -> tuple[list[Line], str]:
    """The first lines with content, after `skip` ones, and the delimiter that a `sep=` line tells, "" without one."""
    texts = file.head.decode("utf-8", "replace").removesuffix("\n").split("\n")
    if skip >= len(texts):
        raise InputError(
            f"recording {file.path}: skip_lines is {skip}; allowed is below {len(texts)}, of {file.lines} lines"
        )
    texts = texts[: skip + _HEAD_LINES]
    lines: list[Line] = []
    delimiter, number = "", 0
    while number < len(texts):
        text, start = texts[number], number + 1
        number += 1
        if not lines and (match := re.fullmatch(r'\s*"?sep=(.)"?\s*', text, re.IGNORECASE)):
            delimiter = match[1]
            continue
        for end in range(number, min(number + 5, len(texts))):  # a name in quotes may go on in the next line
            if text.count('"') % 2 == 0:
                break
            if "\n".join(texts[start - 1 : end + 1]).count('"') % 2 == 0:
                text, number = "\n".join(texts[start - 1 : end + 1]), end + 1
        if start > skip and text.strip(" \t\0\x1a"):
            named = _NUMBERED_ROWS.match(text) and number < len(texts) and _STARTS_WITH_NUMBER.match(texts[number])
            comment = None if named else COMMENT.match(text)
            lines.append(Line(start, text[comment.end() :] if comment else text, bool(comment)))
    return lines, delimiter


def _list_after(options: Mapping[str, Any]) -> str:
    return f" after {options['skip_lines']} lines" if options.get("skip_lines") else ""


def _strip_units(rows: Sequence[Sequence[str]], columns: Sequence[Column], cells: Cells) -> Sequence[Sequence[str]]:
    """The cells of rows, without units behind numbers."""
    marked = [number for number, column in enumerate(columns) if column.unit]
    if not marked:
        return rows
    return [[cells.split_unit(cell)[0] if n in marked else cell for n, cell in enumerate(row)] for row in rows]


def _counts_rows(rows: Sequence[Sequence[str]], cells: Cells) -> bool:
    """Whether the first column counts the first rows, from 0 or 1."""
    first = [row[0] for row in rows[:_COUNTED]]
    return len(first) > 2 and any(first == [str(start + n) for n in range(len(first))] for start in (0, 1))


def _mark_hexadecimal(
    path: Path,
    columns: Sequence[Column],
    headings: Headings,
    samples: Sequence[Sequence[str]],
    cells: Cells,
    options: Mapping[str, Any],
) -> list[Column]:
    """The columns, with those as hexadecimal numbers that `hexadecimal` of a map names. Raises InputError."""
    marked = list(columns)
    for wanted in filter(None, map(str.strip, options.get("hexadecimal", "").split(","))):
        matching = [n for n in range(len(marked)) if wanted in (headings.names[n], headings.texts[n])]
        if not matching:
            raise InputError(
                f"recording {path} has no column {wanted!r}, which file.hexadecimal names; allowed are"
                f" {', '.join(headings.texts[:_MOST_NAMED])}"
            )
        for n in matching:
            for row in samples:
                if not (cells.is_missing(row[n]) or cells.is_hexadecimal(row[n])):
                    raise InputError(
                        f"recording {path}: column {wanted!r} holds {show(row[n])}, which is not hexadecimal"
                    )
            marked[n] = Column("number", hexadecimal=True)
    return marked


def _count_empty(rows: Sequence[Sequence[str]], width: int) -> int:
    """How many columns at the end are empty: every row ends with so many delimiters."""
    empty = 0
    while empty < width - 1 and not any(row[width - 1 - empty] for row in rows):
        empty += 1
    return empty


def _find_rows(
    path: Path,
    lines: Sequence[Line],
    delimiter: str,
    cells: Cells,
    wanted: TimeFormat | None,
    options: Mapping[str, Any],
) -> _Rows:
    """The first row among `lines`. Raises InputError where there is none."""
    rows = [split(line.text, delimiter) for line in lines]
    counts = [sum(_has_value(cell, cells, wanted) for cell in row) for row in rows]
    by_width: dict[int, int] = {}
    for row, count in zip(rows, counts, strict=True):
        by_width[len(row)] = by_width.get(len(row), 0) + count
    width = max(by_width, key=lambda one: by_width[one])
    if width > _MOST_COLUMNS:
        raise InputError(f"recording {path} has {width} columns; allowed are {_MOST_COLUMNS}")
    usual = sorted(count for row, count in zip(rows, counts, strict=True) if len(row) == width and count)
    header_first = 1 if options.get("header") and "skip_lines" in options else 0  # then the names are the first line
    if _numbers_columns(rows[0], [row for row in rows[1:] if len(row) == width], cells):
        if "header" not in options and rows[0][0]:
            raise InputError(
                f"recording {path}: line {lines[0].number}, {show(lines[0].text)}, can be a row or the numbers of columns; set"
                " header = false or header = true in [file]"
            )
        header_first = max(header_first, int(options.get("header", True)))
    if usual:
        enough = 0.5 * usual[len(usual) // 2]
        near = [n for n in range(header_first, len(rows)) if len(rows[n]) == width and counts[n] >= enough]
        table = [rows[n] for n in range(near[0] if near else 0, len(rows)) if len(rows[n]) == width]
        columns = judge_columns(table, width, cells, wanted)
        right = [is_row(row, width, columns, cells) for row in rows]
        for n in near:
            after = right[n + 1 : n + 1 + _FOLLOW]
            if right[n] and sum(after) >= _FOLLOWING * len(after) - 1:  # -1: one damaged row of a short file
                if n == 0 and options.get("header"):
                    continue  # names that are numbers
                if _is_labelled(n, rows, columns, cells):
                    continue
                if (
                    len(rows) > n + 2
                    and not right[n + 1]
                    and len(rows[n + 1]) == width
                    and are_names(rows[n + 1], cells, width)
                ):
                    continue  # numbers of channels above their names
                while (
                    n > header_first
                    and has_words(rows[n - 1], width, columns, cells)
                    and follows(rows[n], rows[n - 1], columns, cells)
                ):
                    n -= 1
                clocks = _list_clocks(rows[n : n + _JUDGED], columns, cells)
                while n > header_first and right[n - 1] and _begins_sparsely(n - 1, clocks, rows, columns, cells):
                    n -= 1
                return _Rows(lines[n].number, width, columns, [row for row in rows[n:] if len(row) == width])
    if _NAMED_NUMBERS.match(lines[-1].text):
        raise InputError(
            f"recording {path} has a name before each number, as in line {lines[-1].number}, {show(lines[-1].text)}; write the"
            " names once, in a line above the rows, and the numbers alone"
        )
    raise InputError(
        f"recording {path} has no rows of numbers{_list_after(options)}; line {lines[-1].number} is {show(lines[-1].text)}; set"
        " delimiter, decimal, encoding or skip_lines in [file]"
    )


def _numbers_columns(row: Sequence[str], after: Sequence[Sequence[str]], cells: Cells) -> bool:
    """Whether a line is 0,1,2, as pandas writes for columns without names, above rows in which a column has fractions only."""
    numbered = row[1:] if row[0] == "" else row
    if len(after) < 2 or list(numbered) != [str(number) for number in range(len(numbered))]:
        return False
    return any(all(cells.decimal in other[number] for other in after) for number in range(len(row)))


def _list_clocks(rows: Sequence[Sequence[str]], columns: Sequence[Column], cells: Cells) -> list[int]:
    """Columns that have a time, or a number that rises, in every row."""
    whole = [row for row in rows if len(row) == len(columns)]
    clocks = []
    for number, column in enumerate(columns):
        texts = [row[number] for row in whole]
        if column.kind == "text" or any(map(cells.is_missing, texts)):
            continue
        values = np.zeros(0) if column.time else cells.parse(from_texts(texts)).values
        if column.time or (np.isfinite(values).all() and np.all(np.diff(values) > 0.0)):
            clocks.append(number)
    return clocks


def _begins_sparsely(
    number: int, clocks: Sequence[int], rows: Sequence[Sequence[str]], columns: Sequence[Column], cells: Cells
) -> bool:
    """Whether a line is a row before the next one, with few values, as loggers write them before all sensors answer."""
    row, after = rows[number], rows[number + 1]
    runs_on = any(
        not cells.is_missing(row[one])
        and (columns[one].time or cells.read_number(row[one]) < cells.read_number(after[one]))
        for one in clocks
    )
    return runs_on and not _is_labelled(number, rows, columns, cells)


def _is_labelled(number: int, rows: Sequence[Sequence[str]], columns: Sequence[Column], cells: Cells) -> bool:
    """Whether a line has a word before its numbers where the rows have nothing, as `SampleRate,100,100` above `,0.5,1.5`.

    The first row may have one, too: `trace_values,0.00,1.5` of ControlDesk, whose time goes on in the rows below.
    """
    width = len(columns)
    after = [row for row in rows[number + 1 :] if len(row) == width]
    empty = sum(cells.is_missing(row[0]) for row in after)
    if columns[0].kind != "text" or cells.is_missing(rows[number][0]) or len(after) < 2:
        return False
    goes_on = any(_is_clock(n, [rows[number], *after[:2]], columns[n], cells) for n in range(1, width))
    return empty >= _FOLLOWING * len(after) - 1 and not goes_on


def _is_clock(number: int, rows: Sequence[Sequence[str]], column: Column, cells: Cells) -> bool:
    """Whether the cells of a column in three rows are times, or numbers that rise evenly."""
    if column.time:
        return all(column.time.matches(row[number]) for row in rows)
    first, second, third = (cells.read_number(row[number]) for row in rows)
    return first < second and isclose(second - first, third - second, rel_tol=_EVEN)


def _has_value(cell: str, cells: Cells, wanted: TimeFormat | None) -> bool:
    return (
        cells.is_number(cell)
        or bool(cells.split_unit(cell)[1])
        or bool(wanted and wanted.matches(cell))
        or (len(cell) > 4 and bool(find_time_format([cell])))
    )


def _name(delimiter: str) -> str:
    return {RUNS: "blanks", "\t": "tabs"}.get(delimiter, repr(delimiter))


def _describe(file: TextFile, delimiter: str, cells: Cells, headings: Headings) -> list[str]:
    """What the file's layout is, in sentences."""
    text = f"text in {file.encoding}, {_name(delimiter)} between cells, {cells.decimal!r} as decimal mark"
    if cells.thousands:
        text += f", {cells.thousands!r} between thousands"
    labels = ["names before each number are those of the columns"] if file.form.labels else []
    return [text, *([file.decision] if file.decision else []), *labels, *headings.notes]
