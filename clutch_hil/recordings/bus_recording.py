"""Recording of the signals of a bus log, by a DBC: each a channel, named Message.Signal; each message a raster."""

from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

import numpy as np
from cantools.database.can import Message, Signal

from clutch_hil.recordings import channel as recording
from clutch_hil.recordings.bench_samples import SoundFrames, find_samples
from clutch_hil.recordings.can_signals import (
    find_rows_with_signal,
    list_bit_places,
    list_multiplexers,
    read_physical_values,
)
from clutch_hil.recordings.channel import name_first
from clutch_hil.recordings.foreign import NEEDS_DATABASE
from clutch_hil.recordings.foreign_database import ForeignDatabase, read_foreign_database
from clutch_hil.recordings.j1939 import find_no_values, is_j1939, match_groups
from clutch_hil.recordings.state_names import note_names, note_other_numbers, number_by_states, take_names
from clutch_hil.recordings.value_tables import is_status, list_missing, list_names, list_state_names
from protocols.can.claim import BOUND, bind_data_id
from protocols.can.database import is_carried, read_data_id
from protocols.can.frames import DBC, DBC_1, FrameCodec
from protocols.can.version import VERSION_1, VERSION_2, Version, find_version
from protocols.errors import InputError, format_count, join_names
from protocols.files.bus_logs.bus_frames import ERROR, EXTENDED, FD, FLAG_NAMES, REMOTE, BusLog
from protocols.files.bus_logs.bus_log import check_crcs, check_size, find_claim_sessions, read_bus_log
from protocols.files.bus_logs.version_1 import find_old_channels

_SAMPLES = "SAMPLES"  # raster of the bench's samples
_EPOCH_S = 1e8  # s, three years: stamps above count from 1970
_MOST_NAMES = 20  # identifiers in a message for people
_LONGEST_SIGNAL = 64  # bits
_CLASSIC_BYTES = 8  # of a frame of classic CAN


def open_frames(path: Path, options: Mapping[str, Any], zero: float | None = None) -> recording.Recording:
    """The signals of the frames in a file. zero: time stamp of the time 0 [s]; that of the first frame if not given."""
    given = options.get("dbc")
    log = read_bus_log(path)
    dbc = find_database(path, given) if given else _choose_database(log, options.get("channel"))
    foreign = read_foreign_database(dbc)
    messages = {(m.frame_id, m.is_extended_frame): m for m in foreign.database.messages}
    j1939 = options.get("j1939")
    extended = log.ids[(log.flags & (EXTENDED | ERROR)) == EXTENDED]
    groups = match_groups(foreign.database, extended, j1939)
    if j1939 is None and not groups and (likely := match_groups(foreign.database, extended, True)):
        names = [f"0x{can_id:08X} that of {message.name}" for can_id, message in likely.items()]
        log.notes.append(
            f"identifiers have a parameter group of J1939 in common with a message, {name_first(names)}; set j1939 = true in"
            " [file] where the bus is one"
        )
    messages |= {(can_id, True): message for can_id, message in groups.items()}
    if errors := np.count_nonzero(log.flags & ERROR):
        log.notes.append(f"left out {errors} error frames")
    known = _find_known(log, messages)
    log = log.select_channel(
        options.get("channel"), known, f"messages of {dbc.name}", 'write channel = "NAME" in [file]'
    )
    return _BusRecording(path, dbc, foreign, log, messages, bool(given), zero, j1939)


@dataclass(frozen=True)
class _Raster:
    """Frames of a message with one identifier: indices (n,) in the log, payloads (n, bytes), and bytes that each has (n,)."""

    message: Message
    can_id: int
    rows: np.ndarray
    payloads: np.ndarray
    lengths: np.ndarray

    def select(self, chosen: np.ndarray) -> "_Raster":
        """Return the frames of a mask (n,)."""
        return _Raster(self.message, self.can_id, self.rows[chosen], self.payloads[chosen], self.lengths[chosen])


