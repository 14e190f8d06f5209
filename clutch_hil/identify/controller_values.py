"""Controller values: model parameters and phase limits of the controller, from the parameters of an identified clutch.

Equation        the controller's maps are over the cylinder pressure p, the rig's over the pressure p* on the plates, which the
                  springs reduce: p* = p_c + r (p - p_c), r = k_stack/(k_stack + k_s)                    docs/rig.md, 3
                a line a p* + b over p: slope r a, intercept b + a (1 - r) p_c
                beta over p: onset p_c + (p_1 - p_c)/r, scale p_0/r
                gains of a slow valve: rt_controller/law/valve_gains.py
"""

from collections.abc import Mapping

from clutch_hil.fitting.model import Values
from clutch_hil.identify.clutch_effects import DELAY, MOTOR, PRESSURE
from clutch_hil.identify.clutch_parameters import shift_pressures
from clutch_hil.identify.piston_landing import measure_landing
from protocols.files.parameters import ParameterSet
from protocols.files.units import BAR
from rt_controller.law.clutch_size import scale_size
from rt_controller.law.valve_gains import Valve, scale_gains

# controller parameter -> plant parameter: the same quantity in the same unit
_SAME: Mapping[str, str] = {
    **{
        f"model.{name}": f"clutch.{name}"
        for name in (
            "coulomb_slope", "coulomb_intercept", "viscous_slope", "viscous_intercept", "beta_inf", "beta_onset", "beta_scale",
            "stribeck_speed", "viscous_exponent", "attraction",
        )
    },
    "model.contact_pressure": "piston.contact_pressure",
    "model.oil_viscous_gain": "oil.viscous_gain",
    "model.motor_inertia": "motor.inertia",
    "model.motor_gain": "motor.proportional_gain",
    "pressure.valve_gain": "valve.gain",
}  # fmt: skip
# Parameters needed to hold a clutch at a pressure: no maps
_PRESSURES = (
    "model.contact_pressure", "pressure.valve_gain", "pressure.floor", "phases.fill_pressure", "phases.released_pressure",
    "phases.lost_pressure", "torque.pressure_limit",
)  # fmt: skip

_LANDED = "phases.touch_band"
_LANDING_MARGIN = "phases.contact_band"  # also ten standard deviations of the sensor's noise


def derive_controller_values(plant: Values, nominal: Values, controller: ParameterSet) -> dict[str, tuple[float, str]]:
    """Return values by the controller's dotted names, with their source.

    Pressure limits keep their nominal position relative to contact and preload. plant: values of the identified rig. nominal:
    values of the rig for which the `controller` parameters were designed. The controller's pressures are cylinder pressures as
    measured, with the sensor's offset. One fill is simulated to find the pressure at which the piston lands.
    """
    values = _convert(plant, nominal, controller)
    landing = measure_landing(plant, {name: value for name, (value, _) in values.items()})
    if landing is not None:
        why = f"the piston lands {landing:.2g} bar above contact in a simulated fill; plus ten standard deviations of the noise"
        values |= _keep_within({_LANDED: (landing + controller[_LANDING_MARGIN].value, why)}, controller)
    return values


def _convert(plant: Values, nominal: Values, controller: ParameterSet) -> dict[str, tuple[float, str]]:
    """Return the values that need no simulation. Arguments as for `derive_controller_values`."""
    shown = shift_pressures(plant, plant.get(PRESSURE, 0.0))  # with the offset of the sensor
    lines = _convert_to_cylinder(shown)
    plant = {**shown, **lines}
    values = {
        ours: (
            plant[theirs],
            f"as the plant: {theirs}{', over the pressure in the cylinder' if theirs in lines else ''}",
        )
        for ours, theirs in _SAME.items()
    }
    values["model.motor_torque_zero"] = plant.get(MOTOR, 0.0), f"as the plant: {MOTOR}"
    lag = plant["piston.damping"] / plant["piston.stack_stiffness"]
    values["model.piston_lag"] = lag, "as the plant: piston.damping / piston.stack_stiffness (docs/rig.md, 3)"
    contact, preload = plant["piston.contact_pressure"], plant["piston.preload_pressure"]
    was_contact, was_preload = nominal["piston.contact_pressure"], nominal["piston.preload_pressure"]
    shift = contact - was_contact
    for name in ("phases.fill_pressure", "torque.pressure_limit"):
        values[name] = controller[name].value + shift, "distance above the contact pressure as nominal"
    for name in ("phases.released_pressure", "phases.lost_pressure"):
        values[name] = controller[name].value * preload / was_preload, "share of the springs' preload as nominal"
    share = (controller["pressure.floor"].value - was_preload) / (was_contact - was_preload)
    values["pressure.floor"] = (
        preload + share * (contact - preload),
        "position between preload and contact as nominal",
    )
    size = plant["clutch.coulomb_slope"] / nominal["clutch.coulomb_slope"]
    why = f"scaled with the slope of the torque, which is {size:.3g} times the nominal one"
    values |= {name: (factor * controller[name].value, why) for name, factor in scale_size(size).items()}
    values |= _follow_valve(plant, nominal, controller, values)
    limit = controller["lock.pressure_limit"].value
    if values["torque.pressure_limit"][0] > limit:
        values["torque.pressure_limit"] = (
            limit,
            "the limit of the lock, as the nominal distance above contact would exceed it",
        )
    return _keep_within(values, controller)


