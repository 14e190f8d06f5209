"""Time integration of the tribometer: two structures joined by a friction contact and a normal contact.

Equation        x_after = Phi x + Gamma_f f + Gamma_u u (exact for held forces), f the contact force at the end of the step:
                contact displacement  D = D_free - b f(D),  b > 0 the compliance of the structure over one step
Assumptions     f rises with D faster than -1/b: always so for small steps, as b falls with dt^2
Valid range     steps well below the period of the mode that deforms a contact most
Not modelled    -
References      Janssens 2010, sec. 3.10 (structures); `plant_sim.friction.coupled` (balance of the friction)
"""

from math import exp, sin

import numpy as np
from numba import njit, types
from numba.core.types import float64, int64

from plant_sim.friction.coupled import balance
from plant_sim.friction.kernel import LAW, VECTOR

# theta 1..3 [rad], velocity of table, motor, slip [rad/s], x 1..2 [m], friction and normal force [N], motor torque [Nm]
COLUMN_COUNT = 11

_MOST_EVALUATIONS = 100  # evaluations of the normal contact in one step; 3 to 5 are usual
_MATRIX = types.Array(float64, 2, "C")
_MATRICES = types.Array(float64, 3, "C")


@njit(cache=True)
def normal_force(approach, free, compliance, preload, dt, contact):
    """Return the normal force N [N]: N = N_c(approach + D), D = free - compliance (N - preload) the change of the approach [m].

    contact: load and approach that calibrate it, exponent, damping time [s]. Newton from the side where N = 0; the residual is
    convex there, so that no step overshoots.
    """
    load_1, approach_1, exponent, time = contact
    gain = (1.0 + time / dt) / approach_1
    change = free + compliance * preload
    force = 0.0
    for _ in range(_MOST_EVALUATIONS):
        pressed = approach / approach_1 + gain * change
        if pressed <= 0.0:
            return 0.0
        force = load_1 * pressed**exponent
        slope = 1.0 + compliance * exponent * force / pressed * gain
        step = (change - free + compliance * (force - preload)) / slope
        change -= step
        if abs(step) <= 1e-13 * approach_1:
            break
    return force


_ADVANCE_SIGNATURE = types.void(
    LAW, VECTOR, VECTOR, _MATRICES, VECTOR, _MATRICES, VECTOR, VECTOR, VECTOR, VECTOR, VECTOR, float64, int64, _MATRIX
)


@njit(inline="always")
def _propagate(matrices, mode, before, drive, after):
    """Compute after = Phi before + Gamma_u drive for the structure matrices[mode] (8, 6).

    Its rows are Phi's columns, Gamma_f, Gamma_u.
    """
    for j in range(6):
        after[j] = matrices[mode, 7, j] * drive
    for k in range(6):
        for j in range(6):
            after[j] += matrices[mode, k, j] * before[k]


@njit(_ADVANCE_SIGNATURE, cache=True, error_model="numpy", fastmath={"contract"})
def advance(law, parameters, friction, torsion, q, normal, x, motor, command, contact, loads, dt, every, kept):
    """Run the rig over the samples of `command` and `loads`; `q` (7,), `x` (9,), `friction` are the state, overwritten.

    torsion: (2, 8, 6) transposed structure matrices of a step, with the drive gains within and without; normal: (1, 8, 6).
    motor: stiffness, damping, torque limit; command: the rest of the motor torque [Nm] (n,); loads [N] (n,).
    contact: preload [N] and approach [m] at which `x` is 0, calibrating load and approach, exponent, damping time [s], half the
    runout [m], lift-up: height [m], speed scale [rad/s], rate [1/s]; mean radius [m].
    kept: (rows, COLUMNS), every `every`-th sample.
    """
    stiffness, damping, limit = motor
    preload, approach_0, load_1, approach_1, exponent, time, runout, highest, speed, rate, radius = contact
    sink = normal[0, 6, 0] - normal[0, 6, 1]  # m/N: approach lost in a step for 1 N in the contact
    compliance = radius * radius * (torsion[0, 6, 0] - torsion[0, 6, 1])  # m/N at the mean radius
    old, new_friction = np.empty(6), np.empty_like(friction)
    follow = exp(-rate * dt)
    force, load = q[6], x[8]
    for i in range(command.size):
        if i > 0:
            # normal direction; runout and lift-up are those of angle and speed at the start of the step
            approach = approach_0 + x[1] - x[0] + x[6] + x[7]
            lift = highest * (1.0 - exp(-abs(q[4] - q[3]) / speed))
            moved = runout * sin(q[1] - q[0]) - x[6] + (lift - x[7]) * (1.0 - follow)
            x[6] = runout * sin(q[1] - q[0])
            x[7] = lift + (x[7] - lift) * follow
            for j in range(6):
                old[j] = x[j]
            _propagate(normal, 0, old, loads[i] - preload, x)
            free = x[1] - x[0] - (old[1] - old[0]) + moved
            load = normal_force(approach, free, sink, preload, dt, (load_1, approach_1, exponent, time))
            for j in range(6):
                x[j] += normal[0, 6, j] * (load - preload)

            # torsion
            asked = 0.5 * (command[i - 1] + command[i])
            torque = asked - stiffness * q[2] - damping * q[5]
            mode = 1 if abs(torque) > limit else 0
            torque = min(max(torque, -limit), limit)
            for j in range(6):
                old[j] = q[j]
            _propagate(torsion, mode, old, torque if mode == 1 else asked, q)
            free = radius * (q[1] - q[0] - (old[1] - old[0]))
            force = balance(law, parameters, friction, 1.0 / compliance, free / compliance, dt, load, new_friction)[1]
            for j in range(6):
                q[j] += torsion[mode, 6, j] * radius * force
            for j in range(friction.size):
                friction[j] = new_friction[j]
        if i % every == 0:
            row = i // every
            torque = min(max(command[i] - stiffness * q[2] - damping * q[5], -limit), limit)
            for j in range(4):
                kept[row, j] = q[j]
            kept[row, 4], kept[row, 5] = q[5], q[4] - q[3]
            kept[row, 6], kept[row, 7], kept[row, 8], kept[row, 9], kept[row, 10] = x[0], x[1], force, load, torque
    q[6], x[8] = force, load
