"""A whole run of one clutch between two shafts in one compiled call: voltage and slip in, outputs of the data acquisition out.

Equation        valve, cylinder, piston, plates and oil as in `clutch_unit`; the slip is given at the samples, and is a straight
                line between them
Integration     as in `power_shift`, whose clutch this is
Assumptions     the voltage is constant from sample to sample; the speed of the cylinder is a straight line between the samples
Not modelled    plates that stick: at a slip of 0 the friction state stays, and the torque is that state's. Effects between
                motor and clutch (hook DRIVE)
References      docs/rig.md; docs/power_shift.md

The compiled call releases the interpreter lock, so that several runs can be simulated side by side in threads.
"""

import numpy as np
from numba import njit

from plant_sim.blocks import oil
from plant_sim.effects.signals import ACQUISITION, RIG, SENSORS, SIGNALS, bind_laws, call, has_law, set_known
from plant_sim.rigs.clutch_unit import actuate, friction_pressure, slide, viscosity_ratio
from plant_sim.rigs.sensors import voltages
from plant_sim.rigs.wet_clutch import sense
from plant_sim.rigs.wet_clutch_run import QUIET

PRESSURE, TEMPERATURE, TORQUE = range(3)  # columns of what `run` returns


@njit(cache=True, nogil=True, error_model="numpy")
def run(
    state, states, voltage, slip, cylinder_speed, parameters, effects, period, substeps, driven, pressure, scales, shown
):
    """Simulate a run; write the outputs to `shown` (n, 3) in Pa, degC, Nm, and advance `state`, `states`.

    state, states: fields of a `Whole`. voltage [V], slip and cylinder speed [rad/s]: inputs (n,). effects: attachments of a
    table. period [s], divided into `substeps`. driven: the cylinder pressure [Pa] is set to `pressure` (n,) at each sample.
    scales: physical value of a volt, for pressure, temperature and clutch torque [Pa/V, K/V, Nm/V].
    """
    own, signals = parameters.copy(), np.zeros(1, SIGNALS)
    e = bind_laws(effects, states)
    y, c, s = state[0], own[0], signals[0]
    h = period / substeps
    for k in range(voltage.size):
        if driven:
            y.valve_pressure = pressure[k]
            y.pressure = pressure[k]
        y.slip_speed = slip[k]
        if has_law(RIG, e):
            own[0] = parameters[0]  # such effects change the original parameters at each sample
            set_known(e, s, y)
            call(RIG, e, s, c, period)
        set_known(e, s, y)
        plates = friction_pressure(y.position, s, c, e)
        _, torque = slide(y.friction_state, plates, slip[k], viscosity_ratio(y.temperature, c), s, c, e, 0.0)
        sense(y, torque, torque, s, c, e, 0.0)
        cylinder, kelvin, motor, clutch = voltages(
            y.sensed_pressure, y.sensed_temperature, torque, y.sensed_clutch_torque, QUIET, c
        )
        if has_law(ACQUISITION, e):
            set_known(e, s, y)
            s.pressure_voltage, s.temperature_voltage = cylinder, kelvin
            s.motor_torque_voltage, s.clutch_torque_voltage, s.encoder_angle = motor, clutch, y.angle
            call(ACQUISITION, e, s, c, period)
            cylinder, kelvin, clutch = s.pressure_voltage, s.temperature_voltage, s.clutch_torque_voltage
        shown[k, PRESSURE] = cylinder * scales[0]
        shown[k, TEMPERATURE] = kelvin * scales[1]
        shown[k, TORQUE] = clutch * scales[2]
        step = turn = 0.0
        if k + 1 < voltage.size:
            step = (slip[k + 1] - slip[k]) / substeps
            turn = (cylinder_speed[k + 1] - cylinder_speed[k]) / substeps
        for j in range(substeps):
            set_known(e, s, y)
            s.time = y.time + 0.5 * h
            s.cylinder_speed = cylinder_speed[k] + j * turn
            plates = actuate(y, voltage[k], s, c, e, h)
            middle = slip[k] + (j + 0.5) * step
            viscosity = viscosity_ratio(y.temperature, c)
            y.friction_state, torque = slide(y.friction_state, plates, middle, viscosity, s, c, e, h)
            y.temperature += h * oil.heating_rate(
                y.temperature, abs(torque * middle), c.oil_heat_capacity, c.oil_heat_transfer, c.oil_sump_temperature
            )
            y.slip_speed = slip[k] + (j + 1.0) * step
            y.angle += h * middle
            y.time += h
            if has_law(SENSORS, e):
                sense(y, torque, torque, s, c, e, h)
