"""Kind of a bus log, by its first bytes. This module loads no reader, as every file of a user is asked for its kind."""

import re
from dataclasses import dataclass
from pathlib import Path

SQLITE_MARK = b"SQLite format 3\0"
MF4_MARKS = (b"MDF     ", b"UnFinMF ")
HEAD_LINES = 60  # non-empty lines that decide the format
_PAIRS = r"(?:[0-9A-Fa-f]{2})"
CANDUMP_LINE = re.compile(
    r"\((?P<time>\d+(?:\.\d*)?)\)\s+(?P<channel>\S+)\s+(?P<id>[0-9A-Fa-f]{3}|[0-9A-Fa-f]{8})#"
    rf"(?P<data>[Rr](?P<dlc>[0-8])?|#(?P<fd>[0-9A-Fa-f])(?P<long>{_PAIRS}{{0,64}})|(?P<bytes>{_PAIRS}{{0,8}}))(?:_[0-9A-Fa-f])?"
    r"(?:\s+[RTrt])?\s*"
)
SCREEN_LINE = re.compile(
    r"\s*(?:\((?P<time>[^()]*)\)\s+)?(?P<channel>[^\s(]\S*)\s+(?:(?:RX|TX)\s+\S\s+\S\s+)?(?P<id>[0-9A-F]{3}|[0-9A-F]{8})\s+"
    r"\[(?P<n>\d{1,2})\](?:\s+(?P<data>remote request|[0-9A-F]{2}(?:\s[0-9A-F]{2})*))?(?:\s+(?:ERRORFRAME|'.*'|::\s.*))?\s*"
)
ASC_FRAME = re.compile(r"\d+\.\d+\s+(?:\d+\s+(?:[0-9A-Fa-f]+x?\s+(?:Tx|Rx)\b|ErrorFrame)|CANFD\s+\d+)", re.IGNORECASE)
_ASC_HEAD = re.compile(
    r"date\s+\w{2,4}\.?\s+\w{3,}\.?\s+\d|base\s+(?:hex|dec)\b|begin\s+trigger\s*block\b", re.IGNORECASE
)
_ASC_BASE = re.compile(r"base\s+(hex|dec)(?:\s+timestamps\s+(absolute|relative))?", re.IGNORECASE)
_TRC_VERSION = re.compile(r";\$FILEVERSION\s*=\s*([^\s;]+)")


# Names of the columns of SavvyCAN (GVRET), and of python-can
SAVVYCAN = re.compile(r"Time Stamp,ID,Extended,(Dir,)?Bus,LEN,D1\b.*", re.IGNORECASE)
PYTHON_CAN = "timestamp,arbitration_id,extended,remote,error,dlc,data"


@dataclass(frozen=True)
class TextLog:
    """Format of a text log. kind: candump, asc, trc, table; name: for messages. base: of numbers in ASC.

    relative: times are relative. says_times: whether the head of an ASC file declares the reference of its times.
    """

    kind: str
    name: str
    encoding: str
    base: str = "hex"
    relative: bool = False
    version: str = ""
    says_times: bool = False


def recognise_text_log(head: bytes) -> TextLog | None:
    """Return the format of a text log that begins with `head`; None for other content."""
    encoding = _guess_encoding(head)
    text = head.decode(encoding, errors="replace")
    lines = [line.strip("\0 \t") for line in text.splitlines()]  # a logger that lost power leaves zero bytes
    if "\0" in "".join(lines[:1]):
        return None
    lines = [line for line in lines if line and not line.startswith(("#", "//"))][:HEAD_LINES]
    if not lines:
        return None
    if version := next((match for line in lines if (match := _TRC_VERSION.match(line))), None):
        return TextLog("trc", "PEAK TRC", encoding, version=version[1])
    if SAVVYCAN.fullmatch(lines[0]) or lines[0] == PYTHON_CAN:
        return TextLog("table", "SavvyCAN CSV" if lines[0] != PYTHON_CAN else "python-can CSV", encoding)
    if any(_ASC_HEAD.match(line) for line in lines) or ASC_FRAME.match(lines[0]):
        base = _ASC_BASE.search(text)
        relative = bool(base and (base[2] or "").lower() == "relative")
        says_times = bool(base and base[2])
        return TextLog(
            "asc", "Vector ASC", encoding, base[1].lower() if base else "hex", relative, says_times=says_times
        )
    if any(line.startswith(";") for line in lines[:1]) and any(re.match(r"\d+\)\s", line) for line in lines):
        return TextLog("trc", "PEAK TRC", encoding, version="1.0")
    if CANDUMP_LINE.fullmatch(lines[0]) or (len(lines) > 1 and CANDUMP_LINE.fullmatch(lines[1])):
        return TextLog("candump", "candump", encoding)
    if SCREEN_LINE.fullmatch(lines[0]):
        return TextLog("candump", "candump, screen format", encoding)
    return None


def _guess_encoding(head: bytes) -> str:
    if head.startswith((b"\xff\xfe", b"\xfe\xff")):
        return "utf-16"
    return "utf-8-sig"


def find_log_kind(path: Path, head: bytes) -> str:
    """Return the kind of the log that begins with `head`: blf, mf4, sqlite, or the kind of a text log; "" if it is none."""
    if head.startswith(b"LOGG"):
        return "blf"
    if head.startswith(MF4_MARKS):
        from protocols.files.mdf.frames import is_bus_log

        return "mf4" if is_bus_log(path) else ""
    if holds_sqlite_frames(head):
        return "sqlite"
    text_log = recognise_text_log(head)
    return text_log.kind if text_log else ""


def holds_sqlite_frames(head: bytes) -> bool:
    """Return whether a file that begins with `head` is a database of SQLite with the table of python-can."""
    return head.startswith(SQLITE_MARK) and b"arbitration_id" in head
