"""A whole run of the power-shift rig's driveline behind measured clutch torques, in one compiled call.

Equation        shafts, road and motor as in `power_shift`; the torques of the clutches are given at the samples, and are
                straight lines between them
                plates that stick pass a step of the motor's torque at a sample, and the straight line has it at its end:
                  M = line + q D (1 - s),  D: the step, q: share of it that is passed, s: part of the sample that is over
Integration     midpoint rule, in steps of a sample's `substeps`th part
Assumptions     the speed demand is constant from sample to sample
Not modelled    what `power_shift` leaves out
References      docs/power_shift.md

The compiled call releases the interpreter lock, so that several runs can be simulated side by side in threads.
"""

import numpy as np
from numba import njit

from plant_sim.blocks import motor
from plant_sim.rigs.tied_shafts import road_torque

SLIP_A, SLIP_B, MOTOR_TORQUE = range(3)  # columns of what `run` returns
MOTOR_RECORD = np.dtype([(name, np.float64) for name in ("inertia", "proportional", "integral", "limit")])


@njit(cache=True, nogil=True, error_model="numpy")
def run(
    torque_a, torque_b, passed_a, passed_b, demand, input_speed, output_speed, integral, drive, driveline, period, substeps,
    shown,
):  # fmt: skip
    """Simulate a run; write the slips over the last sample [rad/s] and the motor's torque [Nm] to `shown` (n, 3).

    torque_a, torque_b [Nm], demand [rad/s]: inputs (n,). passed_a, passed_b (n,): q of each clutch, 0 while it slips.
    input_speed, output_speed [rad/s], integral of the speed error [rad]: at the start. drive (1,) of MOTOR_RECORD;
    driveline: see `power_shift.make_driveline_record`. period [s].
    """
    m, d, h = drive[0], driveline[0], period / substeps
    w_in, w_out = input_speed, output_speed
    into = out = 0.0  # rad, turned since the sample before
    asked = demand[0]
    for k in range(demand.size):
        if k > 0:
            shown[k, SLIP_A] = (into - d.ratio_a * out) / period
            shown[k, SLIP_B] = (into - d.ratio_b * out) / period
        else:
            shown[k, SLIP_A], shown[k, SLIP_B] = w_in - d.ratio_a * w_out, w_in - d.ratio_b * w_out
        before = motor.limit_torque(motor.torque_demand(asked - w_in, integral, m.proportional, m.integral), m.limit)
        shown[k, MOTOR_TORQUE] = before
        asked = demand[k]
        step = (
            motor.limit_torque(motor.torque_demand(asked - w_in, integral, m.proportional, m.integral), m.limit)
            - before
        )
        into = out = 0.0
        rise_a = torque_a[k + 1] - torque_a[k] if k + 1 < demand.size else 0.0
        rise_b = torque_b[k + 1] - torque_b[k] if k + 1 < demand.size else 0.0
        for j in range(substeps):
            share = (j + 0.5) / substeps
            gone = (1.0 - share) * step
            a = torque_a[k] + share * rise_a + passed_a[k] * gone
            b = torque_b[k] + share * rise_b + passed_b[k] * gone
            carried, output = a + b, d.ratio_a * a + d.ratio_b * b
            now = motor.limit_torque(motor.torque_demand(asked - w_in, integral, m.proportional, m.integral), m.limit)
            middle = w_in + 0.5 * h * (now - carried) / m.inertia
            error = asked - middle
            wanted = motor.torque_demand(error, integral + 0.5 * h * error, m.proportional, m.integral)
            given = motor.limit_torque(wanted, m.limit)
            if wanted == given:
                integral += h * error
            after = w_in + h * (given - carried) / m.inertia
            onward = w_out + h * (output - road_torque(w_out, output, d, h)) / d.inertia
            into += 0.5 * h * (w_in + after)
            out += 0.5 * h * (w_out + onward)
            w_in, w_out = after, onward
