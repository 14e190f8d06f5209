"""The wet-clutch rig under its pressure regulator: a whole profile in one compiled call, to obtain the inputs of a run.

What            valve voltage and speed demand that the controller would give the rig for a profile in pressure, with any
                parameters and effects, some 500 times faster than the controller itself
Equation        pressure regulator of docs/rig.md: u = p_d + k_p (p_d - p) + k_i integral(p_d - p), V = u/k_v; p as the data
                acquisition shows it; fill at the fill pressure until contact, release to voltage 0
Assumptions     one sample from measurement to voltage and from set-point to speed demand, as on the bus
Not modelled    noise, rounding, faults, torque demands
References      docs/rig.md; rt_controller/law/torque_law.py and phases.py, whose parameters are used;
                test_experiment_design.py checks that both agree
"""

from collections.abc import Mapping
from typing import NamedTuple

import numpy as np
from numba import njit

from plant_sim.effects.signals import ACQUISITION, SIGNALS, bind_laws, call, has_law, set_known
from plant_sim.profiles.profile import Profile
from plant_sim.rigs.sensors import voltages
from plant_sim.rigs.wet_clutch import Rig, advance, load_nominal
from plant_sim.rigs.wet_clutch_run import QUIET
from protocols.files.units import BAR, ZERO_CELSIUS
from protocols.node import load_node

_OPEN, _FILL, _CLOSED = range(3)


class Regulator(NamedTuple):
    """Parameters of the controller's pressure regulator, SI units: gains, pressures [Pa], dwell [s], highest voltage [V]."""

    valve_gain: float
    proportional: float
    integral: float
    floor: float
    most: float
    fill: float
    contact: float
    band: float
    dwell: float
    voltage: float
    sensitivity: float  # V/Pa, of the pressure sensor by its data sheet, whatever the sensor is

    @classmethod
    def from_controller(cls, changed: Mapping[str, float] | None = None) -> "Regulator":
        """Read the parameters of the controller; `changed` ones are by dotted name, in their units."""
        p = load_node("controller")().parameters.with_values(changed or {})
        names = (
            "pressure.valve_gain", "pressure.proportional_gain", "pressure.integral_gain", "pressure.floor",
            "torque.pressure_limit", "phases.fill_pressure", "model.contact_pressure", "phases.contact_band",
            "phases.fill_dwell", "pressure.voltage_limit",
        )  # fmt: skip
        return cls._make((*(p[name].si for name in names), load_nominal()["sensors.pressure_sensitivity"].si))


class RegulatedInputs(NamedTuple):
    """Inputs of a run, valve voltage [V] and speed demand [rad/s], (n,) each, and the extremes of the run.

    Extremes are the highest true pressure [Pa], torque of either sign [Nm], temperature [K] and slip of either sign [rad/s].
    """

    voltage: np.ndarray
    speed: np.ndarray
    pressure: float
    torque: float
    temperature: float
    slip: float


def regulate_profile(
    rig: Rig, profile: Profile, regulator: Regulator, celsius: float, rate: int, substeps: int
) -> RegulatedInputs:
    """Return the inputs of the `rig` by `profile` in pressure and speed. It starts at rest with oil of `celsius` [degC].

    rate: sampling rate [Hz]; substeps: integration steps per sample.
    """
    period = 1.0 / rate
    setpoints = [profile.interpolate(k * period) for k in range(round(profile.duration * rate))]
    demand = np.array([s.pressure for s in setpoints]) * BAR  # Pa
    speed = np.array([s.speed for s in setpoints])
    speed = np.concatenate([speed[:1], speed[:-1]])
    voltage = np.zeros(len(speed))
    state = rig.make_rest_state(float(speed[0]), celsius + ZERO_CELSIUS)
    peaks = _regulate(
        state.y.copy(), state.effects.copy(), demand, speed, regulator, rig.record[0]["motor_torque_limit"], rig.record,
        rig.table.kernel, period, substeps, voltage,
    )  # fmt: skip
    return RegulatedInputs(voltage, speed, *peaks)


@njit(cache=True, nogil=True, error_model="numpy")
def _regulate(state, states, demand, speed, regulator, limit, parameters, effects, period, substeps, voltage):
    """Write the voltage (n,) that follows `demand` [Pa] (n,); return peaks of pressure, torque, temperature, slip."""
    r, signals = regulator, np.zeros(1, SIGNALS)
    phase, contact, saturated, dwelt, integral, following = _OPEN, False, False, 0.0, 0.0, 0.0
    highest, strongest, hottest, fastest = 0.0, 0.0, 0.0, 0.0
    for k in range(demand.size):
        y, c, s = state[0], parameters[0], signals[0]
        highest, strongest = max(highest, y.pressure), max(strongest, abs(y.clutch_torque))
        hottest, fastest = max(hottest, y.temperature), max(fastest, abs(y.slip_speed))
        e = bind_laws(effects, states)
        shown, kelvin, motor, clutch = voltages(
            y.sensed_pressure, y.sensed_temperature, y.sensed_motor_torque, y.sensed_clutch_torque, QUIET, c
        )
        if has_law(ACQUISITION, e):
            set_known(e, s, y)
            s.pressure_voltage, s.temperature_voltage = shown, kelvin
            s.motor_torque_voltage, s.clutch_torque_voltage, s.encoder_angle = motor, clutch, y.angle
            call(ACQUISITION, e, s, c, period)
            shown = s.pressure_voltage
        pressure = shown / r.sensitivity

        dwelt = dwelt + period if pressure >= r.contact else 0.0
        if demand[k] <= 0.0:
            phase = _OPEN
        elif phase == _OPEN:
            phase = _FILL
        elif phase == _FILL and dwelt >= r.dwell:
            phase = _CLOSED
        contact = phase != _OPEN and pressure >= r.contact - (r.band if contact else 0.0)
        asked = 0.0
        if phase == _OPEN:
            integral = following = 0.0
            saturated = False
        else:
            wanted = max(demand[k], r.floor) if phase == _CLOSED else r.fill
            p_d = min(wanted, r.most)
            error = p_d - pressure
            integral = following
            if contact and not saturated:
                following = integral + r.integral * error * period
            u = (p_d + r.proportional * error + integral) / r.valve_gain
            asked = min(max(u, 0.0), r.voltage)
            saturated = p_d != wanted or asked != u
        if k + 1 < demand.size:
            voltage[k + 1] = asked
        state, states = advance(state, states, voltage[k], speed[k], limit, parameters, effects, period, substeps)
    return highest, strongest, hottest, fastest
