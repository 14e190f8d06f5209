"""Bench log: the samples of a recorded bus, and the valve commands that answered them.

Frames that a bus port ignores (remote, CAN FD, error, extended identifiers) are counted and left out. Frames with a wrong CRC
or length stay: the controller rejects them, as it does on a bus. Frames of version 1 are converted (`version_1.py`).
"""

from collections import Counter
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import overload

import numpy as np

from protocols.can.frames import Frame, FrameCodec, load_frames
from protocols.can.lifecycle import Lifecycle
from protocols.can.traffic import Traffic
from protocols.can.version import VERSION_1, VERSION_2
from protocols.errors import InputError
from protocols.files.bus_logs import version_1
from protocols.files.bus_logs.bus_frames import FLAG_NAMES, BusLog
from protocols.files.bus_logs.bus_log import check_size, iterate, mark_bench_frames, read_bus_log

COMPARED_FRAMES = ("VALVE_COMMAND", "MOTOR_COMMAND", "CONTROLLER_STATUS")
_FRAMES_BEFORE_START = 64  # frames before the first sample that its cycle still receives, as in service.py
_COUNTED = ("corrupt", "repeated", "misshapen", "conflicting", "wrong_sequence")  # in the document for JSON


class Samples(Sequence[list[Frame]]):
    """Frames of each sample, made on access: a log of half an hour has ten million."""

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

    `channel` selects a channel if several have frames of the bench. rate [Hz]; `samples`: frames by sample; `answers`:
    payloads by index of the sample; `seconds`: duration of the log; `notes`: decisions, one sentence each; `traffic`:
    counts of all frames; `ignored`: number of frames by kind that a bus port ignores; `defects`: what is wrong, "" for nothing.
    `version`: of the frames in the log. `setpoint`: with `exact`, the definition of TORQUE_SETPOINT in `samples` if it is not
    the bench's own, as set-points of version 1 have smaller steps. Without `exact` they are rounded to the steps of version 2.
    """

    def __init__(self, path: Path, channel: str | None = None, exact: bool = True) -> None:
        codecs = load_frames()
        whole = read_bus_log(path)
        carries = mark_bench_frames(whole, VERSION_2) | mark_bench_frames(whole, VERSION_1)
        if not carries.any():
            check_size(whole)
        log = whole.select_channel(channel, carries, "frames of the bench", "choose one with --channel")
        self.version = VERSION_1 if version_1.find_old_channels(log) else VERSION_2
        self.setpoint: FrameCodec | None = None
        if self.version is VERSION_1:
            self.setpoint = version_1.fit_setpoint(log) if exact else None
            rounded = "" if self.setpoint else ", whose set-points have larger steps: answers can differ by them"
            log.notes.append(version_1.NOTE + rounded)
            log = version_1.convert_frames(log, self.setpoint)
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
            self.notes.append(f"ignored frames with identifiers of the bench, as on a bus: {counts}")

    def _sort(self, log: BusLog, codecs: dict[str, FrameCodec]) -> tuple[np.ndarray, np.ndarray]:
        """Return the rows of the frames that the controller gets, and the end of each sample among them."""
        by_id = {codec.can_id: codec for codec in codecs.values()}
        own = {codecs[name].can_id for name in (*COMPARED_FRAMES, "CONTROLLER_HEARTBEAT")}
        second = load_frames(clutch="b")["ENCODER"]
        encoder, valve, heartbeat = codecs["ENCODER"], codecs["VALVE_COMMAND"], codecs["PLANT_HEARTBEAT"]
        ticks: dict[int, int] = {}
        # samples; the tick of an older one may be that of a missing sample
        oldest = 1 << encoder.bits["sample_tick"] - 1
        rows: list[int] = []
        ends: list[int] = []
        first, last, ended = None, 0.0, False
        for row, (stamp, can_id, flags, data) in enumerate(iterate(log)):
            codec = by_id.get(can_id)
            if codec is None:
                if can_id == second.can_id and not flags and second.is_valid(data):
                    raise InputError(
                        f"log {log.path} is of a run of two clutches, whose controllers receive each other's frames; only"
                        " a log of one clutch can be replayed"
                    )
                continue
            if flags:
                self.ignored[next(name for flag, name in FLAG_NAMES.items() if flags & flag)] += 1
                continue
            if ended and codec is encoder:
                self.notes.append(
                    f"left out the frames after the end of the plant, {stamp - (first or stamp):.3f} s after the start"
                )
                break
            if ended:
                continue
            first, last = stamp if first is None else first, stamp
            used = self.traffic.take(stamp, can_id, data)
            if can_id in own:
                index = ticks.get(valve.raw(data).sample_tick) if can_id == valve.can_id and used else None
                if index is not None and len(ends) - index <= oldest:
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

    def is_answer(self, index: int, data: bytes) -> bool:
        """Return whether the valve command `data` says the same as the logged answer to sample `index`.

        Enable, voltage and tick are compared. The counter is not: all counters after a cycle that the controller of the log
        left out are other ones.
        """
        valve = load_frames()["VALVE_COMMAND"]
        return valve.raw(data) == valve.raw(self.answers[index])

    @property
    def begins_late(self) -> bool:
        """Whether the first logged valve command is not the first of its controller, whose state is then not known."""
        first = min(self.answers, default=None)
        valve = load_frames()["VALVE_COMMAND"]
        return first is not None and valve.read_counter(self.answers[first]) != first % self.version.counter_modulus

    @property
    def defects(self) -> str:
        """Text on what is missing or wrong in the log, because of which answers can differ; "" if nothing is."""
        counts = {
            "lost (by their counters)": self._lost, "corrupt": self.traffic.count("corrupt"),
            "repeated": self.traffic.count("repeated"), "of wrong length": self.traffic.count("misshapen"),
            "conflicting": self.traffic.count("conflicting"), "out of sequence": self.traffic.count("wrong_sequence"),
        }  # fmt: skip
        parts = [f"{count} {what}" for what, count in counts.items() if count]
        sentences = [f"frames {', '.join(parts)}"] if parts else []
        sentences += [f"{self.damaged} lines damaged"] if self.damaged else []
        sentences += ["the log is cut"] if self.cut else []
        return "; ".join(sentences)

    @property
    def _lost(self) -> int:
        """Number of frames missing in the log. Corrupt frames, and frames of wrong length, also leave gaps in the counters."""
        return max(self.traffic.count("lost") - self.traffic.count("corrupt") - self.traffic.count("misshapen"), 0)

    @property
    def document(self) -> dict:
        """Counts, for JSON."""
        counts = {what: self.traffic.count(what) for what in _COUNTED}
        return {
            "channel": self.channel, "lost": self._lost, **counts, "ignored": dict(self.ignored), "damaged": self.damaged,
            "cut": self.cut or None, "notes": self.notes, "defects": self.defects or None,
        }  # fmt: skip
