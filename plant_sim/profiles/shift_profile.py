"""Shift profile: set-points of the supervisor for two clutches and their common input over time.

A CSV file with the columns `time_s`, `torque_demand_a_nm`, `torque_demand_b_nm`, `input_speed_demand_rad_s` and, optionally,
`pressure_demand_a_bar`, `pressure_demand_b_bar`, `lock_a` and `lock_b`; linear between rows. Each clutch is engaged,
locked or follows a pressure as in a profile of one clutch (profile.py), so it is filled by a small demand.
"""

from dataclasses import dataclass

import numpy as np

from plant_sim.profiles.profile import FOLDER, Profile, Setpoint, find_profile, read_columns
from protocols.can.two_clutches import CLUTCHES

COLUMNS = ("time_s", "torque_demand_a_nm", "torque_demand_b_nm", "input_speed_demand_rad_s")
PRESSURE_COLUMNS = tuple(f"pressure_demand_{clutch}_bar" for clutch in CLUTCHES)
OPTIONAL_COLUMNS = (*PRESSURE_COLUMNS, "lock_a", "lock_b")


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
        """Tables of both clutches, shape (2, 5, rows)."""
        return np.array([self.a.table, self.b.table])

    def interpolate(self, time: float) -> tuple[Setpoint, Setpoint]:
        """Return the set-points of a and b at `time` [s]."""
        return self.a.interpolate(time), self.b.interpolate(time)


def load_shift_profile(name: str, seconds: float | None = None) -> ShiftProfile:
    """Load a shift profile by file path, or by name from those that come with the rig; cut to `seconds` if given.

    Raises InputError.
    """
    path = find_profile(name, FOLDER, "shift profile")
    columns = read_columns(path, "shift profile", COLUMNS, OPTIONAL_COLUMNS)
    time, speed = columns["time_s"], columns["input_speed_demand_rad_s"]
    a, b = (
        Profile(
            f"{path.stem} of clutch {clutch}", time, columns[f"torque_demand_{clutch}_nm"], speed,
            pressure=columns.get(pressure, ()), lock=columns.get(f"lock_{clutch}", ()),
        )
        for clutch, pressure in zip(CLUTCHES, PRESSURE_COLUMNS, strict=True)
    )  # fmt: skip
    if seconds is not None:
        a, b = a.repeat_to(seconds), b.repeat_to(seconds)
    return ShiftProfile(path.stem, a, b)
