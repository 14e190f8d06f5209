"""The other clutch of a power shift, from its frames, and the torque balance of both clutches.

Equation        slip of each clutch s = w_in - i w_out, i its ratio; so w_in' = (i s_o' - i_o s')/(i - i_o), o the other clutch.
                M + M_o = M_m - J w_in'. A clutch that slides transmits its estimate, with a friction level within the bounds of
                the adaptation. A clutch that sticks transmits any torque up to its capacity, in both directions
Assumptions     the estimate of the other is at most 0.1 s old (CONTROLLER_STATUS); the hand-over of torque is slower
Not modelled    which of the two clutches is wrong: both controllers detect the mismatch
References      docs/rig.md, 8 for one clutch; Janssens 2010, fig 6.1
"""

from typing import Any

import numpy as np
from numba import njit

from protocols.can.words import count_rise, count_turn, read_raw
from rt_controller.law.record import make_float_type, make_record
from rt_controller.law.slip import observe

# Ratios [-] of this clutch and of the other; patience [s]: time for which a status is valid
PAIR_SETTINGS = make_float_type("ratio", "other_ratio", "patience")
# count: encoder count (unwrapped); tick: its tick, -1 before the first. angle [rad], slip [rad/s], acceleration [rad/s^2] of
# the observer. estimate [Nm], sticks: the status in use since `age` [s]. new_...: the newest status; is_new: it is not in use
# yet
OTHER = np.dtype(
    [("count", "i8"), ("tick", "i8"), ("angle", "f8"), ("slip", "f8"), ("acceleration", "f8"), ("estimate", "f8"),
     ("sticks", "?"), ("age", "f8"), ("new_estimate", "f8"), ("new_sticks", "?"), ("is_new", "?")]
)  # fmt: skip


def make_other() -> Any:
    """Return OTHER before the first frame."""
    return make_record(OTHER, tick=-1, age=np.inf)


@njit
def take_other_encoder(other, word, encoder, period, bandwidth):
    """Take the payload `word` of the other clutch's ENCODER.

    `encoder`: definition of the frame (`words.make_frame_layout`); period [s]; bandwidth [1/s] of the slip observer.
    """
    tick = read_raw(word, encoder.sample_tick)
    other.count += count_turn(read_raw(word, encoder.shaft_angle), other.count, encoder.shaft_angle)
    angle = other.count * encoder.shaft_angle.scale
    ticks = count_rise(tick, other.tick, encoder.sample_tick)
    if other.tick < 0:
        other.angle, other.slip, other.acceleration = angle, 0.0, 0.0
    elif ticks:
        other.angle, other.slip, other.acceleration = observe(
            (other.angle, other.slip, other.acceleration), angle, ticks * period, bandwidth
        )
    other.tick = tick


@njit
def take_other_status(other, estimate, sticks):
    """Store the other clutch's CONTROLLER_STATUS: its estimate [Nm], and whether its plates stick."""
    other.new_estimate, other.new_sticks, other.is_new = estimate, sticks, True


@njit
def use_newest_status(other):
    """Use the newest status. Called at a fixed time between two statuses: so the exact cycle of arrival has no effect."""
    if other.is_new:
        other.estimate, other.sticks, other.is_new, other.age = other.new_estimate, other.new_sticks, False, 0.0


@njit
def find_applied_torque(other, pair, settings, motor_torque):
    """Return the torque [Nm] applied to this clutch while its slip is constant, and whether it is known: the other is open."""
    known = other.age <= pair.patience and other.tick >= 0 and other.estimate == 0.0
    input_acceleration = pair.ratio / (pair.ratio - pair.other_ratio) * other.acceleration  # w_in' with s' = 0
    return motor_torque - settings.model.motor_inertia * input_acceleration, known


@njit
def pair_mismatch(other, pair, settings, estimate, capacity, sticks, sample):
    """Return motor torque minus inertia torque minus the torques of both clutches [Nm].

    It is 0 when friction levels within their bounds explain the difference, and without a valid status of the other.
    `settings`: TORQUE_SETTINGS; `estimate`, `capacity` [Nm] of this clutch, and whether it `sticks`; `sample`: SAMPLE.
    """
    if other.age > pair.patience or other.tick < 0:
        return 0.0
    ratio = pair.ratio - pair.other_ratio
    input_acceleration = (pair.ratio * other.acceleration - pair.other_ratio * sample.acceleration) / ratio  # w_in'
    both = sample.motor_torque - settings.model.motor_inertia * input_acceleration  # M + M_o
    own, its = capacity if sticks else estimate, other.estimate
    least, most = settings.adaptation.level_low, settings.adaptation.level_high
    touch = settings.touch_torque
    if both > _highest_torque(own, sticks, least, most) + _highest_torque(its, other.sticks, least, most) + touch:
        return both - _highest_torque(own, sticks, 1.0, 1.0) - _highest_torque(its, other.sticks, 1.0, 1.0)
    if both < -_highest_torque(-own, sticks, least, most) - _highest_torque(-its, other.sticks, least, most) - touch:
        return both + _highest_torque(-own, sticks, 1.0, 1.0) + _highest_torque(-its, other.sticks, 1.0, 1.0)
    return 0.0


@njit
def _highest_torque(torque, sticks, least, most):
    """Return the highest torque [Nm] of a clutch with friction levels `least`..`most`.

    `torque` [Nm] is its estimate, or its capacity if it `sticks`, at friction level 1.
    """
    return most * abs(torque) if sticks else max(least * torque, most * torque)