class _BusRecording:
    """See `clutch_hil.recordings.channel.Recording`."""

    def __init__(
        self,
        path: Path,
        dbc: Path,
        foreign: ForeignDatabase,
        log: BusLog,
        messages: Mapping[tuple[int, bool], Message],
        given: bool,
        zero: float | None,
        said_j1939: bool | None,
    ) -> None:
        version = find_version(foreign.database)
        self._path, self._database, self._left_out = path, foreign.database, foreign.left_out
        self._said_j1939 = said_j1939
        self.numbers: Mapping[str, float] = {}
        self.notes = [
            *log.notes,
            f"signals by {dbc.name}" + ("" if given else ", the bench's own: the map names no dbc"),
        ]
        self.notes += foreign.notes
        if not given and version is VERSION_1:
            self.notes.append(
                "frames of version 1 of the bench's database, with a CRC of 8 bits, are read by that version"
            )
        self._version, self._given = version, given
        if zero is None:
            zero = float(log.stamps[0]) if len(log) else 0.0
        self.start = ""
        if zero > _EPOCH_S:
            try:
                self.start = datetime.fromtimestamp(zero, UTC).isoformat()
            except (OverflowError, ValueError, OSError):
                self.start = ""
        self._times = log.stamps - zero
        self._rasters = self._sort(log, messages)
        if not self._rasters:
            raise self._refuse(path, dbc, log, messages)
        self._signals: dict[int, tuple[_Raster, Signal]] = {}
        self._clocks: dict[int, _Raster] = {}
        frames = {one.message.name: SoundFrames(one.rows, one.payloads) for one in self._rasters}
        self._samples = None if given or version is VERSION_1 else find_samples(log, frames)
        self._of_samples: dict[int, str] = {}  # channel by number -> column of the samples
        self.channels: Sequence[recording.Channel] = self._list()
        if not self.channels:
            raise self._refuse(path, dbc, log, messages)

    def _refuse(self, path: Path, dbc: Path, log: BusLog, messages: Mapping[tuple[int, bool], Message]) -> InputError:
        """The error for a log without frames that carry signals."""
        if _find_known(log, messages, with_remote=True).any():
            why = [note for note in self.notes if note.startswith("left out")] or ["these have no signals"]
            return InputError(f"recording {path} has messages of {dbc}, and none that can be read: {'; '.join(why)}")
        of_data = (log.flags & ERROR) == 0
        ids = np.unique(np.stack([log.ids[of_data], (log.flags[of_data] & EXTENDED) != 0]), axis=1).T
        if not len(ids):
            return InputError(f"recording {path} has no message of {dbc}: it has error frames only")
        seen = [f"0x{can_id:0{8 if extended else 3}X}" for can_id, extended in ids[: _MOST_NAMES + 1].tolist()]
        more = ", ..." if len(seen) > _MOST_NAMES else ""
        remedy = _find_other_kind(ids.tolist(), messages) or next(
            (note for note in log.notes if "j1939 = true" in note), NEEDS_DATABASE
        )
        return InputError(
            f"recording {path} has no message of {dbc}; its identifiers are {', '.join(seen[:_MOST_NAMES])}{more}; {remedy}"
        )

    def _sort(self, log: BusLog, messages: Mapping[tuple[int, bool], Message]) -> list[_Raster]:
        """Frames by message, without those that cannot carry its signals; what was left out is noted."""
        rasters: list[_Raster] = []
        unsound = {name for name, _ in self._left_out}
        sessions = {
            BOUND[message.name]: find_claim_sessions(log, FrameCodec(message, self._version))
            for message in messages.values()
            if message.name in BOUND and message.name not in unsound and is_carried(message, self._version)
        }
        unknown: dict[str, int] = {}
        for can_id, extended, there in _split_by_identifier(log, np.flatnonzero((log.flags & ERROR) == 0)):
            message = messages.get((can_id, extended))
            if message is None:
                unknown[f"0x{can_id:X}"] = len(there)
                continue
            flags = log.flags[there]
            # many databases do not tell which frames are CAN FD (VFrameFormat)
            strange = (flags & ~np.uint8(EXTENDED | (FD if message.is_fd or self._given else 0))) != 0
            lengths = log.lengths[there]
            enough = lengths >= message.length
            if self._given and not is_carried(message, self._version):
                # classic frames of a longer message are rather packets of it
                in_part = (
                    (lengths > 0) & ((message.length <= _CLASSIC_BYTES) | ((flags & FD) != 0)) & ~enough & ~strange
                )
                if in_part.any():
                    self.notes.append(
                        f"{format_count(np.count_nonzero(in_part), 'frame')} of {message.name} with fewer than"
                        f" {message.length} bytes: the signals whose bits they have are read"
                    )
                enough |= in_part
            rows = there[~strange & enough]
            short = len(there) - np.count_nonzero(strange) - len(rows)
            if kinds := [
                name for flag, name in FLAG_NAMES.items() if flag != EXTENDED and np.any(flags[strange] & flag)
            ]:
                self.notes.append(
                    f"left out {format_count(np.count_nonzero(strange), 'frame')} of {message.name}: {', '.join(kinds)}"
                )
            if short:
                packets = message.length > _CLASSIC_BYTES and message.is_extended_frame and not len(rows)
                self.notes.append(
                    f"left out {format_count(short, 'frame')} of {message.name} with fewer than {message.length} bytes"
                    f"{', as packets of several frames (NMEA 2000, J1939 TP) are not joined' if packets else ''}"
                )
            if longer := np.count_nonzero(log.lengths[rows] > message.length):
                self.notes.append(
                    f"{format_count(longer, 'frame')} of {message.name} with more than {message.length} bytes"
                )
            protected = bool(read_data_id(message)) or not self._version.needs_data_id
            if protected and is_carried(message, self._version) and len(rows):
                data_id = read_data_id(message)
                good = check_crcs(log, rows, message.length, data_id, self._version)
                for session in sessions.get(message.name, ()):
                    good |= check_crcs(log, rows, message.length, bind_data_id(data_id, session))
                if not good.all():
                    self.notes.append(
                        f"left out {format_count(np.count_nonzero(~good), 'frame')} of {message.name} with a wrong CRC"
                    )
                rows = rows[good]
                lost = _count_lost(log, rows, self._version) - np.count_nonzero(~good)
                if lost > 0:
                    self.notes.append(f"missing by the alive counters: {format_count(lost, 'frame')} of {message.name}")
            if len(rows) and message.signals:
                payloads = log.read_padded(rows, message.length)
                rasters.append(_Raster(message, can_id, rows, payloads, log.lengths[rows]))
        if unknown:
            count, others = sum(unknown.values()), list(unknown)
            names = join_names(others[:_MOST_NAMES]) + (", ..." if len(others) > _MOST_NAMES else "")
            self.notes.append(f"left out {format_count(count, 'frame')} that the database does not have: {names}")
        return rasters

    def _list(self) -> list[recording.Channel]:
        channels: list[recording.Channel] = []
        identifiers = Counter(raster.message.name for raster in self._rasters)
        for raster in self._rasters:
            message = raster.message
            # of J1939, several nodes may send one message
            sender = f"@0x{raster.can_id:X}" if identifiers[message.name] > 1 else ""
            if raster.can_id != message.frame_id:
                self.notes.append(f"frames 0x{raster.can_id:X} are {message.name} by their parameter group (J1939)")
            by_name = {signal.name: signal for signal in message.signals}
            clocks: set[str] = set()
            for signal in message.signals:
                if (message.name, signal.name) in self._left_out:
                    continue
                if signal.length > _LONGEST_SIGNAL or max(list_bit_places(signal)) >= 8 * message.length:
                    self.notes.append(f"left out {message.name}.{signal.name}: its bits are not in the frame")
                    continue
                selected = list(list_multiplexers(signal, by_name))
                needed = 1 + max(max(list_bit_places(one)) for one in (signal, *(one for one, _ in selected))) // 8
                long_enough = raster.lengths >= needed
                if not long_enough.any():
                    self.notes.append(f"left out {message.name}.{signal.name}: no frame has its bits")
                    continue
                pages = [f"{one.name}={','.join(map(str, ids))}" for one, ids in selected]
                if not long_enough.all():
                    pages.append(f"{raster.lengths[long_enough].min()} bytes")
                part = raster.select(find_rows_with_signal(message, signal, raster.payloads) & long_enough)
                if not len(part.rows):
                    continue
                name = message.name + sender + (f"[{' '.join(pages)}]" if pages else "")
                times = self._times[part.rows]
                span = float(times[-1] - times[0])
                common: dict[str, Any] = {
                    "raster": name, "rows": len(times), "start_s": float(times[0]), "end_s": float(times[-1]),
                    "rate_hz": (len(times) - 1) / span if span > 0.0 else float("nan"),
                }  # fmt: skip
                if name not in clocks:
                    clocks.add(name)
                    number = len(channels) + 1
                    self._clocks[number] = part
                    channels.append(recording.Channel("time", number, f"{name}.time", "s", kind="time", **common))
                number = len(channels) + 1
                self._signals[number] = (part, signal)
                kind = "status" if is_status(signal) else "number"
                path = f"{message.name}{sender}.{signal.name}"
                plain, comment = f"{message.name}.{signal.name}", str(signal.comment or "")
                channels.append(
                    recording.Channel(plain, number, path, signal.unit or "", kind=kind, comment=comment, **common)
                )
        return channels + self._list_samples(len(channels))

    def _list_samples(self, before: int) -> list[recording.Channel]:
        """Channels of the samples of the bench, numbered after `before` others; none where the log has no samples."""
        if self._samples is None:
            return []
        samples, count = self._samples, len(self._samples.time)
        start, span = float(self._times[samples.first]), float(samples.time[-1])
        common: dict[str, Any] = {
            "raster": _SAMPLES, "rows": count, "start_s": start, "end_s": start + span,
            "rate_hz": (count - 1) / span if span else float("nan"),
        }  # fmt: skip
        names = ("time", *samples.columns)
        self._of_samples = dict(enumerate(names, before + 1))
        return [
            recording.Channel(
                name if name == "time" else f"{_SAMPLES}.{name}", number, f"{_SAMPLES}.{name}",
                "s" if name == "time" else samples.units[name], kind="time" if name == "time" else "number", **common,
            )
            for number, name in self._of_samples.items()
        ]  # fmt: skip

    def read(self, channels: Sequence[recording.Channel]) -> list[recording.Signal]:
        return [self._read(channel) for channel in channels]

    def _read_sample(self, channel: recording.Channel) -> recording.Signal:
        assert self._samples is not None  # as it has such a channel
        name, times = self._of_samples[channel.number], float(self._times[self._samples.first]) + self._samples.time
        for note in self._samples.notes:
            self._note(note)
        return recording.Signal(channel, times if name == "time" else self._samples.columns[name], times)

    def _read(self, channel: recording.Channel) -> recording.Signal:
        if channel.number in self._of_samples:
            return self._read_sample(channel)
        if channel.number in self._clocks:
            times = self._times[self._clocks[channel.number].rows]
            return recording.Signal(channel, times, times)
        raster, signal = self._signals[channel.number]
        values = read_physical_values(signal, raster.payloads)
        self._note_missing(channel.path, signal, values)
        if channel.states and (all_names := list_names(signal)):
            numbered = number_by_states(self._path, channel, values, all_names)
            return replace(numbered, time=self._times[raster.rows])
        names = list_state_names(signal)
        if taken := take_names(values, names):
            values, notes = taken
            self._note(note_names(channel.path, notes))
        elif note := note_other_numbers(channel.path, names):
            self._note(note)
        if is_j1939(self._database, raster.message, self._said_j1939):
            absent = find_no_values(signal, raster.payloads)
            values[absent] = np.nan
            if absent.any():
                self._note(
                    f"{channel.path}: {format_count(np.count_nonzero(absent), 'sample')} with an error or not available (J1939)"
                )
        return recording.Signal(channel, values, self._times[raster.rows])

    def _note_missing(self, path: str, signal: Signal, values: np.ndarray) -> None:
        if (names := list_missing(signal)) and (count := np.count_nonzero(np.isnan(values))):
            missing = f"{format_count(count, 'sample')} without a value by the database"
            note = f"{path}: {missing}: {name_first(list(names.values()))}"
            self._note(note)

    def _note(self, note: str) -> None:
        self.notes += [note] if note not in self.notes else []


