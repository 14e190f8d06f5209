"""Adaptation of the friction level from motor torque and slip acceleration, without the torque sensor.

Equation        y = M_m - J alpha  (torque balance of the motor side);  y = level (c + v) + viscous v + noise,
                c, v the Coulomb and viscous part of the estimate. Least squares with forgetting on the moments of
                (c + v, v); the level follows with a time constant. `viscous` is updated only while v varies
                independently of c + v (excitation), otherwise it is held.
                level(T) = base + sum_i w_i(T) d_i, w_i hat functions over oil temperature: each temperature keeps
                what was learnt there.
Assumptions     the motor torque signal is correct while it changes; a stuck signal is not learnt from; the inertia is known;
                friction changes more slowly than the window
Valid range     |slip| and torque above their floors, |alpha| below its limit; outside all states are held
Not modelled    errors that are not proportional to torque (contact pressure, seal) appear as a level
References      developed here; torque balance: docs/rig.md, 8. Janssens 2010, ch. 7, announces adaptation as future work
"""

import numpy as np
from numba import njit

from rt_controller.law.record import make_float_type

TEMPERATURE_NODES = (313.15, 333.15, 353.15, 373.15, 398.15, 423.15)  # K: 40..150 degC, the span of fig 6.8
_LAST_INTERVAL = len(TEMPERATURE_NODES) - 2  # index of the lower node of the last interval

# Names and units as in `controller.toml`, SI
ADAPTATION_SETTINGS = make_float_type(
    "window", "time_constant", "temperature_share", "level_low", "level_high", "viscous_bound", "torque_floor", "slip_floor",
    "acceleration_limit", "stuck_time", "excitation",
)  # fmt: skip
# level and viscous: friction level and viscous correction [-] for estimator and inverse model. active: it learns in this step.
# base, deviations: terms of the level [-]. aa to vy: exponentially weighted moments [Nm^2] of a = c + v, v and y
ADAPTATION = np.dtype(
    [("level", "f8"), ("viscous", "f8"), ("active", "?"), ("base", "f8"), ("deviations", "f8", len(TEMPERATURE_NODES)),
     ("aa", "f8"), ("av", "f8"), ("vv", "f8"), ("ay", "f8"), ("vy", "f8")]
)  # fmt: skip
INITIAL_ADAPTATION = {"level": 1.0, "base": 1.0}  # no correction of the identified parameters


@njit
def adapt(state, settings, coulomb, viscous, observed, slip, acceleration, temperature, step, sliding):
    """Advance ADAPTATION by `step` [s]; it learns only while `sliding`.

    Coulomb and viscous part of the estimate and observed torque [Nm], slip [rad/s], acceleration [rad/s^2], temperature [K].
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
        correction = gain * (best - _interpolate_level(state, node, weight))
        state.base += (1.0 - s.temperature_share) * correction
        state.deviations[node] += s.temperature_share * (1.0 - weight) * correction
        state.deviations[node + 1] += s.temperature_share * weight * correction
    state.level = _clip(_interpolate_level(state, node, weight), s.level_low, s.level_high)


@njit
def _interpolate_level(state, node, weight):
    """Return the friction level [-] between two temperature nodes, without bounds."""
    return state.base + (1.0 - weight) * state.deviations[node] + weight * state.deviations[node + 1]


@njit
def _locate_temperature(temperature):
    """Return the lower node and the weight of the upper one, to interpolate over TEMPERATURE_NODES; constant outside."""
    node = 0
    while node < _LAST_INTERVAL and temperature >= TEMPERATURE_NODES[node + 1]:
        node += 1
    low, high = TEMPERATURE_NODES[node], TEMPERATURE_NODES[node + 1]
    return node, _clip((temperature - low) / (high - low), 0.0, 1.0)


@njit
def _clip(value, low, high):
    """Return `value` limited to `low`..`high`."""
    return min(max(value, low), high)
