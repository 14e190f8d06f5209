"""Walk through an HDF5 file: its channels, single numbers and notes."""

from dataclasses import replace
from itertools import islice
from typing import Any

import numpy as np

from clutch_hil.recordings.channel import Channel
from clutch_hil.recordings.hdf5.axes import Axes
from clutch_hil.recordings.hdf5.fields import list_fields
from clutch_hil.recordings.hdf5.file import Hdf5File
from clutch_hil.recordings.hdf5.labels import Labels
from clutch_hil.recordings.hdf5.packing import read_packing
from clutch_hil.recordings.hdf5.place import Place
from clutch_hil.recordings.stated_date import read_date
from clutch_hil.recordings.stated_rate import is_rate_name, split_value
from clutch_hil.recordings.stated_scaling import describe_scaling, is_scaling, is_scaling_beside
from clutch_hil.recordings.unit_in_name import take_unit
from protocols.errors import InputError

_COMMENTS = ("description", "long_name", "comment", "Description", "Comment")
_STARTS = ("start_time", "start", "date", "timestamp", "created", "recorded_at", "StartTime", "Date")  # of the file
_MOST_ENTRIES = 20_000  # datasets and groups of a file: 2 s to walk through
_MOST_COLUMNS = 1000  # of a dataset with two axes: more are a picture
_MOST_FIELDS = 10_000  # of the rows of a table, with those in fields
_MOST_DEPTH = 32
MOST_REMARKS = 20


class Walk:
    """Collects the channels of an open file."""

    def __init__(self, file: Hdf5File) -> None:
        self.channels: list[Channel] = []
        self.places: list[Place] = []
        self.numbers: dict[str, float] = {}
        self.notes: list[str] = []
        self.left_out: dict[str, str] = {}
        self.start = ""
        self._file, self._left, self._labels = file, _MOST_ENTRIES, Labels(file)
        self._axes = Axes(file, self._labels)
        self._walked: set[Any] = set()  # groups: hard links may lead back

    def walk(self, group: Any, depth: int) -> None:
        """Collect what is in a group and in the groups below it, each once. Raises InputError."""
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
        for key in list(group.attrs)[:MOST_REMARKS]:
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
            self._append(data, path, name, Place(data.name), "text")
        elif data.dtype.kind not in "fiub":
            self.left_out[path] = f"numbers of the type {data.dtype}"
        elif len(data.shape) == 1:
            place = Place(data.name, time=self._axes.find_time(data))
            self._append(data, path, name, place, _find_kind(data.dtype), self._labels.find_unit(data))
        elif len(data.shape) == 2 and data.shape[1 - (axis := self._axes.find_rows(data))] <= _MOST_COLUMNS:
            time = self._axes.find_time(data, axis)
            count = data.shape[1 - axis]
            names = self._labels.list_names(data, count)
            for column in range(count):
                place = Place(data.name, column=column, axis=axis, time=time)
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
            place = Place(data.name, one.outer, one.inside, axis=axis)
            inside = f"{path}/{one.path}"
            if h5py.check_string_dtype(one.kind) is not None and not place.inside:
                self._append(data, inside, one.name, place, "text")
            elif one.kind.shape or one.kind.kind not in "fiub":
                self.left_out[inside] = f"values of the type {one.kind}"
            else:
                unit = "" if place.inside else self._labels.find_unit(data, one.number, count, place.field)
                self._append(data, inside, one.name, place, _find_kind(one.kind), unit)

    def _append(self, data: Any, path: str, name: str, place: Place, kind: str, unit: str = "") -> None:
        name, unit = take_unit(name, unit, kind)
        rows = data.shape[place.axis]
        raster = place.dataset if place.field else place.time.dataset if place.time else f"{rows} rows"
        comment = self._file.read_attribute(data, *_COMMENTS)
        dated = " since " in unit and len(data.shape) == 1  # times, whether the file says that they are an axis or not
        if (
            (data.is_scale or dated)
            and kind == "number"
            and not place.field
            and (axis := self._axes.make_time(data, unit))
        ):
            kind, unit, raster = "time", "s", data.name if data.is_scale else raster
            place = replace(axis, time=axis)
        elif kind == "number" and not place.field:
            place = replace(place, packing=read_packing(self._file, data))
        start, end, rate = self._axes.measure_span(place.time, rows)
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

    def finish(self) -> None:
        """Add a note of what was left out."""
        if self.left_out:
            named = "; ".join(f"{path} ({what})" for path, what in list(self.left_out.items())[:MOST_REMARKS])
            more = len(self.left_out) - MOST_REMARKS
            self.notes.append(f"left out {named}{f'; and {more} more' if more > 0 else ''}")


def _find_kind(dtype: np.dtype) -> str:
    import h5py

    return "status" if dtype.kind == "b" or h5py.check_enum_dtype(dtype) is not None else "number"
