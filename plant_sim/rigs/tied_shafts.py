"""Torques of clutches that stick, or nearly do, between the shafts of the power-shift rig.

Equation        shafts as in `power_shift`. One clutch k, with the torque M_o of the other one given:
                J_k ds_k/dt = D_k - M_k,  1/J_k = 1/J_m + i_k^2/J_v,
                D_k = J_k ((M_m - M_o)/J_m - i_k (i_o M_o - T_road)/J_v),  so that `standstill` applies as to one clutch
    k sticks    M_k = D_k, less what brings s_k to 0 in the step. The other one then has
                D = (i_k M_m - T_road)/(i_k - i_o),  J = (J_v + i_k^2 J_m)/(i_k - i_o)^2
    both stick  both shafts stand still: M_a + M_b = M_m, and the road takes i_a M_a + i_b M_b, at most its level
Assumptions     both stick: a range of M_a is possible. They carry in proportion to their capacities as far as it allows
Not modelled    as in `power_shift`

`d`: parameters of the driveline; `h`: step [s]; with h = 0 the torques are the present ones.
"""

from typing import NamedTuple

import numpy as np
from numba import njit

from plant_sim.rigs.standstill import hold, step_near_standstill, torque_capacity


class Shafts(NamedTuple):
    """Motor torque [Nm], speeds of input and output shaft at the start of a step [rad/s], inertia J_m [kg m^2]."""

    motor: float
    input_speed: float
    output_speed: float
    inertia: float


class Standing(NamedTuple):
    """A clutch at the start of a step.

    `rests`: its slip is at or near zero. Then state m, slip [rad/s], torque [Nm] if it slides, friction pressure [Pa],
    viscosity ratio [-], gear ratio [-].
    """

    rests: bool
    m: float
    begin: float
    torque: float
    pressure: float
    viscosity: float
    ratio: float


@njit(inline="always")
def _stopping_torque(speed, inertia, h):
    """Return the torque [Nm] that brings a shaft to rest within the step; infinite with h = 0, unless the shaft is at rest."""
    if h > 0.0:
        return inertia * speed / h
    return 0.0 if speed == 0.0 else np.inf * speed


@njit(inline="always")
def road_torque(speed, output, d, h):
    """Return the torque of road and air on the output shaft [Nm].

    `speed` of the shaft [rad/s], driving torque `output` [Nm].
    """
    other = d.grade + d.drag * abs(speed) * speed
    stopping = output - other + _stopping_torque(speed, d.inertia, h)  # would bring the vehicle to rest within the step
    return other + min(max(stopping, -d.rolling), d.rolling)


@njit(error_model="numpy")
def tied_torque(shafts, other, ratio, other_ratio, d, h):
    """Return the torque [Nm] of a clutch that sticks at the end of the step, and of the road.

    `other`: torque of the other clutch [Nm].
    """
    brought = shafts.motor - other + _stopping_torque(shafts.input_speed, shafts.inertia, h)  # both shafts to rest
    road = road_torque(shafts.output_speed, ratio * brought + other_ratio * other, d, h)
    drive, inertia = free_drive(shafts, other, road, ratio, other_ratio, d)
    begin = shafts.input_speed - ratio * shafts.output_speed
    return drive + (inertia * begin / h if h > 0.0 else 0.0), road


@njit(inline="always")
def free_drive(shafts, other, road, ratio, other_ratio, d):
    """Return the torque D_k [Nm] that drives the slip of a clutch, and the inertia J_k [kg m^2] that it accelerates."""
    inertia = 1.0 / (1.0 / shafts.inertia + ratio * ratio / d.inertia)
    push = (shafts.motor - other) / shafts.inertia - ratio * (other_ratio * other - road) / d.inertia
    return inertia * push, inertia


@njit(error_model="numpy")
def hold_both(shafts, low_a, high_a, low_b, high_b, d, h):
    """Return the torques of a and b [Nm], and whether both clutches hold the shafts at rest at the end of the step."""
    together = shafts.motor + _stopping_torque(shafts.input_speed, shafts.inertia, h)
    if low_a >= high_a or low_b >= high_b or not abs(together) < np.inf:
        return 0.0, 0.0, False
    first, last = max(low_a, together - high_b), min(high_a, together - low_b)
    speed = shafts.output_speed
    other = d.grade + d.drag * abs(speed) * speed - _stopping_torque(speed, d.inertia, h) - d.ratio_b * together
    span = d.ratio_a - d.ratio_b
    if span == 0.0:
        if abs(other) > d.rolling:
            return 0.0, 0.0, False
    else:
        one, two = (other - d.rolling) / span, (other + d.rolling) / span
        first, last = max(first, min(one, two)), min(last, max(one, two))
    if not first <= last:
        return 0.0, 0.0, False
    even = (low_a * (high_b - low_b) + (together - low_b) * (high_a - low_a)) / (high_a - low_a + high_b - low_b)
    torque = min(max(even, first), last)
    return torque, together - torque, True


