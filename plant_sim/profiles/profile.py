"""Profile: set-points of the supervisor over time.

A CSV file with the columns `time_s`, `torque_demand_nm`, `motor_speed_demand_rad_s` and, optionally, `pressure_demand_bar` and
`lock`, in any order; linear between rows. From a row with `lock` 1 to the next with 0 the clutch is locked, and torque and
pressure demands have no effect. Otherwise a pressure demand above zero is followed, whatever the torque demand. Otherwise the
clutch is engaged between two rows if one of them has a torque demand above zero. The first 50 ms are idle for any demand,
because a controller needs a request for idle before it closes a clutch. A pressure demand below 2 bar (`pressure.floor` of the
controller: the plates do not touch there) is followed at 2 bar.
"""

import csv
import os
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property
from math import ceil
from pathlib import Path
from typing import NamedTuple

import numpy as np

from protocols.can.request import Request
from protocols.can.size import find_database, read_size
from protocols.errors import InputError, join_names
from protocols.input_file import read_text

FOLDER = Path(__file__).parent
COLUMNS = ("time_s", "torque_demand_nm", "motor_speed_demand_rad_s")
PRESSURE_COLUMN = "pressure_demand_bar"
OPTIONAL_COLUMNS = (PRESSURE_COLUMN, "lock")
_SIZE = read_size(find_database())  # of this process's bench
TORQUE_LIMIT = 30.0 * _SIZE.torque  # Nm, range of the maps (Janssens 2010, fig 6.12)
# bar, highest demand of the controller: the maps end at 4.2 bar (Janssens 2010, fig 6.12)
PRESSURE_LIMIT = 4.5 * _SIZE.pressure
FULL_PRESSURE = 5.0 * _SIZE.pressure  # bar, upper end of plot scales: the guard's limit, as shipped (limits.toml)
# bar, at which the controller fills: with a lower demand it would open a clutch that it has just closed
FILL_PRESSURE = 2.6
# s at the beginning in which the request is idle, whatever the profile demands: a controller needs it before it closes a
# clutch (phases.py). Three samples at 50 Hz, as one frame may be lost.
IDLE_FIRST = 0.05
LATEST_TIME = 1e9  # s, 31 years: the latest time of a row
_SHORTEST_RUN = 0.1  # s, of a run: five samples at the lowest rate
_LONGEST_RUN = 1e6  # s, of a run that repeats a profile: 11 days
_MOST_ROWS = 2_000_000  # of a profile, including repetitions: it is held in memory, 0.3 kB a row
_MOST_BYTES = 100_000_000  # of a file with _MOST_ROWS rows
_OTHER_MARKS = ";\t"  # between columns of tables of spreadsheets in other languages
_REPEAT_GAP = 1e-3  # s between the last row of a profile and the first of its repetition: times must increase
SPEED_LIMIT = 26.2 * _SIZE.speed  # rad/s either way, 250 rpm, range of the maps (Janssens 2010, fig 6.12)


def interpolate_setpoint(table, time):
    """Return the set-point of a `Profile.table` at `time` [s]: request, torque [Nm], speed [rad/s], pressure [bar].

    table has shape (5, rows); linear between rows. The plant's loop compiles it (`plant_cycle.py`).
    """
    times, torques, speeds, pressures, locks = table[0], table[1], table[2], table[3], table[4]
    after = np.searchsorted(times, time, side="right")
    if after == 0:
        return Request.IDLE.value, torques[0], speeds[0], 0.0
    if after == len(times):
        return Request.IDLE.value, 0.0, speeds[-1], 0.0
    before = after - 1
    share = (time - times[before]) / (times[after] - times[before])
    speed = speeds[before] + share * (speeds[after] - speeds[before])
    if locks[before] > 0.0:
        return Request.LOCK.value if time >= IDLE_FIRST else Request.IDLE.value, 0.0, speed, 0.0
    torque = torques[before] + share * (torques[after] - torques[before])
    pressure = pressures[before] + share * (pressures[after] - pressures[before])
    engage = torques[before] > 0.0 or torques[after] > 0.0
    request = Request.PRESSURE.value if pressure > 0.0 else Request.ENGAGE.value if engage else Request.IDLE.value
    if time < IDLE_FIRST:
        request = Request.IDLE.value
    return request, torque, speed, pressure


