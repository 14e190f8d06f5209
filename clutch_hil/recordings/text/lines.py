"""TextFile: a text file as lines in UTF-8 that end in a line feed, whatever its encoding and line ends, read in blocks.

The encoding is told by a mark at the beginning, or by where zero bytes stand (UTF-16). What is neither and not valid UTF-8 is
taken for cp1252, the code page of western Windows. Numbers are the same in all code pages: only names and units may suffer.
"""

import codecs
import csv
import re
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

from clutch_hil.recordings.text.characters import simplify_characters
from clutch_hil.recordings.text.line_form import LineForm, find_line_form
from protocols.errors import InputError

_BLOCK = 1 << 22  # bytes that are read at once: large against a call, small against the memory allowed
_MOST_LINE = 1 << 20  # bytes of a line: 50 000 cells of 20 characters
_HEAD, _HEAD_LINES = 1 << 18, 20  # bytes in which the layout is looked for, but so many lines at least
_TAIL = 1 << 16  # bytes in which the end of the rows is looked for
_JUDGED = 1 << 16  # bytes that tell UTF-8 from a code page where later ones are damaged
_CONTROL = bytes(set(range(32)) - set(b"\0\t\n\v\f\r\x1a")) + b"\x7f"  # what no text has
_CONTROL_SHARE = 0.01  # of the bytes: random ones have a tenth
_MARKS = (
    (codecs.BOM_UTF32_LE, "utf-32"), (codecs.BOM_UTF32_BE, "utf-32"), (codecs.BOM_UTF8, "utf-8-sig"),
    (codecs.BOM_UTF16_LE, "utf-16"), (codecs.BOM_UTF16_BE, "utf-16"),
)  # fmt: skip
_SHARES = (0.4, 0.05)  # of zero bytes at every second place, and between, in UTF-16 of western text

# Encodings of Japan, China, Korea, Russia, DOS and old Macs, whose bytes are valid in cp1252 as well
_OTHERS = ("cp932", "gbk", "euc_kr", "cp1251", "cp437", "mac_roman")
_WESTERN = "äöüÄÖÜßàâáãåÅçéèêëíîïñóôõúûù°µ²³·±×½"  # of names and units of western Europe
_STRANGE = re.compile(rb"[^,;\t\"\r\n\x80-\xff]{0,16}[\x80-\xff][^,;\t\"\r\n]{0,24}")  # a word that is not ASCII

RUNS = " "  # delimiter: any number of blanks and tabs
_BLANKS = " \t\f\v"  # a no-break space is none of them: it parts thousands
_RUN = re.compile(f"[{_BLANKS}]+")
COMMENT = re.compile(
    r"\s*(?:#(?!N/A|NV|NA\b|NUM!|DIV/|VALUE!|WERT!|REF!|NAME\?|NULL!|ZAHL!|BEZUG!)|%|//)", re.IGNORECASE
)


@dataclass(frozen=True)
class Line:
    """A line of the file, or several of which a quoted cell consists. comment: whether it was marked as one."""

    number: int
    text: str
    comment: bool = False


def split(text: str, delimiter: str) -> list[str]:
    """The cells of a line, without blanks around them."""
    if delimiter == RUNS:
        text = _RUN.sub(" ", text.strip(_BLANKS))
        if not text:
            return []
    if '"' in text:
        try:
            return [cell.strip() for cell in next(csv.reader([text], delimiter=delimiter, skipinitialspace=True), [])]
        except csv.Error:
            pass
    return [cell.strip() for cell in text.split(delimiter)]


@dataclass(frozen=True)
class Block:
    """Whole lines, each with its line feed. first: number of the first one in the file, from 1."""

    first: int
    text: bytes


