"""TDMS of LabVIEW, VeriStand and DIAdem: groups of channels, each with a start and an increment, or beside a channel of times.

The index file beside one (.tdms_index) is not used: if it belongs to another recording, its numbers would be wrong.
"""

from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field, replace
from math import nan
from pathlib import Path
from typing import TYPE_CHECKING, Any, ClassVar

import numpy as np

from clutch_hil.recordings.channel import Channel, Signal, name_first
from clutch_hil.recordings.stated_rate import is_rate_name, split_value
from clutch_hil.recordings.stated_scaling import describe_scaling
from clutch_hil.recordings.stated_unit import join_units, list_unit_keys
from clutch_hil.recordings.tdms.file import INDEX_MAGIC, open_file
from clutch_hil.recordings.tdms.times import (
    FRACTION,
    Times,
    Timing,
    count_seconds_between,
    format_moment,
    is_number,
    read_times,
)
from clutch_hil.recordings.text_values import convert_texts
from clutch_hil.recordings.unit_in_name import take_unit
from protocols.errors import InputError, tell_reason
from protocols.files.bounds import check_bytes, check_rows
from protocols.files.quiet_libraries import quiet

if TYPE_CHECKING:
    from nptdms import TdmsChannel, TdmsFile

_MAGIC = b"TDSm"  # first bytes of a file
_MOST_PIECES = 1_000_000  # parts in which one channel is stored: each is read alone, which takes 10 us
_MOST_SCALES = 100  # scalings of a channel, one after another: DAQmx writes up to three
_SCALES = (
    "Polynomial", "Linear", "RTD", "Strain", "Table", "Thermistor", "Thermocouple", "Add", "Subtract", "AdvancedAPI",
)  # that nptdms computes; with another one it would give raw numbers  # fmt: skip
_LONGEST_REASON = 200  # characters of another library's sentence


class Tdms:
    """TDMS."""

    name = "TDMS"
    keys: ClassVar[Mapping[str, type]] = {}
    order = 0

    def recognises(self, head: bytes, path: Path) -> bool:
        return head.startswith((_MAGIC, INDEX_MAGIC))

    def open(self, path: Path, options: Mapping[str, Any]) -> "TdmsRecording":
        return TdmsRecording(path)


@dataclass
class _Raster:
    """Channels of a group that share their rows, of which the shortest has `rows`."""

    name: str
    rows: int
    times: Times
    stamps: "TdmsChannel | None" = None
    channels: list["TdmsChannel"] = field(default_factory=list)


