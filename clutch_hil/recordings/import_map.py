"""ImportMap: how the columns of a foreign recording become those of runs. One TOML file:

    notes = "where the data come from"

    [file]                        # all optional
    skip_rows = 15                # rows of data to leave out
    low_pass_hz = 40.0            # all columns alike, Butterworth of order 4 forwards and backwards: no delay
    resample_hz = 250.0           # where rasters differ, or the rate is not constant or is too high (rasters.py tells the rule)
    longest_gap_s = 0.5           # longer gaps cut the recording into runs
    from_s = 0.1                  # part of the record to keep
    to_s = 24.7
    delimiter = ";"               # and other entries that only one format understands: docs/recordings.md

    [columns]                     # column of the run = column of the recording, in its unit
    position_m = { from = "qm", unit = "m" }
    motor_force_n = { from = "vir", unit = "N", scale_by = "gtau" }  # times a number that the file has
    friction_force_n = { number = 4, unit = "uN", scale = -1.0 }     # the fourth column of the file, times a number
    gear_1 = { from = "gear", unit = "1", hold = true }              # keeps its last value between samples
    shaft_angle_rad = { from = "angle", unit = "deg", wraps_at = 360.0 }  # begins anew after so many of its unit
    time_s = { rate_hz = 1000.0 }                                    # by the number of the row, where the file tells no time

The unit of the run's column is the end of its name. Where the file tells a unit, that one counts, and `unit` may be left out;
`unit_from = "map"` sets a wrong one right. The metadata `import` of a run say what was done to the data.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from datetime import UTC, datetime
from math import inf, isclose, isnan, nan, tau
from pathlib import Path
from typing import Any

import numpy as np

from clutch_hil.recordings.channel import Channel, Recording, Signal, choose_channel, is_time_name, simplify_unit
from clutch_hil.recordings.format import list_option_keys, open_recording
from clutch_hil.recordings.rasters import Sampling, TimedColumn, join
from protocols.errors import InputError, name_file_in_errors, suggest_closest
from protocols.files.run import Run
from protocols.files.runs import check_columns
from protocols.files.toml_table import TomlTable, read_table
from protocols.files.units import from_si, have_same_quantity, to_si

MAPS = Path(__file__).parent / "maps"
_KEYS: Mapping[str, type] = {
    "skip_rows": int, "low_pass_hz": float, "resample_hz": float, "longest_gap_s": float, "from_s": float, "to_s": float,
}  # fmt: skip
_COLUMN_KEYS = ("from", "number", "unit", "unit_from", "scale", "scale_by", "hold", "wraps_at", "missing", "rate_hz")
_MOST_HZ = 1e9  # rate of rows: more than any recorder of a rig
_EPOCH_S = 1e8  # s, three years: a time axis that begins later counts from a date, not from a start
_LATEST_S = 2e11  # s, the year 8307 from 1970; MATLAB's days from the year 0 are 6e10 s, ms since 1970 are above 9e11
_DAY = 86400.0  # s
_DAYS = ((3e4, 6e4), (7.2e5, 7.5e5))  # from 1982 to 2064 as Excel counts days, and about these years as MATLAB does
_FEWEST_DAYS = 10  # rows that tell
_SHORT_STEP = 2e-5  # s; above 50 kHz no rig records torque. As a day it is 2 s
_LARGEST = 1e100  # in the file's unit: no quantity is so large, and what is computed of it stays finite
_SAME_NUMBER = 1e-6  # of it: a number that the file has with 32 bits
_FEW_STATES = 32  # different whole numbers of a column without unit that is taken for a status
# End of a column's name -> its unit (docs/rig.md, "Signals of a recorded run")
UNITS = {
    "s": "s", "v": "V", "rad": "rad", "rad_s": "rad/s", "bar": "bar", "degc": "degC", "nm": "Nm", "n": "N", "m": "m",
    "m_s": "m/s", "a": "A", "w": "W", "hz": "Hz", "1": "1",
}  # fmt: skip


@dataclass(frozen=True)
class ForeignColumn:
    """A foreign column: its name, or its number from 1; 0 for a time by the number of the row, at `rate_hz`.

    unit: "" where the file's own counts. trust_file: whether a unit in the file counts more than `unit`. scale: factor.
    scale_by: name of a further factor in the file, "" for none. hold: whether it keeps its value between samples; None: decided
    by content. wraps_at: range after which it begins anew, in the file's unit; 0 for never. missing: number in the file that
    stands for no value; NaN for none.
    """

    column: str | int
    unit: str = ""
    trust_file: bool = True
    scale: float = 1.0
    scale_by: str = ""
    hold: bool | None = None
    wraps_at: float = 0.0
    missing: float = nan
    rate_hz: float = 0.0


@dataclass(frozen=True)
class ImportMap:
    """How the columns of a foreign file become those of runs; fields as in the TOML file, see above.

    options: entries of [file] that only the file's format understands.
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
        """This map for the part of the record from `from_s` to `to_s` [s]; None keeps an end."""
        return replace(self, from_s=self.from_s if from_s is None else from_s, to_s=self.to_s if to_s is None else to_s)

    def read(self, path: Path, required: Sequence[str] = ()) -> Run:
        """The one run in the foreign file `path`; see `read_runs`. Raises InputError also where gaps cut it into several."""
        runs = self.read_runs(path, required)
        if len(runs) > 1:
            spans = ", ".join(f"{run['time_s'][0]:.4g} to {run['time_s'][-1]:.4g} s" for run in runs)
            raise InputError(f"recording {path} has gaps and becomes {len(runs)} runs ({spans}); one was asked for")
        return runs[0]

    def read_runs(self, path: Path, required: Sequence[str] = ()) -> list[Run]:
        """The runs in the foreign file `path`, one for each stretch without gaps; they must have the columns `required`.

        Only the columns of this map are read. Raises InputError naming the column and its first bad row.
        """
        if "time_s" not in self.columns:
            raise InputError(
                f"import map {self.name} has no column time_s; `clutch-hil import --draft` lists what a file has"
            )
        recording = open_recording(path, self.options)
        if self.skip_rows and (
            units := getattr(recording, "units_rows", 0)
        ):  # older maps leave out a row of units this way
            return replace(self, skip_rows=max(self.skip_rows - units, 0))._read_from(path, recording, required)
        return self._read_from(path, recording, required)

    def _read_from(self, path: Path, recording: Recording, required: Sequence[str]) -> list[Run]:
        """The runs in an open `recording`."""
        sources = {
            name: choose_channel(path, recording.channels, one.column)
            for name, one in self.columns.items()
            if not one.rate_hz
        }
        beside = _find_times_beside(recording.channels, sources)
        read = recording.read([*sources.values(), *beside.values()])
        signals = dict(zip(sources, read[: len(sources)], strict=True))
        times = dict(zip(beside, read[len(sources) :], strict=True))
        notes = list(recording.notes)
        if rate := self.columns["time_s"].rate_hz:
            signals["time_s"] = _count_rows(signals, rate)
            notes.append(f"time_s is the number of the row over {rate:g} Hz")
        columns = {n: self._convert(path, recording, n, signals[n], notes) for n in self.columns}
        timed, start = self._with_times(path, recording, signals, times, columns, notes)
        try:
            pieces, done = join(path, timed, self.sampling)
        except InputError as error:
            raise InputError(f"{error}{_describe_losses(recording)}") from None
        notes += done
        origin = {"from": path.name, "map": self.name, "notes": self.notes, "done": notes}
        runs = []
        for piece in pieces:
            kept = self._keep(piece)
            if len(kept["time_s"]):
                run = {name: kept[name] for name in self.columns}  # in the map's order
                try:
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

    def _convert(
        self, path: Path, recording: Recording, name: str, signal: Signal, notes: list[str], origin: float = 0.0
    ) -> np.ndarray:
        """Values (n,) of a signal in the unit of the run's column `name`, above `origin`, which is in the file's unit."""
        source, channel = self.columns[name], signal.channel
        if channel.kind == "text":
            cells = f", {channel.comment}" if channel.comment.startswith("such as") else ""
            remedy = "; set time_format in [file] where these are times" if name == "time_s" and cells else ""
            raise InputError(
                f"recording {path}: column {channel.name!r} for {name} holds text{cells}; allowed are numbers{remedy}"
            )
        unit = _choose_unit(path, name, source, channel, notes)
        scale = source.scale
        if source.scale_by:
            factor = recording.numbers.get(source.scale_by)
            if factor is None:
                raise InputError(f"recording {path} has no number {source.scale_by!r} to scale {name} by")
            scale *= factor
        one, zero = (from_si(to_si(value, unit), find_unit(name)) for value in (1.0, 0.0))
        values = signal.values[self.skip_rows :]
        if not isnan(source.missing):
            absent = np.isclose(values, source.missing, rtol=_SAME_NUMBER, atol=0.0)
            values = np.where(absent, nan, values)
            notes.append(
                f"{channel.name}: {np.count_nonzero(absent)} samples are {source.missing:g}, which is no value"
            )
        if len(huge := np.flatnonzero(np.isfinite(values) & (np.abs(values) > _LARGEST))):
            row = int(huge[0])
            raise InputError(
                f"recording {path}: {channel.path!r} for {name} is {values[row]:.4g} in row {row + self.skip_rows}; allowed is"
                f" up to {_LARGEST:g}; where it stands for no value, set missing = {values[row]!r} for {name} in the map"
            )
        if source.wraps_at:
            values, turns = _unwrap(values, source.wraps_at)
            notes.append(f"{channel.name}: began anew {turns} times after {source.wraps_at:g}, which is undone")
        if origin:  # before all else: a time since 1970 in us or ns loses digits as seconds
            values = values - origin
        if (one, zero, scale) == (1.0, 0.0, 1.0):
            return values
        return (one - zero) * scale * values.astype(float) + zero  # of 32 bits a small unit would leave infinity

    def _with_times(
        self,
        path: Path,
        recording: Recording,
        signals: Mapping[str, Signal],
        times: Mapping[str, Signal],
        columns: Mapping[str, np.ndarray],
        notes: list[str],
    ) -> tuple[list[TimedColumn], str]:
        """All columns but time_s, each with its time, and the time of day of time 0. times: those beside a column."""
        if self.skip_rows:
            notes.append(f"left out the first {self.skip_rows} rows")
        clock, axis, start = signals["time_s"].channel, columns["time_s"], recording.start
        if len(columns) == 1:
            raise InputError(f"import map {self.name} has no column beside time_s")
        origin = 0.0
        if len(axis) and _EPOCH_S < axis[0] < inf:
            _check_epoch(path, signals["time_s"].channel, axis[0])
            start = _format_time_of_day(axis[0]) or start
            notes.append(f"time_s begins at {axis[0]:.6f} s{f', {start}' if start else ''}; counted from there")
            origin = signals["time_s"].values[self.skip_rows]
            axis = self._convert(path, recording, "time_s", signals["time_s"], [], origin)
            whole, source = signals["time_s"].whole, self.columns["time_s"]
            if (
                whole is not None and isnan(source.missing) and not source.wraps_at
            ):  # the first one goes before the digits do
                since = np.array(whole - whole[self.skip_rows], float)
                axis = self._convert(path, recording, "time_s", Signal(signals["time_s"].channel, since), [])
        if clock.kind == "number" and _looks_like_days(axis):
            notes.append(
                f"time_s begins at {axis[0]:.6g} s with steps of {1e6 * np.median(np.diff(axis)):.3g} us: {clock.path!r} counts"
                " days of a spreadsheet, perhaps; set unit = 'd' then"
            )
        timed = []
        for name, values in columns.items():
            if name == "time_s":
                continue
            signal = signals[name]
            if own := times.get(name):
                begin = origin * self._count_seconds(path, clock) / self._count_seconds(path, own.channel)
                time = self._convert(path, recording, "time_s", own, [], begin)
                notes.append(f"{name}: at the times of {own.channel.path!r}, which stands beside it")
            elif signal.channel.raster == clock.raster:
                time = axis
            elif clock.kind == "time" and signal.time is not None:
                time = self._convert(path, recording, "time_s", Signal(clock, signal.time), [], origin)
            else:
                raise InputError(_describe_strangers(path, recording, signal, name, clock))
            if len(time) != len(values):
                raise InputError(
                    f"recording {path}: {signal.channel.path!r} for {name} has {len(values)} rows, its time has {len(time)}"
                )
            timed.append(TimedColumn(name, time, values, _is_held(self.columns[name], signal, notes, name)))
        if start:
            notes.append(f"recorded at {start}, by the file")
        return timed, start

    def _count_seconds(self, path: Path, clock: Channel) -> float:
        """Seconds in the unit of a time axis."""
        return to_si(1.0, _choose_unit(path, "time_s", self.columns["time_s"], clock, []))


