"""Parquet and Feather (Arrow IPC): tables of pandas, Polars, DuckDB; and run files of this project."""

import json
import re
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import replace
from datetime import UTC, datetime, timedelta
from math import isfinite
from pathlib import Path
from typing import Any, ClassVar

import numpy as np
import pyarrow as pa
import pyarrow.compute as pc

from clutch_hil.recordings.channel import EXACT, Channel, Signal, keep_whole, name_first
from clutch_hil.recordings.long_table import can_name_signals, make_refusal, names_signals
from clutch_hil.recordings.state_names import value_states
from clutch_hil.recordings.stated_rate import split_value
from clutch_hil.recordings.stated_scaling import describe_scaling
from clutch_hil.recordings.stated_unit import join_units, list_unit_keys
from clutch_hil.recordings.text_values import convert_texts
from clutch_hil.recordings.unit_in_name import is_unit, take_unit
from protocols.errors import InputError
from protocols.files.arrow import convert_numbers
from protocols.files.arrow_file import FEATHER_1, IPC_FILE, IPC_STREAM, PARQUET, ArrowFile, reading
from protocols.files.run import parse_json
from protocols.input_file import read_head

_TIME = "time_s"  # column of run files of this project
_START = ("time_zero", "recorded_at")  # metadata of a run with the time of day, ISO 8601
_MEANING_KEYS = ("meaning", "description", "comment")  # metadata of a column
_TICKS = {"s": 1, "ms": 1_000, "us": 1_000_000, "ns": 1_000_000_000}  # of Arrow's clocks in a second
_DAY = 86400.0  # s
_MOST_STATES = 20  # names of states in a note
_JUDGED_ROWS = 2000  # that tell whether a column of words names the signal of each row
_LEVELS = re.compile(r"\('(?P<name>[^']+)', '(?P<unit>[^']+)'\)")  # as pandas writes two levels of names
_LONGEST_LEVELS = 200  # characters of a name in which levels are looked for
_SCHEMA_BYTES = 8  # bytes of a message before its content


class ArrowTable:
    """Parquet, Feather 2 and Arrow IPC."""

    name = "Parquet or Feather"
    keys: ClassVar[Mapping[str, type]] = {}
    order = 0

    def recognises(self, head: bytes, path: Path) -> bool:
        return head.startswith((PARQUET, IPC_FILE, FEATHER_1)) or (head.startswith(IPC_STREAM) and _is_message(head))

    def open(self, path: Path, options: Mapping[str, Any]) -> "ArrowRecording":
        return ArrowRecording(path)


