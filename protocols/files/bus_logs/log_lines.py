"""Lines of a text bus log, converted for the readers of python-can, which lose or misread other notations.

candump         screen format and `-L`, with or without direction; data that end within a byte are not a frame
ASC             times relative to the line before are added up; transmit requests (TxRq) are not frames
tables          rows of SavvyCAN, with times in us, and of python-can, with data in base64, are written as candump -L
TRC             version 1.2, which python-can does not read, is written as 1.3; other unknown versions are refused
"""

import io
import re
from base64 import b64decode
from collections.abc import Iterator, Sequence
from datetime import UTC, datetime
from pathlib import Path
from typing import TextIO

import can
import numpy as np

from protocols.errors import InputError
from protocols.files.bus_logs.line_frames import UsualLines
from protocols.files.bus_logs.log_kind import (
    ASC_FRAME,
    CANDUMP_LINE,
    HEAD_LINES,
    PYTHON_CAN,
    SAVVYCAN,
    SCREEN_LINE,
    TextLog,
)

_LONGEST_LINE = 4096  # characters: ten times a CAN FD frame with all its remarks
_BACKWARD_SHARE = 0.1  # of steps: if more are negative, the values are time differences
_MOST_CHANNELS = 64  # whose times are checked
_CLASSIC_BYTES, _MOST_BYTES = 8, 64  # most data of a classic frame, and of CAN FD
_FEW_FRAMES = 20  # too few frames to judge by the share of steps

_ASC_REQUEST = re.compile(r"\d+\.\d+\s+(?:CANFD\s+)?\d+\s+(?:\S+\s+)?TxRq\b", re.IGNORECASE)
_ASC_SYMBOLIC = re.compile(r"\d+\.\d+\s+\d+\s+(?P<name>[A-Za-z_]\w*)\s+(?:Rx|Tx)\s+[dr]\b", re.IGNORECASE)
_ASC_J1939 = re.compile(r"\d+\.\d+\s+\d+\s+(?:J1939TP\s+)?[0-9A-Fa-f]+p\s", re.IGNORECASE)
_ASC_BEGIN = re.compile(r"date\s|begin\s+trigger\s*block\b", re.IGNORECASE)
_ASC_TIME = re.compile(r"(\d+\.\d+)(\s+.*)", re.DOTALL)
_ASC_BORING = re.compile(r"//|end\s+trigger\s*block|(no\s+)?internal\s+events|date\s|base\s", re.IGNORECASE)
_TRC_VERSIONS = ("1.0", "1.1", "1.2", "1.3", "2.0", "2.1")
_TRC_BEFORE_LENGTH = 5  # cells of a frame in version 1.2; 1.3 adds a dash after them and is otherwise the same
_TRC_FRAME = re.compile(r"\s*\d+\)?\s+\d+(?:\.\d+)?\s+\S")
_TRC_UNNUMBERED = re.compile(r"\s*\d+(?:\.\d+)?\s+[A-Z]{2}\s+\S")  # of version 2, where $COLUMNS has no N
_TRC_EVENTS = {"Warng", "Error", "Statu", "ST", "EC", "ER", "EV"}
_ERROR_FLAG, _ERROR_MARK = 0x20000000, "20000080"  # error frames; python-can recognises them by these two bits


