"""Characters of numbers and times in a text file: those of other scripts and of typesetters, as ASCII writes them.

Digits of Arabic, Persian, Indian, Thai and full width; a full-width or Arabic decimal mark; dashes before a digit; thin blanks
between digits; marks of direction, which nobody sees. In names letters stand beside digits, and these are left as they are.
Marks with which spreadsheets say that a number is text: ="0.5", '0.5 and '0.5'. Quotes around whole lines, which are one cell.
"""

import re

_ZEROS = "٠۰०০๐０"  # each is followed by its 1 to 9
_DIGITS = "".join(chr(ord(zero) + digit) for zero in _ZEROS for digit in range(10))
_MARKS = "٫٬．，：－＋"
_PLAIN = str.maketrans(_DIGITS + _MARKS, "0123456789" * len(_ZEROS) + ".'.,:-+")
_DIRECTION = "\u200e\u200f\u202a-\u202e\u2066-\u2069"
_BLANKS, _DASHES = "\u2007-\u200a\u205f", "\u2010-\u2015\ufe63\uff0d"
_ANY = re.compile(f"[{_DIRECTION}{_BLANKS}{_DASHES}{_DIGITS}]")  # most files have none of them
_UNSEEN = re.compile(f"[{_DIRECTION}]")
_FOREIGN = re.compile(f"[{_DIGITS}]")
_RUN = rf"[0-9{_DIGITS}{_MARKS}.:/eE+\u2212-]"
_NUMBER = re.compile(rf"(?<![^\W\d_])(?<!{_RUN}){_RUN}++(?![^\W\d_])")  # whole runs, without letters beside them
_THIN = re.compile(f"(?<=[0-9])[{_BLANKS}](?=[0-9])")
_DASH = re.compile(f'(?:(?<=[\\n;,\\t|"])|^)[{_DASHES}](?=[0-9])')
_QUOTES = re.compile(rb'(?m)^"((?:""|[^"\n])*)"$')
_JUDGED_LINES = 100  # that tell whether lines are quoted
_BEGIN, _END = rb"(?m)(?:(?<=[;,\t| ])|^)", rb"(?=[;,\t| \r]|$)"  # of a cell
_FORMULA = re.compile(_BEGIN + rb'(?:"=""([^"\n]*)"""|="([^"\n]*)")' + _END)
_QUOTED = re.compile(_BEGIN + rb"'([^'\"\n;\t|]*)'" + _END)
# A comma is in a number where other delimiters are there, and parts cells elsewhere
_MARKED = re.compile(_BEGIN + rb"'([+-]?[0-9]+(?:\.[0-9]+)?(?:[eE][+-]?[0-9]+)?)" + _END)
_MARKED_COMMA = re.compile(rb"(?m)(?:(?<=[;\t| ])|^)'([+-]?[0-9]+(?:[.,][0-9]+)*(?:[eE][+-]?[0-9]+)?)(?=[;\t| \r]|$)")


def are_quoted(lines: bytes) -> bool:
    """Whether every one of whole lines is quoted, and has several cells in the quotes: spreadsheets save one column so.

    A single comma in the quotes may be a decimal mark.
    """
    given = [line for line in lines.split(b"\n") if line.strip()]
    return len(given) > 2 and all(map(_is_quoted, given[:_JUDGED_LINES]))


def _is_quoted(line: bytes) -> bool:
    inside = line[1:-1]
    if len(line) < 2 or line[:1] + line[-1:] != b'""' or b'"' in inside.replace(b'""', b""):
        return False
    return b";" in inside or b"\t" in inside or inside.count(b",") > 1


def strip_quotes(lines: bytes) -> bytes:
    """Whole lines without the quotes around each; quotes within are doubled there."""
    return _QUOTES.sub(lambda line: line[1].replace(b'""', b'"'), lines)


def strip_marks_of_text(lines: bytes) -> bytes:
    """Whole lines without the marks of spreadsheets around numbers, and with the usual quotes in place of single ones."""
    if b'="' in lines:
        lines = _FORMULA.sub(rb'"\1\2"', lines)
    if b"'" in lines:
        marked = _MARKED_COMMA if b";" in lines or b"\t" in lines else _MARKED
        lines = marked.sub(rb'"\1"', _QUOTED.sub(rb'"\1"', lines))
    return lines


def simplify_characters(text: str) -> str:
    """A text whose numbers and times are written in ASCII."""
    if text.isascii() or not _ANY.search(text):
        return text
    text = _UNSEEN.sub("", text)
    if _FOREIGN.search(text):
        text = _NUMBER.sub(lambda number: number[0].translate(_PLAIN), text)
    return _DASH.sub("-", _THIN.sub("\u00a0", text))