class Setpoint(NamedTuple):
    """Set-point at one instant: the values of the frame TORQUE_SETPOINT, in its order."""

    request: Request
    torque: float  # Nm
    speed: float  # rad/s
    pressure: float  # bar


def check_seconds(seconds: float) -> None:
    """Raise InputError for a duration `seconds` [s] that a run cannot have."""
    if not seconds >= _SHORTEST_RUN:
        raise InputError(f"a run of {seconds:g} s is not possible; it must last {_SHORTEST_RUN:g} s or more")


@dataclass(frozen=True)
class Profile:
    """Breakpoints: time [s], torque demand [Nm], motor speed demand [rad/s], all of the same length, at least 2.

    pressure: pressure demand [bar]; lock: 1 from a row at which the clutch is locked, 0 from a row at which it is not. Both
    have the same length; zeros by default.
    """

    name: str
    time: Sequence[float]
    torque: Sequence[float]
    speed: Sequence[float]
    pressure: Sequence[float] = ()
    lock: Sequence[float] = ()

    def __post_init__(self) -> None:
        """Raise InputError naming the first bad row."""
        for name in ("pressure", "lock"):
            object.__setattr__(self, name, getattr(self, name) or (0.0,) * len(self.time))
        if len(self.time) < 2:
            raise InputError(f"profile {self.name} has {len(self.time)} rows; at least 2 are needed")
        if len(set(lengths := [len(column) for column in self._columns])) > 1:
            raise InputError(f"profile {self.name} has columns of {lengths} values; all columns need the same number")
        for row, (time, torque, speed, pressure, lock) in enumerate(self._list_rows(), 1):
            if not 0.0 <= time <= LATEST_TIME or (row > 1 and time <= self.time[row - 2]):
                raise InputError(
                    f"profile {self.name}, row {row}: time_s = {time:g}; it must increase, from 0 to {LATEST_TIME:g} at most"
                )
            if not 0.0 <= torque <= TORQUE_LIMIT:
                raise InputError(
                    f"profile {self.name}, row {row}: set-point {torque:g} Nm is outside 0..{TORQUE_LIMIT:g} Nm"
                )
            if not -SPEED_LIMIT <= speed <= SPEED_LIMIT:
                raise InputError(
                    f"profile {self.name}, row {row}: speed {speed:g} rad/s is outside {-SPEED_LIMIT:g}..{SPEED_LIMIT:g} rad/s"
                )
            if not 0.0 <= pressure <= PRESSURE_LIMIT:
                raise InputError(
                    f"profile {self.name}, row {row}: set-point {pressure:g} bar is outside 0..{PRESSURE_LIMIT:g} bar"
                )
            if lock not in (0.0, 1.0):
                raise InputError(f"profile {self.name}, row {row}: lock is {lock:g}; allowed are 0 and 1")
        if self.duration < _SHORTEST_RUN:
            raise InputError(
                f"profile {self.name} ends at {self.duration:g} s; it must last {_SHORTEST_RUN:g} s or more"
            )

    @property
    def duration(self) -> float:
        """Time of the last breakpoint [s]."""
        return self.time[-1]

    def interpolate(self, time: float) -> Setpoint:
        """Return the set-point at `time` [s]; the first and last row hold outside."""
        request, *demands = interpolate_setpoint(self.table, time)
        return Setpoint(Request(request), *map(float, demands))

    @cached_property
    def table(self) -> np.ndarray:
        """Times, torques, speeds, pressures and locks, shape (5, rows)."""
        return np.array(self._columns)

    def shift_pressures(self, shift: float) -> "Profile":
        """Add `shift` [bar] to every pressure demand above zero. Raises InputError if one leaves its range."""
        pressures = tuple(pressure + shift if pressure > 0.0 else 0.0 for pressure in self.pressure)
        return Profile(f"{self.name}{shift:+.2f}bar", self.time, self.torque, self.speed, pressures, self.lock)

    def format_csv(self) -> str:
        """Return the text of a file of this profile, as `load_profile` reads it."""
        rows = (",".join(map(repr, map(float, row))) for row in self._list_rows())
        return "\n".join([",".join((*COLUMNS, *OPTIONAL_COLUMNS)), *rows, ""])

    def repeat_to(self, seconds: float) -> "Profile":
        """Repeat this profile and cut it to `seconds`. Raises InputError for a time that is too short or too long."""
        check_seconds(seconds)
        if seconds > _LONGEST_RUN:
            raise InputError(f"a run of {seconds:g} s is not possible; it must last {_LONGEST_RUN:g} s or less")
        period = self.duration + _REPEAT_GAP
        if (count := ceil(seconds / period) * len(self.time)) > _MOST_ROWS:
            raise InputError(
                f"a run of {seconds:g} s repeats profile {self.name} until it has {count} rows; allowed are {_MOST_ROWS}"
            )
        rows = [(k * period + time, *row) for k in range(ceil(seconds / period)) for time, *row in self._list_rows()]
        cut = [row for row in rows if row[0] < seconds]
        end = self.interpolate(seconds % period)
        cut.append((seconds, end.torque, end.speed, end.pressure, float(end.request is Request.LOCK)))
        return Profile(self.name, *zip(*cut, strict=True))

    @property
    def _columns(self) -> tuple[Sequence[float], ...]:
        return self.time, self.torque, self.speed, self.pressure, self.lock

    def _list_rows(self) -> Iterator[tuple[float, ...]]:
        return zip(*self._columns, strict=True)


