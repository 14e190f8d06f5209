"""HDF5: datasets by path. MATLAB's own are in matlab.py, which asks first."""

from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from clutch_hil.recordings.channel import EXACT, Channel, Recording, Signal, keep_whole
from clutch_hil.recordings.formats.matlab import MatlabRecording
from clutch_hil.recordings.hdf5.file import Hdf5File, is_hdf5
from clutch_hil.recordings.hdf5.place import Place, list_state_names, read_place
from clutch_hil.recordings.hdf5.walk import MOST_REMARKS, Walk
from clutch_hil.recordings.isolated import IsolatedRecording
from clutch_hil.recordings.matlab.level73 import has_matlab_classes, is_level73
from clutch_hil.recordings.state_names import note_names, number_by_states, take_names
from clutch_hil.recordings.text_values import convert_texts
from protocols.errors import InputError
from protocols.files.bounds import check_rows


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


class Hdf5Recording:
    """See Recording."""

    def __init__(self, file: Hdf5File) -> None:
        self._file = file
        self.channels: Sequence[Channel] = []
        self.numbers: Mapping[str, float] = {}
        self.notes: list[str] = []
        with file:
            walk = Walk(file)
            with file.errors("what is in it"):
                walk.walk(file.root, 0)
            walk.finish()
            self._places = walk.places
            self.channels, self.numbers, self.notes, self.start = walk.channels, walk.numbers, walk.notes, walk.start
        if not self.channels:
            left = "; ".join(f"{path} ({what})" for path, what in list(walk.left_out.items())[:MOST_REMARKS])
            raise InputError(f"{file.name} has no columns of numbers{f'; in it are {left}' if left else ''}")

    def read(self, channels: Sequence[Channel]) -> list[Signal]:
        """See Recording.read."""
        clocks = {place.time: c.rows for c in channels if (place := self._places[c.number - 1]).time is not None}
        rows = sum(c.rows for c in channels) + sum(clocks.values())
        check_rows(f"{self._file.name}: the {len(channels)} requested columns have together", rows, 1)
        times: dict[Place, np.ndarray] = {}
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

    def _read_whole(self, channel: Channel, place: Place, values: np.ndarray) -> np.ndarray | None:
        """Whole numbers of a channel for `Signal.whole`."""
        if channel.kind != "number" or place.packing or place.field or not np.any(np.abs(values) > EXACT):
            return None
        return keep_whole(self._file.read(place.dataset, place.index).reshape(channel.rows))
