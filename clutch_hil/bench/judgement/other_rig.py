"""Other rig: what a run of a simulated rig says of parameters that do not belong together: those of the controller and of the
rig, or those of the rig and of the demand.

What            advice after a fault or a torque that followed poorly, where the controller was told another rig than the one
                that was simulated. Nobody knows the parameters of a real rig, so nothing is said of one
Limit           ratio of the two values from which the controller cannot make up for the difference, see _SAME
Not modelled    differences that lie in effects, such as a friction level, which the controller is to cope with
"""

from collections.abc import Mapping
from math import isfinite, log
from typing import NamedTuple

import numpy as np

from rt_controller.loop.parameter_sets import load_controller_parameters


class _Pair(NamedTuple):
    """The same quantity in the controller and in the rig; `most`: largest ratio of the two that the controller copes with."""

    controller: str
    rig: str
    most: float


_SAME = (
    # a fill goes to 0.25 bar above contact, a tenth of it (controller.toml); the integrator waits for contact
    _Pair("model.contact_pressure", "piston.contact_pressure", 1.1),
    _Pair("pressure.valve_gain", "valve.gain", 1.1),
    _Pair("model.coulomb_slope", "clutch.coulomb_slope", 1.5),  # bound of the adapted friction level
    _Pair("model.viscous_slope", "clutch.viscous_slope", 1.5),
    # the torque balance is M_m - J alpha: chosen, as half of J alpha is then no friction
    _Pair("model.motor_inertia", "motor.inertia", 1.5),
    # a motor at its limit is told from one that should still turn the plates; cycle.py takes 0.95 of it as the limit
    _Pair("phases.motor_torque_limit", "motor.torque_limit", 1.1),
)
_MOTOR, _HEAT, _TRANSFER = "motor.torque_limit", "oil.heat_capacity", "oil.heat_transfer"
_BY_FILE = "by --controller-parameters, or a --calibration of clutch-hil identify"


def describe_other_rig(controller: Mapping[str, float], rig: Mapping[str, float], clutch: str = "") -> str | None:
    """Return a sentence on the `controller` parameters that are far from those of the simulated `rig`; None without such.

    Both by dotted name, in their units; clutch: prefix of one of two clutches in the names of the `rig`.
    """
    known = [pair for pair in _SAME if pair.controller in controller and clutch + pair.rig in rig]
    ratios = {pair: _compare(controller[pair.controller], rig[clutch + pair.rig]) for pair in known}
    far = sorted(
        (pair for pair in known if ratios[pair] > pair.most), key=lambda pair: -log(ratios[pair]) / log(pair.most)
    )
    if not far:
        return None
    units = load_controller_parameters()
    named = [
        f"{pair.controller} = {controller[pair.controller]:g} {units[pair.controller].unit}, but the rig has"
        f" {rig[clutch + pair.rig]:g}"
        for pair in far
    ]
    return f"the controller was told another rig than the simulated one: {'; '.join(named)}; give them {_BY_FILE}"


def describe_weak_motor(columns: Mapping[str, np.ndarray], rig: Mapping[str, float]) -> str | None:
    """Return a sentence if the torque demand of a run is above the torque of the motor of the simulated `rig`; else None."""
    demand, most = columns["torque_demand_nm"], rig.get(_MOTOR)
    highest = float(np.nanmax(demand, initial=0.0))
    if most is None or highest <= most:
        return None
    return (
        f"the torque demand is up to {highest:.4g} Nm, but the motor of the simulated rig gives {most:g} Nm: the plates stick"
        f" before; raise {_MOTOR}, and with it motor.proportional_gain and integral_gain, by --plant-parameters"
    )


def describe_hot_oil(
    fault: float | str, columns: Mapping[str, np.ndarray], rig: Mapping[str, float], clutch: str = ""
) -> str | None:
    """Return advice on oil that got too hot, the `fault` of a run of a simulated `rig`; None for another fault."""
    heat, transfer = rig.get(clutch + _HEAT), rig.get(clutch + _TRANSFER)
    if fault != "overtemperature" or heat is None or transfer is None:
        return None
    power = float(np.nanmax(np.abs(columns["clutch_torque_nm"] * columns["slip_speed_rad_s"])))
    if not isfinite(power):
        return None
    return (
        f"the plates heat with up to {power:.3g} W, and the oil of the simulated rig has {heat:g} J/K and {transfer:g} W/K;"
        f" give {_HEAT} and {_TRANSFER} of your rig by --plant-parameters, or slip less"
    )


def _compare(one: float, other: float) -> float:
    """Return the ratio of two values, at least 1; 1 where one of them is not above 0."""
    return max(one / other, other / one) if one > 0.0 and other > 0.0 else 1.0
