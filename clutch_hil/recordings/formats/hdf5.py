"""HDF5: datasets by path. MATLAB's own are in matlab.py, which asks first."""

import contextlib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from datetime import UTC, datetime
from itertools import islice
from pathlib import Path
from typing import Any

import numpy as np

from clutch_hil.recordings.channel import EXACT, Channel, Recording, Signal, keep_whole, simplify_unit
from clutch_hil.recordings.formats.matlab import MatlabRecording
from clutch_hil.recordings.hdf5_fields import list_fields, read_field
from clutch_hil.recordings.hdf5_file import Hdf5File, is_hdf5
from clutch_hil.recordings.hdf5_labels import Labels
from clutch_hil.recordings.hdf5_packing import Packing, read_packing
from clutch_hil.recordings.isolated import IsolatedRecording
from clutch_hil.recordings.matlab.level73 import has_matlab_classes, is_level73
from clutch_hil.recordings.matlab.texts import read_date
from clutch_hil.recordings.state_names import note_names, number_by_states, take_names
from clutch_hil.recordings.stated_rate import is_rate_name, split_value
from clutch_hil.recordings.stated_scaling import describe_scaling, is_scaling, is_scaling_beside
from clutch_hil.recordings.text_values import convert_texts
from clutch_hil.recordings.unit_in_name import take_unit
from protocols.errors import InputError
from protocols.files.bounds import check_rows
from protocols.files.units import have_same_quantity, to_si

_COMMENTS = ("description", "long_name", "comment", "Description", "Comment")
_STARTS = ("start_time", "start", "date", "timestamp", "created", "recorded_at", "StartTime", "Date")  # of the file
_TIMES = ("time", "time_s", "t", "timestamp", "timestamps", "zeit")  # names of datasets that hold times
_FEWEST_ROWS = 50  # of a run
_MOST_ENTRIES = 20_000  # datasets and groups of a file: 2 s to walk through
_MOST_COLUMNS = 1000  # of a dataset with two axes: more are a picture
_MOST_FIELDS = 10_000  # of the rows of a table, with those in fields
_MOST_DEPTH = 32
_MOST_TIMES = 4_000_000  # numbers of time axes that are read while a file is opened: 32 MB
_MOST_REMARKS = 20


class Hdf5:
    name = "HDF5"
    keys: Mapping[str, type] = {}
    order = 0

    def recognises(self, head: bytes, path: Path) -> bool:
        return is_hdf5(head) and not is_level73(head)

    def open(self, path: Path, options: Mapping[str, Any]) -> Recording:
        return IsolatedRecording(path, f"{__name__}:open_hdf5")


def open_hdf5(path: Path) -> Recording:
    """A file, opened in this process; one of MATLAB that lost its first bytes is read as such."""
    file = Hdf5File(path)
    with file, file.errors("what is in it"):
        is_matlab = has_matlab_classes(file)
    return MatlabRecording(file) if is_matlab else Hdf5Recording(file)


@dataclass(frozen=True)
class _Place:
    """Where the numbers of a channel are: in a dataset, in a field of its rows or "", in a column or None.

    inside: the steps from the values of the field to the numbers: names of fields, and numbers of elements.
    """

    dataset: str
    field: str = ""
    inside: tuple[str | int, ...] = ()
    column: int | None = None
    axis: int = 0  # of the rows
    factor: float = 1.0  # of a time axis, in s
    time: "_Place | None" = None
    packing: "Packing | None" = None

    @property
    def index(self) -> tuple[Any, ...]:
        """Of the numbers in the dataset."""
        own = () if self.column is None else (self.column,)
        return (slice(None), *own) if self.axis == 0 else (*own, slice(None))

    def describe(self) -> str:
        """The column as h5py writes it."""
        return f"[:,{self.column}]" if self.axis == 0 else f"[{self.column},:]"