class LogLines(io.TextIOBase):
    """Lines of a log, as a file for python-can. Lines that its reader does not accept as frames are counted as damaged.

    numbers: line numbers in the log, if `file` has only some of its lines; before_last: in this case the line before an
    incomplete last line. number: of the last line read. ended: no line is left. notes: decisions, one sentence each. heads:
    numbers of the lines at which an ASC recording begins.
    """

    def __init__(
        self,
        path: Path,
        file: TextIO,
        text_log: TextLog,
        numbers: Sequence[int] | None = None,
        before_last: bytes = b"",
    ) -> None:
        self.path, self.found = path, text_log
        self._numbers, self._read, self._before_last = numbers, 0, len(before_last.split())
        self.number = self.damaged = self.first_damaged = 0
        self.ended = self.ends_within_line = False
        self.notes: list[str] = []
        self.heads: list[int] = []
        self._file, self._expected, self._whole, self._last_answered = file, False, True, True
        self._time, self._requests, self._groups, self._tokens = 0.0, 0, 0, 0
        self._header: list[str] = []
        self._trc_frame = _TRC_FRAME
        self._again: list[str] = []  # lines that a reader must read before it continues
        self._with_direction, self._commas = False, 0  # of a table
        self._backward = self._frames = 0
        self._last_stamps: dict[str, float] = {}
        if text_log.kind == "trc" and text_log.version not in _TRC_VERSIONS:
            raise InputError(
                f"log {path} is PEAK TRC of version {text_log.version}; known are {', '.join(_TRC_VERSIONS)}"
            )
        self.restart(first=True)

    def restart(self, first: bool = False) -> None:
        """Continue after the line at which a reader stopped."""
        if not first:
            self._settle()
        if self.found.kind == "asc":
            self._again = [f"base {self.found.base}  timestamps absolute\n", "internal events logged\n"]
        elif self.found.kind == "trc":
            self._again = list(self._header)

    def answer(self, good: bool) -> None:
        """Note that the reader made a frame of the last line, and whether it is `good`."""
        self._expected = not good
        self._last_answered = good
        self._settle()

    def readline(self, size: int | None = -1) -> str:  # type: ignore[override]
        """Return the next line for the reader; "" at the end."""
        if self._again:
            return self._again.pop(0)
        while not self.ended:
            self._settle()
            line = self._read_line()
            if not line:
                self.ended = True
                if not self._whole and not self._last_answered:
                    self.ends_within_line = True
                    self.damaged -= 1
                return ""
            prepared = self._prepare(line)
            if prepared is None:
                self._expected, self._last_answered = True, False
            elif prepared:
                return prepared
        return ""

    def _read_line(self) -> str:
        """Return the next line of the file; "" at the end. Only the beginning of a line that is too long is kept."""
        line = self._file.readline(_LONGEST_LINE)
        if not line:
            return ""
        self._read += 1
        self.number = self._read if self._numbers is None else self._numbers[self._read - 1]
        self._whole = line.endswith("\n")
        if not self._whole and len(line) == _LONGEST_LINE:
            while (more := self._file.readline(_LONGEST_LINE)) and not more.endswith("\n"):
                pass
            self._whole = True
            return "damaged: too long\n"
        return line

    def _settle(self) -> None:
        if self._expected:
            self.damaged += 1
            self.first_damaged = self.first_damaged or self.number
            self._expected = False

    def _prepare(self, line: str) -> str | None:
        """Return the line for the reader, "" for a line without a frame; None if it is damaged."""
        text = line.strip()
        if not text or (text[0] == "#" and self.found.kind == "candump") or text.startswith("//"):
            self._last_answered = True
            return ""
        prepare = {
            "candump": self._prepare_candump, "asc": self._prepare_asc, "trc": self._prepare_trc, "table": self._prepare_row,
        }[self.found.kind]  # fmt: skip
        prepared = prepare(text)
        self._last_answered = prepared == ""
        return prepared

    def _prepare_candump(self, text: str) -> str | None:
        if match := CANDUMP_LINE.fullmatch(text):
            tokens = len(text.split())
            if not self._whole and tokens < max(self._tokens, self._before_last):
                return None  # its end is missing, although the rest could be a frame
            self._tokens = tokens
            can_id = _format_error_id(match["id"])
            data = match["data"]
            if match["fd"]:
                data = f"#{int(match['fd'], 16) & 3}{match['long']}"
            elif match["bytes"] is not None:
                data = match["bytes"]
            self._expected = True
            return f"({match['time']}) {match['channel']} {can_id}#{data}\n"
        if match := SCREEN_LINE.fullmatch(text):
            return self._prepare_screen(match)
        return None

    def _prepare_row(self, text: str) -> str | None:
        """Return a row of a table as candump writes it, "" for the names of the columns, None for another line."""
        names = text.lower()
        if SAVVYCAN.fullmatch(text) or names == PYTHON_CAN:
            self._with_direction = ",dir," in names
            return ""
        if not self._whole and text.count(",") < self._commas:
            return None  # its end is missing, although the rest could be a frame
        self._commas = text.count(",")
        written = (
            _write_python_can(text)
            if self.found.name == "python-can CSV"
            else _write_savvycan(text, self._with_direction)
        )
        self._expected = written is not None
        return written

    def _prepare_screen(self, match: re.Match[str]) -> str | None:
        if match["time"] is None:
            raise InputError(
                f"log {self.path}: line {self.number} has no time; record with candump -L, or show times with candump -t a"
            )
        time = _parse_screen_time(match["time"])
        if time is None:
            return None
        data, count, fd = match["data"] or "", int(match["n"]), len(match["n"]) == 2
        if data == "remote request":
            written = f"R{count}"
        else:
            parts = data.split()
            if len(parts) != count:
                return None
            written = ("#0" if fd else "") + "".join(parts)
        self._expected = True
        self._note_stamp(time, match["channel"])
        return f"({time!r}) {match['channel']} {_format_error_id(match['id'])}#{written}\n"

    def _note_stamp(self, stamp: float, channel: str) -> None:
        self._frames += 1
        self._backward += stamp < self._last_stamps.get(channel, stamp)
        if channel in self._last_stamps or len(self._last_stamps) < _MOST_CHANNELS:
            self._last_stamps[channel] = stamp

    def check_steps(self, usual: UsualLines | None = None) -> None:
        """Raise InputError where times of a bus go backwards so often that they are times between frames.

        usual: further lines, which this object has not read.
        """
        frames, backward = self._frames, self._backward
        if usual and self.found.kind == "asc" and not self.found.says_times:
            for channel in range(len(usual.channels)):
                stamps = usual.frames["stamp"][usual.frames["channel"] == channel]
                frames, backward = frames + len(stamps), backward + int(np.count_nonzero(np.diff(stamps) < 0))
        if frames > _FEW_FRAMES and backward > _BACKWARD_SHARE * frames:
            remedy = (
                "; write `timestamps relative` after the base in its header"
                if self.found.kind == "asc"
                else " (candump -t d); record with candump -L"
            )
            raise InputError(f"log {self.path} has times between frames, not times{remedy}")
        if self._groups:
            self.notes.append(
                f"left out {self._groups} parameter groups of J1939, not frames: record the frames themselves"
            )
        if self._requests:
            self.notes.append(f"left out {self._requests} requests to send (TxRq): they are not frames on the bus")
        if self.found.relative:
            self.notes.append("added up times: each counts from the line before (timestamps relative)")

    def _prepare_asc(self, text: str) -> str | None:
        if self.found.relative and (timed := _ASC_TIME.match(text)):
            self._time += float(timed[1])
            text = f"{self._time:.9f}{timed[2]}"
        if _ASC_REQUEST.match(text):
            self._requests += 1
            return ""
        if ASC_FRAME.match(text):
            self._expected = True
            if not self.found.says_times:
                self._note_stamp(float(text.split(maxsplit=1)[0]), text.split(maxsplit=2)[1])
            return text + "\n"
        if _ASC_J1939.match(text):
            self._groups += 1
            return ""
        if symbolic := _ASC_SYMBOLIC.match(text):
            raise InputError(
                f"log {self.path}: line {self.number} has the name {symbolic['name']!r} where an identifier is needed; write"
                " the log with identifiers as numbers, not symbolic"
            )
        if _ASC_BEGIN.match(text):
            self.heads.append(self.number)
            if self._time > 0.0 and text[:4].lower() == "date":  # of a log with relative times
                raise InputError(
                    f"log {self.path} has a second recording from line {self.number} on, and its times count from the line"
                    " before, so when it began is not known; split the file there"
                )
        if not self._whole and not _ASC_BORING.match(text):
            return None
        return ""  # a head, an event, statistics: python-can's reader also skips them

    def _prepare_trc(self, text: str) -> str | None:
        if text.startswith(";"):
            if text.startswith(";$") and len(self._header) < HEAD_LINES:
                entry = text.replace(" ", "").rstrip(";")  # PEAK writes `;$STARTTIME=39878.6772258947;`
                if entry.startswith(";$COLUMNS=") and "N" not in entry.partition("=")[2].split(","):
                    self._trc_frame = _TRC_UNNUMBERED
                self._header.append(entry.replace("$FILEVERSION=1.2", "$FILEVERSION=1.3") + "\n")
                return self._header[-1]
            return ""
        if _TRC_EVENTS & set(text.split()[1:4]):
            return ""
        if not self._trc_frame.match(text):
            return None
        self._expected = True
        if self.found.version == "1.2":
            cells = text.split()
            text = " ".join([*cells[:_TRC_BEFORE_LENGTH], "-", *cells[_TRC_BEFORE_LENGTH:]])
        return text + "\n"


