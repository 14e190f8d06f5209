"""Bus log: the frames of a recorded bus, in order of time, whatever the format of the file; python-can reads it.

Formats         candump (`-L`, and what it shows on a screen), Vector ASC and BLF, PEAK TRC, ASAM MF4 of a bus logger. The
                content decides, not the suffix
Damage          A line or an object that is no frame is counted, and so is a file that ends within one: `damaged`, `cut`
Bounds          MOST_FRAMES frames and MOST_CHANNELS channels, checked while the file is read
"""

import logging
import os
import stat
from array import array
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass, field, replace
from itertools import islice
from math import isfinite
from pathlib import Path

import can
import numpy as np

from protocols.can.words import CRC_TABLE
from protocols.errors import InputError, listing
from protocols.files.blf_objects import count_sound_objects
from protocols.files.log_lines import LogLines, TextLog, candump_lines, text_log
from protocols.files.mf4_frames import is_bus_log, read_frames, without_remarks

MOST_FRAMES = 10_000_000  # 33 min of a bench at 1 kHz; they take 0.4 GB while they are read
MOST_CHANNELS = 256  # more are a damaged file
EXTENDED, REMOTE, ERROR, FD = 1, 2, 4, 8  # flags of a frame: the bench uses none that has one
FLAG_NAMES = {REMOTE: "remote", FD: "CAN FD", ERROR: "error", EXTENDED: "extended"}
_BLOCK = 1 << 16  # bytes that decide the format; frames that are taken at once
_BACKWARD_RUN = 3  # falling times in sequence: chosen, two senders that are out of order make one or two
_HIGHEST_STANDARD_ID = 0x7FF
_FEW = 1000  # damaged lines that are always borne; more than the frames are no log
_MF4_MARKS = (b"MDF     ", b"UnFinMF ")


@dataclass(frozen=True)
class BusLog:
    """Frames in order of time. Each array has shape (frames,).

    stamps: time [s], from any origin. ids: identifiers. flags: EXTENDED, REMOTE, ERROR, FD. channel: index in `channels`, names
    as in the file. payload, starts, lengths: data of frame i are payload[starts[i] : starts[i] + lengths[i]]. damaged: lines or
    objects that are no frame. cut: why the end is missing, "" where it is not. notes: what was decided, a sentence each.
    """

    path: Path
    kind: str
    stamps: np.ndarray
    ids: np.ndarray
    flags: np.ndarray
    channel: np.ndarray
    starts: np.ndarray
    lengths: np.ndarray
    payload: bytes
    channels: tuple[str, ...]
    damaged: int = 0
    cut: str = ""
    notes: list[str] = field(default_factory=list)

    def __len__(self) -> int:
        return len(self.stamps)

    def data(self, index: int) -> bytes:
        """Payload of a frame."""
        start = self.starts[index]
        return self.payload[start : start + self.lengths[index]]

    def matrix(self, rows: np.ndarray, length: int) -> np.ndarray:
        """Payloads of the frames `rows`, which have at least `length` bytes: shape (rows, length)."""
        return np.frombuffer(self.payload, np.uint8)[self.starts[rows][:, None] + np.arange(length)]

    def keep(self, rows: np.ndarray) -> "BusLog":
        """The log with the frames `rows` only, indices or a mask."""
        names = ("stamps", "ids", "flags", "channel", "starts", "lengths")
        return replace(self, **{name: getattr(self, name)[rows] for name in names})

    def only_channel(self, wanted: str | None, carries: np.ndarray, what: str, how: str) -> "BusLog":
        """The log of one channel: `wanted`, or else the only one with frames of the mask `carries`.

        what: such frames, for messages; how: the way to ask for a channel. Raises InputError where several are possible.
        """
        if wanted is not None:
            if wanted not in self.channels:
                raise InputError(f"log {self.path} has no channel {wanted!r}; it has {listing(self.channels)}")
            chosen = self.channels.index(wanted)
        else:
            counts = np.bincount(self.channel[carries], minlength=len(self.channels))
            possible = [self.channels[k] for k in np.flatnonzero(counts)]
            if len(possible) > 1:
                raise InputError(f"log {self.path} has {what} on {len(possible)} channels, {listing(possible)}; {how}")
            if not possible:
                return self
            chosen = self.channels.index(possible[0])
        others = np.bincount(self.channel, minlength=len(self.channels))
        left_out = ", ".join(f"{n} of {self.channels[k]}" for k, n in enumerate(others) if n and k != chosen)
        if left_out:
            self.notes.append(f"took channel {self.channels[chosen]}; left out frames: {left_out}")
        return self.keep(self.channel == chosen)


def log_kind(path: Path, head: bytes) -> str:
    """Kind of the log that begins with `head`: blf, mf4, or that of a text; "" for no log."""
    if head.startswith(b"LOGG"):
        return "blf"
    if head.startswith(_MF4_MARKS):
        return "mf4" if is_bus_log(path) else ""
    found = text_log(head)
    return found.kind if found else ""


