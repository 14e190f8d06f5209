"""Parameters that a law of the truth shares with the catalogue, so that an estimate can be compared with the truth.

Laws whose strength has a different meaning are left out (another gas law, another wave).
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any


def _return_strength(strength: float) -> float:
    return strength


def _add_one(strength: float) -> float:
    return 1.0 + strength


def _negate(strength: float) -> float:
    return -strength


@dataclass(frozen=True)
class SharedParameter:
    """A parameter of the catalogue that a law of the truth shares.

    Its true value is `value` of the strength in the unit of the law, for these `laws` of the truth. `off`: its value
    where the effect is off; relative errors refer to the distance from it. `warming`: relative growth of the strength
    per kelvin above 70 degC in the second law of the truth [1/K]. The parameter is constant in the catalogue, so its
    true value is that at the mean temperature.
    """

    parameter: str
    laws: tuple[int, ...] = (0, 1)
    value: Callable[[float], float] = _return_strength
    off: float = 0.0
    warming: float = 0.0

    def compute_truth(self, effect: Mapping[str, Any], celsius: float) -> float:
        """Compute the true value of the parameter for an `effect`, at the mean oil temperature `celsius` [degC]."""
        grown = self.warming * (celsius - 70.0) if effect["law"] == 1 else 0.0
        return self.value(effect["strength"] * (1.0 + grown))


SHARED_PARAMETERS: Mapping[str, SharedParameter] = {
    "valve_deadband": SharedParameter("width"),  # both laws are V - width far from zero
    "valve_hysteresis": SharedParameter("width"),
    "spool_stiction": SharedParameter("breakaway"),
    "valve_delay": SharedParameter("delay"),  # group delay
    "valve_gain": SharedParameter("ratio", (0,), _add_one, 1.0),  # at 3.4 bar
    "internal_leakage": SharedParameter("conductance"),  # at 3.4 bar, 70 degC
    "centrifugal_pressure": SharedParameter("coefficient", (0,)),
    "piston_seal_friction": SharedParameter("force", (0,)),
    "clearance_change": SharedParameter("change", (0,)),
    "coulomb_temperature": SharedParameter("slope", (0, 1), _negate),  # at the reference temperature
    "friction_level": SharedParameter("level", (0, 1), _add_one, 1.0),
    "direction_asymmetry": SharedParameter("asymmetry", (1,)),
    "shaft_angle_ripple": SharedParameter("amplitude", (0,)),  # of the first order
    "position_ripple": SharedParameter("amplitude", (0,)),
    "motor_torque_ripple": SharedParameter("amplitude"),
    "shaft_compliance": SharedParameter("compliance", (1,)),
    "backlash": SharedParameter("gap"),
    "pressure_sensor_gain": SharedParameter("gain", (0, 1), _add_one, 1.0, warming=0.01),
    "pressure_sensor_offset": SharedParameter("offset", warming=0.01),
    "torque_sensor_gain": SharedParameter("gain", (0, 1), _add_one, 1.0, warming=0.01),
    "torque_sensor_offset": SharedParameter("offset", warming=0.01),
    "torque_time_offset": SharedParameter("delay"),
    "pressure_time_offset": SharedParameter("delay"),
    "temperature_sensor_lag": SharedParameter("time", (0,)),
}
