"""Demonstration of an effect: the rig with it, at typical values, beside the rig without it."""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import cache

import numpy as np

from clutch_hil.bench.excitation import QUANTITIES, Excitation, answer, excitations
from plant_sim.effects.catalogue import effect as named
from plant_sim.effects.effect import Effect
from plant_sim.rigs import wet_clutch
from protocols.files.parameters import ParameterSet


@dataclass(frozen=True)
class Choice:
    """How an effect is shown: by an excitation; in a quantity, None for the one that changes most; over a column, None for
    the excitation's; beside an effect without which it has nothing to do."""

    excitation: str
    column: str | None = None
    over: str | None = None
    beside: str | None = None


_OTHERWISE = ("engagement", "triangle", "slip_sine", "slip_steps")
# Where the quantity and excitation changed most do not show what an effect is, and where it takes a long hold
CHOICES: Mapping[str, Choice] = {
    "backlash": Choice("slip_steps"),
    "coarse_quantisation": Choice("triangle", "clutch_torque_nm"),
    "coulomb_temperature": Choice("hold", "clutch_torque_nm"),
    "dc_restoration": Choice("hold", "clutch_torque_nm", beside="torque_sensor_leakage"),
    "direction_asymmetry": Choice("slip_sine", "clutch_torque_nm"),
    "drag_torque": Choice("engagement", "clutch_torque_nm"),
    "encoder_offset": Choice("engagement", "shaft_angle_rad"),
    "friction_fade": Choice("hold", "clutch_torque_nm"),
    "load_dependent_friction": Choice("triangle", "clutch_torque_nm"),
    "motor_torque_ripple": Choice("crawl", "motor_torque_nm", over="shaft_angle_rad"),
    "oil_viscosity": Choice("cold_engagement", "clutch_torque_nm"),
    "piston_seal_friction": Choice("triangle", "clutch_torque_nm", over="cylinder_pressure_bar"),
    "plate_waviness": Choice("engagement", "clutch_torque_nm"),
    "position_ripple": Choice("crawl", "clutch_torque_nm", over="shaft_angle_rad"),
    "presliding": Choice("reversals", "shaft_angle_rad", over="clutch_torque_nm"),
    "sensor_freeze": Choice("engagement", "clutch_torque_nm"),
    "shaft_angle_ripple": Choice("crawl", "clutch_torque_nm", over="shaft_angle_rad"),
    "spool_stiction": Choice("triangle", "cylinder_pressure_bar"),
    "stribeck_change": Choice("slip_sine", "clutch_torque_nm"),
    "temperature_sensor_lag": Choice("hold"),
    "torque_sensor_leakage": Choice("hold"),
    "valve_deadband": Choice("triangle", "cylinder_pressure_bar"),
    "valve_gain": Choice("triangle", "cylinder_pressure_bar"),
    "valve_hysteresis": Choice("triangle", "cylinder_pressure_bar"),
}
_CHANGED_MOST = [column for column in QUANTITIES if column != "shaft_angle_rad"]  # any slip adds up in the angle


@dataclass(frozen=True, eq=False)
class Demonstration:
    """Answers (n,) of a rig without and with an effect to one excitation, free of noise, by column of docs/rig.md.

    `column` is the measured quantity that shows the effect; `over` the abscissa, each rig's own.
    """

    excitation: Excitation
    column: str
    over: str
    without: Mapping[str, np.ndarray]
    with_it: Mapping[str, np.ndarray]

    @property
    def what(self) -> str:
        """Name of the quantity."""
        return QUANTITIES[self.column][0]

    @property
    def unit(self) -> str:
        """Its unit."""
        return QUANTITIES[self.column][1]

    @property
    def difference(self) -> np.ndarray:
        """(n,) in `unit`: with less without."""
        return self.with_it[self.column] - self.without[self.column]

    @property
    def largest(self) -> float:
        """Largest difference, in `unit`."""
        return float(np.abs(self.difference).max())

    @property
    def times_resolution(self) -> float:
        """The largest difference over what the measurement resolves, its noise and quantisation."""
        return self.largest / QUANTITIES[self.column][2]


def demonstrate(effect: Effect) -> Demonstration:
    """The demonstration of `effect`: the one chosen for it, or the excitation and quantity that it changes most.

    A fault comes in the middle of an engagement.
    """
    if effect.name in CHOICES:
        chosen = [CHOICES[effect.name]]
    else:
        chosen = [Choice(name) for name in (_OTHERWISE[:1] if effect.block == "fault" else _OTHERWISE)]
    return max((_shown(effect, choice) for choice in chosen), key=lambda shown: shown.times_resolution)


def _shown(effect: Effect, choice: Choice) -> Demonstration:
    excitation = excitations()[choice.excitation]
    if choice.beside:
        excitation = replace(excitation, title=f"{excitation.title}, beside {choice.beside}")
    without = _without(choice)
    parameters = wet_clutch.nominal().with_values(_beside(choice))
    changed = parameters.with_values(effect.typical())
    if effect.block == "fault":
        with_it = _settled(parameters, excitation, (len(excitation.voltage) // 2, changed))
    else:
        with_it = _settled(changed, excitation)
    over = choice.over or excitation.over
    columns = [choice.column] if choice.column else _CHANGED_MOST
    found = [Demonstration(excitation, column, over, without, with_it) for column in columns]
    return max(found, key=lambda shown: shown.times_resolution)


@cache
def _without(choice: Choice) -> Mapping[str, np.ndarray]:
    return _settled(wet_clutch.nominal().with_values(_beside(choice)), excitations()[choice.excitation])


def _beside(choice: Choice) -> Mapping[str, float]:
    return named(choice.beside).typical() if choice.beside else {}


def _settled(
    parameters: ParameterSet, excitation: Excitation, later: tuple[int, ParameterSet] | None = None
) -> Mapping[str, np.ndarray]:
    columns = answer(parameters, excitation, later=later)
    return {name: column[excitation.settling :] for name, column in columns.items()}
