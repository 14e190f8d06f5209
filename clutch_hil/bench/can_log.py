"""CAN log: record all frames on a bus in a file of python-can's writers (Vector BLF and ASC, candump, PEAK).

The log is a separate participant that only listens; the services do not know of it. The queue of a bus holds half a second
of frames at 1 kHz. A reader that sleeps longer loses frames. Lost frames show as a gap in the alive counters, except for whole
rounds of 256 frames and for the last frames of the log. So a log whose queue may have been full is not reported as complete.
"""

import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import can

from clutch_hil.bench.progress import format_table
from protocols.buses.bus import open_bus, resolve
from protocols.can.frames import list_bus_frames
from protocols.can.traffic import Traffic
from protocols.can.two_clutches import CLUTCHES
from protocols.errors import InputError, format_count, join_names
from protocols.files.output_file import whole_file
from protocols.realtime.stopping import Stop

WRITERS: dict[str, Any] = {
    ".blf": can.BLFWriter,
    ".asc": can.ASCWriter,
    ".log": can.CanutilsLogWriter,
    ".trc": can.TRCWriter,
}
# Frames that the bench does not use: attribute of a message, name
_STRANGE = (
    ("is_error_frame", "error"), ("is_remote_frame", "remote"), ("is_fd", "CAN FD"), ("is_extended_id", "extended"),
)  # fmt: skip
# Names of frames that are counted one by one: there are 2^29 extended identifiers, and a log may run for days
_MOST_NAMES = 4096
_FIRST_FRAME_TIMEOUT = 10.0  # s, where the length of the log is given; otherwise the log waits without limit
_RECEIVE_TIMEOUT = 0.1  # s to wait for a frame, before the next check whether to end
_PROGRESS_INTERVAL = 0.5  # s between reports of progress
# Frames that waited together; from this number on the queue may have been full. It is 50 ms at 1 kHz. A local bus holds 2731
# frames of a sender, or 554 where the kernel grants no larger buffer. A CAN socket has half of that buffer for all senders.
_SUSPECT_BACKLOG = 250


@dataclass(frozen=True)
class CanLogResult:
    """Contents of a log.

    frames: number of frames by name, by identifier where the DBC does not have it. seconds: from the first to the last frame.
    lost: frames missing by the alive counters. They wrap at 256, so more may be missing.
    waited: the largest number of frames that waited together to be read.
    failure: why the bus could no longer be read; empty if it could.
    """

    bus: str
    path: Path
    frames: dict[str, int]
    seconds: float
    lost: int
    waited: int
    failure: str

    @property
    def good(self) -> bool:
        """Return whether there is no sign of a missing frame."""
        return not (self.lost or self.failure) and self.waited < _SUSPECT_BACKLOG

    @property
    def verdict(self) -> str:
        """Return the verdict line."""
        if self.lost:
            loss = f"at least {format_count(self.lost, 'frame')} lost, by their alive counters"
        elif self.waited >= _SUSPECT_BACKLOG:
            loss = f"frames may be lost: {self.waited} waited at the same time, which fills the queue of the bus"
        else:
            loss = "no frame lost"
        return f"{self.seconds:.1f} s recorded, {loss}" + (f"; the bus failed: {self.failure}" if self.failure else "")

    @property
    def text(self) -> str:
        """Return what was read and written, as text."""
        rows = [("frame", "count", "frames/s")]
        rows += [(name, f"{count}", f"{count / max(self.seconds, 1e-3):.1f}") for name, count in self.frames.items()]
        total = sum(self.frames.values())
        return "\n".join([f"read:    bus {self.bus}", format_table(rows), f"wrote:   {self.path}  ({total} frames)"])

    @property
    def document(self) -> dict[str, Any]:
        """Return contents and verdict, for JSON."""
        return {
            "bus": self.bus,
            "log": str(self.path),
            "seconds": self.seconds,
            "frames": self.frames,
            "frames_lost": self.lost,
            "frames_waited": self.waited,
            "bus_failure": self.failure,
            "verdict": self.verdict,
            "good": self.good,
        }


