"""Bus log: the frames of a recorded bus, in order of time, whatever the format of the file; python-can reads it.

Formats         candump (`-L` and screen format), Vector ASC and BLF, PEAK TRC, ASAM MF4 of a bus logger, CSV of SavvyCAN
                and python-can, SQLite of python-can. The content decides, not the suffix
Damage          lines or objects that are not frames are counted in `damaged`; `cut` notes a file that ends within one
"""

import io
import os
import stat
from collections.abc import Callable, Iterable, Iterator
from itertools import islice
from pathlib import Path
from typing import TextIO

import can
import numpy as np
from e2e.crc import calculate_crc8

from protocols.can.claim import BOUND, bind_data_id
from protocols.can.frames import DBC, DBC_1, Frame, FrameCodec, list_bus_frames
from protocols.can.other_size import SizeWatch
from protocols.can.two_clutches import CLUTCHES
from protocols.can.version import VERSION_1, VERSION_2, Version
from protocols.can.words import CRC_START, CRC_TABLE
from protocols.errors import InputError
from protocols.files.bus_logs import bus_frames
from protocols.files.bus_logs.blf_objects import count_sound_objects
from protocols.files.bus_logs.bus_frames import EXTENDED, BusLog, FrameCollector
from protocols.files.bus_logs.line_frames import UsualLines, read_usual_lines
from protocols.files.bus_logs.log_kind import MF4_MARKS, TextLog, holds_sqlite_frames, recognise_text_log
from protocols.files.bus_logs.log_lines import LogLines, read_candump
from protocols.files.bus_logs.sqlite_frames import read_sqlite_frames
from protocols.files.mdf.blocks import check_blocks
from protocols.files.mdf.frames import is_bus_log, read_frames
from protocols.files.quiet_libraries import quiet

_BLOCK = 1 << 16  # bytes that decide the format; also frames per block
# Share of a channel's frames on the bench's identifiers: a wrong CRC passes in 1 of 256, another bus has no valid frame
_VALID_SHARE = 0.5
# CRC-8 SAE J1850 of version 1, as a table: the CRC of one byte is table[0xFF ^ byte] ^ 0xFF
_CRC_8 = np.array([calculate_crc8(bytes((index ^ 0xFF,))) ^ 0xFF for index in range(256)], np.uint8)
_MOST_WATCHED = 10_000  # frames checked for a bench of another size: with other frames between, some seconds of a bus
_FEW = 1000  # damaged lines that are always tolerated; with more of them than frames, the file is not a log
_OTHERS = {
    b"\x1f\x8b": "it is compressed; unpack it first",
    b"PAR1": "it is a Parquet file, as of a run",
    b"MATLAB ": "it is a MATLAB file",
    b"\x89HDF": "it is an HDF5 file",
}  # kind of files that are not logs, by their first bytes


def read_bus_log(path: Path) -> BusLog:
    """Read a bus log. Raises InputError for a file that is not a log or cannot be read."""
    return _read_any(path, _read_head(path))


def _read_any(path: Path, head: bytes) -> BusLog:
    if head.startswith(b"LOGG"):
        return _read_blf(path)
    if head.startswith(MF4_MARKS):
        if not is_bus_log(path, wholly=False):
            raise InputError(f"log {path} cannot be read: it is an MDF file without frames of a CAN bus")
        return _read_mf4(path, head)
    if holds_sqlite_frames(head):
        collector = FrameCollector(path, "python-can SQLite", lambda name: "-")
        return _collect_sound(path, collector, lambda: read_sqlite_frames(path), "", [])
    text_log = recognise_text_log(head)
    if text_log is None:
        reason = next(
            (what for mark, what in _OTHERS.items() if head.startswith(mark)), f"it begins with {head[:16]!r}"
        )
        raise InputError(
            f"log {path} cannot be read: {reason}; known are candump, Vector ASC and BLF, PEAK TRC, MF4 of a bus logger,"
            " CSV of SavvyCAN and python-can, SQLite of python-can"
        )
    return _read_text(path, text_log)


def _read_head(path: Path) -> bytes:
    try:
        if not stat.S_ISREG(os.stat(path).st_mode):
            raise InputError(f"log {path} is not a file")
        with path.open("rb") as file:
            head = file.read(_BLOCK)
    except FileNotFoundError:
        raise InputError(f"log {path} does not exist") from None
    except (OSError, ValueError) as error:
        raise InputError(f"log {path} cannot be read: {getattr(error, 'strerror', None) or error}") from None
    if not head:
        raise InputError(f"log {path} is empty")
    return head