def _find_times_beside(channels: Sequence[Channel], sources: Mapping[str, Channel]) -> dict[str, Channel]:
    """For columns in another group of the file than time_s: the channel of its name in their own group.

    Tools write `fast/time`, `fast/torque` and `slow/time`, `slow/speed`, also with as many rows.
    """
    clock = sources.get("time_s")
    if not clock or clock.kind != "number" or not is_time_name(clock.name):
        return {}
    named = [one for one in channels if one.name == clock.name and one.kind == "number"]
    found = {}
    for name, channel in sources.items():
        groups = [one for one in named if channel.path.startswith(_find_group(one))]
        if not groups and channel.raster != clock.raster:  # a path has no group where the name is unique
            groups = [one for one in named if one.raster == channel.raster]
        nearest = max(groups, key=lambda one: len(_find_group(one)), default=clock)
        if name != "time_s" and _find_group(nearest) != _find_group(clock) and nearest.rows == channel.rows:
            found[name] = nearest
    return found


def _find_group(channel: Channel) -> str:
    """What stands before the name in a path, as `fast/` in `fast/time` and `fast/time [ms]`."""
    return channel.path.rpartition(channel.name)[0]


def _count_rows(signals: Mapping[str, Signal], rate: float) -> Signal:
    """The number of the row over `rate` [Hz], for the raster of the first signal."""
    first = next(iter(signals.values()), Signal(Channel("", 0, ""), np.zeros(0)))
    rows = len(first.values)
    return Signal(Channel("row", 0, "row", "s", first.channel.raster, rows), np.arange(rows) / rate)


