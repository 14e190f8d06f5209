"""ImportMap: conversion of the columns of a foreign recording to those of runs, as one TOML file:

    notes = "where the data come from"

    [file]                        # all optional
    skip_rows = 15                # rows of data to leave out
    low_pass_hz = 40.0            # for all columns, Butterworth of order 4 forwards and backwards: no delay
    resample_hz = 250.0           # where rasters differ, or the rate is not constant or too high (rule: rasters.py)
    longest_gap_s = 0.5           # longer gaps divide the recording into runs
    from_s = 0.1                  # part of the record to keep
    to_s = 24.7
    delimiter = ";"               # and other entries that only one format understands: docs/recordings.md

    [columns]                     # column of the run = column of the recording, in its unit
    position_m = { from = "qm", unit = "m" }
    motor_force_n = { from = "vir", unit = "N", scale_by = "gtau" }  # times a number in the file
    friction_force_n = { number = 4, unit = "uN", scale = -1.0 }     # the fourth column of the file, times a number
    pressure_bar = { from = "p", unit = "bar", scale = 2.5, offset = -1.25 }  # 0.5 to 4.5 V are 0 to 10 bar; offset in `unit`
    gear_1 = { from = "gear", unit = "1", hold = true }              # holds its last value between samples
    brake_1 = { from = "brake", states = { open = 0, closed = 1 } }  # words of the file, and the numbers that they stand for
    shaft_angle_rad = { from = "angle", unit = "deg", wraps_at = 360.0 }  # starts again at 0 after this range
    time_s = { rate_hz = 1000.0 }                                    # row number over the rate, where the file has no time
    oil_temperature_degc = { constant = 60.0 }                       # not in the file; in the unit of the run
    slip_speed_rad_s = { formula = "input_speed_rad_s - output_speed_rad_s" }  # computed from columns of the run

The unit of the run's column is the end of its name. A unit in the file takes precedence, and `unit` may then be left out;
`unit_from = "map"` overrides a wrong one. The metadata `import` of a run list the processing steps.
"""

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from math import inf, isnan
from pathlib import Path
from typing import Any

import numpy as np

from clutch_hil.recordings.channel import Channel, Recording, Signal, choose_channel
from clutch_hil.recordings.checks.values import find_placeholder
from clutch_hil.recordings.foreign_column import ForeignColumn, Reading, convert_signal, find_unit, read_column
from clutch_hil.recordings.format import list_option_keys, open_recording
from clutch_hil.recordings.rasters import Sampling, join, refuse_empty
from clutch_hil.recordings.split_time import find_fraction, join_fraction
from clutch_hil.recordings.time_axis import add_times, check_rate, count_rows
from clutch_hil.recordings.times_beside import find_times_beside, keep_rising
from clutch_hil.recordings.wrapping import find_range
from protocols.errors import InputError, name_file_in_errors, suggest_closest
from protocols.files.run import Run
from protocols.files.runs import check_columns
from protocols.files.toml_table import read_table

MAPS = Path(__file__).parent / "maps"
_KEYS: Mapping[str, type] = {
    "skip_rows": int, "low_pass_hz": float, "resample_hz": float, "longest_gap_s": float, "from_s": float, "to_s": float,
}  # fmt: skip

_LONGEST_REASON = 400  # characters of a note in an error text


