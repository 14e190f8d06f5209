"""The truth's plates: friction by docs/rig.md, eq. 4 to 6, with the laws of the effects, and standstill.

Equation        slide   m' = sign(omega) C (1 - m/s_n), M = M_C m + C_v r_T sign(omega) |omega|^(1/3), changed by effects
                stick   omega = 0, M = applied torque, while that lies between the torques at m = -1 and m = 1 (Karnopp 1985)
                break-away starts with m = -1 or 1. A slip that reaches zero keeps m. The plates stick there only if
                eq. 6.9 brings the friction to the applied torque within LANDING_TIME; else the slip reverses
Assumptions     |omega|^(1/3) is rounded below 1 mrad/s, because its slope is infinite at 0
Not modelled    elastic plates. With the effect `presliding`, or `standstill.lag` other than 0, plates never stick rigidly:
                sign(omega) is rounded below 1 mrad/s and eq. 6.9 holds at all speeds
References      Karnopp 1985, J. Dyn. Syst. Meas. Control 107 (stick as a mode of its own); Janssens 2010, eq. 6.9

`slide_direction`: -1 or 1 while plates slide, 0 while they stick. `y`: states; `c`: parameters; `e`, `f`, `v`: strength, form
(-1..1) and law (0 or 1) of each effect, by its name.
"""

from math import exp, sqrt

from numba import njit

from benchmarks.battery import truth_clutch as clutch
from benchmarks.battery.truth_states import (
    ANGLE,
    BENT,
    FILM,
    HEAT_1,
    HEAT_2,
    HEAT_3,
    KELVIN,
    LOAD_1,
    LOAD_2,
    M_SLOW,
    SLIP,
    WORK,
    M,
    X,
)

BAR = 1e5  # Pa
# rad/s; chosen: a fortieth of one encoder count per sample. Five times as much for the plate behind a spring, which is lighter.
ROUNDING_SPEED = 1e-3
LANDING_TIME = 1.25e-4  # s; chosen: one integration step, in which m moves by less than 2 %


@njit(error_model="numpy")
def sticks_rigidly(c, e):
    """Return whether plates without slip stick rigidly; else friction builds up by eq. 6.9 at standstill too."""
    return c.standstill_lag == 0.0 and e.presliding == 0.0


@njit(error_model="numpy")
def has_spring(e):
    """Return whether there is a spring between motor and plate."""
    return e.shaft_compliance != 0.0 or e.backlash != 0.0