def _unwrap(values: np.ndarray, period: float) -> tuple[np.ndarray, int]:
    """Values (n,) without the steps back by `period`, and how many there were. What is missing stays missing."""
    known = np.isfinite(values)
    whole = values.astype(float)
    whole[known] = np.unwrap(whole[known], period=period)
    moved = np.diff(whole[known] - values[known])
    return whole, int(np.count_nonzero(np.abs(moved) > 0.5 * period))


def _check_complete(path: Path, run: Mapping[str, np.ndarray]) -> None:
    for name, values in run.items():
        if len(missing := np.flatnonzero(~np.isfinite(values))):
            raise InputError(
                f"recording {path}: {name} is not a number in row {missing[0]}, one of {len(missing)} such rows; set"
                " resample_hz in [file]: they then count as missing, and longest_gap_s says which gaps are bridged"
            )


def _describe_strangers(path: Path, recording: Recording, signal: Signal, name: str, clock: Channel) -> str:
    """What is wrong where a signal does not share its rows with that of time_s."""
    own = [c.path for c in recording.channels if c.kind == "time" and c.raster == signal.channel.raster]
    remedy = f"; take time_s from {own[0]!r}" if own else ", and no time axis of its own"
    return (
        f"recording {path}: {signal.channel.path!r} for {name} has {len(signal.values)} rows on the raster"
        f" {signal.channel.raster!r}, time_s has {clock.rows} on {clock.raster!r}{remedy}"
    )


