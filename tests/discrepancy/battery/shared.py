"""Parameters that a law of the truth shares with the catalogue's, so that an estimate can be right or wrong.

Left out are laws whose strength has another meaning there (another gas law, another wave).
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass


def _same(strength: float) -> float:
    return strength


def _factor(strength: float) -> float:
    return 1.0 + strength


def _against(strength: float) -> float:
    return -strength


@dataclass(frozen=True)
class Shared:
    """`parameter` of the catalogue is `value` of the strength in the law's unit, for these of the truth's `laws`.

    off: its value where the effect is off, from which a relative error is taken.
    """

    parameter: str
    laws: tuple[int, ...] = (0, 1)
    value: Callable[[float], float] = _same
    off: float = 0.0


SHARED: Mapping[str, Shared] = {
    "valve_deadband": Shared("width"),  # both laws are V - width far from zero
    "valve_hysteresis": Shared("width"),
    "spool_stiction": Shared("breakaway"),
    "valve_delay": Shared("delay"),  # group delay
    "valve_gain": Shared("ratio", (0,), _factor, 1.0),  # at 3.4 bar
    "internal_leakage": Shared("conductance"),  # at 3.4 bar, 70 degC
    "centrifugal_pressure": Shared("coefficient", (0,)),
    "piston_seal_friction": Shared("force", (0,)),
    "clearance_change": Shared("change", (0,)),
    "coulomb_temperature": Shared("slope", (0, 1), _against),  # at the reference temperature
    "friction_level": Shared("level", (0, 1), _factor, 1.0),
    "direction_asymmetry": Shared("asymmetry", (1,)),
    "shaft_angle_ripple": Shared("amplitude", (0,)),  # of the first order
    "position_ripple": Shared("amplitude", (0,)),
    "motor_torque_ripple": Shared("amplitude"),
    "shaft_compliance": Shared("compliance", (1,)),
    "backlash": Shared("gap"),
    "pressure_sensor_gain": Shared("gain", (0, 1), _factor, 1.0),
    "pressure_sensor_offset": Shared("offset"),
    "torque_sensor_gain": Shared("gain", (0, 1), _factor, 1.0),
    "torque_sensor_offset": Shared("offset"),
    "torque_time_offset": Shared("delay"),
    "pressure_time_offset": Shared("delay"),
    "temperature_sensor_lag": Shared("time", (0,)),
}