class TextFile:
    """A text file. encoding: "" where it is to be found.

    lines: how many there are. head, tail: the first and last ones. ended: whether the last line has a line end.
    decision: a sentence where the encoding was guessed, "" otherwise. form: what is taken away around the cells of its lines.
    Raises InputError for a file that cannot be read.
    """

    def __init__(self, path: Path, encoding: str = "") -> None:
        self.path, self.decision, self.form = path, "", LineForm()
        try:
            with path.open("rb") as file:
                begin = file.read(_JUDGED)
        except OSError as error:
            raise InputError(f"recording {path} cannot be read: {error.strerror}") from None
        self.encoding = _check_encoding(encoding) if encoding else find_marked_encoding(begin)
        self._errors = "replace" if self.encoding and not encoding else "strict"
        self.encoding = self.encoding or "utf-8"
        try:
            self._scan()
        except UnicodeError:
            if encoding:
                raise InputError(f"recording {path} is not {encoding}, as `encoding` in [file] says") from None
            self._errors = "replace"
            if _is_damaged_utf8(begin):
                self.decision = "some bytes are not UTF-8 and were replaced"
            else:
                self.encoding = "cp1252"
                self.decision = (
                    "the file is not UTF-8 and was read as cp1252; set encoding in [file] if names look wrong"
                    f"{_list_other_readings(begin)}"
                )
            self._scan()

    def read_blocks(self) -> Iterator[Block]:
        """All lines, in blocks. Raises InputError for a line without end."""
        first, rest, known = 1, b"", False
        for text in self._read_texts():
            text = rest + text
            end = text.rfind(b"\n") + 1
            if len(text) - end > _MOST_LINE:
                number = first + text.count(b"\n")
                raise InputError(f"recording {self.path}: line {number} has more than {_MOST_LINE} bytes")
            if end:
                if not known:
                    known, self.form = True, find_line_form(text[: text.rfind(b"\n", 0, _HEAD) + 1])
                yield Block(first, self.form.simplify(text[:end]))
                first += text.count(b"\n", 0, end)
            rest = text[end:]
        if rest.strip(b"\x1a"):  # the mark with which DOS ends a file
            yield Block(first, self.form.simplify(rest + b"\n"))

    def _scan(self) -> None:
        """Count lines, keep the first and last ones, and try the encoding."""
        self.lines, self.head, self.tail = 0, b"", Block(1, b"")
        for block in self.read_blocks():
            self.lines = block.first + block.text.count(b"\n") - 1
            if block.first == 1:
                self.head = block.text[
                    : max(block.text.rfind(b"\n", 0, _HEAD) + 1, find_end_of_lines(block.text, _HEAD_LINES))
                ]
            both = self.tail.text + block.text
            cut = 0 if len(both) <= _TAIL else both.find(b"\n", len(both) - _TAIL) + 1
            self.tail = Block(self.tail.first + both.count(b"\n", 0, cut), both[cut:])

    def _read_texts(self) -> Iterator[bytes]:
        """The file in pieces of any length, in UTF-8, with line feeds. Raises InputError."""
        decoder = codecs.getincrementaldecoder(self.encoding)(self._errors)
        self.ended, waits = True, ""
        try:
            with self.path.open("rb") as file:
                while raw := file.read(_BLOCK):
                    piece = waits + decoder.decode(raw)
                    waits = "\r" if piece.endswith("\r") else ""  # half of a line end, perhaps
                    if text := _convert_line_ends(piece[: len(piece) - len(waits)]):
                        yield text.replace(codecs.BOM_UTF8, b"")  # also of a file that was appended
                        self.ended = text.endswith(b"\n")
                if text := _convert_line_ends(waits + decoder.decode(b"", True)):
                    yield text
                    self.ended = text.endswith(b"\n")
        except OSError as error:
            raise InputError(f"recording {self.path} cannot be read: {error.strerror}") from None


def find_end_of_lines(text: bytes, lines: int) -> int:
    """Where in `text` the line after `lines` ones begins; its end where it has no more."""
    place = 0
    for _ in range(lines):
        end = text.find(b"\n", place)
        if end < 0:
            return len(text)
        place = end + 1
    return place


def looks_like_text(head: bytes) -> bool:
    """Whether a file that begins with `head` may be text."""
    if find_marked_encoding(head):
        return True
    text = head.replace(b"\0", b"")  # a logger that lost power leaves them
    return bool(text) and len(text) - len(text.translate(None, _CONTROL)) <= _CONTROL_SHARE * len(text)


def find_marked_encoding(begin: bytes) -> str:
    """The encoding that the first bytes tell, "" where they do not."""
    for mark, name in _MARKS:
        if begin.startswith(mark):
            return name
    begin = begin[: len(begin) // 2 * 2]
    low, high = begin[::2], begin[1::2]
    if len(low) > 1:
        zeros = low.count(0) / len(low), high.count(0) / len(high)
        for share, other, name in ((zeros[1], zeros[0], "utf-16-le"), (zeros[0], zeros[1], "utf-16-be")):
            if share > _SHARES[0] and other < _SHARES[1]:
                return name
    return ""


def _check_encoding(name: str) -> str:
    """The encoding `name` of an import map, in lower case. Raises InputError."""
    try:
        fits = "0;1.5\n".encode(name).decode(name) == "0;1.5\n"
    except (LookupError, ValueError):  # unknown, with a null character, or of bytes only
        fits = False
    if not fits or name.lower() in ("idna", "punycode"):
        raise InputError(f"import map: file.encoding is {name!r}; allowed are names such as utf-8, cp1252, utf-16")
    return name.lower()


def _convert_line_ends(text: str) -> bytes:
    """Text in UTF-8 whose line ends are line feeds, and whose numbers are in ASCII."""
    data = simplify_characters(text).encode("utf-8", "replace")
    return data.replace(b"\r\n", b"\n").replace(b"\r", b"\n") if b"\r" in data else data


def _is_damaged_utf8(begin: bytes) -> bool:
    """Whether half or more of what is not ASCII in `begin` is UTF-8, and the first of it is: in a code page neither is."""
    text = begin.decode("utf-8", "replace")
    strange = [character for character in text if not character.isascii()]
    damaged = strange.count("\ufffd")
    return bool(strange) and strange[0] != "\ufffd" and len(strange) >= 2 * damaged


def _list_other_readings(begin: bytes) -> str:
    """What the first word that is not ASCII would be in other encodings, for a note; "" where it is western in cp1252."""
    word = _STRANGE.search(begin)
    shown = word[0].decode("cp1252", "replace").strip() if word else ""
    if not word or all(character.isascii() or character in _WESTERN for character in shown):
        return ""
    others = {}
    for name in _OTHERS:
        try:
            others[name] = word[0].decode(name).strip()
        except UnicodeDecodeError:
            continue
    readings = ", ".join(f"{text!r} in {name}" for name, text in others.items() if text.isprintable() and text != shown)
    return f": {shown!r} is {readings}" if readings else ""