class Hdf5Recording:
    """See Recording."""

    def __init__(self, file: Hdf5File) -> None:
        self._file = file
        self.channels: Sequence[Channel] = []
        self.numbers: Mapping[str, float] = {}
        self.notes: list[str] = []
        with file:
            walk = _Walk(file)
            with file.errors("what is in it"):
                walk.walk(file.root, 0)
            walk.finish()
            self._places = walk.places
            self.channels, self.numbers, self.notes, self.start = walk.channels, walk.numbers, walk.notes, walk.start
        if not self.channels:
            left = "; ".join(f"{path} ({what})" for path, what in list(walk.left_out.items())[:_MOST_REMARKS])
            raise InputError(f"{file.name} has no columns of numbers{f'; in it are {left}' if left else ''}")

    def read(self, channels: Sequence[Channel]) -> list[Signal]:
        """See Recording.read."""
        clocks = {place.time: c.rows for c in channels if (place := self._places[c.number - 1]).time is not None}
        rows = sum(c.rows for c in channels) + sum(clocks.values())
        check_rows(f"{self._file.name}: the {len(channels)} requested columns have together", rows, 1)
        times: dict[_Place, np.ndarray] = {}
        signals = []
        with self._file:
            for channel in channels:
                place = self._places[channel.number - 1]
                if place.time is not None and place.time not in times:
                    times[place.time] = read_place(self._file, place.time, channel.rows)
                time = times.get(place.time) if place.time is not None else None
                if channel.kind == "text":
                    texts = self._file.read_text_column(place.dataset, place.field)
                    signals.append(replace(convert_texts(self._file.path, channel, texts, self.notes), time=time))
                    continue
                values = read_place(self._file, place, channel.rows, self.notes)
                names = list_state_names(self._file, place) if channel.kind == "status" else {}
                if channel.states and names:
                    signals.append(replace(number_by_states(self._file.path, channel, values, names), time=time))
                    continue
                if taken := take_names(values, names):
                    values, notes = taken
                    note = note_names(channel.path, notes)
                    self.notes += [note] if note not in self.notes else []
                signals.append(Signal(channel, values, time, self._read_whole(channel, place, values)))
        return signals

    def _read_whole(self, channel: Channel, place: _Place, values: np.ndarray) -> np.ndarray | None:
        """Whole numbers of a channel for `Signal.whole`."""
        if channel.kind != "number" or place.packing or place.field or not np.any(np.abs(values) > EXACT):
            return None
        return keep_whole(self._file.read(place.dataset, place.index).reshape(channel.rows))


def read_place(file: Hdf5File, place: _Place, rows: int, notes: list[str] | None = None) -> np.ndarray:
    """Values (rows,) of a channel. notes: where to tell what is missing. Raises InputError."""
    if place.field:
        values = read_field(file, place.dataset, place.field, place.inside, rows)
    else:
        values = file.read_column(place.dataset, place.index, rows)
    if packing := place.packing:
        values, outside = packing.unpack(values)
        if outside and notes is not None:
            name = place.dataset.lstrip("/") + ("" if place.column is None else place.describe())
            note = f"{name}: {outside} of {rows} samples are outside of its valid range, and count as missing"
            notes += [note] if note not in notes else []
    return values if place.factor == 1.0 else values * place.factor


def list_state_names(file: Hdf5File, place: _Place) -> dict[float, str]:
    """Names of the numbers of a channel by its type, an enumeration; none for another one."""
    import h5py

    with file.errors(place.dataset):
        kind = file.root[place.dataset].dtype
        for step in (place.field, *place.inside) if place.field else ():
            kind = kind[step] if isinstance(step, str) else kind.base
        members = h5py.check_enum_dtype(kind) or {}
    return {float(number): name.strip() for name, number in members.items()}


