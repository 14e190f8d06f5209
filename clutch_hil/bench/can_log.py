"""CAN log: everything on a bus, as it was on the wire, in a file of python-can's writers (Vector BLF and ASC, candump, PEAK).

It is a participant of its own that only listens; the services do not know of it. A bus queues half a second of frames at
1 kHz: who sleeps longer loses some. What was lost shows as a gap in the alive counters, but for whole rounds of 16 frames
and for the last ones; so a log that found a full queue does not claim to be whole.
"""

import time
from collections import Counter
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import can

from clutch_hil.bench.progress import table_text
from protocols.buses.bus import open_bus, resolve
from protocols.can.frames import bus_frames
from protocols.can.reception import Reception
from protocols.can.two_clutches import CLUTCHES
from protocols.errors import InputError, listing
from protocols.files.run import whole_file
from protocols.realtime.stopping import Stop

WRITERS: dict[str, Any] = {
    ".blf": can.BLFWriter,
    ".asc": can.ASCWriter,
    ".log": can.CanutilsLogWriter,
    ".trc": can.TRCWriter,
}
_FIRST_FRAME_TIMEOUT = (
    10.0  # s for the first frame where the length of the log is given; else it is waited for without end
)
_RECEIVE_TIMEOUT = 0.1  # s for a frame to come, then a look whether to end
_PROGRESS_INTERVAL = 0.5  # s between reports of progress
_HEARTBEATS = ("PLANT_HEARTBEAT", "CONTROLLER_HEARTBEAT", "CONTROLLER_HEARTBEAT_B")
_SUPERVISOR = "SUPERVISOR"  # sender without a heartbeat
_SUPERVISOR_SILENCE = 0.1  # s; a supervisor listens for longer before it speaks, and counts from 0 then
# frames waiting at once from which on a queue may have been full: 50 ms at 1 kHz. A local bus holds 2731 of a sender, 554
# where the kernel grants no larger buffer; a CAN socket has half of that buffer for all senders
_SUSPECT_BACKLOG = 250