def _read_text(path: Path, text_log: TextLog) -> BusLog:
    """Read a text log. Usual lines are parsed at once, others by python-can's reader.

    A line is damaged if the reader does not accept it, or reads an impossible frame.
    """
    readers: dict[str, Callable[[LogLines], Iterable[can.Message]]] = {
        "candump": read_candump,
        "table": read_candump,
        "asc": lambda lines: can.ASCReader(lines, base=text_log.base),  # type: ignore[arg-type]
        "trc": can.TRCReader,  # type: ignore[dict-item]
    }
    first = 1 if text_log.kind == "asc" else 0  # python-can counts channels of ASC from 0, the file from 1
    collector = FrameCollector(
        path, text_log.name, lambda name: str(name + first) if isinstance(name, int) else str(name or "-")
    )
    usual = _find_usual_lines(path, text_log)
    with _open_others(path, text_log, usual) as file:
        lines = LogLines(path, file, text_log, *((usual.numbers.tolist(), usual.before_last) if usual else ()))
        with quiet():
            numbers = _collect(path, collector, lines, readers[text_log.kind], len(usual.frames) if usual else 0)
    lines.check_steps(usual)
    cut = f"the log ends within line {lines.number}" if lines.ends_within_line else ""
    if usual:
        collector.mix(usual, numbers)
    of_frames = np.sort(np.concatenate([usual.frames["line"] if usual else [], numbers]).astype(np.int64))
    return collector.log(lines.damaged, cut, lines.notes, of_frames, lines.heads)


def _find_usual_lines(path: Path, text_log: TextLog) -> UsualLines | None:
    """Return the usual lines of a log; None if each line of its format depends on the lines before it."""
    usual_format = text_log.name == "candump" or (
        text_log.kind == "asc" and text_log.base == "hex" and not text_log.relative
    )
    if not usual_format or text_log.encoding == "utf-16":
        return None
    usual = read_usual_lines(path, text_log.kind, bus_frames.MOST_FRAMES)
    one_kind_of_break = usual.others.count(b"\r") == usual.others.count(b"\r\n")
    return usual if one_kind_of_break and len(usual.frames) else None


def _open_others(path: Path, text_log: TextLog, usual: UsualLines | None) -> TextIO:
    if usual is None:
        return path.open(encoding=text_log.encoding, errors="replace")
    return io.TextIOWrapper(io.BytesIO(usual.others), encoding=text_log.encoding, errors="replace")


def _collect(
    path: Path,
    collector: FrameCollector,
    lines: LogLines,
    reader: Callable[[LogLines], Iterable[can.Message]],
    usual: int,
) -> list[int]:
    """Collect the frames of lines, beside `usual` frames of usual lines. Return the line number of each frame."""
    numbers: list[int] = []
    while not lines.ended:
        begin = lines.number
        try:
            for message in reader(lines):
                good = collector.add(message)
                lines.answer(good)
                if good:
                    numbers.append(lines.number)
                if lines.damaged > max(len(collector) + usual, _FEW):
                    raise InputError(
                        f"log {path} ({lines.found.name}): line {lines.first_damaged} is not a frame, nor are more than half of"
                        f" the {lines.number} lines to here"
                    )
        except (ValueError, LookupError, TypeError, ArithmeticError, NotImplementedError) as error:
            if lines.number == begin:
                raise InputError(f"log {path} cannot be read: {' '.join(str(error).split())[:200]}") from None
        lines.restart()
        if lines.damaged > max(len(collector) + usual, _FEW):
            raise InputError(
                f"log {path} ({lines.found.name}): line {lines.first_damaged} is not a frame; it is damaged"
            )
    return numbers


def _read_blf(path: Path) -> BusLog:
    collector = FrameCollector(path, "BLF", lambda name: str(int(name) + 1) if isinstance(name, int) else "-")
    sound, cut = count_sound_objects(path, bus_frames.MOST_FRAMES)
    with path.open("rb") as file:
        return _collect_sound(path, collector, lambda: islice(can.BLFReader(file), sound), cut, [])


def _read_mf4(path: Path, head: bytes) -> BusLog:
    collector = FrameCollector(path, "MF4", lambda name: str(name) if isinstance(name, int) else "-")
    there = check_blocks(path).cut_text()
    cut = f"the log is cut or damaged at its end: it has {there}" if there else ""
    if head.startswith(b"UnFin"):
        cut = "the log is an unfinished MF4: its logger was stopped before the end"
    return _collect_sound(path, collector, lambda: read_frames(path, bus_frames.MOST_FRAMES), cut, [])


