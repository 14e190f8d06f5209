"""BusLog: frames of a bus in order of time, and how they are collected, one by one or as the usual lines of a text.

Bounds          MOST_FRAMES frames and MOST_CHANNELS channels, checked while they are collected
"""

from array import array
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from math import isfinite
from pathlib import Path
from typing import Any

import can
import numpy as np

from protocols.errors import InputError, join_names
from protocols.files.bus_logs.line_frames import UsualLines
from protocols.files.bus_logs.time_restarts import find_restart, find_step_back

MOST_FRAMES = 10_000_000  # 33 min of a bench at 1 kHz; they take 0.4 GB while they are read
MOST_CHANNELS = 256  # more occur only in a damaged file
EXTENDED, REMOTE, ERROR, FD = 1, 2, 4, 8  # flags of a frame: the bench ignores frames with one of them
FLAG_NAMES = {REMOTE: "remote", FD: "CAN FD", ERROR: "error", EXTENDED: "extended"}
_BACKWARD_RUN = 3  # consecutive decreasing times: chosen, two senders that are out of order cause one or two
_HIGHEST_STANDARD_ID, _HIGHEST_ID = 0x7FF, 0x1FFFFFFF
_SMALL_STEP = 0.01  # of the range of times: chosen, frames around a head may be out of order
_USUAL_BYTES = 8  # of data of a usual line in `payload`, whatever its length


