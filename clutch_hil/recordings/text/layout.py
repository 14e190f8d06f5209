"""Layout: how a text file is arranged, found in its first and last lines: delimiter, marks in numbers, names, units, rows.

The rows decide: of all delimiters and decimal marks, those that make most cells numbers are the file's. The first row is the
first line whose cells are of the same kinds as those of the lines that follow. Names and units stand above it.
"""

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

from clutch_hil.recordings.text.cells import GROUP_MARKS, Cells, show
from clutch_hil.recordings.text.clock import TimeFormat, find_time_format, read_time_format
from clutch_hil.recordings.text.headings import Headings, are_names, find_headings
from clutch_hil.recordings.text.lines import COMMENT, RUNS, Line, TextFile, split
from clutch_hil.recordings.text.marks import choose_marks, tells_decimal
from protocols.errors import InputError

_MOST_COLUMNS = 10_000  # more than any logger has channels
_HEAD_LINES = 2000  # that are looked at; a preamble is shorter
_FOOTER_LINES = 20  # after the rows: more are something else, such as a second table
_FOLLOW, _FOLLOWING = 10, 0.8  # lines after the first row, and the share of them that must be rows too
_TIME_SHARE = 0.9  # of the cells of a time column; the others are told when it is read


@dataclass(frozen=True)
class Column:
    """kind: as of a Channel. time: how a column of kind "time" is written."""

    kind: str
    time: TimeFormat | None = None