@njit(error_model="numpy")
def step_at_standstill(shafts, one, two, d, s1, c1, e1, s2, c2, e2, h):
    """Return how each clutch passes the step, and the torques of both [Nm] if both stick.

    For each clutch: (state m to slide with, slip to slide at, whether it sticks). A clutch that does not rest keeps its torque.
    Changes no state.
    """
    first, second = (one.m, one.begin, False), (two.m, two.begin, False)
    if not two.rests:
        first, _ = _step_given_other(shafts, one, two.torque, two.ratio, d, s1, c1, e1, h)
    elif not one.rests:
        second, _ = _step_given_other(shafts, two, one.torque, one.ratio, d, s2, c2, e2, h)
    else:
        low_1, high_1 = torque_capacity(one.pressure, one.viscosity, s1, c1, e1)
        low_2, high_2 = torque_capacity(two.pressure, two.viscosity, s2, c2, e2)
        torque_1, torque_2, both = hold_both(shafts, low_1, high_1, low_2, high_2, d, h)
        if both:
            share_1, share_2 = hold(one.m, torque_1, low_1, high_1)[0], hold(two.m, torque_2, low_2, high_2)[0]
            return (share_1, 0.0, True), (share_2, 0.0, True), (torque_1, torque_2)
        second, torque_2 = _step_beside_stuck(shafts, two, one.ratio, d, s2, c2, e2, h)
        first, torque_1 = _step_given_other(shafts, one, torque_2, two.ratio, d, s1, c1, e1, h)
        if not first[2]:
            beside, torque = _step_beside_stuck(shafts, one, two.ratio, d, s1, c1, e1, h)
            second, _ = _step_given_other(shafts, two, torque, one.ratio, d, s2, c2, e2, h)
            if second[2]:
                first = beside
            else:  # both slide
                second, _ = _step_given_other(shafts, two, torque_1, one.ratio, d, s2, c2, e2, h)
        if first[2] and second[2]:  # both cannot carry the torque: one of them slides from its present state
            second = (second[0], 0.0, False)
    return first, second, (0.0, 0.0)


@njit(error_model="numpy")
def _step_given_other(shafts, own, other, other_ratio, d, s, c, e, h):
    """Return the result of `step_near_standstill` for a clutch, and its torque [Nm].

    `other`: torque of the other clutch [Nm].
    """
    _, road = tied_torque(shafts, other, own.ratio, other_ratio, d, h)
    drive, inertia = free_drive(shafts, other, road, own.ratio, other_ratio, d)
    went = step_near_standstill(own.m, own.begin, drive, inertia, own.pressure, own.viscosity, s, c, e, h)
    return went, drive - inertia * (went[1] - own.begin) / h


@njit(error_model="numpy")
def _step_beside_stuck(shafts, own, stuck_ratio, d, s, c, e, h):
    """Return the result of `step_near_standstill` for a clutch, and its torque [Nm], while the other one sticks."""
    drive, inertia = _tied_drive(shafts, own.ratio, stuck_ratio, d, h)
    went = step_near_standstill(own.m, own.begin, drive, inertia, own.pressure, own.viscosity, s, c, e, h)
    return went, drive - inertia * (went[1] - own.begin) / h


@njit(inline="always")
def _tied_drive(shafts, ratio, stuck_ratio, d, h):
    """Return the torque [Nm] that drives the slip of a clutch, and the inertia [kg m^2] that it accelerates.

    The other clutch sticks.
    """
    span = stuck_ratio - ratio
    road = road_torque(shafts.output_speed, stuck_ratio * shafts.motor, d, h)
    if span == 0.0:
        return shafts.motor, shafts.inertia
    return (stuck_ratio * shafts.motor - road) / span, (d.inertia + stuck_ratio * stuck_ratio * shafts.inertia) / (
        span * span
    )


@njit(inline="always")
def stuck_torques(shafts, torque_a, torque_b, sticks_a, sticks_b, torques, d, h):
    """Return the torques of both clutches [Nm]. A sticking clutch has the torque that keeps it sticking.

    `torques`: result if both stick.
    """
    if sticks_a and sticks_b:
        return torques
    if sticks_a:
        torque_a, _ = tied_torque(shafts, torque_b, d.ratio_a, d.ratio_b, d, h)
    elif sticks_b:
        torque_b, _ = tied_torque(shafts, torque_a, d.ratio_b, d.ratio_a, d, h)
    return torque_a, torque_b


@njit(error_model="numpy")
def present_torques(shafts, rests_a, rests_b, ends_a, ends_b, d):
    """Return the present torques of both clutches [Nm].

    rests: whether each has zero slip. ends: lower and upper limit of the torque of each [Nm]; where it slides, both
    are its torque.
    """
    (low_a, high_a), (low_b, high_b) = ends_a, ends_b
    if rests_a and rests_b:
        torque_a, torque_b, both = hold_both(shafts, low_a, high_a, low_b, high_b, d, 0.0)
        if both:
            return torque_a, torque_b
        drive, _ = _tied_drive(shafts, d.ratio_b, d.ratio_a, d, 0.0)
        torque_b = min(max(drive, low_b), high_b)
        torque_a, _ = tied_torque(shafts, torque_b, d.ratio_a, d.ratio_b, d, 0.0)
        if low_a <= torque_a <= high_a:
            return torque_a, torque_b
        drive, _ = _tied_drive(shafts, d.ratio_a, d.ratio_b, d, 0.0)
        rests_a, low_a = False, min(max(drive, low_a), high_a)
    if rests_a:
        torque_a, _ = tied_torque(shafts, low_b, d.ratio_a, d.ratio_b, d, 0.0)
        return min(max(torque_a, low_a), high_a), low_b
    torque_b, _ = tied_torque(shafts, low_a, d.ratio_b, d.ratio_a, d, 0.0)
    return low_a, min(max(torque_b, low_b), high_b)
