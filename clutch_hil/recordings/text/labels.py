"""Labels: names that a program writes before each number, as the serial plotter of Arduino takes them: `t:0.01,torque:3.2`.

They become the names of the columns, and the numbers stand alone. Nearly all lines must have the same labels, in one order. A
line that has others is left as it is, so that its words are told or refused.
"""

import re
from dataclasses import dataclass
from functools import cached_property

from clutch_hil.recordings.text.arrival import STAMP
from clutch_hil.recordings.unit_in_name import is_unit

_JUDGED_LINES = 100  # the last ones of the beginning: lines above the rows may be anything
_LONGEST_LINE = 10_000  # characters of one that is judged
_SHARE = 0.9  # of these lines that have the labels: a program may also write a remark, and the last line may be cut
_FEWEST = 2  # labels in a line, and lines with them: a single one may be a remark
_DELIMITERS = ("\t", ";", ",")
_LETTERS = r"[^,;\t:=\"'{}\n]"
_NAME = rf"[^\W\d_](?:{_LETTERS}*(?!\s){_LETTERS})?"
_WORD = r"(?<!\S)[^\W\d_][^\s,;:=\"'{}]*"  # a name without blanks
_NUMBER = r"[+-]?(?:[0-9][0-9.,]*(?<!,)|\.[0-9]+|nan|inf|ovf)(?:[eE][+-]?[0-9]+)?"
_CLOCK = r"(?:[0-9]{4}-[0-9]{2}-[0-9]{2}[T ])?[0-9]{1,2}:[0-9]{2}:[0-9]{2}(?:[.,][0-9]+)?(?:Z|[+-][0-9]{2}:?[0-9]{2})?"
_UNIT = r"[^\W\d_%°][\w%/·*.^-]{0,11}|[%°][A-Za-z]{0,2}"  # behind a number
_CELL = re.compile(rf"\s*(?P<name>{_NAME})\s*[:=]\s*(?:{_CLOCK}|{_NUMBER}(?:\s*(?:{_UNIT}))?)?\s*", re.IGNORECASE)
# Of a line whose cells blanks part: `t: 0.01 torque: 3.2 Nm`
_PAIR = re.compile(
    rf"(?P<name>{_WORD})\s*[:=]\s*(?:{_CLOCK.replace('T ', 'T')}|{_NUMBER})"
    rf"(?:\s+(?P<unit>{_UNIT})(?=\s|$)(?!\s*[:=]))?(?:\s+|$)",
    re.IGNORECASE,
)
_STAMPED = re.compile(rb"(?m)^" + STAMP)
_GAP, _LEAD = r"[ \t]+", r"([^\s]+)[ \t]+"


@dataclass(frozen=True)
class Labels:
    """names: labels in the order of the line. before: cells without one that stand before them. delimiter: of the lines."""

    names: tuple[str, ...]
    before: int
    delimiter: str

    def list_names(self) -> list[str]:
        """Return the names of all columns."""
        return [*(f"column {number}" for number in range(1, self.before + 1)), *self.names]

    def remove(self, lines: bytes) -> bytes:
        """Return whole lines without these labels; tabs part what blanks parted."""
        return self._pattern.sub(self._numbers, lines)

    @property
    def mark(self) -> str:
        """What parts the cells of lines without labels."""
        return "\t" if self.delimiter == " " else self.delimiter

    @cached_property
    def _pattern(self) -> re.Pattern[bytes]:
        stamp = STAMP.decode()
        if self.delimiter == " ":
            cells = [rf"{re.escape(name)}[ \t]*[:=][ \t]*([^\n:=]*?(?:[0-9]:[^\n:=]*?)*)" for name in self.names]
            text = rf"(?m)^((?:{stamp})?)[ \t]*{self.before * _LEAD}{_GAP.join(cells)}[ \t]*$"
            return re.compile(text.encode())
        mark = re.escape(self.delimiter)
        lead = rf"([^{mark}\n]*){mark}" * self.before
        cells = [rf"[ \t]*{re.escape(name)}[ \t]*[:=][ \t]*([^{mark}\n]*)" for name in self.names]
        text = rf"(?m)^((?:{stamp})?){lead}{mark.join(cells)}{mark}?[ \t]*$"
        return re.compile(text.encode())

    @cached_property
    def _numbers(self) -> bytes:
        groups = (b"\\g<%d>" % number for number in range(2, 2 + self.before + len(self.names)))
        return b"\\g<1>" + self.mark.encode().join(groups)


def find_labels(lines: bytes) -> Labels | None:
    """Return the labels that nearly all of the whole lines at the end of `lines` have, None if there are none."""
    texts = _STAMPED.sub(b"", lines).decode("utf-8", "replace").split("\n")
    given = [text for text in texts if text.strip()][-_JUDGED_LINES:]
    for delimiter in (*_DELIMITERS, " "):
        found = [_list_labels(text, delimiter) for text in given if len(text) <= _LONGEST_LINE]
        usual = max(found, key=found.count, default=None)
        if usual and found.count(usual) >= max(_SHARE * len(given) - 1, _FEWEST):
            return usual
    return None


def _list_labels(text: str, delimiter: str) -> Labels | None:
    """Return the labels of a line; None for one with fewer than two, or with a cell without one behind one that has it."""
    if delimiter == " ":
        first = next((match.start() for match in _PAIR.finditer(text)), len(text))
        before, names, place = len(text[:first].split()), [], first
        while match := _PAIR.match(text, place):
            if match["unit"] and not is_unit(match["unit"]):
                return None
            names.append(match["name"])
            place = match.end()
        whole = place == len(text)
    else:
        cells = text.split(delimiter)
        if not cells[-1].strip():
            del cells[-1]
        labelled = [_CELL.fullmatch(cell) for cell in cells]
        before = next((number for number, cell in enumerate(labelled) if cell), len(cells))
        names = [cell["name"] for cell in labelled if cell]
        whole = before + len(names) == len(cells)
    if not whole or len(names) < _FEWEST or len(set(names)) < len(names):
        return None
    return Labels(tuple(names), before, delimiter)