def read_bus_log(path: Path) -> BusLog:
    """Read a log of a bus. Raises InputError for what is none, or cannot be read."""
    log = logging.getLogger("can")
    level = log.level
    log.setLevel(logging.ERROR)  # its readers warn of lines that are counted here
    try:
        return _read_any(path, _read_head(path))
    finally:
        log.setLevel(level)


def _read_any(path: Path, head: bytes) -> BusLog:
    if head.startswith(b"LOGG"):
        return _read_blf(path)
    if head.startswith(_MF4_MARKS):
        if not is_bus_log(path):
            raise InputError(f"log {path} cannot be read: it is an MDF file without frames of a CAN bus")
        return _read_mf4(path, head)
    found = text_log(head)
    if found is None:
        reason = (
            "it is compressed; unpack it first" if head.startswith(b"\x1f\x8b") else f"it begins with {head[:16]!r}"
        )
        raise InputError(
            f"log {path} cannot be read: {reason}; known are candump, Vector ASC and BLF, PEAK TRC, MF4 of a bus logger"
        )
    return _read_text(path, found)


def _read_head(path: Path) -> bytes:
    try:
        if not stat.S_ISREG(os.stat(path).st_mode):
            raise InputError(f"log {path} is no file")
        with path.open("rb") as file:
            head = file.read(_BLOCK)
    except FileNotFoundError:
        raise InputError(f"log {path} does not exist") from None
    except (OSError, ValueError) as error:
        raise InputError(f"log {path} cannot be read: {getattr(error, 'strerror', None) or error}") from None
    if not head:
        raise InputError(f"log {path} is empty")
    return head


class _Collector:
    """Frames of messages, in the order of the file. channel_name: text of a channel of python-can."""

    def __init__(self, path: Path, kind: str, channel_name: Callable[[object], str]) -> None:
        self._path, self._kind, self._channel_name = path, kind, channel_name
        self._stamps, self._ids, self._flags = array("d"), array("I"), array("B")
        self._channel, self._starts, self._lengths = array("H"), array("q"), array("B")
        self._payload = bytearray()
        self._channels: dict[object, int] = {}

    def __len__(self) -> int:
        return len(self._stamps)

    def add(self, message: can.Message) -> bool:
        """Add a frame; return whether it is one: its parts fit each other."""
        data, can_id = message.data or b"", message.arbitration_id
        usual = not (message.is_remote_frame or message.is_error_frame)
        length = message.dlc if usual and not message.is_fd else len(data)
        if not isfinite(message.timestamp) or (usual and len(data) != min(length, 8) and not message.is_fd):
            return False
        if not message.is_extended_id and can_id > _HIGHEST_STANDARD_ID and not message.is_error_frame:
            return False
        if len(self._stamps) >= MOST_FRAMES:
            raise InputError(f"log {self._path} has more than {MOST_FRAMES} frames; cut it into parts")
        index = self._channels.setdefault(message.channel, len(self._channels))
        if index >= MOST_CHANNELS:
            raise InputError(f"log {self._path} has more than {MOST_CHANNELS} channels: it is damaged")
        self._stamps.append(message.timestamp)
        self._ids.append(can_id)
        self._flags.append(
            EXTENDED * message.is_extended_id
            | REMOTE * message.is_remote_frame
            | ERROR * message.is_error_frame
            | FD * message.is_fd
        )
        self._channel.append(index)
        self._starts.append(len(self._payload))
        self._lengths.append(len(data))
        self._payload += data
        return True

    def log(self, damaged: int, cut: str, notes: list[str]) -> BusLog:
        """The frames in order of time. Raises InputError where there is none."""
        if not self._stamps:
            why = f"; {damaged} lines are damaged" if damaged else f"; {cut}" if cut else ""
            raise InputError(f"log {self._path} ({self._kind}) has no frame{why}")
        log = BusLog(
            self._path, self._kind, np.frombuffer(self._stamps, np.float64), np.frombuffer(self._ids, np.uint32),
            np.frombuffer(self._flags, np.uint8), np.frombuffer(self._channel, np.uint16),
            np.frombuffer(self._starts, np.int64), np.frombuffer(self._lengths, np.uint8), bytes(self._payload),
            tuple(map(self._channel_name, self._channels)), damaged, cut, notes,
        )  # fmt: skip
        if damaged:
            notes.append(f"left out {damaged} lines that are no frame")
        if cut:
            notes.append(cut)
        backwards = np.diff(log.stamps) < 0
        if backwards.any():
            latest = np.maximum.accumulate(log.stamps)
            notes.append(
                f"{np.count_nonzero(log.stamps < latest)} of {len(log)} frames were not in order of time, up to"
                f" {np.max(latest - log.stamps):.6g} s late; ordered by time"
            )
            log = log.keep(_order(log.stamps))
        return log