class _Walk:
    """Collects the channels of an open file."""

    def __init__(self, file: Hdf5File) -> None:
        self.channels: list[Channel] = []
        self.places: list[_Place] = []
        self.numbers: dict[str, float] = {}
        self.notes: list[str] = []
        self.left_out: dict[str, str] = {}
        self.start = ""
        self._file, self._left, self._labels = file, _MOST_ENTRIES, Labels(file)
        self._lengths: dict[str, tuple[set[int], set[int]]] = {}  # by the name of a group
        self._spans: dict[str, tuple[float, float]] = {}
        self._left_times = _MOST_TIMES
        self._walked: set[Any] = set()  # groups: hard links may lead back

    def walk(self, group: Any, depth: int) -> None:
        import h5py

        if group.id in self._walked:
            return
        self._walked.add(group.id)
        if depth > _MOST_DEPTH:
            self.left_out[group.name] = f"groups more than {_MOST_DEPTH} levels deep"
            return
        self._add_remarks(group)
        for name, entry in self._file.list_members(group):
            self._left -= 1
            if self._left < 0:
                raise InputError(f"{self._file.name} has more than {_MOST_ENTRIES} datasets and groups")
            path = f"{group.name.rstrip('/')}/{name}".lstrip("/")
            if isinstance(entry, h5py.Group):
                self.walk(entry, depth + 1)
            elif isinstance(entry, h5py.Dataset):
                self._add_dataset(entry, path, name)

    def _add_remarks(self, group: Any) -> None:
        for key in list(group.attrs)[:_MOST_REMARKS]:
            text = self._file.read_attribute(group, key)
            if text and group.name == "/":
                self.notes.append(f"{key} is {text[:200]}")
            if key in _STARTS:
                self.start = self.start or read_date(text)
        self._add_stated_numbers(group)

    def _add_stated_numbers(self, entry: Any) -> None:
        """Attributes of a group or dataset that tell a rate of rows, or scale what they name, as single numbers."""
        here = entry.name.strip("/")
        for key in entry.attrs:
            if not (is_rate_name(key) or is_scaling_beside(key)):
                continue
            path, numbers = f"{here}/{key}".lstrip("/"), self._file.read_numbers(entry, key)
            if len(numbers) == 1:
                self.numbers[path] = float(numbers[0])
            elif parts := split_value(path, self._file.read_attribute(entry, key)):
                self.numbers[parts[0]] = parts[1]

    def _add_dataset(self, data: Any, path: str, name: str) -> None:
        import h5py

        if data.shape is None or not data.size:
            return
        self._add_stated_numbers(data)
        text = h5py.check_string_dtype(data.dtype) is not None
        if data.dtype.names and data.size == max(data.shape, default=1) > 1:
            self._add_table(data, path)
        elif data.size == 1:
            self._add_number(data, path)
        elif text and len(data.shape) == 1:
            self._append(data, path, name, _Place(data.name), "text")
        elif data.dtype.kind not in "fiub":
            self.left_out[path] = f"numbers of the type {data.dtype}"
        elif len(data.shape) == 1:
            place = _Place(data.name, time=self._find_time(data))
            self._append(data, path, name, place, _find_kind(data.dtype), self._labels.find_unit(data))
        elif len(data.shape) == 2 and data.shape[1 - (axis := self._choose_axis(data))] <= _MOST_COLUMNS:
            time = self._find_time(data, axis)
            count = data.shape[1 - axis]
            names = self._labels.list_names(data, count)
            for column in range(count):
                place = _Place(data.name, column=column, axis=axis, time=time)
                self._append(
                    data,
                    path if count == 1 else f"{path}{place.describe()}",
                    names[column] if names else name if count == 1 else f"{name}({column + 1})",
                    place,
                    _find_kind(data.dtype),
                    self._labels.find_unit(data, column, count),
                )
        else:
            self.left_out[path] = f"an array of {' x '.join(map(str, data.shape))} numbers"

    def _add_number(self, data: Any, path: str) -> None:
        if data.dtype.kind in "fiub":
            self._file.check(data)
            self.numbers[path] = float(np.asarray(data[()]).ravel()[0])
        elif data.dtype.names and any(data.dtype[field].shape for field in data.dtype.names):
            self.left_out[path] = "a single row, with arrays in its fields: save one row a sample"

    def _add_table(self, data: Any, path: str) -> None:
        import h5py

        axis, count = int(np.argmax(data.shape)), len(data.dtype.names)
        fields = list(islice(list_fields(data.dtype), _MOST_FIELDS + 1))
        if len(fields) > _MOST_FIELDS:
            self.left_out[path] = f"rows of more than {_MOST_FIELDS} fields"
            return
        for one in fields:
            place = _Place(data.name, one.outer, one.inside, axis=axis)
            inside = f"{path}/{one.path}"
            if h5py.check_string_dtype(one.kind) is not None and not place.inside:
                self._append(data, inside, one.name, place, "text")
            elif one.kind.shape or one.kind.kind not in "fiub":
                self.left_out[inside] = f"values of the type {one.kind}"
            else:
                unit = "" if place.inside else self._labels.find_unit(data, one.number, count, place.field)
                self._append(data, inside, one.name, place, _find_kind(one.kind), unit)

    def _append(self, data: Any, path: str, name: str, place: _Place, kind: str, unit: str = "") -> None:
        name, unit = take_unit(name, unit, kind)
        rows = data.shape[place.axis]
        raster = place.dataset if place.field else place.time.dataset if place.time else f"{rows} rows"
        comment = self._file.read_attribute(data, *_COMMENTS)
        dated = " since " in unit and len(data.shape) == 1  # times, whether the file says that they are an axis or not
        if (data.is_scale or dated) and kind == "number" and not place.field and (axis := self._make_axis(data, unit)):
            kind, unit, raster = "time", "s", data.name if data.is_scale else raster
            place = replace(axis, time=axis)
        elif kind == "number" and not place.field:
            place = replace(place, packing=read_packing(self._file, data))
        start, end, rate = self._measure_span(place.time, rows)
        number = len(self.channels) + 1
        scaling = ""
        if kind == "number" and not place.field:
            used = ("scale_factor", "add_offset")  # that the packing has applied
            keys = [key for key in data.attrs if is_scaling(key) and key not in used]
            scaling = describe_scaling((key, list(self._file.read_numbers(data, key))) for key in keys)
        self.channels.append(
            Channel(name, number, path, unit, raster, rows, rate, start, end, kind, comment[:200], scaling)
        )
        self.places.append(place)

    def _choose_axis(self, data: Any) -> int:
        """The axis of the rows of a dataset with two: the one with times, else the one across the names of columns, else the
        first unless it is too short for a run."""
        for axis in (0, 1):
            if self._find_time(data, axis):
                return axis
        rows, columns = data.shape
        for axis in (0, 1):
            if rows != columns and self._labels.list_names(data, data.shape[1 - axis]):
                return axis
        times, others = self._find_lengths(data.parent)
        if columns <= rows or rows in times:
            return 0
        return 1 if columns in times or (rows < _FEWEST_ROWS and rows not in others) else 0

    def _find_lengths(self, group: Any) -> tuple[set[int], set[int]]:
        """Lengths of datasets with one axis in a group: of those with times, also in the groups around it, and of others."""
        import h5py

        if group.name not in self._lengths:
            times: set[int] = set() if group.name == "/" else set(self._find_lengths(group.parent)[0])
            others: set[int] = set()
            for name, entry in self._file.list_members(group):
                if (
                    isinstance(entry, h5py.Dataset)
                    and entry.shape
                    and len(entry.shape) == 1
                    and entry.dtype.kind in "fiu"
                ):
                    named = name.lower() in _TIMES or _find_seconds(self._labels.find_unit(entry))
                    (times if named else others).add(entry.shape[0])
            self._lengths[group.name] = (times, others)
        return self._lengths[group.name]

    def _find_time(self, data: Any, rows: int = 0) -> _Place | None:
        """The dimension scale of the axis `rows` of a dataset, where it holds times."""
        if data.is_scale or not len(data.dims):
            return None
        for scale in data.dims[rows].values():
            axis = self._make_axis(scale, self._labels.find_unit(scale))
            if axis and scale.shape == (data.shape[rows],) and scale.dtype.kind in "fiu":
                return axis
        return None

    def _make_axis(self, scale: Any, unit: str) -> _Place | None:
        """A dimension scale as an axis of time; None where its unit is none. `ms since DATE` counts from 1970 then."""
        unit, _, since = unit.partition(" since ")
        factor = _find_seconds(unit)
        if not factor:
            return None
        packing = read_packing(self._file, scale)
        with contextlib.suppress(ValueError):
            date = datetime.fromisoformat(read_date(since))
            epoch = date.replace(tzinfo=date.tzinfo or UTC).timestamp()
            packing = replace(packing or Packing(), offset=(packing.offset if packing else 0.0) + epoch / factor)
        return _Place(scale.name, factor=factor, packing=packing)

    def _measure_span(self, time: _Place | None, rows: int) -> tuple[float, float, float]:
        """First and last time [s] and mean rate [Hz] of a time axis, as far as such axes are not too many."""
        nan = float("nan")
        if time is None:
            return nan, nan, nan
        if time.dataset not in self._spans:
            if rows > self._left_times:
                return nan, nan, nan
            self._left_times -= rows
            seconds = read_place(self._file, time, rows)
            self._spans[time.dataset] = (float(seconds[0]), float(seconds[-1]))
        start, end = self._spans[time.dataset]
        return start, end, (rows - 1) / (end - start) if end > start else nan

    def finish(self) -> None:
        if self.left_out:
            named = "; ".join(f"{path} ({what})" for path, what in list(self.left_out.items())[:_MOST_REMARKS])
            more = len(self.left_out) - _MOST_REMARKS
            self.notes.append(f"left out {named}{f'; and {more} more' if more > 0 else ''}")


def _find_kind(dtype: np.dtype) -> str:
    import h5py

    return "status" if dtype.kind == "b" or h5py.check_enum_dtype(dtype) is not None else "number"


def _find_seconds(unit: str) -> float:
    """Seconds in a unit of time, 0 where it is none."""
    unit = simplify_unit(unit)
    try:
        return to_si(1.0, unit) if unit and have_same_quantity(unit, "s") else 0.0
    except InputError:
        return 0.0
