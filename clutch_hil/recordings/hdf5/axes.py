"""Axes of the datasets of an HDF5 file: which one has the rows, and which times belong to them."""

import contextlib
from dataclasses import replace
from datetime import UTC, datetime
from typing import Any

from clutch_hil.recordings.channel import simplify_unit
from clutch_hil.recordings.hdf5.file import Hdf5File
from clutch_hil.recordings.hdf5.labels import Labels
from clutch_hil.recordings.hdf5.packing import Packing, read_packing
from clutch_hil.recordings.hdf5.place import Place, read_place
from clutch_hil.recordings.stated_date import read_date
from protocols.errors import InputError
from protocols.files.units import have_same_quantity, to_si

_TIMES = ("time", "time_s", "t", "timestamp", "timestamps", "zeit")  # names of datasets that hold times
_FEWEST_ROWS = 50  # of a run
_MOST_TIMES = 4_000_000  # numbers of time axes that are read while a file is opened: 32 MB


class Axes:
    """Of the datasets of an open file. `labels`: its names and units."""

    def __init__(self, file: Hdf5File, labels: Labels) -> None:
        self._file, self._labels = file, labels
        self._lengths: dict[str, tuple[set[int], set[int]]] = {}  # by the name of a group
        self._spans: dict[str, tuple[float, float]] = {}
        self._left_times = _MOST_TIMES

    def find_rows(self, data: Any) -> int:
        """The axis of the rows of a dataset with two: the one with times, else the one across the names of columns, else the
        first unless it is too short for a run."""
        for axis in (0, 1):
            if self.find_time(data, axis):
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

    def find_time(self, data: Any, rows: int = 0) -> Place | None:
        """The dimension scale of the axis `rows` of a dataset, where it holds times."""
        if data.is_scale or not len(data.dims):
            return None
        for scale in data.dims[rows].values():
            axis = self.make_time(scale, self._labels.find_unit(scale))
            if axis and scale.shape == (data.shape[rows],) and scale.dtype.kind in "fiu":
                return axis
        return None

    def make_time(self, scale: Any, unit: str) -> Place | None:
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
        return Place(scale.name, factor=factor, packing=packing)

    def measure_span(self, time: Place | None, rows: int) -> tuple[float, float, float]:
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


def _find_seconds(unit: str) -> float:
    """Seconds in a unit of time, 0 where it is none."""
    unit = simplify_unit(unit)
    try:
        return to_si(1.0, unit) if unit and have_same_quantity(unit, "s") else 0.0
    except InputError:
        return 0.0