@dataclass(frozen=True)
class ImportMap:
    """Conversion of a foreign file's columns to those of runs; fields as in the TOML file, see above.

    options: entries of [file] that are specific to the file's format.
    """

    name: str
    notes: str
    columns: Mapping[str, ForeignColumn]
    sampling: Sampling = field(default_factory=Sampling)
    skip_rows: int = 0
    from_s: float = -inf
    to_s: float = inf
    options: Mapping[str, Any] = field(default_factory=dict)

    def cut(self, from_s: float | None, to_s: float | None) -> "ImportMap":
        """Return this map for the part of the record from `from_s` to `to_s` [s]; None keeps an end."""
        return replace(self, from_s=self.from_s if from_s is None else from_s, to_s=self.to_s if to_s is None else to_s)

    def read(self, path: Path, required: Sequence[str] = ()) -> Run:
        """Read the foreign file `path` as one run; see `read_runs`. Raises InputError also where gaps divide it into
        several."""
        runs = self.read_runs(path, required)
        if len(runs) > 1:
            spans = ", ".join(f"{run['time_s'][0]:.4g} to {run['time_s'][-1]:.4g} s" for run in runs)
            raise InputError(f"recording {path} has gaps and becomes {len(runs)} runs ({spans}); one was asked for")
        return runs[0]

    def read_runs(self, path: Path, required: Sequence[str] = ()) -> list[Run]:
        """Read the foreign file `path` as runs, one for each stretch without gaps. required: columns that they must have.

        Only the columns of this map are read. Raises InputError with the column and its first bad row.
        """
        if "time_s" not in self.columns:
            raise InputError(
                f"import map {self.name} has no column time_s; `clutch-hil import --draft` lists what a file has"
            )
        if not any(one.is_read for name, one in self.columns.items() if name != "time_s"):
            raise InputError(f"import map {self.name} has no column except time_s")
        recording = open_recording(path, self.options)
        if self.skip_rows and (
            units := getattr(recording, "units_rows", 0)
        ):  # older maps skip a row of units with skip_rows
            return replace(self, skip_rows=max(self.skip_rows - units, 0))._read_from(path, recording, required)
        return self._read_from(path, recording, required)

    def _read_from(self, path: Path, recording: Recording, required: Sequence[str]) -> list[Run]:
        """Read the runs of an open `recording`."""
        sources = {
            name: _choose_channel(path, recording, one.column) for name, one in self.columns.items() if one.is_read
        }
        beside = find_times_beside(recording.channels, sources)
        wanted = [replace(channel, states=self.columns[name].states) for name, channel in sources.items()]
        _check_states(path, wanted)
        read = recording.read([*wanted, *beside.values()])
        signals = dict(zip(sources, read[: len(sources)], strict=True))
        times = keep_rising(dict(zip(beside, read[len(sources) :], strict=True)))
        split = find_fraction(recording.channels, signals.get("time_s"), self.columns["time_s"].unit)
        fraction = recording.read([split[0]])[0] if split else None
        notes = list(recording.notes)
        if split and fraction:
            signals["time_s"] = join_fraction(signals["time_s"], fraction, split[1], notes)
        if rate := self.columns["time_s"].rate_hz:
            signals["time_s"] = count_rows(signals, rate)
            notes.append(f"time_s is the number of the row over {rate:g} Hz")
            notes += check_rate(path, recording, list(sources.values()), self.columns["time_s"])
        reading = Reading(path, recording, self.columns, self.skip_rows)
        columns = {
            name: convert_signal(reading, name, signals[name], notes) for name in self.columns if name in signals
        }
        if self.sampling.low_pass_hz or self.sampling.resample_hz:  # behind a filter it could not be found any more
            found = {name: find_placeholder(values, 1)[0] for name, values in columns.items() if name != "time_s"}
            notes += [f"{name} {text}" for name, text in found.items() if text]
        constants = {name: one.constant for name, one in self.columns.items() if not isnan(one.constant)}
        formulas = {name: one.formula for name, one in self.columns.items() if one.formula}
        notes += [
            f"{name} is {value:g} throughout by the map: the file does not have it" for name, value in constants.items()
        ]
        notes += [
            f"{name} = {formula.text} by the map: the file does not have it" for name, formula in formulas.items()
        ]
        if self.skip_rows:
            notes.append(f"left out the first {self.skip_rows} rows")
        timed, start = add_times(reading, signals, times, columns, notes)
        try:
            pieces, done = join(path, timed, self.sampling)
        except InputError as error:
            raise InputError(f"{error}{_describe_range(signals['time_s'])}{_describe_losses(recording)}") from None
        notes += done
        origin: dict[str, Any] = {"from": path.name, "map": self.name, "notes": self.notes, "done": notes}
        if constants or formulas:
            origin["not_measured"] = {**constants, **{name: formula.text for name, formula in formulas.items()}}
        runs = []
        for piece in pieces:
            count = len(piece["time_s"])
            whole = {**piece, **{name: np.full(count, value) for name, value in constants.items()}}
            for name, formula in formulas.items():
                whole[name] = formula.compute(path, whole)
            kept = self._keep(whole)
            if len(kept["time_s"]):
                run = {name: kept[name] for name in self.columns}  # in the map's order
                try:
                    for name, formula in formulas.items():
                        formula.check_values(path, run[name])
                    _check_complete(path, run)
                    check_columns(path, run, tuple(dict.fromkeys((*run, *required))))
                except InputError as error:
                    raise InputError(f"{error}{_describe_losses(recording)}") from None
                runs.append(Run(run, {**recording.numbers, "import": origin}, {name: find_unit(name) for name in run}))
        if not runs:
            last = max(piece["time_s"][-1] for piece in pieces)
            first = min(piece["time_s"][0] for piece in pieces)
            raise InputError(
                f"recording {path} has no row from {self.from_s:g} to {self.to_s:g} s; its rows are at {first:.6g} to"
                f" {last:.6g} s"
            )
        if any(len(self._keep(piece)["time_s"]) < len(piece["time_s"]) for piece in pieces):
            notes.append(f"kept {self.from_s:g} to {min(self.to_s, runs[-1]['time_s'][-1]):g} s")
        if start:
            origin["start"] = start
        return runs

    def _keep(self, columns: Mapping[str, np.ndarray]) -> dict[str, np.ndarray]:
        kept = (columns["time_s"] >= self.from_s) & (columns["time_s"] <= self.to_s)
        return {name: values[kept] for name, values in columns.items()}


