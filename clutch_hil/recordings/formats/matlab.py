"""MATLAB: MAT-files of the levels 4, 5 (`-v6`, `-v7`) and 7.3, also as Octave, SciPy, dSPACE and others write them."""

from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from clutch_hil.recordings.channel import Channel, Recording, Signal
from clutch_hil.recordings.hdf5.file import Hdf5File, is_hdf5
from clutch_hil.recordings.isolated import IsolatedRecording
from clutch_hil.recordings.matlab.bytes import BinaryFile
from clutch_hil.recordings.matlab.controldesk import ControlDesk
from clutch_hil.recordings.matlab.layouts import Column, Found, TimeAxis, Walk
from clutch_hil.recordings.matlab.level4 import is_level4, read_level4
from clutch_hil.recordings.matlab.level5 import is_level5, read_level5
from clutch_hil.recordings.matlab.level73 import is_level73, read_level73
from clutch_hil.recordings.matlab.modelica import add_trajectory
from clutch_hil.recordings.matlab.simulink import Dataset, SimulationOutput, StructureWithTime, Timeseries
from clutch_hil.recordings.matlab.simulink import Signal as LoggedSignal
from clutch_hil.recordings.matlab.tables import Categorical, Table, Times
from clutch_hil.recordings.matlab.value import Numbers, Value
from clutch_hil.recordings.text_values import convert_texts
from clutch_hil.recordings.unit_in_name import take_unit
from protocols.errors import InputError
from protocols.files.bounds import check_rows

_TIMES_OF_SIMULINK = "tout"  # vector of the times of a simulation [s]
_LAYOUTS = (
    ControlDesk(), StructureWithTime(), Timeseries(), Dataset(), LoggedSignal(), SimulationOutput(), Table(), Times(),
    Categorical(),
)  # fmt: skip
_MATLAB = b"MATLAB "  # first bytes of a file of level 5 and 7.3
_TITLE = 30  # bytes of a file in which a MATLAB file of level 5 or 7.3 says so: "MATLAB 7.3 MAT-file"
_MOST_TIMES = 4_000_000  # numbers of time axes that are read while a file is opened: 32 MB
_MOST_AXES = 100
_MOST_LEFT_OUT = 20  # variables that are named
_EXACT = float(1 << 53)  # above, float64 has no longer every whole number


class Matlab:
    name = "MATLAB"
    keys: Mapping[str, type] = {}
    order = 0

    def recognises(self, head: bytes, path: Path) -> bool:
        if head.startswith(_MATLAB) and (0 in head or b"MAT-file" in head[:_TITLE]):  # whatever of it is damaged
            return not is_hdf5(head) or is_level73(head)
        return is_level5(head) or is_level4(head)

    def open(self, path: Path, options: Mapping[str, Any]) -> Recording:
        with path.open("rb") as file:
            head = file.read(4096)
        if _is_cut_level73(head):
            raise InputError(
                f"recording {path} is cut or damaged: its header is that of a MATLAB 7.3 file, but it has no HDF5 content"
            )
        if is_level73(head):
            return IsolatedRecording(path, f"{__name__}:open_level73")
        if not (is_level5(head) or is_level4(head)):
            raise InputError(
                f"recording {path} is cut or damaged: its header is that of a MATLAB file, but of an unknown level"
            )
        return MatlabRecording(BinaryFile(path), is_level5(head))


def open_level73(path: Path) -> Recording:
    """A file of level 7.3, opened in this process."""
    return MatlabRecording(Hdf5File(path))


def _is_cut_level73(head: bytes) -> bool:
    return is_level73(head) and not is_hdf5(head)


