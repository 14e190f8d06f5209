"""Shift profile: what the supervisor asks of two clutches and their common input over time.

A CSV file with the columns `time_s`, `torque_demand_a_nm`, `torque_demand_b_nm`, `input_speed_demand_rad_s`; straight lines
between rows. Each clutch is engaged as in a profile of one clutch (profile.py), so it is filled by a small demand.
"""

import csv
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from plant_sim.profile import FOLDER, Profile, Setpoint
from protocols.errors import InputError

COLUMNS = ("time_s", "torque_demand_a_nm", "torque_demand_b_nm", "input_speed_demand_rad_s")


@dataclass(frozen=True)
class ShiftProfile:
    """The profiles of clutch a and clutch b, of the same times and speeds."""

    name: str
    a: Profile
    b: Profile

    @property
    def duration(self) -> float:
        """Time of the last breakpoint [s]."""
        return self.a.duration

    @property
    def table(self) -> np.ndarray:
        """The tables of both, shape (2, 4, rows)."""
        return np.array([self.a.table, self.b.table])

    def at(self, time: float) -> tuple[Setpoint, Setpoint]:
        """Set-points of a and b at `time` [s]."""
        return self.a.at(time), self.b.at(time)


def load_shift_profile(name: str, seconds: float | None = None) -> ShiftProfile:
    """A shift profile by file path, or by name from those that come with the rig, cut to some `seconds` if given.

    Raises InputError.
    """
    path = Path(name) if name.endswith(".csv") else FOLDER / f"{name}.csv"
    try:
        lines = path.read_text(encoding="utf-8").splitlines()
        rows = csv.reader(line for line in lines if not line.startswith("#"))
        header = tuple(next(rows, ()))
        if header != COLUMNS:
            columns = ", ".join(header) or "-"
            raise InputError(f"shift profile {path} has the columns {columns}; needed are {', '.join(COLUMNS)}")
        table = [[float(cell) for cell in row] for row in rows if row]
    except (OSError, ValueError, csv.Error) as error:
        raise InputError(f"shift profile {path} cannot be read: {error}") from None
    if bad := next((i for i, row in enumerate(table, 1) if len(row) != len(COLUMNS)), None):
        raise InputError(f"shift profile {path}, row {bad} has {len(table[bad - 1])} cells; needed are {len(COLUMNS)}")
    time, torque_a, torque_b, speed = zip(*table, strict=True) if table else ((), (), (), ())
    a = Profile(f"{path.stem} of clutch a", time, torque_a, speed)
    b = Profile(f"{path.stem} of clutch b", time, torque_b, speed)
    if seconds is not None:
        a, b = a.lasting(seconds), b.lasting(seconds)
    return ShiftProfile(path.stem, a, b)