def _order(stamps: np.ndarray) -> np.ndarray:
    """Indices (n,) that put frames in order of time. Frames of one time keep their order; where a log was written backwards, in
    runs of times that only fall, they are backwards, too.
    """
    steps = np.diff(stamps)
    rank = np.arange(len(stamps))
    begins = np.concatenate([[0], np.flatnonzero(steps > 0) + 1, [len(stamps)]])
    falls = np.concatenate([[0], np.cumsum(steps < 0), [0]])
    ends = begins[1:]
    begins = begins[:-1]
    long = (ends - begins > _BACKWARD_RUN) & (falls[ends - 1] - falls[begins] >= _BACKWARD_RUN)
    for begin, end in zip(begins[long], ends[long], strict=True):
        rank[begin:end] = rank[begin:end][::-1]
    return np.lexsort((rank, stamps))


def _read_text(path: Path, found: TextLog) -> BusLog:
    """Read a text, line by line. A line that the reader does not take, or takes for a frame that cannot be, is damaged."""
    readers: dict[str, Callable[[LogLines], Iterable[can.Message]]] = {
        "asc": lambda lines: can.ASCReader(lines, base=found.base),  # type: ignore[arg-type]
        "trc": can.TRCReader,  # type: ignore[dict-item]
    }
    first = 1 if found.kind == "asc" else 0  # python-can counts channels of ASC from 0, the file from 1
    collector = _Collector(
        path, found.name, lambda name: str(name + first) if isinstance(name, int) else str(name or "-")
    )
    with path.open(encoding=found.encoding, errors="replace") as file:
        lines = LogLines(path, file, found)
        if found.kind == "candump":
            _collect(path, collector, lines, candump_lines)
        else:
            _collect(path, collector, lines, readers[found.kind])
    lines.check_steps()
    cut = f"the log ends within line {lines.number}" if lines.ends_within_line else ""
    return collector.log(lines.damaged, cut, lines.notes)


def _collect(
    path: Path, collector: _Collector, lines: LogLines, reader: Callable[[LogLines], Iterable[can.Message]]
) -> None:
    while not lines.ended:
        begin = lines.number
        try:
            for message in reader(lines):
                lines.answer(collector.add(message))
                if lines.damaged > max(len(collector), _FEW):
                    raise InputError(
                        f"log {path} ({lines.found.name}): line {lines.first_damaged} is no frame, and so are more than half of"
                        f" the {lines.number} lines to here"
                    )
        except (ValueError, LookupError, TypeError, ArithmeticError, NotImplementedError) as error:
            if lines.number == begin:
                raise InputError(f"log {path} cannot be read: {' '.join(str(error).split())[:200]}") from None
        lines.restart()
        if lines.damaged > max(len(collector), _FEW):
            raise InputError(f"log {path} ({lines.found.name}): line {lines.first_damaged} is no frame; it is damaged")


def _read_blf(path: Path) -> BusLog:
    collector = _Collector(path, "BLF", lambda name: str(int(name) + 1) if isinstance(name, int) else "-")
    sound, cut = count_sound_objects(path, MOST_FRAMES)
    with path.open("rb") as file:
        return _collect_sound(path, collector, lambda: islice(can.BLFReader(file), sound), cut, [])


def _read_mf4(path: Path, head: bytes) -> BusLog:
    collector = _Collector(path, "MF4", lambda name: str(name) if isinstance(name, int) else "-")
    cut = "the log is an unfinished MF4: its logger was stopped before the end" if head.startswith(b"UnFin") else ""
    with without_remarks():
        return _collect_sound(path, collector, lambda: read_frames(path, MOST_FRAMES), cut, [])


def _collect_sound(
    path: Path, collector: _Collector, reader: Callable[[], Iterable[can.Message]], cut: str, notes: list[str]
) -> BusLog:
    """Collect from a binary file. Where the reader stops with an error, the rest is missing."""
    damaged = 0
    try:
        for message in reader():
            damaged += not collector.add(message)
    except InputError:
        raise
    except Exception as error:  # each reader has exception types of its own
        cut = f"the log cannot be read after {len(collector)} frames: {' '.join(str(error).split())[:200] or 'it is damaged'}"
    return collector.log(damaged, cut, notes)


def iterate(log: BusLog) -> Iterator[tuple[float, int, int, bytes]]:
    """Stamp [s], identifier, flags and payload of each frame."""
    payload = log.payload
    columns = (log.stamps, log.ids, log.flags, log.starts, log.lengths)
    for first in range(0, len(log), _BLOCK):
        part = slice(first, first + _BLOCK)
        for stamp, can_id, flags, start, length in zip(*(c[part].tolist() for c in columns), strict=True):
            yield stamp, can_id, flags, payload[start : start + length]


def good_crc(log: BusLog, rows: np.ndarray, length: int) -> np.ndarray:
    """Mask (n,) of the frames `rows` of `length` bytes whose first byte is the CRC of the others, as in frames of the bench."""
    good = np.zeros(len(rows), bool)
    for first in range(0, len(rows), _BLOCK):
        data = log.matrix(rows[first : first + _BLOCK], length)
        remainder = np.full(len(data), 0xFF, np.uint8)
        for byte in range(1, length):
            remainder = CRC_TABLE[remainder ^ data[:, byte]]
        good[first : first + _BLOCK] = (remainder ^ 0xFF) == data[:, 0]
    return good
