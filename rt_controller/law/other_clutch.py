"""The other clutch of a power shift, as its frames tell of it, and the torque balance of both.

Equation        slip of each s = w_in - i w_out, i its ratio: so w_in' = (i s_o' - i_o s')/(i - i_o), with o the other clutch
                M + M_o = M_m - J w_in';  a clutch that slides transmits its estimate, at a friction level within the bounds of
                the adaptation; one that sticks anything up to its capacity either way
Assumptions     the other's estimate is as old as its last CONTROLLER_STATUS, 0.1 s: torques are handed over slower than that
Not modelled    which of the two is wrong: both controllers find it
References      docs/rig.md, 8 for one clutch; Janssens 2010, fig 6.1
"""

from typing import Any

import numpy as np
from numba import njit

from protocols.can.words import count_rise, count_turn, raw
from rt_controller.law.record import floats, record
from rt_controller.law.slip import observe

# Ratios [-] of this clutch and of the other; for how long [s] a status is believed
PAIR_SETTINGS = floats("ratio", "other_ratio", "patience")
# Encoder count (unwrapped), tick of it, -1 before the first; angle [rad], slip [rad/s], acceleration [rad/s^2] of the observer;
# estimate [Nm] and whether the plates stick, heeded `age` [s] ago; said_...: the newest, not heeded yet
OTHER = np.dtype(
    [("count", "i8"), ("tick", "i8"), ("angle", "f8"), ("slip", "f8"), ("acceleration", "f8"), ("estimate", "f8"),
     ("sticks", "?"), ("age", "f8"), ("new_estimate", "f8"), ("new_sticks", "?"), ("is_new", "?")]
)  # fmt: skip


def initial_other() -> Any:
    """OTHER before it has been heard."""
    return record(OTHER, tick=-1, age=np.inf)


@njit
def take_other_encoder(other, word, encoder, period, bandwidth):
    """Take the payload `word` of the other's ENCODER; arguments as of `sample.take_encoder`."""
    tick = raw(word, encoder.sample_tick)
    other.count += count_turn(raw(word, encoder.shaft_angle), other.count, encoder.shaft_angle)
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
    """Take what the other's CONTROLLER_STATUS says: estimate [Nm], whether its plates stick."""
    other.new_estimate, other.new_sticks, other.is_new = estimate, sticks, True


@njit
def use_newest_status(other):
    """Believe the newest status from now on. Once between two statuses: so it does not matter in which cycle one came."""
    if other.is_new:
        other.estimate, other.sticks, other.is_new, other.age = other.new_estimate, other.new_sticks, False, 0.0


@njit
def applied_alone(other, pair, settings, motor_torque):
    """Torque [Nm] applied to this clutch while its slip is constant, and whether it is known: whether the other is open."""
    known = other.age <= pair.patience and other.tick >= 0 and other.estimate == 0.0
    input_acceleration = pair.ratio / (pair.ratio - pair.other_ratio) * other.acceleration
    return motor_torque - settings.model.motor_inertia * input_acceleration, known


@njit
def pair_mismatch(other, pair, settings, estimate, capacity, sticks, sample):
    """Motor torque less inertia less both clutches' [Nm]; 0 where friction levels within bounds explain it, or it is unheard.

    `settings`: TORQUE_SETTINGS; `estimate`, `capacity` [Nm] of this clutch, and whether it `sticks`.
    """
    if other.age > pair.patience or other.tick < 0:
        return 0.0
    ratio = pair.ratio - pair.other_ratio
    input_acceleration = (pair.ratio * other.acceleration - pair.other_ratio * sample.acceleration) / ratio
    both = sample.motor_torque - settings.model.motor_inertia * input_acceleration
    own, its = capacity if sticks else estimate, other.estimate
    least, most = settings.adaptation.level_low, settings.adaptation.level_high
    touch = settings.touch_torque
    if both > _end(own, sticks, least, most) + _end(its, other.sticks, least, most) + touch:
        return both - _end(own, sticks, 1.0, 1.0) - _end(its, other.sticks, 1.0, 1.0)
    if both < -_end(-own, sticks, least, most) - _end(-its, other.sticks, least, most) - touch:
        return both + _end(-own, sticks, 1.0, 1.0) + _end(-its, other.sticks, 1.0, 1.0)
    return 0.0


@njit
def _end(torque, sticks, least, most):
    """The most [Nm] that a clutch transmits, whose estimate, or capacity where it `sticks`, is `torque` at friction level 1."""
    return most * abs(torque) if sticks else max(least * torque, most * torque)
