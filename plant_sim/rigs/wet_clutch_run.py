"""A whole run of the wet-clutch rig in one compiled call: inputs in, outputs of the data acquisition out, without noise.

Equation        `wet_clutch.advance`, sample by sample; voltages by `plant_sim/rigs/sensors.py`, converted back and not rounded
Assumptions     inputs are constant from sample to sample
Not modelled    noise, and rounding by the converters, which averages out over samples
References      docs/rig.md

The compiled call releases the interpreter lock, so that several runs can be simulated side by side in threads.
"""

import numpy as np
from numba import njit

from plant_sim.effects.signals import ACQUISITION, RIG, SIGNALS, bind_laws, call, has_law, set_known
from plant_sim.rigs.sensors import voltages
from plant_sim.rigs.wet_clutch import move

PRESSURE, SLIP, ANGLE, TEMPERATURE, CLUTCH_TORQUE, MOTOR_TORQUE = range(6)  # columns of what `run` returns
QUIET = (0.0, 0.0, 0.0, 0.0)  # in place of the standard normal numbers of a sample: no noise


@njit(cache=True, nogil=True, error_model="numpy")
def run(
    state, states, voltage, speed, limit, parameters, effects, period, substeps, driven, pressure, slip, scales, shown
):
    """Simulate a run; write the outputs to `shown` (n, 6) in Pa, rad/s, rad, degC, Nm, Nm, and advance `state`, `states`.

    state, states: fields of a `Whole`. voltage [V], speed [rad/s]: inputs (n,). limit (n,): of the motor torque [Nm]. period
    [s], divided into `substeps`. driven: cylinder pressure [Pa] and slip [rad/s] are set to `pressure` and `slip` (n,)
    at each sample; this simulates the clutch alone, behind its measured inputs. scales: physical value of a volt, for
    the channels of pressure, temperature, motor torque and clutch torque [Pa/V, K/V, Nm/V, Nm/V].
    """
    own, signals = parameters.copy(), np.zeros(1, SIGNALS)
    e = bind_laws(effects, states)
    y, c, s = state[0], parameters[0], signals[0]
    for k in range(voltage.size):
        if driven:
            y.valve_pressure = pressure[k]
            y.pressure = pressure[k]
            y.slip_speed = slip[k]
        cylinder, kelvin, motor, clutch = voltages(
            y.sensed_pressure, y.sensed_temperature, y.sensed_motor_torque, y.sensed_clutch_torque, QUIET, c
        )
        angle = y.angle
        if has_law(ACQUISITION, e):
            set_known(e, s, y)
            s.pressure_voltage, s.temperature_voltage = cylinder, kelvin
            s.motor_torque_voltage, s.clutch_torque_voltage, s.encoder_angle = motor, clutch, angle
            call(ACQUISITION, e, s, c, period)
            cylinder, kelvin = s.pressure_voltage, s.temperature_voltage
            motor, clutch, angle = s.motor_torque_voltage, s.clutch_torque_voltage, s.encoder_angle
        shown[k, PRESSURE] = cylinder * scales[0]
        shown[k, SLIP] = y.slip_speed
        shown[k, ANGLE] = angle
        shown[k, TEMPERATURE] = kelvin * scales[1]
        shown[k, CLUTCH_TORQUE] = clutch * scales[3]
        shown[k, MOTOR_TORQUE] = motor * scales[2]
        if has_law(RIG, e):
            own = parameters.copy()  # such effects change the original parameters at each sample
        move(state, own, signals, e, voltage[k], speed[k], limit[k], period, substeps)
