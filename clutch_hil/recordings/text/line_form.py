"""LineForm: what stands around the cells of the lines of a text file, and is taken away before they are parted.

Quotes around each line; the brackets of tuples and lists that Python prints, `(0.01, 3.2)`; names before each number; times of
arrival, which become a column.
"""

import re
from dataclasses import dataclass

from clutch_hil.recordings.text.arrival import ARRIVAL, find_delimiter_of_stamps, part_stamps
from clutch_hil.recordings.text.characters import are_quoted, strip_marks_of_text, strip_quotes
from clutch_hil.recordings.text.labels import Labels, find_labels

_BRACKETED = re.compile(rb"(?m)^[ \t]*[\[(]([^\[\]()\n]+)[\])],?[ \t]*$")
_PARTED = re.compile(rb"[^\s,][ \t]*[, \t][ \t]*[^\s,]")  # several cells: a number below 0 may be in brackets
_JUDGED_LINES = 100  # that tell whether lines are in brackets, the last ones of the beginning
_SHARE = 0.9  # of them that are


@dataclass(frozen=True)
class LineForm:
    """quoted, bracketed: whether each line is. labels: names before its numbers. stamps: what parts the times of arrival."""

    quoted: bool = False
    bracketed: bool = False
    labels: Labels | None = None
    stamps: bytes = b""

    @property
    def names(self) -> list[str]:
        """Names of the columns by the labels; none without labels."""
        if not self.labels:
            return []
        return [*([ARRIVAL] if self.stamps else []), *self.labels.list_names()]

    def simplify(self, lines: bytes) -> bytes:
        """Return whole lines with nothing but their cells."""
        lines = strip_quotes(lines) if self.quoted else lines
        lines = _BRACKETED.sub(rb"\1", lines) if self.bracketed else lines
        lines = self.labels.remove(lines) if self.labels else lines
        lines = part_stamps(lines, self.stamps) if self.stamps else lines
        return strip_marks_of_text(lines)


def find_line_form(head: bytes) -> LineForm:
    """Return what is around the cells of the whole lines with which a file begins."""
    labels = find_labels(head)
    stamps = find_delimiter_of_stamps(labels.remove(head) if labels else head)
    return LineForm(are_quoted(head), _are_bracketed(head), labels, stamps)


def _are_bracketed(lines: bytes) -> bool:
    """Return whether nearly all whole lines at the end of `lines` are several cells in brackets."""
    given = [line for line in lines.split(b"\n") if line.strip()][-_JUDGED_LINES:]
    inside = [match[1] for match in map(_BRACKETED.match, given) if match]
    parted = sum(_PARTED.search(cells) is not None for cells in inside)
    return len(given) > 2 and parted >= _SHARE * len(given) - 1
