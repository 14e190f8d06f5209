"""Bench log: the samples of a recorded bus, and the valve commands that answered them.

Frames that a bus port ignores (remote, CAN FD, error, extended identifiers) are counted and left out. Frames with a wrong CRC
or length stay: the controller rejects them, as it does on a bus.
"""

from collections import Counter
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import overload

import numpy as np

from protocols.can.frames import Frame, FrameCodec, list_bus_frames, load_frames
from protocols.can.lifecycle import Lifecycle
from protocols.can.traffic import Traffic
from protocols.can.two_clutches import CLUTCHES
from protocols.errors import InputError
from protocols.files.bus_frames import EXTENDED, FLAG_NAMES, BusLog
from protocols.files.bus_log import check_crcs, iterate, read_bus_log

COMPARED_FRAMES = ("VALVE_COMMAND", "MOTOR_COMMAND", "CONTROLLER_STATUS")
_FRAMES_BEFORE_START = 64  # frames before the first sample that its cycle still receives, as in service.py
_VALID_SHARE = (
    0.5  # of a channel's frames on the bench's identifiers: a wrong CRC passes in 1 of 256, another bus has none
)


class Samples(Sequence[list[Frame]]):
    """Frames of each sample, made when they are asked for: a log of half an hour has ten million."""

    def __init__(self, log: BusLog, rows: np.ndarray, ends: np.ndarray) -> None:
        self._log, self._rows, self._ends = log, rows, ends

    def __len__(self) -> int:
        return len(self._ends)

    @overload
    def __getitem__(self, index: int) -> list[Frame]: ...

    @overload
    def __getitem__(self, index: slice) -> "list[list[Frame]]": ...

    def __getitem__(self, index: int | slice) -> "list[Frame] | list[list[Frame]]":
        if isinstance(index, slice):
            return [self[k] for k in range(*index.indices(len(self)))]
        index = range(len(self))[index]
        first = max(self._ends[0] - _FRAMES_BEFORE_START, 0) if index == 0 else self._ends[index - 1]
        rows = self._rows[first : self._ends[index]].tolist()
        return [Frame(int(self._log.ids[row]), self._log.read_data(row)) for row in rows]

    def __iter__(self) -> Iterator[list[Frame]]:
        return (self[index] for index in range(len(self)))


