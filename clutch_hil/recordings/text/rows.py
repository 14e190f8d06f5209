"""Rows: the rows of a text file in blocks, as tables of text; what is no row is left out and counted."""

import re
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field
from pathlib import Path

import pyarrow as pa
import pyarrow.csv

from clutch_hil.recordings.text.cells import show
from clutch_hil.recordings.text.layout import Layout
from clutch_hil.recordings.text.lines import COMMENT, RUNS, Block, TextFile, find_end_of_lines, split
from protocols.errors import InputError, format_count

_DAMAGED_SHARE = 0.01  # of the rows: more are no damage but another layout than was found
_REMARK, _REMARK_SHARE = re.compile(r"[^\W\d_]{3}"), 0.1  # a word in a line without cells; the share of such lines
_LEAD = 200  # bytes that tell of a first line how it begins
_MOST_HEAD = 100  # lines above the rows in which the name of their channel is looked for
_LONGEST_NAME = 200  # characters of such a line
_CHANNEL = re.compile(
    r"\W*(?P<key>channel|kanal|source|trace|signal|curve)(\s?(name|no|number))?\s*[:=]\s*(?P<name>\S.*?)\s*",
    re.IGNORECASE,
)
_BLANKS = re.compile(rb"[ \t]+")
_ENDS = re.compile(rb"(?m)^\t|\t$")


@dataclass
class Rows:
    """What was left out: lines by reason; and of damaged rows and of remarks the first line and its text.

    width: cells of a row. parted_by_blanks: whether blanks part them.
    channels: the channel that a line above the rows names, `CHANNEL:CH1` of Hantek, by `channel`, `source` or similar.
    """

    channels: dict[str, str] = field(default_factory=dict)
    comments: int = 0
    empty: int = 0
    zeros: int = 0
    repeated: int = 0
    first_repeated: int = 0
    damaged: int = 0
    first: int = 0
    text: str = ""
    width: int = 0
    wrong: int = field(default=0)
    parted_by_blanks: bool = False
    remarks: int = 0
    first_remark: tuple[int, str] = (0, "")

    def add_damaged(self, line: int, text: str, wrong: int) -> None:
        """Count a line with `wrong` cells, 0 for a quote without its end. A line of words is a remark, as of a program."""
        words = wrong == 1 or (self.parted_by_blanks and text[:1].isalpha())
        if words and self.width > 1 and _REMARK.search(text):
            self.first_remark = self.first_remark if self.remarks else (line, " ".join(text.split()))
            self.remarks += 1
            return
        if not self.damaged or line < self.first:
            self.first, self.text, self.wrong = line, text, wrong
        self.damaged += 1

    def check_channel(self, path: Path, line: int, text: str) -> None:
        """Raise InputError for a comment between the rows that names another channel than the one above all rows."""
        named = _CHANNEL.fullmatch(text[:_LONGEST_NAME])
        above = self.channels.get(named["key"].lower(), "") if named else ""
        if named and above not in ("", named["name"]):
            raise InputError(
                f"recording {path} has rows of another channel below {show(text.strip())} in line {line}, above are those of"
                f" {above!r}; split the file there"
            )

    def list_notes(self, path: Path, rows: int) -> list[str]:
        """What was left out, a sentence each. Raises InputError where it is too much."""
        if self.remarks > max(1.0, _REMARK_SHARE * rows):
            line, text = self.first_remark
            raise InputError(
                f"recording {path}: {self.remarks} lines between {rows} rows are words, first line {line}: {show(text)}; remove"
                " them, or set delimiter, decimal or skip_lines in [file]"
            )
        cells = f"{self.wrong} cells where the others have {self.width}" if self.wrong else "a quote without its end"
        if self.damaged > max(1.0, _DAMAGED_SHARE * rows):
            raise InputError(
                f"recording {path}: {self.damaged} of {rows + self.damaged} rows do not fit, first line {self.first} with"
                f" {cells}: {show(self.text)}; correct them, or set delimiter, decimal or skip_lines in [file]"
            )
        notes = []
        if self.damaged:
            count = format_count(self.damaged, "damaged row")
            notes.append(f"left out {count}, the first in line {self.first} with {cells}: {show(self.text)}")
        if self.remarks:
            line, text = self.first_remark
            notes.append(
                f"left out {format_count(self.remarks, 'line')} of words, the first is line {line}: {show(text)}"
            )
        if self.zeros:
            notes.append(
                f"left out {format_count(self.zeros, 'line')} with zero bytes, as a logger that lost power leaves them"
            )
        if self.repeated:
            notes.append(
                f"left out {self.repeated} lines between the rows that repeat those above them, the first is line"
                f" {self.first_repeated}"
            )
        if self.comments:
            notes.append(f"left out {format_count(self.comments, 'comment')} between the rows")
        if self.empty:
            notes.append(f"left out {format_count(self.empty, 'empty line')} between the rows")
        return notes