def load_profile(name: str, seconds: float | None = None) -> Profile:
    """Load a profile by file path, or by name from those that come with the rig; repeated or cut to `seconds` if given.

    Raises InputError.
    """
    path = find_profile(name, FOLDER, "profile")
    columns = read_columns(path, "profile", COLUMNS, OPTIONAL_COLUMNS)
    profile = Profile(path.stem, *(columns.get(name, ()) for name in (*COLUMNS, *OPTIONAL_COLUMNS)))
    return profile if seconds is None else profile.repeat_to(seconds)


def list_profiles() -> list[str]:
    """Return the names of the shipped profiles, of one clutch and of two."""
    return sorted(path.stem for path in FOLDER.glob("*.csv"))


def find_profile(name: str, folder: Path, kind: str) -> Path:
    """Return the path of a profile of this `kind`, given by its path or its name in `folder`. Raises InputError."""
    if name.endswith(".csv"):
        return Path(name)
    if os.path.isfile(path := folder / f"{name}.csv"):
        return path
    if os.path.isfile(name):
        raise InputError(f"{kind} {name!r} has the wrong suffix; a profile file ends with .csv")
    if os.path.isdir(name):
        raise InputError(f"{kind} {name!r} is a folder; allowed is a .csv file")
    known = join_names(sorted(p.stem for p in folder.glob("*.csv")))
    raise InputError(f"{kind} {name!r} does not exist; known are {known}, or the path of a .csv file")


def read_columns(path: Path, kind: str, needed: Sequence[str], optional: Sequence[str]) -> dict[str, tuple[float, ...]]:
    """Read columns of a CSV file by name: the `needed` ones and existing `optional` ones. Lines with # are comments.

    kind: of the file, for the InputError about a wrong file.
    """
    try:
        lines = read_text(path, kind, _MOST_BYTES).splitlines()
        rows = csv.reader(line for line in lines if not line.startswith("#"))
        header = tuple(next(rows, ()))
        if mark := next((mark for mark in _OTHER_MARKS if any(mark in name for name in header)), None):
            raise InputError(
                f"{kind} {path} has {mark!r} between its columns; allowed is a comma, and a point in the numbers"
            )
        if len(set(header)) < len(header) or not set(needed) <= set(header) <= {*needed, *optional}:
            raise InputError(
                f"{kind} {path} has the columns {', '.join(header) or '-'}; {', '.join(needed)} are needed,"
                f" {', '.join(optional)} are optional"
            )
        table = [row for row in rows if row]
    except csv.Error as error:
        raise InputError(f"{kind} {path} cannot be read: {error}") from None
    if bad := next((i for i, row in enumerate(table, 1) if len(row) != len(header)), None):
        raise InputError(f"{kind} {path}, row {bad} has {len(table[bad - 1])} cells; {len(header)} are needed")
    values = [
        [_parse_number(cell, f"{kind} {path}, row {i}: {name}") for cell, name in zip(row, header, strict=True)]
        for i, row in enumerate(table, 1)
    ]
    return {name: tuple(row[i] for row in values) for i, name in enumerate(header)}


def _parse_number(cell: str, what: str) -> float:
    """Parse the number in a cell. Raises InputError, which calls it `what`."""
    try:
        return float(cell)
    except ValueError:
        raise InputError(f"{what} is {cell!r}; a number is needed") from None