class Log:
    """Samples of a log and the valve commands that answered them. Raises InputError for a file that is no log of the bench.

    `channel` is the one to take, where several have frames of the bench. rate [Hz]; `samples`: frames by sample; `answers`:
    payloads by index of the sample; `seconds`: duration of the log; `notes`: what was decided, a sentence each; `traffic`:
    counts of all frames; `ignored`: number of frames by kind that a bus port ignores; `defects`: what is wrong, "" for nothing.
    """

    def __init__(self, path: Path, channel: str | None = None) -> None:
        codecs = load_frames()
        whole = read_bus_log(path)
        log = whole.select_channel(channel, _select_bench_frames(whole), "frames of the bench", "give one by --channel")
        self.channel = log.channels[int(log.channel[0])] if len(log) else ""
        self.rate, self.seconds, self.notes, self.cut, self.damaged = 0, 0.0, log.notes, log.cut, log.damaged
        self.traffic, self.ignored = Traffic(list(codecs.values())), Counter[str]()
        self.answers: dict[int, bytes] = {}  # payload of the valve command by index of its sample
        rows, ends = self._sort(log, codecs)
        if not len(ends) or not self.rate:
            raise InputError(f"log {path} has no {'heartbeat' if len(ends) else 'sample'} of a plant")
        self.samples = Samples(log, rows, ends)
        if self.ignored:
            counts = ", ".join(f"{count} {name}" for name, count in self.ignored.items())
            self.notes.append(f"ignored frames on identifiers of the bench, as on a bus: {counts}")

    def _sort(self, log: BusLog, codecs: dict[str, FrameCodec]) -> tuple[np.ndarray, np.ndarray]:
        """Rows of the frames that the controller gets, and the end of each sample among them."""
        by_id = {codec.can_id: codec for codec in codecs.values()}
        own = {codecs[name].can_id for name in (*COMPARED_FRAMES, "CONTROLLER_HEARTBEAT")}
        second = load_frames(clutch="b")["ENCODER"]
        encoder, valve, heartbeat = codecs["ENCODER"], codecs["VALVE_COMMAND"], codecs["PLANT_HEARTBEAT"]
        ticks: dict[int, int] = {}
        rows: list[int] = []
        ends: list[int] = []
        first, last, ended = None, 0.0, False
        for row, (stamp, can_id, flags, data) in enumerate(iterate(log)):
            codec = by_id.get(can_id)
            if codec is None:
                if can_id == second.can_id and not flags and second.is_valid(data):
                    raise InputError(
                        f"log {log.path} is of a run of two clutches, whose controllers hear each other; what can be replayed"
                        " is a log of one clutch"
                    )
                continue
            if flags:
                self.ignored[next(name for flag, name in FLAG_NAMES.items() if flags & flag)] += 1
                continue
            if ended and codec is encoder:
                self.notes.append(
                    f"left out what follows the end of the plant, {stamp - (first or stamp):.3f} s after the start"
                )
                break
            if ended:
                continue
            first, last = stamp if first is None else first, stamp
            used = self.traffic.take(stamp, can_id, data)
            if can_id in own:
                if can_id == valve.can_id and used and (index := ticks.get(valve.raw(data).sample_tick)) is not None:
                    self.answers.setdefault(index, data)
                continue
            if codec is heartbeat and used:
                state = heartbeat.unpack(data)
                self.rate = self.rate or state.rate
                if state.lifecycle == Lifecycle.FINALIZED:
                    ended = True
                    continue
            rows.append(row)
            if codec is encoder and len(data) == encoder.length:
                if used:
                    ticks[encoder.raw(data).sample_tick] = len(ends)
                ends.append(len(rows))
        self.seconds = last - first if first is not None else 0.0
        return np.array(rows, np.int64), np.array(ends, np.int64)

    @property
    def defects(self) -> str:
        """What is missing or wrong in the log, by which answers can differ; "" where nothing is."""
        told = {
            "lost (by their counters)": self._lost, "corrupt": self.traffic.count("corrupt"),
            "repeated": self.traffic.count("repeated"), "of wrong length": self.traffic.count("misshapen"),
        }  # fmt: skip
        parts = [f"{count} {what}" for what, count in told.items() if count]
        sentences = [f"frames {', '.join(parts)}"] if parts else []
        sentences += [f"{self.damaged} lines damaged"] if self.damaged else []
        sentences += ["the log is cut"] if self.cut else []
        return "; ".join(sentences)

    @property
    def _lost(self) -> int:
        """Frames that are not in the log: a corrupt one, or one of wrong length, leaves a gap in the counters, too."""
        return max(self.traffic.count("lost") - self.traffic.count("corrupt") - self.traffic.count("misshapen"), 0)

    @property
    def document(self) -> dict:
        """What was counted, for JSON."""
        counts = {what: self.traffic.count(what) for what in ("corrupt", "repeated", "misshapen")}
        return {
            "channel": self.channel, "lost": self._lost, **counts, "ignored": dict(self.ignored), "damaged": self.damaged,
            "cut": self.cut or None, "notes": self.notes, "defects": self.defects or None,
        }  # fmt: skip


def _select_bench_frames(log: BusLog) -> np.ndarray:
    """Mask (frames,) of the frames on channels of the bench: those where most frames on its identifiers are valid."""
    mask = np.zeros(len(log), bool)
    ours = np.zeros(len(log), bool)
    for codec in list_bus_frames(clutches=len(CLUTCHES)):
        rows = np.flatnonzero((log.ids == codec.can_id) & ((log.flags & EXTENDED) == 0))
        ours[rows] = True
        rows = rows[(log.flags[rows] == 0) & (log.lengths[rows] == codec.length)]
        mask[rows] = check_crcs(log, rows, codec.length)
    for k in range(len(log.channels)):
        there = log.channel == k
        if np.count_nonzero(mask & there) < _VALID_SHARE * np.count_nonzero(ours & there):
            mask[there] = False
    return mask
