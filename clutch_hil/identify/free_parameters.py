"""Free parameters: scales and bounds with which the parameters of a clutch are fitted."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from clutch_hil.fitting.fit import FreeParameter
from clutch_hil.fitting.model import Values
from clutch_hil.identify.clutch_effects import EFFECTS
from clutch_hil.identify.clutch_parameters import compute_viscous_scale
from protocols.errors import InputError
from protocols.files.parameters import ParameterSet

TIMING = 5e-4  # s, time uncertainty: half a sampling period, because a run does not resolve events within a sample
_MOVE = 0.2  # share of the unit of moves: step of the finite differences
_UNIT = 0.05  # share of a parameter without declared uncertainty: its unit of moves
_ROOM = 5.0  # factor on the bounds of C_v: omega_r^gamma is 4.6 times larger with gamma = 1 than with 1/3
_EXPONENT_UNIT = 0.02  # unit of moves of gamma: 6 % of 1/3
# Standard deviation of the prior of hardly excited parameters. Of a parameter, as a share: rigs of one design are within 30 %
# of the declared value. Of an effect, in units of moves: each is about a tenth of a usual strength
UNKNOWN, _UNKNOWN_EFFECT = 0.15, 10.0

# Of these the parameters of a motor and of oil, whose size is that of the clutch
_SLOPE, _SUMP = "clutch.coulomb_slope", "oil.sump_temperature"
_WITH_SIZE = (
    "oil.heat_capacity", "oil.heat_transfer", _SUMP, "motor.inertia", "motor.proportional_gain", "motor.integral_gain",
)  # fmt: skip

# Parameters of the lines M_C(p) and C_v(p); their smallest size compared with the declared one: steps must not become 0
_LINES = ("clutch.coulomb_slope", "clutch.coulomb_intercept", "clutch.viscous_slope", "clutch.viscous_intercept")
_LEAST_SIZE = 0.01
# Ratio to the declared slope of the torque, or its inverse, from which a clutch is of another size; as in
# rt_controller/law/clutch_size.py
_OTHER_SIZE = 2.0

# start values of these are the declared ones if the runs do not excite them; those of the others are the estimated ones, which
# are consistent with the contact pressure
AS_DECLARED = (
    "clutch.stribeck_speed", "clutch.beta_inf", "clutch.viscous_exponent", "clutch.attraction", "oil.viscous_gain",
    "oil.heat_capacity", "oil.heat_transfer", "oil.sump_temperature", "motor.inertia", "motor.proportional_gain",
    "motor.integral_gain",
)  # fmt: skip


def free_parameter(known: ParameterSet, name: str, bounds: tuple[float, float] | None) -> FreeParameter:
    """Return a parameter of `known`, free within `bounds` or its declared ones. Raises InputError for bounds outside the
    declared."""
    p = known[name]
    usual = _EXPONENT_UNIT if name == "clutch.viscous_exponent" else EFFECTS.get(name, _UNIT * abs(p.value))
    unit = p.uncertainty or usual
    low, high = bounds or p.bounds
    if not p.bounds[0] <= low < high <= p.bounds[1]:
        raise InputError(
            f"bounds of {name} are {low:g} and {high:g} {p.unit}; allowed is a low and a higher one from {p.bounds[0]:g} to"
            f" {p.bounds[1]:g}"
        )
    return FreeParameter(name, _MOVE * unit, unit, low, high)


def is_viscous(name: str) -> bool:
    """Return whether `name` is a parameter of C_v, which is fitted as a torque."""
    return name in ("clutch.viscous_slope", "clutch.viscous_intercept")


def as_fitted(f: FreeParameter, values: Values, declared: Values) -> FreeParameter:
    """Return a parameter in the units of the fit (clutch_parameters.py): C_v as torque at the reference slip.

    A line of a clutch with less torque than `declared` has smaller steps, in proportion.
    """
    scale = compute_viscous_scale(values) if is_viscous(f.name) else 1.0
    low, high = (bound * scale * (_ROOM if is_viscous(f.name) else 1.0) for bound in (f.low, f.high))
    size = _compare_size(f.name, values, declared)
    return FreeParameter(f.name, f.step * scale * size, f.scale * scale * size, low, high)


def _compare_size(name: str, values: Values, declared: Values) -> float:
    """Return the share that a parameter of a torque line has of its declared value, at most 1; 1 for other parameters.

    Slope and intercept cancel each other, so errors of their differences look like information. With the steps of the
    shipped clutch, at a tenth of its slope and three times its pressure, a move that raised the cost by 1.4 seemed to raise
    it by 21, and the true values were 2.4 half widths away.
    """
    if name not in _LINES or declared[name] == 0.0:
        return 1.0
    return float(np.clip(abs(values[name] / declared[name]), _LEAST_SIZE, 1.0))


def choose_hardly_excited(hardly: Sequence[FreeParameter], start: Values, declared: Values) -> dict[str, float]:
    """Return start values of the parameters that the runs `hardly` excite: the declared ones where the estimated ones of
    `start` are worth less.

    A clutch whose torque is more than twice the declared one, or less than half, has another motor and other oil, too: they
    keep the estimate, or have the declared value times the ratio of the torques. With the declared 600 J/K the oil of a clutch
    of 900 Nm became hot, and that spoiled the fit of all other parameters.
    """
    size = start[_SLOPE] / declared[_SLOPE]
    chosen = {f.name: float(np.clip(declared[f.name], f.low, f.high)) for f in hardly if f.name in AS_DECLARED}
    if 1.0 / _OTHER_SIZE < size < _OTHER_SIZE:
        return chosen
    for f in hardly:
        if f.name in _WITH_SIZE:
            estimated = start[f.name] != declared[f.name]
            value = start[f.name] if estimated or f.name == _SUMP else size * declared[f.name]
            chosen[f.name] = float(np.clip(value, f.low, f.high))
    return chosen


def know_roughly(f: FreeParameter, value: float) -> FreeParameter:
    """Return a hardly excited parameter with a prior about `value`: held, it would move the others beyond their intervals."""
    size = _UNKNOWN_EFFECT * EFFECTS[f.name] if f.name in EFFECTS else UNKNOWN * abs(value)
    return replace(f, scale=max(size, f.scale), centre=value)