@njit(error_model="numpy")
def friction_torque(y, force, slide_direction, time, burst, c, e, f, v, dy):
    """Return the friction torque [Nm] of plates that slide under the normal force `force` [N].

    Writes the rates of its states to `dy`.
    """
    kelvin, slip = y[KELVIN], y[SLIP]
    resting = 5.0 * ROUNDING_SPEED if has_spring(e) else ROUNDING_SPEED
    speed_squared = slip * slip + resting * resting
    torque, direction = 0.0, slide_direction if sticks_rigidly(c, e) else slip / sqrt(speed_squared)
    pressure = force / c.piston_area
    if force > 0.0:
        if e.hydrodynamic_lift != 0.0:  # unknown: grooves pump oil under the lining, which lifts it
            pressure = max(pressure - e.hydrodynamic_lift * slip * slip, 0.0)
        if e.friction_lag != 0.0 and v.friction_lag != 0.0:
            # second law: asperities creep under load, two lags of 3 ms a unit (the catalogue: M_C behind one lag)
            dy[LOAD_1] = (pressure - y[LOAD_1]) / (3e-3 * e.friction_lag)
            dy[LOAD_2] = (y[LOAD_1] - y[LOAD_2]) / (3e-3 * e.friction_lag)
            pressure = y[LOAD_2]
        friction_pressure = c.piston_contact_pressure + pressure
        coulomb = max(0.0, c.clutch_coulomb_slope * friction_pressure + c.clutch_coulomb_intercept)
        viscous = max(0.0, c.clutch_viscous_slope * friction_pressure + c.clutch_viscous_intercept)
        beta = c.clutch_beta_inf
        beta = min(1.0, beta + (1.0 - beta) * exp(-(friction_pressure - c.clutch_beta_onset) / c.clutch_beta_scale))
        ratio = 1.0
        if slip != 0.0:
            ratio += (beta - 1.0) * exp(-c.clutch_stribeck_speed / abs(slip))
        ratio = clutch.stribeck_ratio(ratio, beta, slip, c, e, v)
        coulomb = clutch.coulomb_torque(coulomb, pressure, kelvin, c, e, v)
        attraction = c.clutch_attraction
        aim, sliding = direction, abs(direction)
        if e.presliding != 0.0:
            # first law: LuGre bristles whose level keeps the lag (Canudas de Wit et al. 1995); second: Dahl 1968, half
            # exponent, in series with the lag. The catalogue: four Maxwell-slip elements. Strength: angle of break-away
            rate = slip / max(0.5 * e.presliding, 5e-4 * abs(slip))  # bristles take half a millisecond at least
            if v.presliding == 0.0:
                dy[BENT] = rate - abs(rate) * y[BENT]
            else:
                along = y[BENT] * direction
                dy[BENT] = rate * sqrt(max(1.0 - along, 0.0)) if along > 0.0 else rate
            aim, sliding = y[BENT], 1.0  # bristles that are bent hold their torque at rest
        dy[M] = attraction * (aim - y[M] * sliding / ratio)
        m = y[M]
        if e.friction_lag != 0.0 and v.friction_lag == 0.0:
            # first law: 60 % of the asperities follow more slowly, spread rates (the catalogue: one slower rate)
            dy[M_SLOW] = attraction / (1.0 + e.friction_lag) * (aim - y[M_SLOW] * sliding / ratio)
            m = 0.4 * m + 0.6 * y[M_SLOW]
        coulomb_factor, viscous_factor = clutch.fade_factors(coulomb * m, y[HEAT_1], y[HEAT_2], y[HEAT_3], e, v)
        coulomb_part = coulomb * m * coulomb_factor
        if e.direction_asymmetry != 0.0 and v.direction_asymmetry == 0.0:
            coulomb_part = clutch.asymmetric_friction(coulomb_part, m, e, v)
        root = slip * speed_squared ** (0.5 * (c.clutch_viscous_exponent - 1.0))
        torque = coulomb_part + viscous_factor * viscous * clutch.viscosity_ratio(kelvin, c) * root
        if e.direction_asymmetry != 0.0 and v.direction_asymmetry != 0.0:
            torque = clutch.asymmetric_friction(torque, slip, e, v)
        if e.squeeze_film != 0.0:
            # squeezed out by Reynolds' equation, 0.1 bar s times 2^form a unit; it returns within 0.1 s of parting
            dy[FILM] = pressure / (0.1 * 2.0**f.squeeze_film * BAR * clutch.relative_viscosity(kelvin))
            torque *= clutch.asperity_load_share(y[FILM], e, v)
        if e.friction_level != 0.0:
            torque *= clutch.friction_level_factor(time, y[WORK], e, v)
        if e.shaft_angle_ripple != 0.0:
            torque *= 1.0 + e.shaft_angle_ripple * clutch.ripple_wave(
                y[ANGLE], clutch.ripple_order(f.shaft_angle_ripple, 1.0, 4.0), v.shaft_angle_ripple
            )
        if e.torque_bursts != 0.0:  # unknown: the lining chatters now and then, bursts at random
            torque += e.torque_bursts * burst * direction
    elif e.squeeze_film != 0.0:
        dy[FILM] = -y[FILM] / 0.1
    if e.position_ripple != 0.0:
        torque += e.position_ripple * clutch.ripple_wave(
            y[ANGLE], clutch.ripple_order(f.position_ripple, 3.0, 10.0), v.position_ripple
        )
    return torque + clutch.drag_torque(slip, y[X], pressure, kelvin, c, e, v)


@njit(error_model="numpy")
def _torque_at_rest(y, force, end, share, time, burst, c, e, f, v, work):
    """Return the friction torque [Nm] at zero slip, with the friction state moved towards `end` (-1 or 1).

    share: part of the present distance between friction state and `end` that remains.
    """
    states_at_rest = work[3]
    states_at_rest[:] = y
    states_at_rest[SLIP] = 0.0
    for state in (M, M_SLOW):
        states_at_rest[state] = end + (y[state] - end) * share
    return friction_torque(states_at_rest, force, end, time, burst, c, e, f, v, work[4])


@njit(error_model="numpy")
def sticking_margin(y, applied, force, time, burst, c, e, f, v, work):
    """Return the margin [Nm] between the `applied` torque and the nearer limit of sticking plates.

    It is negative beyond the limit.
    """
    low = _torque_at_rest(y, force, -1.0, 0.0, time, burst, c, e, f, v, work)
    high = _torque_at_rest(y, force, 1.0, 0.0, time, burst, c, e, f, v, work)
    return min(applied - low, high - applied)


@njit(error_model="numpy")
def break_away(y, applied, force, time, burst, c, e, f, v, work):
    """Begin to slide under the `applied` torque [Nm]: return the direction and set the friction state to it."""
    low = _torque_at_rest(y, force, -1.0, 0.0, time, burst, c, e, f, v, work)
    high = _torque_at_rest(y, force, 1.0, 0.0, time, burst, c, e, f, v, work)
    slide_direction = 1.0 if applied - low > high - applied else -1.0
    y[M] = y[M_SLOW] = slide_direction
    return slide_direction


@njit(error_model="numpy")
def direction_after_stop(y, applied, force, time, burst, c, e, f, v, work):
    """Return the direction of sliding after the slip has become zero under the `applied` torque [Nm]; 0 if the plates stick."""
    share = exp(-c.clutch_attraction * LANDING_TIME)
    low = _torque_at_rest(y, force, -1.0, share, time, burst, c, e, f, v, work)
    high = _torque_at_rest(y, force, 1.0, share, time, burst, c, e, f, v, work)
    if low <= applied <= high:
        return 0.0
    return 1.0 if applied > high else -1.0
