"""Measurement data format (ASAM MDF 3 and 4): files of INCA, CANape, CANoe, loggers; finished or not, with any suffix.

Only a master that counts time gives times: its values become seconds, whatever its unit. Rows over an angle, a distance or an
index have no time, unless the map names a column of the group as `time_s`.
"""

from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import replace
from math import isfinite, nan
from pathlib import Path
from typing import Any, ClassVar

import numpy as np

from clutch_hil.recordings.channel import Channel, Recording, Signal, name_first, simplify_unit
from clutch_hil.recordings.foreign import NEEDS_DATABASE
from clutch_hil.recordings.formats.bus_log import BusLogFormat
from clutch_hil.recordings.state_names import (
    note_names,
    note_other_numbers,
    number_by_states,
    says_no_value,
    take_names,
)
from clutch_hil.recordings.text_values import convert_texts
from clutch_hil.recordings.unit_in_name import is_unit, take_unit
from protocols.errors import InputError, format_count
from protocols.files.bounds import check_rows
from protocols.files.mdf.conversions import TEXT
from protocols.files.mdf.file import MAGIC, MdfFile
from protocols.files.mdf.groups import BUS_MESSAGES, MdfChannel, MdfGroup
from protocols.files.units import have_same_quantity, to_si

_MASTER_UNITS = {"angle": "rad", "distance": "m", "index": "1"}  # ASAM MDF 4.2, table 17; where the file writes none
_MOST_PROBED = 200  # groups whose first and last times are shown: each may inflate two blocks of 4 MB, 10 ms


class Mdf:
    """MDF 3 and 4."""

    name = "MDF"
    keys: ClassVar[Mapping[str, type]] = BusLogFormat.keys  # of the frames that a file may have beside its signals
    order = 0

    def recognises(self, head: bytes, path: Path) -> bool:
        return head[:8] in MAGIC

    def open(self, path: Path, options: Mapping[str, Any]) -> Recording:
        file = MdfFile(path)
        if BUS_MESSAGES not in file.left_out:
            return MdfRecording(path, file)
        from clutch_hil.recordings.bus_recording import open_frames  # loads what decodes frames: 0.3 s

        try:
            frames = open_frames(path, options, file.start_stamp)
        except InputError:
            if options:
                raise
            return MdfRecording(path, file)  # which tells what it leaves out
        del file.left_out[BUS_MESSAGES]
        return SignalsAndFrames(MdfRecording(path, file), frames)


class SignalsAndFrames:
    """A Recording in an MDF file of signals and of frames of a bus, decoded by a database; numbers of the frames come last."""

    def __init__(self, signals: "MdfRecording", frames: Recording) -> None:
        self._parts = (signals, frames)
        self._first = len(signals.channels)
        self.numbers: Mapping[str, float] = {}
        self.notes = [*signals.notes, *(note for note in frames.notes if note not in signals.notes)]
        self.start = signals.start
        shifted = [replace(channel, number=channel.number + self._first) for channel in frames.channels]
        self.channels: Sequence[Channel] = [*signals.channels, *shifted]

    def read(self, channels: Sequence[Channel]) -> list[Signal]:
        signals, frames = self._parts
        of_signals = [channel for channel in channels if channel.number <= self._first]
        own = signals.read(of_signals) if of_signals else []
        others = [channel for channel in channels if channel.number > self._first]
        decoded = frames.read([replace(channel, number=channel.number - self._first) for channel in others])
        self.notes += [note for note in frames.notes if note not in self.notes]
        by_number = {signal.channel.number: signal for signal in own}
        by_number |= {c.number: replace(s, channel=c) for c, s in zip(others, decoded, strict=True)}
        return [by_number[channel.number] for channel in channels]