def _follow_valve(
    plant: Values, nominal: Values, controller: ParameterSet, values: Mapping[str, tuple[float, str]]
) -> dict[str, tuple[float, str]]:
    """Return the gains, rates and times that the valve of the plant changes; `values` may already have scaled them."""
    valve, designed = _describe_valve(plant), _describe_valve(nominal)
    lags = [1e3 * (each.lag + each.dead_time) for each in (valve, designed)]
    why = f"for the lag of valve and oil, {lags[0]:.3g} ms; nominal {lags[1]:.3g} ms (rt_controller/law/valve_gains.py)"
    return {
        name: (factor * values.get(name, (controller[name].value, ""))[0], why)
        for name, factor in scale_gains(valve, designed).items()
    }


def _describe_valve(plant: Values) -> Valve:
    """Return valve and line of the plant; docs/rig.md, 1 to 3."""
    stiffness = plant["piston.stack_stiffness"] + _spring_stiffness(plant)  # N/m
    stored = plant["hydraulics.capacity"] + plant["piston.area"] ** 2 * BAR / stiffness  # m^3/bar, oil and plates
    line = stored / plant["hydraulics.conductance"]
    return Valve(plant["valve.frequency"], plant["valve.damping"], 1e-3 * plant.get(DELAY, 0.0), line)


def _spring_stiffness(plant: Values) -> float:
    """Return k_s of the return springs [N/m]; docs/rig.md, 3."""
    travel = plant["piston.contact_pressure"] - plant["piston.preload_pressure"]
    return plant["piston.area"] * BAR * travel / plant["piston.clearance"]


def _keep_within(values: Mapping[str, tuple[float, str]], controller: ParameterSet) -> dict[str, tuple[float, str]]:
    """Clip values to the bounds of the controller's parameters, and note this in their source."""
    bounded = {}
    for name, (value, why) in values.items():
        low, high = controller[name].bounds
        bounded[name] = (min(max(value, low), high), why if low <= value <= high else f"{why}; held at its bound")
    return bounded


def derive_pressures(contact: float, valve_gain: float, nominal: Values, controller: ParameterSet) -> dict[str, float]:
    """Return pressures and valve gain that a controller needs to fill and regulate a clutch with unknown maps.

    contact [bar] and valve_gain [bar/V]: measured in a first run. The preload is scaled with the contact pressure.
    """
    preload = nominal["piston.preload_pressure"] * contact / nominal["piston.contact_pressure"]
    known = {"piston.contact_pressure": contact, "piston.preload_pressure": preload, "valve.gain": valve_gain}
    values = _convert({**nominal, **known}, nominal, controller)
    return {name: values[name][0] for name in _PRESSURES}


def _convert_to_cylinder(plant: Values) -> dict[str, float]:
    """Return the plant's map parameters over the cylinder pressure; see Equation."""
    contact, stack = plant["piston.contact_pressure"], plant["piston.stack_stiffness"]
    share = stack / (stack + _spring_stiffness(plant))
    lines = {}
    for line in ("coulomb", "viscous"):
        slope, intercept = plant[f"clutch.{line}_slope"], plant[f"clutch.{line}_intercept"]
        lines[f"clutch.{line}_slope"] = share * slope
        lines[f"clutch.{line}_intercept"] = intercept + (1.0 - share) * slope * contact
    lines["clutch.beta_onset"] = contact + (plant["clutch.beta_onset"] - contact) / share
    lines["clutch.beta_scale"] = plant["clutch.beta_scale"] / share
    return lines