@dataclass(frozen=True)
class BusLog:
    """Frames in order of time. Each array has shape (frames,).

    stamps: time [s], from any origin. ids: identifiers. flags: EXTENDED, REMOTE, ERROR, FD. channel: index in `channels`, names
    as in the file. payload, starts, lengths: data of frame i are payload[starts[i] : starts[i] + lengths[i]]. damaged: number
    of lines or objects that are not frames. cut: why the end is missing; "" if it is not. notes: decisions, one sentence each.
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

    def read_data(self, index: int) -> bytes:
        """Return the payload of a frame."""
        start = self.starts[index]
        return self.payload[start : start + self.lengths[index]]

    def read_matrix(self, rows: np.ndarray, length: int) -> np.ndarray:
        """Return the payloads of the frames `rows`, which have at least `length` bytes: shape (rows, length)."""
        return np.frombuffer(self.payload, np.uint8)[self.starts[rows][:, None] + np.arange(length)]

    def read_padded(self, rows: np.ndarray, length: int) -> np.ndarray:
        """Return the payloads of the frames `rows`, shape (rows, length); 0 where a frame has fewer bytes."""
        if np.all(self.lengths[rows] >= length):
            return self.read_matrix(rows, length)
        at = np.arange(length)
        content = np.frombuffer(self.payload, np.uint8)
        places = np.minimum(self.starts[rows][:, None] + at, max(len(content) - 1, 0))
        return np.where(at < self.lengths[rows][:, None], content[places], np.uint8(0))

    def keep(self, rows: np.ndarray) -> "BusLog":
        """Return the log with the frames `rows` only, indices or a mask."""
        names = ("stamps", "ids", "flags", "channel", "starts", "lengths")
        return replace(self, **{name: getattr(self, name)[rows] for name in names})

    def select_channel(self, wanted: str | None, carries: np.ndarray, what: str, how: str) -> "BusLog":
        """Return the log of one channel: `wanted`, or else the only one with frames of the mask `carries`.

        what: name of such frames, for messages; how: the way to ask for a channel. Error frames are not counted. Raises
        InputError if several channels are possible.
        """
        if wanted is not None:
            if wanted not in self.channels:
                raise InputError(f"log {self.path} has no channel {wanted!r}; it has {join_names(self.channels)}")
            chosen = self.channels.index(wanted)
        else:
            counts = np.bincount(self.channel[carries], minlength=len(self.channels))
            possible = [self.channels[k] for k in np.flatnonzero(counts)]
            if len(possible) > 1:
                raise InputError(
                    f"log {self.path} has {what} on {len(possible)} channels, {join_names(possible)}; {how}"
                )
            if not possible:
                return self
            chosen = self.channels.index(possible[0])
        others = np.bincount(self.channel[(self.flags & ERROR) == 0], minlength=len(self.channels))
        left_out = ", ".join(f"{n} of {self.channels[k]}" for k, n in enumerate(others) if n and k != chosen)
        if left_out:
            self.notes.append(f"took channel {self.channels[chosen]}; left out frames: {left_out}")
        return self.keep(self.channel == chosen)


class FrameCollector:
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
        """Add a frame; return whether it is consistent."""
        data, can_id = message.data or b"", message.arbitration_id
        usual = not (message.is_remote_frame or message.is_error_frame)
        length = message.dlc if usual and not message.is_fd else len(data)
        if not isfinite(message.timestamp) or (usual and len(data) != min(length, 8) and not message.is_fd):
            return False
        highest = _HIGHEST_ID if message.is_extended_id or message.is_error_frame else _HIGHEST_STANDARD_ID
        if not 0 <= can_id <= highest:
            return False
        if len(self._stamps) >= MOST_FRAMES:
            raise self._refuse_frames()
        index = self._channels.setdefault(message.channel, len(self._channels))
        if index >= MOST_CHANNELS:
            raise self._refuse_channels()
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

    def mix(self, usual: UsualLines, numbers: list[int]) -> None:
        """Insert the frames of usual lines between the collected ones, in file order.

        numbers: lines of the collected frames.
        """
        lines = np.concatenate([usual.frames["line"], np.array(numbers, np.int64)])
        if len(lines) > MOST_FRAMES:
            raise self._refuse_frames()
        order = np.argsort(lines, kind="stable")
        names = [*usual.channels, *map(self._channel_name, self._channels)]
        channel = np.concatenate([usual.frames["channel"], np.array(self._channel, np.int64) + len(usual.channels)])[
            order
        ]
        seen: dict[str, int] = {}  # by name, in the order in which they come
        there, first = np.unique(channel, return_index=True)
        index = np.zeros(len(names), np.uint16)
        for old in there[np.argsort(first)].tolist():
            index[old] = seen.setdefault(names[old], len(seen))
        if len(seen) > MOST_CHANNELS:
            raise self._refuse_channels()
        before = _USUAL_BYTES * len(usual.frames)

        def join(of_usual: np.ndarray, others: "array[Any]") -> Any:
            kind = others.typecode
            return array(kind, np.concatenate([of_usual, np.array(others, kind)])[order].astype(kind).tobytes())

        self._starts = join(np.arange(0, before, _USUAL_BYTES), array("q", [start + before for start in self._starts]))
        self._stamps = join(usual.frames["stamp"], self._stamps)
        self._ids = join(usual.frames["can_id"], self._ids)
        self._flags = join(EXTENDED * usual.frames["extended"], self._flags)
        self._lengths = join(usual.frames["length"], self._lengths)
        self._channel = array("H", index[channel].tobytes())
        self._payload = bytearray(usual.frames["data"].tobytes()) + self._payload
        self._channels, self._channel_name = dict(seen.items()), str

    def _refuse_frames(self) -> InputError:
        return InputError(f"log {self._path} has more than {MOST_FRAMES} frames; cut it into parts")

    def _refuse_channels(self) -> InputError:
        return InputError(f"log {self._path} has more than {MOST_CHANNELS} channels: it is damaged")

    def log(
        self, damaged: int, cut: str, notes: list[str], lines: np.ndarray | None = None, heads: Sequence[int] = ()
    ) -> BusLog:
        """Return the frames in order of time.

        lines: line of each frame in a text; heads: lines at which a recording begins. Raises InputError if there is no frame,
        or a second recording.
        """
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
            notes.append(f"left out {damaged} lines that are not frames")
        if cut:
            notes.append(cut)
        backwards = np.diff(log.stamps) < 0
        if backwards.any():
            _check_one_recording(log, lines, heads)
            latest = np.maximum.accumulate(log.stamps)
            notes.append(
                f"{np.count_nonzero(log.stamps < latest)} of {len(log)} frames were not in order of time, up to"
                f" {np.max(latest - log.stamps):.6g} s late; ordered by time"
            )
            log = log.keep(_sort_stamps(log.stamps))
        return log


def _check_one_recording(log: BusLog, lines: np.ndarray | None, heads: Sequence[int]) -> None:
    """Raise InputError if the times of the frames, in the order of the file, restart."""
    place = ""
    senders = (
        log.ids.astype(np.int64) | (log.flags & EXTENDED).astype(np.int64) << 32 | log.channel.astype(np.int64) << 40
    )
    at = find_restart(log.stamps, senders)
    latest, range_s = np.maximum.accumulate(log.stamps), np.ptp(log.stamps)
    for head in heads:
        first = int(np.searchsorted(lines, head)) if lines is not None else 0
        if not 0 < first < len(log) or (at is not None and at < first):
            continue
        if log.stamps[first] < latest[first - 1] - _SMALL_STEP * range_s:
            at, place = first, f"line {head}"
            break
    if at is None:
        if (back := find_step_back(log.stamps, senders)) is not None:
            where = f"line {lines[back]}" if lines is not None else f"frame {back + 1}"
            raise InputError(
                f"log {log.path}: the clock was set back by {log.stamps[back - 1] - log.stamps[back]:.6g} s at {where}, so that"
                " frames after it would lie between those before; split the file there"
            )
        return
    place = place or (f"line {lines[at]}" if lines is not None else f"frame {at + 1}")
    raise InputError(
        f"log {log.path} has a second recording from {place} on, where its time goes back from {log.stamps[at - 1]:.9g} s to"
        f" {log.stamps[at]:.9g} s; split the file there"
    )


def _sort_stamps(stamps: np.ndarray) -> np.ndarray:
    """Return the indices (n,) that put frames in order of time.

    Frames of equal time keep their order, except in runs of decreasing times of a log written backwards, where it is reversed.
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