@dataclass(frozen=True)
class CanLogResult:
    """What a log holds: `frames` by name (by identifier where the DBC does not know it), `seconds` from first to last.

    `lost` counts gaps in the alive counters of the bench's frames (at least: they wrap at 16); `waited` is how many frames
    waited at once to be read, at most; `failure` is why the bus could not be read any longer.
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
        """Whether nothing speaks against a whole log."""
        return not (self.lost or self.failure) and self.waited < _SUSPECT_BACKLOG

    @property
    def verdict(self) -> str:
        """The verdict line."""
        if self.lost:
            loss = f"at least {self.lost} frames lost, by their alive counters"
        elif self.waited >= _SUSPECT_BACKLOG:
            loss = f"frames may be lost: {self.waited} waited at once, and a full bus takes no more"
        else:
            loss = "no frame lost"
        return f"{self.seconds:.1f} s recorded, {loss}" + (f"; the bus failed: {self.failure}" if self.failure else "")

    @property
    def text(self) -> str:
        """What was read and written, for people."""
        rows = [("frame", "count", "frames/s")]
        rows += [(name, f"{count}", f"{count / max(self.seconds, 1e-3):.1f}") for name, count in self.frames.items()]
        total = sum(self.frames.values())
        return "\n".join([f"read:    bus {self.bus}", table_text(rows), f"wrote:   {self.path}  ({total} frames)"])

    @property
    def document(self) -> dict[str, Any]:
        """The same for machines."""
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
        if path.suffix not in WRITERS:
            raise InputError(f"CAN log {path} cannot be written as {path.suffix!r}; allowed are {listing(WRITERS)}")
        self.bus, self.path = resolve(bus), path
        open_bus(self.bus).close()  # tells what is wrong with a bus in one sentence
        self._codecs = {codec.can_id: codec for codec in bus_frames(clutches=len(CLUTCHES))}
        self._receptions = {can_id: Reception(codec) for can_id, codec in self._codecs.items()}
        self._sessions: dict[str, int] = {}  # of the services, by heartbeat
        self._counts: Counter[str] = Counter()
        self._lost_before = 0  # before the receptions began
        self._last_supervised = 0.0  # s, time stamp of the newest frame of a supervisor

    def record(self, stop: Stop, seconds: float | None, progress: Callable[[str], None]) -> CanLogResult:
        """Write what comes until `stop` is asked or `seconds` after the first frame. Raises InputError when none comes.

        Time stamps are those of the bus: the kernel's at reception, on a local bus the sender's.
        """
        interface, _, channel = self.bus.rpartition(":")
        first = last = 0.0
        backlog = Backlog()
        last_report, failure = time.monotonic(), ""
        with whole_file(self.path) as part:
            bus = can.Bus(channel, interface=interface or "socketcan")
            with WRITERS[self.path.suffix](part) as writer, bus:  # the bus is left first: we read no more
                try:
                    for message in _receive(bus, stop, seconds):
                        backlog.note(message.timestamp, time.time())
                        first = first or message.timestamp
                        # two senders may race for the first place; a log begins with its first line
                        last = message.timestamp = max(message.timestamp, first)
                        writer.on_message_received(message)
                        self._count(message)
                        if time.monotonic() - last_report > _PROGRESS_INTERVAL:
                            last_report = time.monotonic()
                            progress(f"{last - first:.1f} s, {self._counts.total()} frames, lost {self._count_lost()}")
                except can.CanError as error:
                    failure = str(error)
            if not self._counts:
                stop.check(f"no frame had come on bus {self.bus}; nothing was recorded")
                raise InputError(f"no frame came on bus {self.bus}; nothing was recorded")
        counts = dict(sorted(self._counts.items()))
        return CanLogResult(self.bus, self.path, counts, last - first, self._count_lost(), backlog.most, failure)

    def _count(self, message: can.Message) -> None:
        """Count a frame and, by its alive counter, those that should have come before it."""
        can_id = message.arbitration_id
        codec = self._codecs.get(can_id)
        if codec is None or message.is_extended_id or message.is_error_frame or message.dlc != codec.length:
            self._counts["error frame" if message.is_error_frame else f"0x{can_id:03X}"] += 1
            return
        self._counts[codec.name] += 1
        data = bytes(message.data)
        if codec.name in _HEARTBEATS and self._sessions.get(codec.name) != (session := codec.unpack(data).session):
            self._sessions[codec.name] = session
            self._restart_receptions(codec.sender)
        if codec.sender == _SUPERVISOR:
            if message.timestamp - self._last_supervised > _SUPERVISOR_SILENCE:
                self._restart_receptions(_SUPERVISOR)
            self._last_supervised = message.timestamp
        self._receptions[can_id].accept(data)

    def _restart_receptions(self, sender: str) -> None:
        """Expect any alive counters of a sender: it has started."""
        for can_id, codec in self._codecs.items():
            if codec.sender == sender:
                self._lost_before += self._receptions[can_id].lost
                self._receptions[can_id] = Reception(codec)

    def _count_lost(self) -> int:
        return self._lost_before + sum(reception.lost for reception in self._receptions.values())


class Backlog:
    """How many frames waited at once to be read: `most` counts those that had been sent when the first of them was read."""

    def __init__(self) -> None:
        self.most = 0
        self._checked_at = 0.0  # UNIX time [s]
        self._read_since = 0  # frames sent before `_checked_at` and read since

    def note(self, sent: float, now: float) -> None:
        """A frame that was `sent` is read `now`; UNIX times [s]."""
        if sent > self._checked_at:
            self._checked_at, self._read_since = now, 0
        self._read_since += 1
        self.most = max(self.most, self._read_since)


def _receive(bus: can.BusABC, stop: Stop, seconds: float | None) -> Iterator[can.Message]:
    """What comes until `stop` is asked or `seconds` after the first message, and then what waits already."""
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