def _find_other_kind(ids: Sequence[Sequence[int]], messages: Mapping[tuple[int, bool], Message]) -> str:
    """That an identifier of a log has other bits than the one of that number in the database, "" where none has."""
    for can_id, extended in ids:
        if (can_id, not extended) in messages and (can_id, bool(extended)) not in messages:
            here, there = (29, 11) if extended else (11, 29)
            return f"0x{can_id:X} has {here} bits in the log and {there} in the database; correct the database"
    return ""


def find_database(recording_path: Path, name: str) -> Path:
    """The database as named, or beside the recording."""
    path = Path(name)
    beside = recording_path.parent / path
    return beside if not path.exists() and beside.exists() else path


def _split_by_identifier(log: BusLog, rows: np.ndarray) -> Iterator[tuple[int, bool, np.ndarray]]:
    """Identifier, whether it is extended, and those of the frames `rows` that have it, the lowest first."""
    keys = log.ids[rows].astype(np.int64) | ((log.flags[rows] & EXTENDED) != 0).astype(np.int64) << 32
    order = np.argsort(keys, kind="stable")
    there, firsts = np.unique(keys[order], return_index=True)
    for key, part in zip(there.tolist(), np.split(rows[order], firsts[1:])[: len(there)], strict=True):
        yield key & 0xFFFFFFFF, bool(key >> 32), part


