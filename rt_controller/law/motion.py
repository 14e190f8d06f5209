"""Motion of the plates from the encoder counts: at rest, turning, slow, sliding.

Equation        end speed of a sample   omega + alpha T/2, omega the mean over it; without a count  omega_before + alpha T
                slow speed              angle / time, over four counts: one count is 0.04 rad/s at 1 kHz
                The plates stand when the encoder has moved less than `stick_angle` for `stick_time`. A slide slower than the
                ratio of the two cannot be distinguished from rest
Assumptions     the encoder is on the side that turns
References      period measurement of a slow encoder: Ohmae et al. 1982 (IEEE Trans. Ind. Electron. 29:207), M/T method
"""

import numpy as np
from numba import njit

from rt_controller.law.record import make_float_type

# Names and units as in `controller.toml`, SI
MOTION_SETTINGS = make_float_type(
    "standing_angle", "rest_time", "coarse_angle", "coarse_speed", "coarse_time", "stick_angle", "stick_time"
)  # fmt: skip
# begin, end [rad/s]: speed at begin and end of the last sample. Below `coarse_speed` counts are timed: angle turned [rad] in
# the time taken [s], and slow [rad/s], the speed from them. angle [rad]: turned since `still` [s], in which it stayed below
# `stick_angle`. quiet [s]: time since the last count. rests: no count for `rest_time`; turns: the speed has changed its sign;
# moves: the plates slide
MOTION = np.dtype(
    [("begin", "f8"), ("end", "f8"), ("turned", "f8"), ("taken", "f8"), ("slow", "f8"), ("angle", "f8"), ("still", "f8"),
     ("quiet", "f8"), ("rests", "?"), ("turns", "?"), ("moves", "?")]
)  # fmt: skip


@njit
def advance_motion(state, settings, speed, acceleration, step):
    """Advance MOTION by `step` [s] with the mean `speed` [rad/s] and the `acceleration` [rad/s^2] in it."""
    if step > 0.0:
        still = abs(speed) * step <= settings.standing_angle
        state.begin = state.end
        state.end = state.begin + acceleration * step if still else speed + 0.5 * acceleration * step
        state.turns = state.begin * state.end < 0.0
        state.rests = still and not state.turns and state.quiet + step >= settings.rest_time
        if still and not state.turns:
            state.end = 0.0
        _time_counts(state, settings, speed, step)
        state.quiet = state.quiet + step if still else 0.0
        state.angle += speed * step
        state.still += step
        if abs(state.angle) > settings.stick_angle:
            state.angle = state.still = 0.0
    state.moves = state.still < settings.stick_time


@njit
def _time_counts(state, settings, speed, step):
    """Update the slow speed: `coarse_angle` over the time it takes; until then limited by the angle and time so far."""
    if abs(speed) > settings.coarse_speed:
        state.slow, state.turned, state.taken = speed, 0.0, 0.0
        return
    moved = speed * step
    if moved * state.turned < 0.0 or (state.quiet > settings.coarse_time and abs(moved) > settings.standing_angle):
        state.turned, state.taken = 0.0, min(state.quiet, settings.coarse_time)  # it turns back, or moves again
    state.turned += moved
    state.taken += step
    most = (abs(state.turned) + 2.0 * settings.standing_angle) / state.taken
    if abs(state.turned) >= settings.coarse_angle:
        state.slow, state.turned, state.taken = state.turned / state.taken, 0.0, 0.0
    elif state.slow * state.turned < 0.0:
        state.slow = state.turned / state.taken
    else:
        state.slow = min(max(state.slow, -most), most)