class TdmsRecording:
    """A Recording in a TDMS file. Time 0 is the earliest start of a channel; each raster with times has a channel `time`."""

    def __init__(self, path: Path) -> None:
        self._path = path
        self.notes: list[str] = []
        self.start = ""
        with self._reading():
            self._file, self._statements = open_file(path)
            self._check_segments(self._file)
            self.numbers = {k: float(v) for k, v in self._file.properties.items() if is_number(v)}
            self.numbers |= _list_stated_rates(self._file)
            self._rasters = self._find_rasters(self._file)
        self._begin()
        self._tell_apart()
        self._sources: dict[int, tuple[_Raster, TdmsChannel | None]] = {}  # by number; None: the times of the raster
        self.channels: Sequence[Channel] = self._list()

    def read(self, channels: Sequence[Channel]) -> list[Signal]:
        sources = [self._sources[channel.number] for channel in channels]
        rows = max(raster.rows for raster, _ in sources)
        check_rows(f"recording {self._path}: the requested channels have", rows, 2 * len(channels))
        times = {id(raster): self._make_times(raster) for raster, _ in sources}
        return [
            self._read_texts(channel, raster, source, times[id(raster)])
            if channel.kind == "text" and source is not None
            else Signal(channel, self._read_values(channel, raster, source), times[id(raster)])
            for channel, (raster, source) in zip(channels, sources, strict=True)
        ]

    def _read_texts(self, channel: Channel, raster: _Raster, source: "TdmsChannel", time: np.ndarray | None) -> Signal:
        with self._reading():
            texts = [str(text) for text in source[:]][: raster.rows]
        return replace(convert_texts(self._path, channel, texts, self.notes), time=time)

    def _read_values(self, channel: Channel, raster: _Raster, source: "TdmsChannel | None") -> np.ndarray:
        if source is None and raster.times.fault:
            first = raster.channels[0]
            raise InputError(
                f"recording {self._path}: the times of '{first.group_name}/{first.name}' are not known, as it"
                f" {raster.times.fault}; split the file there, or, where the rows are evenly spaced, set"
                " time_s = { rate_hz = ... }"
            )
        if source is None or source is raster.stamps:
            times = self._make_times(raster)
            assert times is not None
            return times
        if channel.kind == "time":
            return self._read_stamps(source)[: raster.rows]
        self._check_scaling(source)
        with self._reading(), np.errstate(all="ignore"):
            values = np.asarray(source[:])
        if values.ndim != 1 or len(values) < raster.rows or values.dtype.kind not in "iufb":
            raise InputError(
                f"recording {self._path} cannot be read, it is cut or damaged: {channel.path!r} has {raster.rows} rows by its"
                f" header, and {len(values)} in its data"
            )
        with np.errstate(invalid="ignore"):  # bits of a damaged number
            return values[: raster.rows].astype(float)

    def _make_times(self, raster: _Raster) -> np.ndarray | None:
        """Times of a raster [s] from the start of the recording; None where none are known."""
        if raster.stamps is not None:
            return self._read_stamps(raster.stamps)[: raster.rows]
        if not raster.times.pieces:
            return None
        ends = [*(piece.row for piece in raster.times.pieces[1:]), raster.rows]
        return np.concatenate(
            [
                self._begin_of(piece) + piece.increment * np.arange(max(min(end, raster.rows) - piece.row, 0))
                for piece, end in zip(raster.times.pieces, ends, strict=True)
            ]
        )

    def _begin_of(self, timing: Timing) -> float:
        return timing.offset + (count_seconds_between(self._zero, timing.start) if timing.start and self._zero else 0.0)

    def _read_stamps(self, source: "TdmsChannel") -> np.ndarray:
        with self._reading():
            stamps = source[:]
            seconds, fractions = np.asarray(stamps["seconds"]), np.asarray(stamps["second_fractions"])
        zero, part = self._zero or (0, 0)
        return (seconds - zero).astype(float) + (fractions.astype(float) - part) * FRACTION

    def _begin(self) -> None:
        """Time 0: the earliest start of a channel, or the first time of day where no channel has one."""
        firsts = [raster.times.pieces[0] for raster in self._rasters if raster.times.pieces]
        starts = [first.start for first in firsts if first.start]
        for raster in self._rasters:
            if raster.stamps is not None and raster.rows:
                with self._reading():
                    first = raster.stamps[0]
                    starts.append((int(first.seconds), int(first.second_fractions)))
        self._zero = min(starts, default=None)
        if self._zero and self._zero[0] > 0:
            self.start = format_moment(self._zero)
        if len(set(starts)) > 1:
            late = count_seconds_between(min(starts), max(starts))
            self.notes.append(
                f"channels begin at {len(set(starts))} times of day, {late:.6g} s apart; time 0 is the first"
            )

    def _tell_apart(self) -> None:
        """Give each raster a name of its own: two of one group may have as many rows, and differ in rate or start."""
        count = Counter(raster.name for raster in self._rasters)
        for raster in self._rasters:
            if count[raster.name] > 1 and raster.times.pieces:
                begin, rate, _ = self._measure_span(raster)
                raster.name += f" at {rate:.6g} Hz from {begin:.6g} s"
        taken: set[str] = set()
        for raster in self._rasters:
            name, number = raster.name, 1
            while raster.name in taken:
                number += 1
                raster.name = f"{name} ({number})"
            taken.add(raster.name)

    def _find_rasters(self, file: "TdmsFile") -> list[_Raster]:
        """Rasters of a file, in its order. Channels of one group share their rows where their lengths and timings are one."""
        status = file.file_status
        lost: dict[str, int] = {}  # values that the last segment should have, by path of the channel
        if status.incomplete_final_segment:
            for path, of_channel in (status.channel_statuses or {}).items():
                lost[path] = of_channel.expected_length - of_channel.read_length
            self.notes.append(
                "the last segment is not whole, as the writer was stopped; read as far as the file reaches"
            )
        rasters: list[_Raster] = []
        for group in file.groups():
            raster_by_times: dict[tuple[int, Times], _Raster] = {}
            for channel in group.channels():
                rows = len(channel) + lost.get(channel.path, 0)
                key = (rows, read_times(channel, self._statements.get(channel.path, []), self.notes))
                raster = raster_by_times.setdefault(key, _Raster(group.name, rows, key[1]))
                raster.channels.append(channel)
                raster.rows = min(raster.rows, len(channel))
            for raster in raster_by_times.values():
                if not raster.times:
                    raster.stamps = next((channel for channel in raster.channels if _is_stamp(channel)), None)
                if len(raster_by_times) > 1:
                    raster.name = f"{group.name}, {raster.rows} rows" + (" with times" if raster.times else "")
                names = name_first([f"{channel.group_name}/{channel.name}" for channel in raster.channels])
                if raster.times.fault:
                    self.notes.append(f"{names}: no times are known, as it {raster.times.fault}")
                elif len(raster.times.pieces) > 1:
                    self.notes.append(
                        f"{names}: {len(raster.times.pieces)} acquisitions one after another, each with its own times"
                    )
            rasters += raster_by_times.values()
        return rasters

    def _list(self) -> list[Channel]:
        count = Counter(channel.name for raster in self._rasters for channel in raster.channels)
        left_out: list[str] = []
        channels: list[Channel] = []
        for raster in self._rasters:
            for source in raster.channels:
                if not (kind := self._find_kind(source)):
                    left_out.append(f"{source.group_name}/{source.name}")
                    continue
                path = source.name if count[source.name] == 1 else f"{source.group_name}/{source.name}"
                unit = {"time": "s", "status": "1"}.get(kind) or self._find_unit(source)
                comment = str(source.properties.get("description", ""))
                channels.append(self._make_channel(len(channels) + 1, raster, source, path, unit, kind, comment))
        taken = {channel.path for channel in channels}
        for raster in self._rasters:
            if raster.times:
                path = f"{raster.name}/time"
                path = f"{path} of the start" if path in taken else path
                comment = "from the start and the increment of its channels"
                channels.append(self._make_channel(len(channels) + 1, raster, None, path, "s", "time", comment))
        if left_out:
            self.notes.append(f"left out, as they hold neither numbers, times nor text: {name_first(left_out)}")
        if not channels:
            raise InputError(f"recording {self._path} is a TDMS file without channels")
        return channels

    def _find_unit(self, channel: "TdmsChannel") -> str:
        """The unit of a channel, or of its group where it is the only one there."""
        group = self._file[channel.group_name]
        return _read_unit(channel.properties) or (_read_unit(group.properties) if len(group.channels()) == 1 else "")

    def _make_channel(
        self, number: int, raster: _Raster, source: "TdmsChannel | None", path: str, unit: str, kind: str, comment: str
    ) -> Channel:
        self._sources[number] = (raster, source)
        name = "time" if source is None else source.name
        name, unit = take_unit(name, unit, kind)
        start, rate, end = self._measure_span(raster)
        scaling = describe_scaling(source.properties.items()) if source is not None and kind == "number" else ""
        return Channel(name, number, path, unit, raster.name, raster.rows, rate, start, end, kind, comment, scaling)

    def _measure_span(self, raster: _Raster) -> tuple[float, float, float]:
        """First time [s], rate [Hz] and last time [s] of a raster, where they are known without reading."""
        pieces = [piece for piece in raster.times.pieces if piece.row < raster.rows]
        if not pieces:
            return nan, nan, nan
        begin, end, increment = self._begin_of(pieces[0]), self._begin_of(pieces[-1]), pieces[0].increment
        rate = 1.0 / increment if all(piece.increment == increment for piece in pieces) else nan
        return begin, rate, end + (raster.rows - 1 - pieces[-1].row) * pieces[-1].increment

    def _find_kind(self, channel: "TdmsChannel") -> str:
        """What a channel holds; "" for what is left out."""
        if _is_stamp(channel):
            return "time"
        if channel.data_type is None or self._list_scales(channel) > _MOST_SCALES:
            return ""
        with self._reading():
            kind = channel.dtype.kind
        return {"O": "text", "b": "status"}.get(kind, "number" if kind in "iuf" else "")

    def _list_scales(self, channel: "TdmsChannel") -> int:
        return max(
            (
                int(p["NI_Number_Of_Scales"])
                for p in self._list_property_levels(channel)
                if is_number(p.get("NI_Number_Of_Scales"))
            ),
            default=0,
        )

    def _check_scaling(self, channel: "TdmsChannel") -> None:
        for properties in self._list_property_levels(channel):
            for name, kind in properties.items():
                if name.startswith("NI_Scale[") and name.endswith("_Scale_Type") and kind not in _SCALES:
                    raise InputError(
                        f"recording {self._path}: {channel.name!r} has the scaling {kind!r}, which is unknown"
                    )

    def _list_property_levels(self, channel: "TdmsChannel") -> tuple[Mapping[str, Any], ...]:
        return channel.properties, self._file[channel.group_name].properties, self._file.properties

    def _check_segments(self, file: "TdmsFile") -> None:
        """Raise InputError where a channel is stored in too many pieces, or in one that is larger than allowed."""
        pieces, seen = 0, set()
        for segment in file._reader._segments:
            pieces += segment.num_chunks
            if id(segment.ordered_objects) not in seen:
                seen.add(id(segment.ordered_objects))
                size = sum(o.number_values * (o.data_type.size or 1) for o in segment.ordered_objects if o.has_data)
                check_bytes(f"recording {self._path} has a piece of", size)
        if pieces > _MOST_PIECES:
            raise InputError(
                f"recording {self._path} is stored in {pieces} pieces; allowed are {_MOST_PIECES}: defragment it in LabVIEW"
            )

    @contextmanager
    def _reading(self) -> Iterator[None]:
        """nptdms at work: what it says is kept away, what it raises becomes an InputError."""
        try:
            with quiet():
                yield
            return
        except InputError:
            raise
        except Exception as error:  # nptdms raises many kinds
            reason = tell_reason(error)[:_LONGEST_REASON]
        raise InputError(f"recording {self._path} cannot be read: {reason}")


def _list_stated_rates(file: "TdmsFile") -> dict[str, float]:
    """Rates of rows among the properties of groups and channels, by path."""
    owners = [*((group.name, group) for group in file.groups())]
    owners += [(f"{group.name}/{one.name}", one) for group in file.groups() for one in group.channels()]
    rates = {}
    for path, owner in owners:
        for key, value in owner.properties.items():
            if is_number(value) and is_rate_name(key):
                rates[f"{path}/{key}"] = float(value)
            elif isinstance(value, str) and (split := split_value(f"{path}/{key}", value)):
                rates[split[0]] = split[1]
    return rates


def _is_stamp(channel: "TdmsChannel") -> bool:
    from nptdms import types

    return channel.data_type is types.TimeStamp


def _read_unit(properties: Mapping[str, Any]) -> str:
    return join_units(str(text) for name in list_unit_keys(properties) if (text := properties.get(name)))