class MdfRecording:
    """A Recording in an MDF file."""

    def __init__(self, path: Path, file: MdfFile) -> None:
        self._path, self._file = path, file
        self.numbers: Mapping[str, float] = {}
        self.notes: list[str] = []
        self.start = self._file.start
        self._seconds: dict[MdfChannel, float] = {}  # of one unit of each time axis
        self._places: dict[int, tuple[MdfGroup, MdfChannel]] = {}  # by number of the channel
        self._describe()
        self.channels: Sequence[Channel] = self._list()

    def read(self, channels: Sequence[Channel]) -> list[Signal]:
        places = [self._places[channel.number] for channel in channels]
        axes = [group.master for group, _ in places if group.master in self._seconds]
        numbers = [one for _, one in places if one.kind != TEXT]
        wanted = dict.fromkeys(numbers + [axis for axis in axes if axis])
        check_rows(
            f"recording {self._path}: the requested channels have", max(group.rows for group, _ in places), len(wanted)
        )
        values = self._file.read(wanted)
        for axis, seconds in self._seconds.items():
            if axis in values and seconds != 1.0:
                values[axis] = seconds * values[axis]
        by_states: dict[MdfChannel, Signal] = {}
        for one, channel in {one: channel for channel, (_, one) in zip(channels, places, strict=True)}.items():
            if one.kind == TEXT:
                continue
            if one.kind == "status" and channel.kind == "number":
                self._drop_missing(channel, one, values[one])
                continue
            names = self._file.list_names(one) if one.kind == "status" else {}
            if channel.states and names:
                by_states[one] = number_by_states(self._path, channel, values[one], names)
                continue
            note = note_other_numbers(channel.path, names)
            if taken := take_names(values[one], names):
                values[one], notes = taken
                note = note_names(channel.path, notes)
            self.notes += [note] if note and note not in self.notes else []
        return [
            self._convert_texts(channel, group, one, self._read_axis(values, group))
            if one.kind == TEXT
            else replace(
                by_states[one], values=by_states[one].values[: group.rows], time=self._read_axis(values, group)
            )
            if one in by_states
            else Signal(channel, values[one][: group.rows], self._read_axis(values, group))
            for channel, (group, one) in zip(channels, places, strict=True)
        ]

    def _drop_missing(self, channel: Channel, one: MdfChannel, values: np.ndarray) -> None:
        """Set numbers (n,) whose names say that they are no value to NaN."""
        names = {number: name for number, name in self._file.list_names(one).items() if says_no_value(name)}
        absent = np.isin(values, list(names))
        values[absent] = nan
        if count := np.count_nonzero(absent):
            told = f"{format_count(count, 'sample')} without a value by the file: {name_first(list(names.values()))}"
            self.notes.append(f"{channel.path}: {told}")

    def _choose_kind(self, one: MdfChannel) -> str:
        """Kind of a channel. Numbers with a unit of which some have names stay numbers, as those of a DBC (value_tables.py)."""
        if one.kind != "status" or one.bits == 1 or simplify_unit(one.unit) in ("", "1") or not is_unit(one.unit):
            return one.kind
        return "number" if len(self._file.list_names(one)) < 1 << one.bits else one.kind

    def _convert_texts(self, channel: Channel, group: MdfGroup, one: MdfChannel, time: np.ndarray | None) -> Signal:
        texts = self._file.read_texts(one)[: group.rows]
        return replace(convert_texts(self._path, channel, texts, self.notes), time=time)

    def _read_axis(self, values: Mapping[MdfChannel, np.ndarray], group: MdfGroup) -> np.ndarray | None:
        return values[group.master][: group.rows] if group.master and group.master in self._seconds else None

    def _describe(self) -> None:
        """Note what the file is and what of it is left out, and find which masters are times."""
        if cut := self._file.condition.cut_text():
            self.notes.append(f"the file is cut or damaged at its end; read as far as its blocks reach: {cut}")
        if self._file.condition.unfinished:
            self.notes.append("the file was never finished by its writer; read as far as its blocks reach")
        for reason, names in self._file.left_out.items():
            how = f"; {NEEDS_DATABASE}" if reason == BUS_MESSAGES else ""
            self.notes.append(f"left out as {reason}: {name_first(names)}{how}")
        for master in dict.fromkeys(group.master for group in self._file.groups if group.master):
            self._describe_master(master)

    def _describe_master(self, master: MdfChannel) -> None:
        """Note what a master is. Where it is a time, keep the seconds of its unit; 1 where there is none, as MDF asks."""
        where = f"group {master.group + 1} is recorded over {master.name!r}"
        unit = simplify_unit(master.unit)
        known = _is_known(unit)
        seconds = to_si(1.0, unit) if known and have_same_quantity(unit, "s") else None
        if master.master == "time" and (seconds or not known):
            if not seconds and unit:
                self.notes.append(f"{where}, a time in the unknown unit {unit!r}; taken as seconds, as MDF asks")
            elif seconds not in (None, 1.0):
                self.notes.append(f"{where} in {unit}; converted to seconds")
            self._seconds[master] = seconds or 1.0
        elif master.master == "unknown" and seconds:
            self.notes.append(f"{where}, which is a time by its unit {unit} alone")
            self._seconds[master] = seconds
        else:
            self.notes.append(f"{where}, which counts {master.master} in {unit or 'no unit'}; it gives no time")

    def _list(self) -> list[Channel]:
        groups = self._file.groups
        count = Counter(one.name for group in groups for one in group.channels)
        channels: list[Channel] = []
        used: set[str] = set()
        for place, group in enumerate(groups):
            start, end = self._read_ends(group) if place < _MOST_PROBED else (nan, nan)
            rate = (group.rows - 1) / (end - start) if isfinite(start) and end > start else nan
            for one in group.channels:
                path = one.name if count[one.name] == 1 else f"group {one.group + 1}/{one.name}"
                if path in used:
                    path = f"group {one.group + 1}/{one.name}/{one.index + 1}"
                used.add(path)
                number = len(channels) + 1
                self._places[number] = (group, one)
                is_time = one in self._seconds
                kind = self._choose_kind(one)
                unit = "s" if is_time else "1" if kind == "status" else one.unit or _MASTER_UNITS.get(one.master, "")
                name, unit = take_unit(one.name, unit, kind)
                channels.append(
                    Channel(
                        name, number, path, unit, f"group {group.number + 1}", group.rows, rate, start, end,
                        "time" if is_time else kind, one.comment,
                    )
                )  # fmt: skip
        if not channels:
            held = f": it holds {' and '.join(self._file.left_out)}" if self._file.left_out else ""
            raise InputError(f"recording {self._path} has no channels to read{held}")
        return channels

    def _read_ends(self, group: MdfGroup) -> tuple[float, float]:
        """First and last time of a group [s]; not-a-number where it has no time."""
        if group.master not in self._seconds or not group.rows or group.master is None:
            return nan, nan
        first, last = self._file.read_ends(group.master)
        return self._seconds[group.master] * first, self._seconds[group.master] * last


def _is_known(unit: str) -> bool:
    try:
        to_si(1.0, unit)
    except InputError:
        return False
    return True