def _check_states(path: Path, channels: Sequence[Channel]) -> None:
    """Raise InputError where two columns of a map read one channel, and with other numbers for its words."""
    by_number: dict[int, Channel] = {}
    for channel in channels:
        if by_number.setdefault(channel.number, channel) != channel:
            raise InputError(
                f"recording {path}: {channel.path!r} is read twice with different states; give them once, or equal"
            )


def _check_complete(path: Path, run: Mapping[str, np.ndarray]) -> None:
    for name, values in run.items():
        if len(missing := np.flatnonzero(~np.isfinite(values))):
            refuse_empty(path, name, len(values) - len(missing))
            raise InputError(
                f"recording {path}: {name} is not a number in row {missing[0]}, one of {len(missing)} such rows; set"
                " resample_hz in [file]: they then count as missing, and longest_gap_s says which gaps are bridged"
            )


def load_map(name: str) -> ImportMap:
    """Load the map in the TOML file `name`, or a map of this package by name (`emps`). Raises InputError.

    A map with [file] only can open a file for `--list` and `--draft`, and not read runs.
    """
    path = Path(name)
    if path.is_dir():
        raise InputError(f"import map {name} is a folder; a TOML file is needed, or the name of a map")
    if not path.suffix:
        known = sorted(p.stem for p in MAPS.glob("*.toml"))
        if name not in known:
            raise InputError(f"import map {name!r} is unknown; {suggest_closest(name, known)}, or give a TOML file")
        path = MAPS / f"{name}.toml"
    with name_file_in_errors("import map", path):
        return _read_map(path)


def _read_map(path: Path) -> ImportMap:
    kinds = {**_KEYS, **list_option_keys()}
    document = read_table(path, ("notes", "file", "columns"))
    file, columns = document.read_subtable("file", tuple(kinds)), document.read_subtable("columns")
    sources = {column: read_column(column, columns) for column in columns}
    computed = [column for column, source in sources.items() if source.formula]
    for k, column in enumerate(computed):
        if formula := sources[column].formula:
            formula.check_names(sources.keys() - set(computed[k:]), set(computed[k:]))
    entries = {key: file.get(key, kinds[key]) for key in file}
    for key in ("low_pass_hz", "resample_hz", "longest_gap_s", "skip_rows"):
        if entries.get(key, 0) < 0:
            raise InputError(f"{key} is {entries[key]:g}; allowed is 0 or more")
    sampling = Sampling(**{key: entries.get(key, 0.0) for key in ("low_pass_hz", "resample_hz", "longest_gap_s")})
    return ImportMap(
        name=path.stem, notes=document.get("notes", str, ""), columns=sources, sampling=sampling,
        skip_rows=entries.get("skip_rows", 0), from_s=entries.get("from_s", -inf), to_s=entries.get("to_s", inf),
        options={key: value for key, value in entries.items() if key not in _KEYS},
    )  # fmt: skip


def _choose_channel(path: Path, recording: Recording, wanted: str | int) -> Channel:
    """Return the channel `wanted`. Raises InputError, with the reason where the reader has left it out."""
    try:
        return choose_channel(path, recording.channels, wanted)
    except InputError as error:
        why = ""
        if isinstance(wanted, str):  # also of a signal without its message
            for name in filter(None, (wanted, wanted.rpartition(".")[0])):
                told = re.compile(rf"left out\b.*(?<!\w){re.escape(name)}(?!\w)", re.DOTALL)
                why = why or next((note for note in recording.notes if told.match(note)), "")
            if not wanted.isascii():
                why = why or next((note for note in recording.notes if "set encoding" in note), "")
        raise InputError(f"{error}; {why[:_LONGEST_REASON]}" if why else str(error)) from None


def _describe_range(clock: Signal) -> str:
    """Return the range after which a time begins anew, for an error text; "" if it is no counter that does."""
    period, row = find_range(clock.values)
    return f"; {clock.channel.path!r} begins anew in row {row}, as a counter does after {period}" if period else ""


def _describe_losses(recording: Recording) -> str:
    """Return what was left out of a recording, for an error text: it may explain why rows do not follow each other."""
    return "".join(f"; {note}" for note in recording.notes if note.startswith("left out"))