@dataclass(frozen=True)
class Layout:
    """delimiter: RUNS for blanks. columns: by content, in the order of the file. first, last: lines of these rows, from 1.

    headings: names, units and what stands above them. samples: cells of rows. notes: what was found, a sentence each.
    unsure: whether nothing in the samples tells the decimal mark from a mark between thousands.
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
    tail = _read_tail(file, delimiter, rows.first)
    last, notes = _find_end(file, rows, tail, delimiter, cells)
    ends = [values for line in tail if line.number <= last and len(values := split(line.text, delimiter)) == rows.width]
    samples = [*rows.samples, *ends]
    columns = _judge_all(samples, rows.width, cells, wanted)  # with the last rows: a date may be certain there only
    if wanted and not any(column.time is wanted for column in columns):
        raise InputError(
            f"recording {file.path}: time_format {options['time_format']!r} fits no column; the first row is"
            f" {show(rows.samples[0])}"
        )
    above = [line for line in lines if line.number < rows.first]
    spare = _count_empty(samples, rows.width)
    headings = find_headings(file.path, above, (rows.width - spare, rows.width), delimiter, cells, options)
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
        if not lines and (told := re.fullmatch(r'\s*"?sep=(.)"?\s*', text, re.IGNORECASE)):
            delimiter = told[1]
            continue
        for end in range(number, min(number + 5, len(texts))):  # a name in quotes may go on in the next line
            if text.count('"') % 2 == 0:
                break
            if "\n".join(texts[start - 1 : end + 1]).count('"') % 2 == 0:
                text, number = "\n".join(texts[start - 1 : end + 1]), end + 1
        if start > skip and text.strip(" \t\0\x1a"):
            comment = COMMENT.match(text)
            lines.append(Line(start, text[comment.end() :] if comment else text, bool(comment)))
    return lines, delimiter


def _list_after(options: Mapping[str, Any]) -> str:
    return f" after {options['skip_lines']} lines" if options.get("skip_lines") else ""


def _count_empty(rows: Sequence[Sequence[str]], width: int) -> int:
    """How many columns at the end are empty: every row ends with so many delimiters."""
    empty = 0
    while empty < width - 1 and not any(row[width - 1 - empty] for row in rows):
        empty += 1
    return empty


def _judge_all(rows: Sequence[Sequence[str]], width: int, cells: Cells, wanted: TimeFormat | None) -> list[Column]:
    """What the columns of `rows` are. wanted: how the first column that fits it writes times."""
    columns = []
    for number in range(width):
        present = [row[number] for row in rows if not cells.is_missing(row[number])]
        if wanted and present and sum(map(wanted.matches, present)) >= _TIME_SHARE * len(present):
            columns.append(Column("time", wanted))
            wanted = None
        else:
            columns.append(_judge(present, cells))
    return columns


def _judge(present: Sequence[str], cells: Cells) -> Column:
    """What a column with these cells, none of them missing, is."""
    numbers = sum(map(cells.is_number, present))
    if numbers < len(present) and all(cells.is_flag(value) or value in ("0", "1") for value in present):
        return Column("status")
    if 2 * numbers >= len(present):
        return Column("number")
    written = find_time_format(present) or _count_most_times(present)
    return Column("time", written) if written else Column("text")


def _count_most_times(present: Sequence[str]) -> TimeFormat | None:
    """How nearly all cells write times, where single ones are damaged."""
    for cell in present[:3]:
        written = find_time_format([cell])
        if written and not written.doubt and sum(map(written.matches, present)) >= _TIME_SHARE * len(present):
            return written
    return None


def _is_row(row: Sequence[str], width: int, columns: Sequence[Column], cells: Cells) -> bool:
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
    return cells.is_number(cell) or (column.kind == "status" and cells.is_flag(cell))


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
    if usual:
        enough = 0.5 * usual[len(usual) // 2]
        near = [n for n in range(header_first, len(rows)) if len(rows[n]) == width and counts[n] >= enough]
        table = [rows[n] for n in range(near[0] if near else 0, len(rows)) if len(rows[n]) == width]
        columns = _judge_all(table, width, cells, wanted)
        right = [_is_row(row, width, columns, cells) for row in rows]
        for n in near:
            after = right[n + 1 : n + 1 + _FOLLOW]
            if right[n] and sum(after) >= _FOLLOWING * len(after) - 1:  # -1: one damaged row of a short file
                if n == 0 and options.get("header"):
                    continue  # names that are numbers
                if (
                    len(rows) > n + 2
                    and not right[n + 1]
                    and len(rows[n + 1]) == width
                    and are_names(rows[n + 1], cells, width)
                ):
                    continue  # numbers of channels above their names
                while (
                    n > header_first
                    and _has_words(rows[n - 1], width, columns, cells)
                    and _follows(rows[n], rows[n - 1], columns, cells)
                ):
                    n -= 1
                return _Rows(lines[n].number, width, columns, [row for row in rows[n:] if len(row) == width])
    raise InputError(
        f"recording {path} has no rows of numbers{_list_after(options)}; line {lines[-1].number} is {show(lines[-1].text)}; set"
        " delimiter, decimal or skip_lines in [file]"
    )


def _has_words(row: Sequence[str], width: int, columns: Sequence[Column], cells: Cells) -> bool:
    """Whether a line is a row in which words stand for numbers, but for its first cell, mostly the time, and half of all."""
    if len(row) != width or columns[0].kind == "text" or cells.is_missing(row[0]):
        return False
    fits = [_fits(cell, column, cells) for cell, column in zip(row, columns, strict=True)]
    return fits[0] and 2 * sum(fits) >= width


def _follows(row: Sequence[str], before: Sequence[str], columns: Sequence[Column], cells: Cells) -> bool:
    """Whether the first number of a row is above that of the row `before`; of times of day this is not asked."""
    return columns[0].kind == "time" or cells.read_number(row[0]) > cells.read_number(before[0])


def _has_value(cell: str, cells: Cells, wanted: TimeFormat | None) -> bool:
    return (
        cells.is_number(cell)
        or bool(wanted and wanted.matches(cell))
        or (len(cell) > 4 and bool(find_time_format([cell])))
    )


def _read_tail(file: TextFile, delimiter: str, first: int) -> list[Line]:
    """The last lines with content that are no comments, not before line `first`."""
    texts = file.tail.text.decode("utf-8", "replace").removesuffix("\n").split("\n")
    lines = [Line(number, text) for number, text in enumerate(texts, file.tail.first) if number >= first]
    blank = " \t\0\x1a" + ("" if delimiter == RUNS else delimiter)
    return [line for line in lines if line.text.strip(blank) and not COMMENT.match(line.text)][-_HEAD_LINES:]


def _find_end(file: TextFile, rows: _Rows, tail: Sequence[Line], delimiter: str, cells: Cells) -> tuple[int, list[str]]:
    """Line of the last row, and what follows it, in a sentence."""
    left: list[Line] = []
    for line in reversed(tail):
        if len(left) > _FOOTER_LINES:
            break
        row = split(line.text, delimiter)
        if _is_row(row, rows.width, rows.columns, cells) and not _is_cut(file, line, tail, delimiter, cells):
            while left and (file.ended or left[-1].number < file.lines):
                after = split(left[-1].text, delimiter)
                if not (
                    _has_words(after, rows.width, rows.columns, cells) and _follows(after, row, rows.columns, cells)
                ):
                    break
                line, row = left.pop(), after
            notes = []
            if left:
                shown = f"lines {left[-1].number} to {left[0].number}" if len(left) > 1 else f"line {left[0].number}"
                notes.append(f"left out {shown} at the end, no whole rows: {show(left[-1].text)}")
            if file.tail.text.rstrip(b"\n\x1a").endswith(b"\0"):
                notes.append("left out the zero bytes at the end, as a logger that lost power leaves them")
            elif not left and not file.ended and line.number == file.lines:
                notes.append(f"line {line.number} ends without a line end: its last number may be cut")
            return line.number, notes
        left.append(line)
    return file.lines, []


def _is_cut(file: TextFile, line: Line, tail: Sequence[Line], delimiter: str, cells: Cells) -> bool:
    """Whether the last line has no end, and fewer decimals in its last cell than all lines before."""
    if file.ended or line is not tail[-1] or len(tail) < 3:
        return False
    before = [_choose_decimals(split(other.text, delimiter)[-1], cells) for other in tail[-_FOOTER_LINES:-1]]
    return _choose_decimals(split(line.text, delimiter)[-1], cells) < min(before)


def _choose_decimals(cell: str, cells: Cells) -> int:
    return len(cell.partition(cells.decimal)[2])


def _name(delimiter: str) -> str:
    return {RUNS: "blanks", "\t": "tabs"}.get(delimiter, repr(delimiter))


def _describe(file: TextFile, delimiter: str, cells: Cells, headings: Headings) -> list[str]:
    """What the file's layout is, in sentences."""
    text = f"text in {file.encoding}, {_name(delimiter)} between cells, {cells.decimal!r} as decimal mark"
    if cells.thousands:
        text += f", {cells.thousands!r} between thousands"
    return [text, *([file.decision] if file.decision else []), *headings.notes]