def _collect_sound(
    path: Path, collector: FrameCollector, reader: Callable[[], Iterable[can.Message]], cut: str, notes: list[str]
) -> BusLog:
    """Collect from a binary file. If the reader stops with an error, the rest is missing."""
    damaged = 0
    try:
        with quiet():  # the readers warn of lines that are counted here
            for message in reader():
                damaged += not collector.add(message)
    except InputError:
        raise
    except Exception as error:  # each reader has exception types of its own
        cut = f"the log cannot be read after {len(collector)} frames: {' '.join(str(error).split())[:200] or 'it is damaged'}"
    return collector.log(damaged, cut, notes)


def iterate(log: BusLog) -> Iterator[tuple[float, int, int, bytes]]:
    """Yield the time stamp [s], identifier, flags and payload of each frame."""
    payload = log.payload
    columns = (log.stamps, log.ids, log.flags, log.starts, log.lengths)
    for first in range(0, len(log), _BLOCK):
        part = slice(first, first + _BLOCK)
        for stamp, can_id, flags, start, length in zip(*(c[part].tolist() for c in columns), strict=True):
            yield stamp, can_id, flags, payload[start : start + length]


def compute_crcs(data: np.ndarray, data_id: int, version: Version) -> np.ndarray:
    """Return the CRCs (n,) of the payloads `data` (n, bytes) of a frame with `data_id`."""
    if version is VERSION_1:
        remainder = np.full(len(data), 0xFF, np.uint8)
        for byte in data[:, 1:].T:
            remainder = _CRC_8[remainder ^ byte]
        return remainder ^ 0xFF
    remainder = np.full(len(data), CRC_START, np.uint16)
    for byte in (*data[:, 2:].T, data_id & 0xFF, data_id >> 8):
        remainder = remainder << 8 ^ CRC_TABLE[remainder >> 8 ^ byte]
    return remainder


def check_crcs(log: BusLog, rows: np.ndarray, length: int, data_id: int, version: Version = VERSION_2) -> np.ndarray:
    """Return a mask (n,) of the frames `rows` that have a correct CRC.

    length: of the frames [bytes]; data_id: for the CRC.
    """
    good = np.zeros(len(rows), bool)
    for first in range(0, len(rows), _BLOCK):
        data = log.read_matrix(rows[first : first + _BLOCK], length)
        own = data[:, 0] if version is VERSION_1 else data[:, 0] + 256 * data[:, 1].astype(np.uint16)
        good[first : first + _BLOCK] = compute_crcs(data, data_id, version) == own
    return good


def find_claim_sessions(log: BusLog, claim: FrameCodec) -> list[int]:
    """Return the sessions of the supervisors in a log that claim set-points; claim: the frame SUPERVISOR_CLAIM of a clutch."""
    rows = np.flatnonzero((log.ids == claim.can_id) & (log.flags == 0) & (log.lengths == claim.length))
    rows = rows[check_crcs(log, rows, claim.length, claim.data_id)]
    return sorted({claim.raw(data.tobytes()).session for data in log.read_matrix(rows, claim.length)})


def check_size(log: BusLog) -> None:
    """Raise InputError if the first frames of a log are of a bench of another size."""
    watch = SizeWatch(list_bus_frames(clutches=len(CLUTCHES)), f"of log {log.path}")
    watch.hear(Frame(can_id, data) for _, can_id, flags, data in islice(iterate(log), _MOST_WATCHED) if not flags)


def mark_bench_frames(log: BusLog, version: Version = VERSION_2) -> np.ndarray:
    """Return a mask (frames,) of the valid frames of a database version.

    Only channels on which most frames with the bench's identifiers are valid count.
    """
    mask = np.zeros(len(log), bool)
    ours = np.zeros(len(log), bool)
    codecs = list_bus_frames(DBC_1 if version is VERSION_1 else DBC, len(CLUTCHES))
    sessions = {BOUND[codec.name]: find_claim_sessions(log, codec) for codec in codecs if codec.name in BOUND}
    for codec in codecs:
        rows = np.flatnonzero((log.ids == codec.can_id) & ((log.flags & EXTENDED) == 0))
        ours[rows] = True
        rows = rows[(log.flags[rows] == 0) & (log.lengths[rows] == codec.length)]
        mask[rows] = check_crcs(log, rows, codec.length, codec.data_id, version)
        for session in sessions.get(codec.name, ()):
            mask[rows] |= check_crcs(log, rows, codec.length, bind_data_id(codec.data_id, session))
    for k in range(len(log.channels)):
        there = log.channel == k
        if np.count_nonzero(mask & there) < _VALID_SHARE * np.count_nonzero(ours & there):
            mask[there] = False
    return mask