class ArrowRecording:
    """A Recording in one table, whose columns share their rows. Times of day count from the first of them."""

    def __init__(self, path: Path) -> None:
        self._path, self._file = path, ArrowFile(path, read_head(path))
        self.notes: list[str] = []
        self._numbers: dict[str, float] = {}
        self.numbers: Mapping[str, float] = self._numbers
        self.start = ""
        self._origin: dict[str, int] = {}  # by the kind of clock: ticks of the first time of day
        self._places: dict[int, int] = {}  # by number of the channel
        self._index: tuple[str, float, float] | None = None  # of pandas, not stored: its name, first number and step
        self._read_metadata()
        self.channels: Sequence[Channel] = self._list()
        self._clock = next((channel for channel in self.channels if channel.kind == "time"), None)
        if self._clock and pa.types.is_timestamp(self._find_type(self._clock)) and self._file.rows:
            with reading(self._path):
                self._begin(self._clock)

    def read(self, channels: Sequence[Channel]) -> list[Signal]:
        self._check_long(channels)
        wanted = list(dict.fromkeys([*channels, *([self._clock] if self._clock else [])]))
        stored = [channel for channel in wanted if channel.number in self._places]
        columns = self._file.read([self._places[channel.number] for channel in stored])
        texts: dict[int, Signal] = {}
        values: dict[int, np.ndarray] = {}
        whole: dict[int, np.ndarray | None] = {}
        with reading(self._path):
            for channel in wanted:
                if channel not in stored and self._index:
                    values[channel.number] = self._index[1] + self._index[2] * np.arange(self._file.rows)
            for channel, column in zip(stored, columns, strict=True):
                if channel.kind == "text" or (channel.states and channel.kind == "status" and _has_words(column)):
                    column = pc.cast(column, pa.string())
                    texts[channel.number] = convert_texts(self._path, channel, column.to_pylist(), self.notes)
                else:
                    values[channel.number] = self._read_values(channel, column)
                    whole[channel.number] = _read_whole(column)
        time = values[self._clock.number] if self._clock else None
        return [
            replace(texts[channel.number], time=time)
            if channel.number in texts
            else Signal(channel, values[channel.number], time, whole.get(channel.number))
            for channel in channels
        ]

    def _check_long(self, asked: Sequence[Channel]) -> None:
        """Raise InputError where each row has the value of another signal, by a column of words that is not asked for."""
        numbers = {channel.number for channel in asked}
        for channel in (channel for channel in self.channels if channel.number in self._places.keys() - numbers):
            kind = self._find_type(channel)
            words_only = channel.kind == "text" or (pa.types.is_dictionary(kind) and channel.kind == "status")
            if words_only and can_name_signals(channel, self.channels):
                (column,) = self._file.read([self._places[channel.number]])
                with reading(self._path):
                    words = pc.cast(column.slice(0, _JUDGED_ROWS), pa.string()).fill_null("").to_pylist()
                if names_signals(words):
                    raise make_refusal(self._path, channel, words)

    def _read_values(self, channel: Channel, column: pa.ChunkedArray) -> np.ndarray:
        kind = column.type
        if pa.types.is_dictionary(kind):
            if channel.kind == "number":
                return convert_numbers(pc.cast(column, kind.value_type))
            return self._number_states(channel, column)
        if pa.types.is_timestamp(kind):
            return self._convert_to_seconds(column, kind.unit, self._origin.get(kind.unit, 0))
        if pa.types.is_duration(kind):
            return self._convert_to_seconds(column, kind.unit, 0)
        if pa.types.is_time(kind):
            return self._pass_midnight(channel, self._convert_to_seconds(column, kind.unit, 0))
        if pa.types.is_boolean(kind):
            column = pc.cast(column, pa.uint8())
        return convert_numbers(column)

    def _convert_to_seconds(self, column: pa.ChunkedArray, unit: str, origin: int) -> np.ndarray:
        """Seconds since `origin`, in ticks of the column's clock: differences are exact, as both are whole numbers."""
        missing = pc.is_null(column).to_numpy()
        width = pa.int32() if column.type.bit_width == 32 else pa.int64()
        ticks = pc.fill_null(pc.cast(column, width), 0).to_numpy().astype(np.int64)
        seconds = (ticks - origin) / _TICKS[unit]
        seconds[missing] = np.nan
        return seconds

    def _pass_midnight(self, channel: Channel, seconds: np.ndarray) -> np.ndarray:
        """Times of day (n,) [s] with a day added wherever midnight passed: a fall of more than half a day, as in text."""
        known = np.isfinite(seconds)
        days = np.cumsum(np.diff(seconds[known], prepend=seconds[known][:1]) < -0.5 * _DAY)
        if len(days) and days[-1]:
            note = f"{channel.path}: passed midnight {days[-1]} times, where a day was added"
            self.notes += [note] if note not in self.notes else []
            seconds[known] += _DAY * days
        return seconds

    def _number_states(self, channel: Channel, column: pa.ChunkedArray) -> np.ndarray:
        """Numbers of the states of a column of names: those that the names say, else from 0 in the order of the file."""
        whole = column.unify_dictionaries()
        names = whole.chunk(0).dictionary.to_pylist() if whole.num_chunks else []
        if (values := value_states(names)) is not None:
            codes = [chunk.indices.fill_null(len(values)).to_numpy(zero_copy_only=False) for chunk in whole.chunks]
            return np.append(values, np.nan)[np.concatenate(codes).astype(np.int64)]
        states = ", ".join(f"{k} = {name}" for k, name in enumerate(names[:_MOST_STATES]))
        self.notes.append(f"{channel.path}: states are {states}{' and more' if len(names) > _MOST_STATES else ''}")
        return convert_numbers(pa.chunked_array([chunk.indices for chunk in whole.chunks], column.type.index_type))

    def _begin(self, clock: Channel) -> None:
        """Make the first time of day time 0."""
        (column,) = self._file.read([self._places[clock.number]])
        unit = column.type.unit
        first = pc.min(pc.cast(column.slice(0, 1), pa.int64())).as_py()
        if first is None:
            return
        for other, ticks in _TICKS.items():
            self._origin[other] = first * ticks // _TICKS[unit]
        try:
            start = datetime(1970, 1, 1, tzinfo=UTC if column.type.tz else None)
            self.start = (start + timedelta(seconds=first / _TICKS[unit])).isoformat()
        except OverflowError:
            self.start = ""
        self.notes.append(f"times count from the first one in {clock.path!r}")

    def _list(self) -> list[Channel]:
        count, seen = Counter(name for name, _ in self._file.described), Counter[str]()
        left_out: list[str] = []
        channels: list[Channel] = []
        for place, (name, type_name) in enumerate(self._file.described):
            described = self._file.schema.field(place)
            seen[name] += 1
            if not (kind := _find_kind(name, described.type)):
                left_out.append(f"{name} ({type_name[:40]})")
                continue
            number = len(channels) + 1
            self._places[number] = place
            path = name if count[name] == 1 else f"{name}/{seen[name]}"
            unit, comment = self._find_unit(described, kind), _find_first(described.metadata, _MEANING_KEYS)
            name, unit = take_unit(*_split_levels(name, unit), kind)
            metadata = ((key.decode(errors="replace"), value) for key, value in (described.metadata or {}).items())
            scaling = describe_scaling(metadata) if kind == "number" else ""
            channels.append(
                Channel(name, number, path, unit, "table", self._file.rows, kind=kind, comment=comment, scaling=scaling)
            )
        if self._index:
            name, unit = take_unit(self._index[0], "", "number")
            channels.append(Channel(name, len(channels) + 1, self._index[0], unit, "table", self._file.rows))
        if left_out:
            self.notes.append(f"left out, as they are neither numbers, times nor text: {name_first(left_out)}")
        if not channels:
            raise InputError(f"recording {self._path} has no columns of numbers, times or text")
        return channels

    def _find_type(self, channel: Channel) -> pa.DataType:
        return self._file.schema.field(self._places[channel.number]).type

    def _find_unit(self, described: pa.Field, kind: str) -> str:
        if kind == "status":
            return "1"
        kind_of_column = described.type
        if kind == "time" or pa.types.is_duration(kind_of_column):
            return "s"
        keys = list_unit_keys(key.decode(errors="replace") for key in described.metadata or ())
        units = join_units(_find_first(described.metadata, [key]) for key in keys)
        return units or self._pandas_units.get(described.name, "")

    def _read_metadata(self) -> None:
        """Numbers and the time of day in a run file's metadata, and units in the attributes of a pandas table."""
        metadata = {k.decode(errors="replace"): v.decode(errors="replace") for k, v in self._file.metadata.items()}
        self._pandas_units: dict[str, str] = {}
        for name, text in metadata.items():
            if name == "ARROW:schema":
                continue
            value = parse_json(text)
            if name == "pandas":
                self._index = _find_index(value, self._file.rows, self._file.schema.names)
                continue
            attributes = value if name == "PANDAS_ATTRS" and isinstance(value, dict) else {name: value}
            for key in list_unit_keys(attributes):
                if isinstance(units := attributes[key], dict):
                    self._pandas_units |= {str(k): v for k, v in units.items() if isinstance(v, str)}
            for key, one in attributes.items():
                if isinstance(one, int | float) and not isinstance(one, bool) and isfinite(one):
                    self._numbers[key] = float(one)
                elif isinstance(one, str) and (split := split_value(key, one)):
                    self._numbers[split[0]] = split[1]
        self.start = next((str(v) for key in _START if isinstance(v := _parse_entry(metadata, key), str)), "")