def read_rows(
    file: TextFile, layout: Layout, wanted: Sequence[int], left_out: Rows
) -> Iterator[tuple[pa.Table, Callable[[int], int]]]:
    """Tables with the columns `wanted`, numbers from 1, as text; and a function from a row of the table to its line."""
    left_out.width, left_out.parted_by_blanks = len(layout.columns), layout.delimiter == RUNS
    head = file.head[: find_end_of_lines(file.head, min(layout.first - 1, _MOST_HEAD))].decode("utf-8", "replace")
    named = filter(None, (_CHANNEL.fullmatch(line[:_LONGEST_NAME]) for line in head.split("\n")))
    left_out.channels = {match["key"].lower(): match["name"] for match in named}
    for block in file.read_blocks():
        part = _cut(block, layout.first, layout.last)
        if part.text:
            yield _parse(file.path, part, layout, wanted, left_out)


def _cut(block: Block, first: int, last: int) -> Block:
    """The lines of a block from `first` to `last`."""
    text, number = block.text, block.first
    end = number + text.count(b"\n") - 1
    if end < first or number > last:
        return Block(number, b"")
    if number < first:
        text, number = text[find_end_of_lines(text, first - number) :], first
    if end > last:
        text = text[: find_end_of_lines(text, last - number + 1)]
    return Block(number, text)


def _parse(
    path: Path, block: Block, layout: Layout, wanted: Sequence[int], left_out: Rows
) -> tuple[pa.Table, Callable[[int], int]]:
    text, kept = _drop_others(path, block, layout, left_out)
    delimiter = layout.delimiter
    if delimiter == RUNS:
        text, delimiter = _ENDS.sub(b"", _BLANKS.sub(b"\t", text)), "\t"
    names = [str(number + 1) for number in range(len(layout.columns))]
    damaged: list[tuple[int, int, str]] = []

    def skip(row: pa.csv.InvalidRow) -> str:
        damaged.append((row.number - 1, row.actual_columns, row.text))
        return "skip"

    include = [str(number) for number in wanted]
    try:
        table = (
            pa.csv.read_csv(
                pa.BufferReader(text),
                pa.csv.ReadOptions(column_names=names, use_threads=False, block_size=len(text) + 1),
                pa.csv.ParseOptions(delimiter=delimiter, invalid_row_handler=skip),
                pa.csv.ConvertOptions(
                    include_columns=include,
                    column_types=dict.fromkeys(include, pa.string()),
                    strings_can_be_null=False,
                    check_utf8=False,
                ),
            )
            if text
            else pa.table({name: pa.array([], pa.string()) for name in include})
        )
    except pa.ArrowException as error:
        raise InputError(
            f"recording {path}: the rows from line {block.first} on cannot be read: {str(error).splitlines()[0]}"
        ) from None
    line = kept.__getitem__ if kept is not None else (lambda row: block.first + row)
    for number, cells, shown in damaged:
        left_out.add_damaged(line(number), shown, cells)
    bad = [number for number, _, _ in damaged]

    def find_line(row: int) -> int:
        for number in bad:  # in their order
            row += number <= row
        return line(row)

    return table, find_line


def _drop_others(path: Path, block: Block, layout: Layout, left_out: Rows) -> tuple[bytes, list[int] | None]:
    """The rows of a block, and their lines where these do not simply follow each other."""
    text, delimiter = block.text, layout.delimiter
    mark = b"" if delimiter == RUNS else delimiter.encode()
    if b'"' in text:
        if mark:
            text = re.sub(re.escape(mark) + rb' +"', mark + b'"', text)
        parts = re.escape(mark) or rb" \t"
        text = re.sub(
            rb"(?m)(?:(?<=[" + parts + rb'])|^)"([^"\n' + parts + rb']*)"(?=[' + parts + rb"\r]|$)", rb"\1", text
        )
    lead = b"\n" + text[:_LEAD]
    starts: tuple[bytes, ...] = (b"\n" + mark if mark else b"\n\n", b"\n\n", b"\n ", b"\n\t", b"\n#", b"\n%", b"\n//")
    starts += tuple(b"\n" + cell.encode() for cell in layout.headings.firsts)
    if not (
        any(start[1:] in text and (start in text or start in lead) for start in starts) or b"\0" in text or b'"' in text
    ):
        return text, None
    rows, numbers = [], []
    firsts = tuple(cell.encode() for cell in layout.headings.firsts)
    blanks = b" \t\x1a" + mark
    for number, line in enumerate(text.split(b"\n")[:-1], block.first):
        if b"\0" in line:
            left_out.zeros += 1
        elif not line.strip(blanks):
            left_out.empty += 1
        elif line.lstrip()[:1] in (b"#", b"%", b"/") and COMMENT.match(line.decode("utf-8", "replace")):
            left_out.comments += 1
            left_out.check_channel(path, number, line.decode("utf-8", "replace"))
        elif line.startswith(firsts) and layout.headings.is_repeated_by(
            split(line.decode("utf-8", "replace"), delimiter)
        ):
            left_out.first_repeated = left_out.first_repeated or number
            left_out.repeated += 1
        elif line.count(b'"') % 2:
            left_out.add_damaged(number, line.decode("utf-8", "replace"), 0)
        else:
            rows.append(line)
            numbers.append(number)
    return b"".join(line + b"\n" for line in rows), numbers
