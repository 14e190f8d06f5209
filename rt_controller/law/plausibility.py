"""Plausibility: checks whether pressure, encoder and motor torque of a clutch agree with each other.

What            mismatch    the motor's torque balance and the torque model differ by more than `torque_mismatch` for
                            `mismatch_dwell` (`transmitted.mismatch`). The model is eq. 6.9 for sliding plates, and the capacity
                            for plates that stand. Then pressure, motor torque or friction is wrong
                encoder     the plates stand, although the motor has a speed demand and is below its torque limit: its speed
                            control would increase the torque. The speed error, integrated, exceeds `standing_error`
                pressure    the signal has not changed by a count for `frozen_dwell`, while its demand has changed by more than
                            `frozen_change`; or it is below `lost_pressure` for `lost_dwell`, where no plates touch
Assumptions     the model is correct within `torque_mismatch`; the motor's speed control integrates; the pressure loop follows
                within the dwell
Not modelled    smaller errors of the signals; a motor torque signal that is constant while the plates stand
References      developed here; the time to detect each fault is measured in docs/states.md
"""

import numpy as np
from numba import njit

from rt_controller.law.record import make_float_type

# Names and units as in `controller.toml`, SI
PLAUSIBILITY_SETTINGS = make_float_type(
    "torque_mismatch",
    "mismatch_dwell",
    "standing_error",
    "frozen_change",
    "frozen_dwell",
    "lost_pressure",
    "lost_dwell",
)
# time_...: duration [s] of each condition. standing: integral of the speed error while the plates stand [rad]. pressure: signal
# of the step before [Pa]; asked: pressure demand [Pa] at the last change of the signal
PLAUSIBILITY = np.dtype(
    [("time_mismatch", "f8"), ("standing", "f8"), ("time_frozen", "f8"), ("time_lost", "f8"), ("pressure", "f8"),
     ("asked", "f8")]
)  # fmt: skip


@njit
def check_torque(state, settings, mismatch, speed_error, stands, motor_limited, step):
    """Advance the torque checks by `step` [s]; return whether motor torque, estimate and encoder contradict each other.

    mismatch [Nm] of the torque balance; speed_error [rad/s] of the motor; `stands`: the encoder shows no motion;
    `motor_limited`: the motor is at its torque limit.
    """
    state.time_mismatch = state.time_mismatch + step if abs(mismatch) > settings.torque_mismatch else 0.0
    state.standing = state.standing + abs(speed_error) * step if stands and not motor_limited else 0.0
    return state.time_mismatch >= settings.mismatch_dwell or state.standing >= settings.standing_error


@njit
def check_pressure(state, settings, pressure, asked, step):
    """Advance the pressure check by `step` [s]; return whether the `pressure` signal [Pa] is invalid; `asked`: demand [Pa]."""
    state.time_lost = state.time_lost + step if pressure < settings.lost_pressure else 0.0
    if pressure != state.pressure:
        state.pressure, state.asked, state.time_frozen = pressure, asked, 0.0
    elif abs(asked - state.asked) > settings.frozen_change:
        state.time_frozen += step
    return state.time_lost >= settings.lost_dwell or state.time_frozen >= settings.frozen_dwell