class CanLog:
    """A log of `bus` at `path`. Raises InputError for a suffix no writer has, or a bus that cannot be opened."""

    def __init__(self, bus: str, path: Path) -> None:
        if path.suffix.lower() not in WRITERS:
            raise InputError(f"CAN log {path} cannot be written as {path.suffix!r}; allowed are {join_names(WRITERS)}")
        self.bus, self.path = resolve(bus), path
        open_bus(self.bus).close()  # raises InputError where the bus cannot be opened
        self._traffic = Traffic(list_bus_frames(clutches=len(CLUTCHES)))

    def record(self, stop: Stop, seconds: float | None, progress: Callable[[str], None]) -> CanLogResult:
        """Write every frame until `stop` is requested or `seconds` [s] after the first frame; call `progress` twice a second.

        Time stamps are those of the bus: the kernel's at reception, the sender's on a local bus. Raises InputError when no
        frame arrives.
        """
        interface, _, channel = self.bus.rpartition(":")
        first = last = 0.0
        backlog = Backlog()
        last_report, failure = time.monotonic(), ""
        with can.Bus(channel, interface=interface or "socketcan") as bus, whole_file(self.path) as part:
            with (
                WRITERS[self.path.suffix.lower()](part) as writer,
                bus,
            ):  # the bus is closed before the writer, so no further frame is read
                try:
                    for message in _receive(bus, stop, seconds):
                        backlog.note(message.timestamp, time.time())
                        first = first or message.timestamp
                        # stamps of two senders may be out of order; no frame of a log may be older than its first frame
                        last = message.timestamp = max(message.timestamp, first)
                        writer.on_message_received(message)
                        self._count(message)
                        if time.monotonic() - last_report > _PROGRESS_INTERVAL:
                            last_report = time.monotonic()
                            count, lost = self._traffic.frames.total(), self._traffic.count("lost")
                            progress(f"{last - first:.1f} s, {count} frames, lost {lost}")
                except can.CanError as error:
                    failure = str(error)
            if not self._traffic.frames:
                stop.check(f"no frame was received on bus {self.bus}; nothing was recorded")
                raise InputError(f"no frame was received on bus {self.bus}; nothing was recorded")
        counts = dict(sorted(self._traffic.frames.items()))
        return CanLogResult(
            self.bus, self.path, counts, last - first, self._traffic.count("lost"), backlog.most, failure
        )

    def _count(self, message: can.Message) -> None:
        """Count a frame and, from its alive counter, the frames missing before it."""
        strange = [name for flag, name in _STRANGE if getattr(message, flag)]
        if strange:
            named = "" if message.is_error_frame else f" 0x{message.arbitration_id:03X}"
            name, counts = f"{strange[0]} frame{named}", self._traffic.frames
            if name not in counts and len(counts) >= _MOST_NAMES:
                name = f"{strange[0]} frames of further identifiers"
            counts[name] += 1
        else:
            self._traffic.take(message.timestamp, message.arbitration_id, bytes(message.data))


class Backlog:
    """Number of frames that waited together to be read. `most`: largest number already sent when the first of them was read."""

    def __init__(self) -> None:
        self.most = 0
        self._checked_at = 0.0  # UNIX time [s]
        self._read_since = 0  # frames sent before `_checked_at` and read since

    def note(self, sent: float, now: float) -> None:
        """Record that a frame stamped `sent` is read at `now`; UNIX times [s]."""
        if sent > self._checked_at:
            self._checked_at, self._read_since = now, 0
        self._read_since += 1
        self.most = max(self.most, self._read_since)


def _receive(bus: can.BusABC, stop: Stop, seconds: float | None) -> Iterator[can.Message]:
    """Yield messages until `stop` is requested or `seconds` [s] after the first one; then those already waiting."""
    end = float("inf") if seconds is None else time.monotonic() + _FIRST_FRAME_TIMEOUT
    first = True
    while not stop.asked and time.monotonic() < end:
        if message := bus.recv(_RECEIVE_TIMEOUT):
            if first and seconds is not None:
                end = time.monotonic() + seconds
            first = False
            yield message
    now = time.time()
    while (message := bus.recv(0.0)) and message.timestamp <= now:
        yield message