def _find_index(described: Any, rows: int, names: Sequence[str]) -> tuple[str, float, float] | None:
    """Return name, first number and step of a RangeIndex of pandas, which only its description has; None if there is none.

    One without a name counts rows.
    """
    columns = described.get("index_columns") if isinstance(described, dict) else None
    index = columns[0] if isinstance(columns, list) and len(columns) == 1 and isinstance(columns[0], dict) else {}
    name, (start, stop, step) = index.get("name"), (index.get(key) for key in ("start", "stop", "step"))
    if not (isinstance(name, str) and name and name not in names and type(start) is type(stop) is type(step) is int):
        return None
    if not step or max(abs(start), abs(stop), abs(step)) > EXACT or len(range(start, stop, step)) != rows:
        return None
    return name, float(start), float(step)


def _split_levels(name: str, unit: str) -> tuple[str, str]:
    """Return name and unit of a column of pandas with two levels of names, the second of which is its unit."""
    match = _LEVELS.fullmatch(name) if not unit and len(name) <= _LONGEST_LEVELS else None
    return (match["name"], match["unit"]) if match and is_unit(match["unit"]) else (name, unit)


def _parse_entry(metadata: Mapping[str, str], key: str) -> Any:
    try:
        return json.loads(metadata[key])
    except (KeyError, ValueError):
        return None


