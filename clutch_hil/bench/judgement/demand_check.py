"""Demand check: check that a controller follows every set-point of a profile. It opens the clutch on one it cannot follow."""

from collections.abc import Iterator
from typing import Any

import numpy as np

from plant_sim.profiles.profile import Profile
from plant_sim.profiles.shift_profile import ShiftProfile
from protocols.errors import InputError
from protocols.files.parameters import ParameterSet

_ROUNDING = 1e-9  # of a limit: a demand equal to the limit is accepted
# Demand of a profile -> the controller's limit of it, in the parameter's own unit
_LIMITS = {"torque": "torque.demand_limit", "speed": "phases.speed_limit", "pressure": "torque.pressure_limit"}


def check_demands(profile: Any, parameters: ParameterSet, clutch: str | None = None) -> None:
    """Raise InputError for a row of `profile` beyond a limit of the controller with `parameters`.

    clutch: a or b on a rig with two clutches. A profile of another class, such as that of a user's rig, is not checked.
    """
    if isinstance(profile, ShiftProfile) and clutch:
        profile = getattr(profile, clutch)
    if not isinstance(profile, Profile):
        return
    for what, demands in _list_demands(profile):
        limit = parameters[_LIMITS[what]]
        beyond = np.flatnonzero(demands > limit.value * (1.0 + _ROUNDING))
        if len(beyond):
            row, name = int(beyond[0]), _LIMITS[what]
            raise InputError(
                f"profile {profile.name}, row {row + 1}, at {profile.time[row]:g} s: the {what} demand of"
                f" {demands[row]:.6g} {limit.unit} is above {limit.value:.6g} {limit.unit}, the controller's {name}; it"
                f" would open the clutch at such a set-point: reduce the demand, or change {name}"
            )


def _list_demands(profile: Profile) -> Iterator[tuple[str, np.ndarray]]:
    """Yield the magnitudes of the demands, (rows,) each: torque [Nm], speed [rad/s], pressure [bar]; 0 where locked."""
    _, torques, speeds, pressures, locks = profile.table
    # modes before and after each row: the row is a demand unless it is locked on both sides
    before = np.append(1.0, locks[:-1])
    locked = (locks > 0.0) & (before > 0.0)
    yield "torque", np.where(locked, 0.0, torques)
    yield "speed", np.abs(speeds)
    yield "pressure", np.where(locked, 0.0, pressures)
