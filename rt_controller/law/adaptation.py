"""Adaptation of the friction level from motor torque and slip acceleration, without the torque sensor.

Equation        y = M_m - J alpha  (torque balance of the motor side);  y = level (c + v) + viscous v + noise,
                c, v the Coulomb and viscous part of the estimate. Least squares with forgetting on the moments of
                (c + v, v); the level follows it with a time constant; `viscous` moves only where v varies
                independently of c + v (excitation), else it is held.
                level(T) = base + sum_i w_i(T) d_i, w_i hat functions over oil temperature: what is learnt at one
                temperature is remembered there.
Assumptions     motor torque signal is right while it moves, one that is stuck teaches nothing; inertia known; friction
                changes slower than the window
Valid range     |slip| and torque above their floors, |alpha| below its limit; outside, everything is held
Not modelled    errors that are not proportional to torque (contact pressure, seal) appear as level
References      ours; torque balance: docs/rig.md, 8. Integral adaptation: announced as future work in Janssens 2010, chapter 7
"""

import numpy as np
from numba import njit

from rt_controller.law.record import floats

TEMPERATURE_NODES = (313.15, 333.15, 353.15, 373.15, 398.15, 423.15)  # K: 40..150 degC, the span of fig 6.8
_LAST_INTERVAL = len(TEMPERATURE_NODES) - 2  # lower node of the last interval

# Names and units as in `controller.toml`, SI
ADAPTATION_SETTINGS = floats(
    "window", "time_constant", "temperature_share", "level_low", "level_high", "viscous_bound", "torque_floor", "slip_floor",
    "acceleration_limit", "stuck_time", "excitation",
)  # fmt: skip
# Friction level and viscous correction [-] of estimator and inverse model; whether it learns; what the level is made of;
# exponentially weighted moments of a = c + v, v and y
ADAPTATION = np.dtype(
    [("level", "f8"), ("viscous", "f8"), ("active", "?"), ("base", "f8"), ("deviations", "f8", len(TEMPERATURE_NODES)),
     ("aa", "f8"), ("av", "f8"), ("vv", "f8"), ("ay", "f8"), ("vy", "f8")]
)  # fmt: skip
INITIAL_ADAPTATION = {"level": 1.0, "base": 1.0}  # the identified parameters as they are


@njit
def adapt(state, settings, coulomb, viscous, observed, slip, acceleration, temperature, step, sliding):
    """Move ADAPTATION on; where not `sliding` nothing is learnt.

    Torque parts and observed torque [Nm], slip [rad/s], acceleration [rad/s^2], temperature [K], step [s].
    """
    s = settings
    node, weight = _locate_temperature(temperature)
    whole = coulomb + viscous
    state.active = (
        sliding
        and step > 0.0
        and abs(slip) > s.slip_floor
        and abs(whole) > s.torque_floor
        and abs(acceleration) < s.acceleration_limit
    )
    if state.active:
        keep = max(0.0, 1.0 - step / s.window)
        fresh = 1.0 - keep
        state.aa = keep * state.aa + fresh * whole * whole
        state.av = keep * state.av + fresh * whole * viscous
        state.vv = keep * state.vv + fresh * viscous * viscous
        state.ay = keep * state.ay + fresh * whole * observed
        state.vy = keep * state.vy + fresh * viscous * observed
        gain = min(1.0, step / s.time_constant)
        unexplained = state.vv - state.av * state.av / state.aa  # of v, given a
        if unexplained > s.excitation * state.aa:
            best = (state.vy - state.av * state.ay / state.aa) / unexplained  # least squares in (level, viscous)
            state.viscous = _clip(state.viscous + gain * (best - state.viscous), -s.viscous_bound, s.viscous_bound)
        best = (state.ay - state.viscous * state.av) / state.aa  # least squares in level, viscous given
        best = _clip(best, s.level_low, s.level_high)
        correction = gain * (best - _level(state, node, weight))
        state.base += (1.0 - s.temperature_share) * correction
        state.deviations[node] += s.temperature_share * (1.0 - weight) * correction
        state.deviations[node + 1] += s.temperature_share * weight * correction
    state.level = _clip(_level(state, node, weight), s.level_low, s.level_high)


@njit
def _level(state, node, weight):
    return state.base + (1.0 - weight) * state.deviations[node] + weight * state.deviations[node + 1]


@njit
def _locate_temperature(temperature):
    """Lower node and weight of the upper one, for linear interpolation over `TEMPERATURE_NODES`; held outside."""
    node = 0
    while node < _LAST_INTERVAL and temperature >= TEMPERATURE_NODES[node + 1]:
        node += 1
    low, high = TEMPERATURE_NODES[node], TEMPERATURE_NODES[node + 1]
    return node, _clip((temperature - low) / (high - low), 0.0, 1.0)


@njit
def _clip(value, low, high):
    return min(max(value, low), high)