def _find_kind(name: str, kind: pa.DataType) -> str:
    """What a column is; "" for what is left out."""
    if pa.types.is_dictionary(kind):
        return "number" if _is_number(kind.value_type) else "status" if _is_text(kind.value_type) else ""
    if pa.types.is_timestamp(kind) or pa.types.is_time(kind):
        return "time"
    if pa.types.is_boolean(kind):
        return "status"
    if _is_number(kind):
        return "time" if name == _TIME else "number"
    return "number" if pa.types.is_duration(kind) else "text" if _is_text(kind) else ""


def _has_words(column: pa.ChunkedArray) -> bool:
    return pa.types.is_dictionary(column.type) and _is_text(column.type.value_type)


def _is_number(kind: pa.DataType) -> bool:
    return pa.types.is_floating(kind) or pa.types.is_integer(kind) or pa.types.is_decimal(kind)


def _read_whole(column: pa.ChunkedArray) -> np.ndarray | None:
    """Whole numbers of a column for `Signal.whole`."""
    if column.type not in (pa.int64(), pa.uint64()) or column.null_count or not len(column):
        return None
    return keep_whole(np.concatenate([np.from_dlpack(chunk) for chunk in column.chunks if len(chunk)]))


def _is_text(kind: pa.DataType) -> bool:
    return pa.types.is_string(kind) or pa.types.is_large_string(kind) or pa.types.is_string_view(kind)


def _find_first(metadata: Mapping[bytes, bytes] | None, keys: Sequence[str]) -> str:
    texts = [metadata[key.encode()].decode(errors="replace") for key in keys if metadata and key.encode() in metadata]
    return texts[0].strip() if texts else ""


def _is_message(head: bytes) -> bool:
    """Whether a stream of Arrow messages begins here: its first one, the schema, is not longer than a schema can be."""
    length = int.from_bytes(head[4:8], "little")
    return len(head) > _SCHEMA_BYTES and 0 < length < (1 << 24) and length % 8 == 0
