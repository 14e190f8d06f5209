"""Free parameters: units of moves and bounds with which the parameters of a clutch are fitted."""

from dataclasses import replace

from clutch_hil.fitting.fit import FreeParameter
from clutch_hil.fitting.model import Values
from clutch_hil.identify.clutch_effects import EFFECTS
from clutch_hil.identify.clutch_parameters import compute_viscous_scale
from protocols.errors import InputError
from protocols.files.parameters import ParameterSet

TIMING = 5e-4  # s: half a sampling period; events within a sample are not resolved by a run
_MOVE = 0.2  # of the unit of moves: step of differences
_UNIT = 0.05  # of a parameter that declares no uncertainty: its unit of moves
_ROOM = 5.0  # times the bounds of C_v: omega_r^gamma is 4.6 times as large with gamma = 1 as with 1/3
_EXPONENT_UNIT = 0.02  # of gamma: 6 % of 1/3
# Deviation of what the runs hardly excite. Of a parameter, as a share: rigs of one design are within 30 % of the declared one.
# Of an effect, in units of moves: each is about a tenth of what is usual
UNKNOWN, _UNKNOWN_EFFECT = 0.15, 10.0

# where the runs do not excite them these are as declared; any other one is as the steps found it beside the contact pressure
AS_DECLARED = (
    "clutch.stribeck_speed", "clutch.beta_inf", "clutch.viscous_exponent", "clutch.attraction", "oil.viscous_gain",
    "oil.heat_capacity", "oil.heat_transfer", "oil.sump_temperature", "motor.inertia", "motor.proportional_gain",
    "motor.integral_gain",
)  # fmt: skip


def free_parameter(known: ParameterSet, name: str, bounds: tuple[float, float] | None) -> FreeParameter:
    """One of the `known` parameters, free within `bounds`, or its declared ones. Raises InputError."""
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
    """Whether it is a parameter of C_v, which is fitted as a torque."""
    return name in ("clutch.viscous_slope", "clutch.viscous_intercept")


def as_fitted(f: FreeParameter, values: Values) -> FreeParameter:
    """A parameter as it is fitted (clutch_parameters.py): of C_v the torque at the reference slip."""
    scale = compute_viscous_scale(values) if is_viscous(f.name) else 1.0
    low, high = (bound * scale * (_ROOM if is_viscous(f.name) else 1.0) for bound in (f.low, f.high))
    return FreeParameter(f.name, f.step * scale, f.scale * scale, low, high)


def know_roughly(f: FreeParameter, value: float) -> FreeParameter:
    """What the runs hardly excite, free about `value`: held, it would move the others beyond their intervals."""
    size = _UNKNOWN_EFFECT * EFFECTS[f.name] if f.name in EFFECTS else UNKNOWN * abs(value)
    return replace(f, scale=max(size, f.scale), centre=value)
