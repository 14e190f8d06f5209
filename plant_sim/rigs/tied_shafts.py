"""What clutches carry that stick, or nearly do, between the shafts of the power-shift rig.

Equation        shafts as in `power_shift`. One clutch k, the torque M_o of the other given:
                J_k ds_k/dt = D_k - M_k,  1/J_k = 1/J_m + i_k^2/J_v,
                D_k = J_k ((M_m - M_o)/J_m - i_k (i_o M_o - T_road)/J_v),  so that `standstill` holds as on one clutch
    k sticks    M_k = D_k, less what brings s_k to 0 in the step. The other one then has
                D = (i_k M_m - T_road)/(i_k - i_o),  J = (J_v + i_k^2 J_m)/(i_k - i_o)^2
    both stick  both shafts stand: M_a + M_b = M_m, and the road takes i_a M_a + i_b M_b, at most its level
Assumptions     both stuck, a range of M_a will do: they carry in proportion to their capacities as far as it allows
Not modelled    what `power_shift` does not

`d` are the driveline's parameters, `h` [s] the step; with h = 0 the torques are those of now.
"""

from typing import NamedTuple

import numpy as np
from numba import njit

from plant_sim.rigs.standstill import capacity, held, near_standstill


class Shafts(NamedTuple):
    """What acts on the shafts in a step: motor torque [Nm], speeds at its beginning [rad/s], inertia J_m [kg m^2]."""

    motor: float
    input_speed: float
    output_speed: float
    inertia: float


class Standing(NamedTuple):
    """A clutch at the beginning of a step: whether it `rests` or nearly does, its state m, slip [rad/s], torque [Nm] if it
    slides, friction pressure [Pa], viscosity ratio, gear ratio."""

    rests: bool
    m: float
    begin: float
    torque: float
    pressure: float
    viscosity: float
    ratio: float


@njit(inline="always")
def _stopping(speed, inertia, h):
    """Torque [Nm] that brings a shaft to rest within the step; with h = 0 none does, unless it is at rest."""
    if h > 0.0:
        return inertia * speed / h
    return 0.0 if speed == 0.0 else np.inf * speed


@njit(inline="always")
def road_torque(speed, output, d, h):
    """Torque of road and air about the output shaft [Nm] at its `speed` [rad/s] and driving torque `output` [Nm]."""
    other = d.grade + d.drag * abs(speed) * speed
    stopping = output - other + _stopping(speed, d.inertia, h)  # would bring the vehicle to rest within the step
    return other + min(max(stopping, -d.rolling), d.rolling)


@njit(error_model="numpy")
def tied(shafts, other, ratio, other_ratio, d, h):
    """Torque of a clutch that sticks at the end of the step, the other one's torque given, and the road's."""
    brought = shafts.motor - other + _stopping(shafts.input_speed, shafts.inertia, h)  # both shafts to rest
    road = road_torque(shafts.output_speed, ratio * brought + other_ratio * other, d, h)
    drive, inertia = alone(shafts, other, road, ratio, other_ratio, d)
    begin = shafts.input_speed - ratio * shafts.output_speed
    return drive + (inertia * begin / h if h > 0.0 else 0.0), road


@njit(inline="always")
def alone(shafts, other, road, ratio, other_ratio, d):
    """What drives the slip of a clutch, D_k [Nm], and what it accelerates, J_k [kg m^2]."""
    inertia = 1.0 / (1.0 / shafts.inertia + ratio * ratio / d.inertia)
    push = (shafts.motor - other) / shafts.inertia - ratio * (other_ratio * other - road) / d.inertia
    return inertia * push, inertia