def read_candump(lines: LogLines) -> Iterator[can.Message]:
    """Yield the messages of a candump log."""
    return iter(can.CanutilsLogReader(lines))  # type: ignore[arg-type]


def _format_error_id(text: str) -> str:
    return _ERROR_MARK if len(text) == 8 and int(text, 16) & _ERROR_FLAG else text


def _write_savvycan(text: str, with_direction: bool) -> str | None:
    """Return a row of SavvyCAN in the notation of candump -L, None where it is none."""
    cells = [cell.strip() for cell in text.split(",")]
    del cells[3 : 3 + with_direction]
    try:
        time, can_id, extended, bus, length = cells[:5]
        count = int(length)
        bytes_of_row = [int(cell, 16) for cell in cells[5:] if cell]  # SavvyCAN fills up to eight with 00
        data = bytes(bytes_of_row[:count]).hex().upper()
        stamp = f"{1e-6 * int(time):.6f}"
        number = int(can_id, 16)
        unsound = number < 0 or not bus.isdigit() or not 0 <= count <= _MOST_BYTES
        if unsound or len(data) != 2 * count or len(bytes_of_row) > max(count, _CLASSIC_BYTES):
            return None
    except ValueError:
        return None
    digits = 8 if extended.lower() in ("true", "1") else 3
    fd = "#0" if count > _CLASSIC_BYTES else ""
    return f"({stamp}) {bus} {_format_error_id(f'{number:0{digits}X}')}#{fd}{data}\n"


def _write_python_can(text: str) -> str | None:
    """Return a row of python-can in the notation of candump -L, None where it is none."""
    try:
        time, can_id, extended, remote, error, length, coded = text.split(",")
        data = b64decode(coded, validate=True)
        number, count = int(can_id, 16), int(length)
        float(time)
        unsound = number < 0 or not {extended, remote, error} <= {"0", "1"} or not 0 <= count <= _MOST_BYTES
        if unsound or (remote == "0" == error and len(data) != count):
            return None
    except ValueError:
        return None
    if error == "1":
        return f"({time}) - {_ERROR_MARK}#\n"
    written = f"R{count}" if remote == "1" else ("#0" if count > _CLASSIC_BYTES else "") + data.hex().upper()
    return f"({time}) - {number:0{8 if extended == '1' else 3}X}#{written}\n"


def _parse_screen_time(text: str) -> float | None:
    """Return the seconds of a time as candump shows it: seconds, or a date."""
    try:
        return (
            float(text)
            if re.fullmatch(r"\d+(\.\d*)?", text)
            else datetime.fromisoformat(text).replace(tzinfo=UTC).timestamp()
        )
    except (ValueError, OverflowError):
        return None
