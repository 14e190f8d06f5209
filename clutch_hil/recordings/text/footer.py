"""Footer: where the rows of a text file end, and what stands below them: a cut row, statistics, a second table or remarks."""

import re
from collections.abc import Sequence
from itertools import pairwise

from clutch_hil.recordings.text.cells import Cells, show
from clutch_hil.recordings.text.column_kind import Column, follows, has_words, is_row
from clutch_hil.recordings.text.lines import COMMENT, RUNS, Line, TextFile, split

_MOST_LINES = 2000  # at the end that are looked at, as at the beginning
_FOOTER_LINES = 20  # after the rows: more are something else, such as a second table
STATISTIC = re.compile(
    r"(min|max)(imum|\.|imal\w*)?|mean|avg\.?|average|median|(std|stdev|sd|rms|sum|count|mittel|moyenne|anzahl|summe)\w*\.?",
    re.IGNORECASE,
)  # the name of a statistic


def read_tail(file: TextFile, delimiter: str, first: int) -> list[Line]:
    """The last lines with content that are no comments, not before line `first`."""
    texts = file.tail.text.decode("utf-8", "replace").removesuffix("\n").split("\n")
    lines = [Line(number, text) for number, text in enumerate(texts, file.tail.first) if number >= first]
    blank = " \t\0\x1a" + ("" if delimiter == RUNS else delimiter)
    return [line for line in lines if line.text.strip(blank) and not COMMENT.match(line.text)][-_MOST_LINES:]


def find_end(
    file: TextFile, columns: Sequence[Column], tail: Sequence[Line], delimiter: str, cells: Cells
) -> tuple[int, list[str]]:
    """Line of the last row, and what follows it, in a sentence."""
    left: list[Line] = []
    apart = _find_apart(tail, columns, delimiter, cells)
    for line in reversed(tail):
        if len(left) > _FOOTER_LINES:
            break
        row = split(line.text, delimiter)
        below = apart and line.number >= apart
        if not below and is_row(row, len(columns), columns, cells) and not _is_cut(file, line, tail, delimiter, cells):
            while left and (file.ended or left[-1].number < file.lines):
                after = split(left[-1].text, delimiter)
                if not (has_words(after, len(columns), columns, cells) and follows(after, row, columns, cells)):
                    break
                line, row = left.pop(), after
            notes = []
            if left:
                shown = f"lines {left[-1].number} to {left[0].number}" if len(left) > 1 else f"line {left[0].number}"
                what = _describe(file, left[::-1], len(columns), delimiter, cells)
                notes.append(f"left out {shown} at the end, {what}: {show(left[-1].text)}")
            if file.tail.text.rstrip(b"\n\x1a").endswith(b"\0"):
                notes.append("left out the zero bytes at the end, as a logger that lost power leaves them")
            elif not left and not file.ended and line.number == file.lines:
                notes.append(f"line {line.number} ends without a line end: its last number may be cut")
            return line.number, notes
        left.append(line)
    return file.lines, []


def _find_apart(tail: Sequence[Line], columns: Sequence[Column], delimiter: str, cells: Cells) -> int:
    """Line from which on numbers stand below the rows, as means in a spreadsheet; 0 if there are none.

    Empty lines are between them and the rows, and their first cell is empty or a word, where each row has a number or a time.
    """
    firsts = [not is_row(split(line.text, delimiter)[:1], 1, columns[:1], cells) for line in tail]
    start = next((n + 1 for n in range(len(firsts) - 1, -1, -1) if not firsts[n]), 0)
    if not 0 < start < len(tail) or any(firsts[:start]) or len(tail) - start > _FOOTER_LINES:
        return 0
    return tail[start].number if tail[start].number - tail[start - 1].number > 1 else 0


def _describe(file: TextFile, lines: Sequence[Line], width: int, delimiter: str, cells: Cells) -> str:
    """What the lines below the rows are."""
    rows = [split(line.text, delimiter) for line in lines]
    if all(len(row) == width and not row[0] for row in rows):
        return "cells below an empty line, such as means"
    if any(STATISTIC.fullmatch(cell.rstrip(":=")) for row in rows for cell in row[:1]):
        return "statistics"
    if not file.ended and len(lines) == 1 and len(rows[0]) <= width:
        return "a row that was cut"
    counts = [len(row) if len(row) > 1 and all(map(cells.is_number, row)) else 0 for row in rows]
    if any(one == other > 0 for one, other in pairwise(counts)):
        count = max(counts)
        return f"a second table, of {count} columns; split the file to read it" if count != width else "a second table"
    if len(lines) == 1 and counts[0]:
        return f"a row of {counts[0]} cells where the others have {width}"
    return "no whole rows"


def _is_cut(file: TextFile, line: Line, tail: Sequence[Line], delimiter: str, cells: Cells) -> bool:
    """Whether the last line has no end, and in its last cell fewer decimals than all lines before, or alone no value."""
    if file.ended or line is not tail[-1] or len(tail) < 3:
        return False
    last, before = split(line.text, delimiter)[-1], [split(one.text, delimiter)[-1] for one in tail[-_FOOTER_LINES:-1]]
    if not last and all(before):
        return True
    return _count_decimals(last, cells) < min(_count_decimals(cell, cells) for cell in before)


def _count_decimals(cell: str, cells: Cells) -> int:
    return len(cell.partition(cells.decimal)[2])
