"""Profile: what the supervisor asks for over time.

A CSV file with the columns `time_s`, `torque_demand_nm`, `motor_speed_demand_rad_s`; straight lines between rows. The
clutch is engaged between two rows of which one has a demand above zero.
"""

import csv
from bisect import bisect_right
from collections.abc import Sequence
from dataclasses import dataclass
from math import ceil, isfinite
from pathlib import Path
from typing import NamedTuple

from protocols.errors import InputError, listing

FOLDER = Path(__file__).with_name("profiles")
COLUMNS = ("time_s", "torque_demand_nm", "motor_speed_demand_rad_s")
TORQUE_LIMIT = 30.0  # Nm, range of the maps (Janssens 2010, fig 6.12)
_SHORTEST = 0.1  # s, of a run: five samples at the lowest rate
_REPEAT_GAP = 1e-3  # s between the last row of a profile and the first of its repetition: times must increase
SPEED_LIMIT = 26.2  # rad/s, 250 rpm, range of the maps (Janssens 2010, fig 6.12)


class Setpoint(NamedTuple):
    """What is asked for at one instant."""

    engage: bool
    torque: float  # Nm
    speed: float  # rad/s


@dataclass(frozen=True)
class Profile:
    """Breakpoints: time [s], torque demand [Nm], motor speed demand [rad/s], all of one length, at least 2."""

    name: str
    time: Sequence[float]
    torque: Sequence[float]
    speed: Sequence[float]

    def __post_init__(self) -> None:
        """Raise InputError naming the first bad row."""
        if not 2 <= len(self.time) == len(self.torque) == len(self.speed):
            raise InputError(f"profile {self.name} has {len(self.time)} rows; at least 2 are needed")
        for row, (time, torque, speed) in enumerate(zip(self.time, self.torque, self.speed, strict=True), 1):
            if not (isfinite(time) and time >= 0.0) or (row > 1 and time <= self.time[row - 2]):
                raise InputError(
                    f"profile {self.name}, row {row}: time_s = {time:g}; it must be 0 or more and increase"
                )
            if not 0.0 <= torque <= TORQUE_LIMIT:
                raise InputError(
                    f"profile {self.name}, row {row}: set-point {torque:g} Nm is outside 0..{TORQUE_LIMIT:g} Nm"
                )
            if not 0.0 <= speed <= SPEED_LIMIT:
                raise InputError(
                    f"profile {self.name}, row {row}: speed {speed:g} rad/s is outside 0..{SPEED_LIMIT:g} rad/s"
                )

    @property
    def duration(self) -> float:
        """Time of the last breakpoint [s]."""
        return self.time[-1]

    def at(self, time: float) -> Setpoint:
        """Set-point at `time` [s]; the first and last row hold outside."""
        after = bisect_right(self.time, time)
        if after == 0:
            return Setpoint(False, self.torque[0], self.speed[0])
        if after == len(self.time):
            return Setpoint(False, 0.0, self.speed[-1])
        t_0, t_1 = self.time[after - 1], self.time[after]
        share = (time - t_0) / (t_1 - t_0)
        torque = self.torque[after - 1] + share * (self.torque[after] - self.torque[after - 1])
        speed = self.speed[after - 1] + share * (self.speed[after] - self.speed[after - 1])
        engage = self.torque[after - 1] > 0.0 or self.torque[after] > 0.0
        return Setpoint(engage, torque, speed)

    def lasting(self, seconds: float) -> "Profile":
        """This profile repeated and cut to `seconds`. Raises InputError when that is too short."""
        if not (isfinite(seconds) and seconds >= _SHORTEST):
            raise InputError(f"a run of {seconds:g} s is not possible; it must last {_SHORTEST:g} s or more")
        period = self.duration + _REPEAT_GAP
        rows = [
            (k * period + time, torque, speed)
            for k in range(ceil(seconds / period))
            for time, torque, speed in zip(self.time, self.torque, self.speed, strict=True)
        ]
        cut = [row for row in rows if row[0] < seconds]
        end = self.at(seconds % period)
        cut.append((seconds, end.torque, end.speed))
        time, torque, speed = zip(*cut, strict=True)
        return Profile(self.name, time, torque, speed)


def load_profile(name: str, seconds: float | None = None) -> Profile:
    """A profile by file path, or by name from the ones that come with the rig, `lasting` some seconds if given.

    Raises InputError.
    """
    path = Path(name) if name.endswith(".csv") else FOLDER / f"{name}.csv"
    if not path.is_file():
        if Path(name).is_file():
            raise InputError(f"profile {name!r} has another suffix; a profile file ends with .csv")
        known = listing(p.stem for p in FOLDER.glob("*.csv"))
        raise InputError(f"profile {name!r} does not exist; known are {known}, or the path of a .csv file")
    try:
        lines = path.read_text(encoding="utf-8").splitlines()
        rows = csv.reader(line for line in lines if not line.startswith("#"))
        header = tuple(next(rows, ()))
        if header != COLUMNS:
            columns = ", ".join(header) or "-"
            raise InputError(f"profile {path} has the columns {columns}; needed are {', '.join(COLUMNS)}")
        table = [[float(cell) for cell in row] for row in rows if row]
    except (OSError, ValueError, csv.Error) as error:
        raise InputError(f"profile {path} cannot be read: {error}") from None
    if bad := next((i for i, row in enumerate(table, 1) if len(row) != len(COLUMNS)), None):
        raise InputError(f"profile {path}, row {bad} has {len(table[bad - 1])} cells; needed are {len(COLUMNS)}")
    time, torque, speed = zip(*table, strict=True) if table else ((), (), ())
    profile = Profile(path.stem, time, torque, speed)
    return profile if seconds is None else profile.lasting(seconds)