def _choose_database(log: BusLog, channel: str | None) -> Path:
    """The bench's own database, of the version of the log's frames (on a channel). Raises InputError for another size."""
    names = [log.channels[k] for k in find_old_channels(log)]
    if channel in names or (names and channel is None):
        return DBC_1
    check_size(log)
    return DBC


def _count_lost(log: BusLog, rows: np.ndarray, version: Version) -> int:
    """Number of frames that the alive counters of the frames `rows` say are missing; they wrap, so more may be."""
    at = version.counter_start // 8
    counters = log.read_matrix(rows, at + 1)[:, at].astype(np.int64)
    steps = (counters[1:] - counters[:-1]) & version.counter_modulus - 1
    if version is VERSION_2:
        steps = steps[steps <= version.counter_modulus // 2]  # a larger step is one back
    return int(np.sum(steps[steps > 0] - 1))


def _find_known(log: BusLog, messages: Mapping[tuple[int, bool], Message], with_remote: bool = False) -> np.ndarray:
    """Mask (frames,) of the frames of `messages`, with or without remote ones."""
    extended = (log.flags & EXTENDED) != 0
    mask = np.zeros(len(log), bool)
    for of_kind in (False, True):
        ids = [can_id for can_id, is_extended in messages if is_extended is of_kind]
        mask |= (extended == of_kind) & np.isin(log.ids, np.array(ids, np.int64))
    return mask & ((log.flags & ~np.uint8(EXTENDED | FD | (REMOTE if with_remote else 0))) == 0)