@njit(error_model="numpy")
def both_stuck(shafts, low_a, high_a, low_b, high_b, d, h):
    """Torque of a, that of b, and whether both hold all that acts on the shafts at the end of the step: at rest."""
    together = shafts.motor + _stopping(shafts.input_speed, shafts.inertia, h)
    if low_a >= high_a or low_b >= high_b or not abs(together) < np.inf:
        return 0.0, 0.0, False
    first, last = max(low_a, together - high_b), min(high_a, together - low_b)
    speed = shafts.output_speed
    other = d.grade + d.drag * abs(speed) * speed - _stopping(speed, d.inertia, h) - d.ratio_b * together
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
def stand(shafts, one, two, d, s1, c1, e1, s2, c2, e2, h):
    """How each clutch goes through the step, as (state m to slide with, slip to slide at, whether it sticks), and the torques
    of both where both stick. A clutch that does not rest keeps its torque. Moves no state."""
    first, second = (one.m, one.begin, False), (two.m, two.begin, False)
    if not two.rests:
        first, _ = _given(shafts, one, two.torque, two.ratio, d, s1, c1, e1, h)
    elif not one.rests:
        second, _ = _given(shafts, two, one.torque, one.ratio, d, s2, c2, e2, h)
    else:
        low_1, high_1 = capacity(one.pressure, one.viscosity, s1, c1, e1)
        low_2, high_2 = capacity(two.pressure, two.viscosity, s2, c2, e2)
        torque_1, torque_2, both = both_stuck(shafts, low_1, high_1, low_2, high_2, d, h)
        if both:
            share_1, share_2 = held(one.m, torque_1, low_1, high_1)[0], held(two.m, torque_2, low_2, high_2)[0]
            return (share_1, 0.0, True), (share_2, 0.0, True), (torque_1, torque_2)
        second, torque_2 = _beside(shafts, two, one.ratio, d, s2, c2, e2, h)
        first, torque_1 = _given(shafts, one, torque_2, two.ratio, d, s1, c1, e1, h)
        if not first[2]:
            beside, torque = _beside(shafts, one, two.ratio, d, s1, c1, e1, h)
            second, _ = _given(shafts, two, torque, one.ratio, d, s2, c2, e2, h)
            if second[2]:
                first = beside
            else:  # both slide
                second, _ = _given(shafts, two, torque_1, one.ratio, d, s2, c2, e2, h)
        if first[2] and second[2]:  # what both cannot bear: one of them is left to slide from where it is
            second = (second[0], 0.0, False)
    return first, second, (0.0, 0.0)


@njit(error_model="numpy")
def _given(shafts, own, other, other_ratio, d, s, c, e, h):
    """How a clutch goes through the step, and its torque [Nm], the torque `other` [Nm] of the other one given."""
    _, road = tied(shafts, other, own.ratio, other_ratio, d, h)
    drive, inertia = alone(shafts, other, road, own.ratio, other_ratio, d)
    went = near_standstill(own.m, own.begin, drive, inertia, own.pressure, own.viscosity, s, c, e, h)
    return went, drive - inertia * (went[1] - own.begin) / h


@njit(error_model="numpy")
def _beside(shafts, own, stuck_ratio, d, s, c, e, h):
    """How a clutch goes through the step, and its torque [Nm], while the other one sticks."""
    drive, inertia = _tied_drive(shafts, own.ratio, stuck_ratio, d, h)
    went = near_standstill(own.m, own.begin, drive, inertia, own.pressure, own.viscosity, s, c, e, h)
    return went, drive - inertia * (went[1] - own.begin) / h


@njit(inline="always")
def _tied_drive(shafts, ratio, stuck_ratio, d, h):
    """What drives the slip of a clutch [Nm], and what it accelerates [kg m^2], while the other one sticks."""
    span = stuck_ratio - ratio
    road = road_torque(shafts.output_speed, stuck_ratio * shafts.motor, d, h)
    if span == 0.0:
        return shafts.motor, shafts.inertia
    return (stuck_ratio * shafts.motor - road) / span, (d.inertia + stuck_ratio * stuck_ratio * shafts.inertia) / (
        span * span
    )


@njit(inline="always")
def stuck(shafts, torque_a, torque_b, sticks_a, sticks_b, torques, d, h):
    """Torques of both clutches [Nm]: of one that sticks what keeps it so, `torques` where both do."""
    if sticks_a and sticks_b:
        return torques
    if sticks_a:
        torque_a, _ = tied(shafts, torque_b, d.ratio_a, d.ratio_b, d, h)
    elif sticks_b:
        torque_b, _ = tied(shafts, torque_a, d.ratio_b, d.ratio_a, d, h)
    return torque_a, torque_b


@njit(error_model="numpy")
def now(shafts, rests_a, rests_b, ends_a, ends_b, d):
    """Torques of both clutches [Nm] at this moment. `rests`: at zero slip; `ends` of its capacity, or twice the torque."""
    (low_a, high_a), (low_b, high_b) = ends_a, ends_b
    if rests_a and rests_b:
        torque_a, torque_b, both = both_stuck(shafts, low_a, high_a, low_b, high_b, d, 0.0)
        if both:
            return torque_a, torque_b
        drive, _ = _tied_drive(shafts, d.ratio_b, d.ratio_a, d, 0.0)
        torque_b = min(max(drive, low_b), high_b)
        torque_a, _ = tied(shafts, torque_b, d.ratio_a, d.ratio_b, d, 0.0)
        if low_a <= torque_a <= high_a:
            return torque_a, torque_b
        drive, _ = _tied_drive(shafts, d.ratio_a, d.ratio_b, d, 0.0)
        rests_a, low_a = False, min(max(drive, low_a), high_a)
    if rests_a:
        torque_a, _ = tied(shafts, low_b, d.ratio_a, d.ratio_b, d, 0.0)
        return min(max(torque_a, low_a), high_a), low_b
    torque_b, _ = tied(shafts, low_a, d.ratio_b, d.ratio_a, d, 0.0)
    return low_a, min(max(torque_b, low_b), high_b)