class MatlabRecording:
    """See Recording."""

    def __init__(self, file: BinaryFile | Hdf5File, level5: bool = False) -> None:
        self._file = file
        walk = Walk(file.name, _LAYOUTS)
        with file:
            variables = self._read_variables(file, level5)
            if not add_trajectory(walk.found, variables):
                walk.walk_fields(variables, "", 0)
            self._columns = walk.found.columns
            spans = self._read_spans()
            self._kept = self._find_kept()
        if not self._columns:
            raise InputError(f"{file.name} has no columns of numbers; in it are {_list_inventory(walk.found)}")
        self.numbers: Mapping[str, float] = walk.found.numbers
        self.channels: Sequence[Channel] = [
            self._make_channel(column, n, spans) for n, column in enumerate(self._columns, 1)
        ]
        self.notes, self.start = walk.found.notes, walk.found.start
        if left_out := walk.found.left_out:
            named = "; ".join(f"{path} ({what})" for path, what in list(left_out.items())[:_MOST_LEFT_OUT])
            more = f"; and {len(left_out) - _MOST_LEFT_OUT} more" if len(left_out) > _MOST_LEFT_OUT else ""
            self.notes.append(f"left out {named}{more}")

    @staticmethod
    def _read_variables(file: BinaryFile | Hdf5File, level5: bool) -> dict[str, Value]:
        if isinstance(file, Hdf5File):
            with file.errors("what is in it"):
                return read_level73(file)
        return read_level5(file) if level5 else read_level4(file)

    def read(self, channels: Sequence[Channel]) -> list[Signal]:
        """See Recording.read. Arrays are read in the order of the file, each once."""
        columns = [self._columns[channel.number - 1] for channel in channels]
        axes = {column.time.path: column.time for column in columns if column.time is not None}
        check_rows(
            f"{self._file.name}: the {len(columns)} requested columns have together",
            sum(c.rows for c in columns) + sum(a.rows for a in axes.values()),
            1,
        )
        with self._file:
            numbers = _read([(c.numbers, c.line) for c in columns] + [(a.numbers, a.line) for a in axes.values()])
        times = {
            axis.path: _convert_to_seconds(axis, raw)
            for axis, raw in zip(axes.values(), numbers[len(columns) :], strict=True)
        }
        signals = []
        for channel, column, values in zip(channels, columns, numbers, strict=False):
            if column.numbers.kind in "iu" and len(values) and np.abs(values).max() > _EXACT:
                self.notes.append(f"{column.path}: whole numbers above 2^53 have lost their last digits")
            time = times[column.time.path] if column.time is not None else None
            own = time if column.is_time and time is not None else values
            if column.time is not None and time is not None and (kept := self._kept.get(column.time.path)) is not None:
                own, time = own[kept], time[kept]
                self._note_events(int(np.count_nonzero(~kept)))
            if column.texts:
                signals.append(replace(convert_texts(self._file.path, channel, column.texts, self.notes), time=time))
            else:
                signals.append(Signal(channel, own, time))
        return signals

    def _note_events(self, count: int) -> None:
        note = f"left out rows just before an event, at the time of the next one: {count}"
        if count and note not in self.notes:
            self.notes.append(note)

    def _find_kept(self) -> dict[str, np.ndarray]:
        """Which rows (n,) are the last ones of their time, by the path of a time axis with events."""
        axes = {c.time.path: c.time for c in self._columns if c.time is not None and c.time.has_events}
        values = _read([(axis.numbers, axis.line) for axis in axes.values()])
        return {path: np.append(raw[:-1] != raw[1:], True) for path, raw in zip(axes, values, strict=True)}

    def _make_channel(self, column: Column, number: int, spans: Mapping[str, tuple[float, float]]) -> Channel:
        path = column.time.path if column.time else ""
        rows = int(np.count_nonzero(self._kept[path])) if path in self._kept else column.rows
        kind = "time" if column.is_time else "text" if column.texts else "status" if column.is_status else "number"
        start, end = spans.get(path, (float("nan"), float("nan")))
        rate = (rows - 1) / (end - start) if end > start else float("nan")
        name, unit = take_unit(column.name, column.unit, kind)
        if name == _TIMES_OF_SIMULINK:
            unit = unit or "s"
        return Channel(
            name,
            number,
            column.path,
            unit,
            column.raster,
            rows,
            rate,
            start,
            end,
            kind,
            column.comment,
            column.scaling,
        )

    def _read_spans(self) -> dict[str, tuple[float, float]]:
        """First and last time [s] of the time axes, as far as they are few."""
        axes: dict[str, TimeAxis] = {}
        left = _MOST_TIMES
        for column in self._columns:
            if column.is_time and column.time is not None and column.rows <= left and len(axes) < _MOST_AXES:
                axes[column.path] = column.time
                left -= column.rows
        values = _read([(axis.numbers, axis.line) for axis in axes.values()])
        spans = {}
        for axis, raw in zip(axes.values(), values, strict=True):
            seconds = _convert_to_seconds(axis, raw)
            spans[axis.path] = (float(seconds[0]), float(seconds[-1]))
        return spans


def _convert_to_seconds(axis: TimeAxis, raw: np.ndarray) -> np.ndarray:
    return raw if (axis.factor, axis.first) == (1.0, 0.0) else (raw - axis.first) * axis.factor


def _read(wanted: Sequence[tuple[Numbers, Any]]) -> list[np.ndarray]:
    """Numbers along lines of arrays, in the order asked for; read in the order of the file."""
    arrays: dict[int, tuple[Numbers, list[int]]] = {}
    for number, (numbers, _) in enumerate(wanted):
        arrays.setdefault(id(numbers.block), (numbers, []))[1].append(number)
    values: list[np.ndarray] = [np.empty(0)] * len(wanted)
    ordered = sorted(arrays.values(), key=lambda one: one[0].block.place)
    for numbers, places in ordered:
        for place, column in zip(places, numbers.read([wanted[place][1] for place in places]), strict=True):
            values[place] = column
    for numbers, _ in ordered:
        numbers.block.check()
    return values


def _list_inventory(inventory: Found) -> str:
    parts = [f"{len(inventory.numbers)} single numbers"] if inventory.numbers else []
    parts += [f"{path} ({what})" for path, what in list(inventory.left_out.items())[:_MOST_LEFT_OUT]]
    return "; ".join(parts) or "no variables with numbers"
