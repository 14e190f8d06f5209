"""State of the plates as the controller believes it, from the encoder alone: open, sliding, sticking, locked.

Equation        the plates stick when the encoder has moved less than `stick_angle` for `stick_time`: slower than their ratio
                a slide cannot be told from rest
Assumptions     the encoder is on the side that turns; plates that do not touch are open, whatever moves
References      ours; locked: "totally closed", Janssens 2010, sec. 6.2.1
"""

from enum import IntEnum

import numpy as np
from numba import njit

from rt_controller.record import floats


class ClutchState(IntEnum):
    """What the plates do."""

    OPEN = 0
    SLIDING = 1
    STICKING = 2
    LOCKED = 3  # sticking, and held so on request


# Names and units as in `controller.toml`, SI
MOTION_SETTINGS = floats("standing_speed", "coarse_speed", "coarse_time", "stick_angle", "stick_time")
# Speed of the sample before, and the present one, below `coarse_speed` smoothed [rad/s]; angle since it began to be looked at
# [rad], time in which that has stayed small [s]; stands: at the end of the last sample the speed is, as far as can be seen, 0,
# or has just passed it; rests: it has been 0 over two; moves: whether the plates do
MOTION = np.dtype(
    [
        ("speed", "f8"),
        ("angle", "f8"),
        ("still", "f8"),
        ("smooth", "f8"),
        ("stands", "?"),
        ("rests", "?"),
        ("moves", "?"),
    ]
)


@njit
def motion(state, settings, speed, slip, step):
    """Move MOTION on by `step` [s] at `speed` [rad/s], the mean over it, and `slip` [rad/s], observed at its end."""
    if step > 0.0:
        still = abs(speed) <= settings.standing_speed
        state.rests = still and abs(state.speed) <= settings.standing_speed
        state.stands = still or speed * slip <= 0.0 or speed * state.speed < 0.0
        share = min(step / settings.coarse_time, 1.0) if abs(speed) <= settings.coarse_speed else 1.0
        state.smooth += share * (speed - state.smooth)
        state.speed = speed
        state.angle += speed * step
        state.still += step
        if abs(state.angle) > settings.stick_angle:
            state.angle = state.still = 0.0
    state.moves = state.still < settings.stick_time


@njit
def clutch_state(contact, moves, lock):
    """The ClutchState, from whether the plates touch, move, and are to be locked."""
    if not contact:
        return ClutchState.OPEN.value
    if moves:
        return ClutchState.SLIDING.value
    return ClutchState.LOCKED.value if lock else ClutchState.STICKING.value
