"""Plausibility: whether pressure, encoder and motor torque can be true of one clutch.

What            mismatch    the motor's torque balance and the model of the torque differ by more than `torque_mismatch` for
                            `mismatch_dwell`: sliding, that is the friction of eq. 6.9; standing, what is applied beyond the
                            capacity (`law.mismatch`). Pressure, motor torque or friction is another than believed
                encoder     the plates stand, the motor is to turn and gives less than it may: a speed control would press
                            until one of the two is no longer so. Its error, summed over time, exceeds `standing_error`
                pressure    the signal has not moved by a count for `frozen_dwell` since the pressure asked for has moved by
                            `frozen_change`; or it lies below `lost_pressure` for `lost_dwell`: no plate touches there
Assumptions     the model is right within `torque_mismatch`; the motor's speed control integrates; the pressure loop follows
                within the dwell
Not modelled    signals that are wrong by less; a motor torque that stands still while the plates do
References      ours; what each fault takes to be found is measured: docs/states.md
"""

import numpy as np
from numba import njit

from rt_controller.law.record import floats

# Names and units as in `controller.toml`, SI
PLAUSIBILITY_SETTINGS = floats(
    "torque_mismatch",
    "mismatch_dwell",
    "standing_error",
    "frozen_change",
    "frozen_dwell",
    "lost_pressure",
    "lost_dwell",
)
# For how long [s] each condition has lasted; sum of the speed error while the plates stand [rad]; pressure signal of the step
# before and the pressure asked for when it last moved [Pa]
PLAUSIBILITY = np.dtype(
    [("time_mismatch", "f8"), ("standing", "f8"), ("time_frozen", "f8"), ("time_lost", "f8"), ("pressure", "f8"),
     ("asked", "f8")]
)  # fmt: skip


@njit
def torque_implausible(state, settings, mismatch, speed_error, stands, pushes, step):
    """Whether motor torque, estimate and encoder contradict each other, `step` [s] later.

    mismatch [Nm]; speed_error [rad/s] of the motor; `stands`: by the encoder the plates do; `pushes`: the motor gives all that
    it may.
    """
    state.time_mismatch = state.time_mismatch + step if abs(mismatch) > settings.torque_mismatch else 0.0
    state.standing = state.standing + abs(speed_error) * step if stands and not pushes else 0.0
    return state.time_mismatch >= settings.mismatch_dwell or state.standing >= settings.standing_error


@njit
def pressure_lost(state, settings, pressure, asked, step):
    """Whether the `pressure` signal is none, `step` [s] later; `asked` for it is what the regulator follows. All in Pa."""
    state.time_lost = state.time_lost + step if pressure < settings.lost_pressure else 0.0
    if pressure != state.pressure:
        state.pressure, state.asked, state.time_frozen = pressure, asked, 0.0
    elif abs(asked - state.asked) > settings.frozen_change:
        state.time_frozen += step
    return state.time_lost >= settings.lost_dwell or state.time_frozen >= settings.frozen_dwell