def load_map(name: str) -> ImportMap:
    """The map in the TOML file `name`, or one of this package by name (`emps`). Raises InputError.

    A map of [file] alone opens a file, for `--list` and `--draft`; it reads no run.
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
    sources = {column: _read_column(column, columns.read_subtable(column, _COLUMN_KEYS)) for column in columns}
    for column in sources:
        find_unit(column)
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


def find_unit(column: str) -> str:
    """Unit of a column of a run, by the end of its name. Raises InputError."""
    words = column.split("_")
    for end in ("_".join(words[-2:]), words[-1]):
        if end in UNITS and len(words) > 1:
            return UNITS[end]
    raise InputError(f"column {column!r} tells no unit; allowed ends are {', '.join('_' + end for end in UNITS)}")


def _read_column(column: str, entry: TomlTable) -> ForeignColumn:
    if "rate_hz" in entry:
        return _read_rate(column, entry)
    if ("from" in entry) == ("number" in entry):
        raise InputError(f"{column} needs either `from`, a name, or `number`, counted from 1")
    unit, source = entry.get("unit", str, ""), entry.get("unit_from", str, "file")
    if source not in ("file", "map"):
        raise InputError(f"{column}.unit_from is {source!r}; allowed are file and map")
    if source == "map" and not unit:
        raise InputError(f"{column} has unit_from = 'map' and no unit")
    if unit and not have_same_quantity(unit, find_unit(column)):
        raise InputError(f"{column} is given in {unit!r}, which cannot be converted into {find_unit(column)!r}")
    if not (scale := entry.get("scale", float, 1.0)):
        raise InputError(f"{column}.scale is 0; allowed is any other number")
    wraps_at = entry.get("wraps_at", float, 0.0)
    if not 0.0 <= wraps_at <= _LARGEST:
        raise InputError(f"{column}.wraps_at is {wraps_at:g}; allowed is above 0, in the file's unit")
    return ForeignColumn(
        entry.get("from", str) if "from" in entry else entry.get("number", int),
        unit,
        source == "file",
        scale,
        entry.get("scale_by", str, ""),
        entry.get("hold", bool, None),
        wraps_at,
        entry.get("missing", float, nan),
    )


def _read_rate(column: str, entry: TomlTable) -> ForeignColumn:
    """A time by the number of the row."""
    rate = entry.get("rate_hz", float)
    if column != "time_s" or list(entry) != ["rate_hz"]:
        raise InputError(f"{column} has rate_hz; allowed is it as the one entry of time_s")
    if not 0.0 < rate <= _MOST_HZ:
        raise InputError(f"time_s.rate_hz is {rate:g}; allowed is above 0, up to {_MOST_HZ:g}")
    return ForeignColumn(0, "s", rate_hz=rate)


def _choose_unit(path: Path, name: str, source: ForeignColumn, channel: Channel, notes: list[str]) -> str:
    """Unit of a foreign column: the file's where it tells one, else the map's. Raises InputError where the two do not fit."""
    written = simplify_unit(channel.unit)
    if not written or not source.trust_file:
        if not source.unit:
            raise InputError(f"recording {path} tells no unit of {channel.name!r} for {name}; set `unit` in the map")
        return source.unit
    try:
        fits = have_same_quantity(written, find_unit(name))
    except InputError:
        if not source.unit:
            raise InputError(
                f"recording {path}: {channel.name!r} for {name} has the unknown unit {channel.unit!r}; set `unit` in the map"
            ) from None
        notes.append(f"{channel.name}: the file's unit {channel.unit!r} is unknown; the map's counts, {source.unit}")
        return source.unit
    if (
        not fits and find_unit(name) == "rad/s" and have_same_quantity(written, "Hz")
    ):  # 1/min, as DIN and ISO write turns
        turns = f"{channel.name}: the file's unit {channel.unit!r} counts turns"
        if source.unit and isclose(to_si(1.0, source.unit), tau * to_si(1.0, written)):
            notes.append(f"{turns}, by the map")
            return source.unit
        raise InputError(
            f"recording {path}: {turns}, or something else; set unit = 'rpm' where these are turns a minute"
        )
    if not fits:
        raise InputError(
            f"recording {path}: {channel.name!r} for {name} is in {channel.unit!r}, which cannot be converted into"
            f" {find_unit(name)!r}; if the file is wrong, set unit and unit_from = 'map'"
        )
    if source.unit and (to_si(1.0, written), to_si(0.0, written)) != (to_si(1.0, source.unit), to_si(0.0, source.unit)):
        notes.append(f"{channel.name}: the file says {channel.unit}, the map {source.unit}; the file's unit counts")
    return written


def _describe_losses(recording: Recording) -> str:
    """What was left out of a recording, for a message: the reason, perhaps, why its rows do not follow each other."""
    return "".join(f"; {note}" for note in recording.notes if note.startswith("left out"))


def _is_held(source: ForeignColumn, signal: Signal, notes: list[str], name: str) -> bool:
    """Whether a column keeps its last value between samples: where the map says so, or the file, or its content."""
    if source.hold is not None:
        return source.hold
    if signal.channel.kind == "status":
        return True
    values = signal.values[np.isfinite(signal.values)]
    if find_unit(name) != "1" or simplify_unit(signal.channel.unit) not in ("", "1") or not len(values):
        return False
    return bool(np.all(values == np.rint(values))) and len(np.unique(values)) <= _FEW_STATES


def _check_epoch(path: Path, clock: Channel, first: float) -> None:
    """Raise InputError for a time that is so large in s that it must count ms, us or ns."""
    if first > _LATEST_S:
        remedy = "set unit and unit_from = 'map'" if clock.unit else "set unit"
        raise InputError(
            f"recording {path}: {clock.path!r} for time_s begins at {first:.6g} s, which no clock shows; if it counts ms, us or"
            f" ns since 1970, {remedy}"
        )


def _looks_like_days(time: np.ndarray) -> bool:
    """Whether a time (n,) [s] can be days, taken for seconds: of Excel from 1900 or of MATLAB from 0, and all within one."""
    if len(time) < _FEWEST_DAYS or not any(low < time[0] <= time[-1] < high for low, high in _DAYS):
        return False
    return bool(time[-1] - time[0] < 1.0 and 0.0 < np.median(np.diff(time)) < _SHORT_STEP)


def _format_time_of_day(epoch: float) -> str:
    """Seconds since 1970 as ISO 8601; "" where they are no date in the past, as days of a spreadsheet are not."""
    if not 0.0 < epoch < datetime.now(UTC).timestamp() + _DAY:
        return ""
    return datetime.fromtimestamp(epoch, UTC).isoformat()
