"""Parameters that a law of the truth shares with the catalogue's, so that an estimate can be right or wrong.

Left out are laws whose strength has another meaning there (another gas law, another wave).
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any


def _same(strength: float) -> float:
    return strength


def _factor(strength: float) -> float:
    return 1.0 + strength


def _against(strength: float) -> float:
    return -strength


@dataclass(frozen=True)
class Shared:
    """`parameter` of the catalogue is `value` of the strength in the law's unit, for these of the truth's `laws`.

    off: its value where the effect is off, from which a relative error is taken. warming: what the strength grows by a kelvin
    above 70 degC in the truth's second law; the catalogue's parameter, which is constant, is right at its mean over the runs.
    """

    parameter: str
    laws: tuple[int, ...] = (0, 1)
    value: Callable[[float], float] = _same
    off: float = 0.0
    warming: float = 0.0

    def truth(self, effect: Mapping[str, Any], celsius: float) -> float:
        """What an estimate should be for an effect of a case whose oil had `celsius` in the mean."""
        grown = self.warming * (celsius - 70.0) if effect["law"] == 1 else 0.0
        return self.value(effect["strength"] * (1.0 + grown))


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
    "pressure_sensor_gain": Shared("gain", (0, 1), _factor, 1.0, warming=0.01),
    "pressure_sensor_offset": Shared("offset", warming=0.01),
    "torque_sensor_gain": Shared("gain", (0, 1), _factor, 1.0, warming=0.01),
    "torque_sensor_offset": Shared("offset", warming=0.01),
    "torque_time_offset": Shared("delay"),
    "pressure_time_offset": Shared("delay"),
    "temperature_sensor_lag": Shared("time", (0,)),
}
