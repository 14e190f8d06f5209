"""The truth's plates: friction of rig.md 4 to 6 with its laws, and what they do at standstill.

Equation        slide   m' = sign(omega) C (1 - m/s_n), M = M_C m + C_v r_T sign(omega) |omega|^(1/3), and what effects do to it
                stick   omega = 0, M = what is applied, while that is within what they carry with m = -1 .. 1 (Karnopp 1985)
                slip from standstill begins with m = +-1. Plates that turn keep m: they pass omega = 0, as often as they must,
                and stay there once eq. 6.9 takes the friction to what is applied within `LANDS`
Assumptions     below 1 mrad/s |omega|^(1/3) is rounded: its slope is infinite at 0
Not modelled    a spring of the plates: with `presliding` they have one and never stick rigidly. There, and in a rig whose
                `standstill.lag` is not 0, sign(omega) is rounded below 1 mrad/s too, and all is eq. 6.9: rig.md 5 to the letter
References      Karnopp 1985, J. Dyn. Syst. Meas. Control 107 (stick as a mode of its own); Janssens 2010, eq. 6.9

`way` is the direction of sliding, -1 or 1, 0 where plates stick; other names as in `truth_clutch`.
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
# rad/s, a fortieth of a count of the encoder in a sample; five times that for the lighter plate behind a spring
RESTING = 1e-3
LANDS = 1.25e-4  # s, a step: m moves by less than 2 %


@njit(error_model="numpy")
def rigid(c, e):
    """Whether plates without slip stick rigidly."""
    return c.standstill_lag == 0.0 and e.presliding == 0.0


@njit(error_model="numpy")
def sprung(e):
    """Whether a spring is between motor and plate."""
    return e.shaft_compliance != 0.0 or e.backlash != 0.0


@njit(error_model="numpy")
def friction(y, force, way, time, burst, c, e, f, v, dy):
    """Torque [Nm] of plates that slide, pressed by `force` [N]; sets what belongs to it of the rates `dy`."""
    kelvin, slip = y[KELVIN], y[SLIP]
    resting = 5.0 * RESTING if sprung(e) else RESTING
    speed_squared = slip * slip + resting * resting
    torque, direction = 0.0, way if rigid(c, e) else slip / sqrt(speed_squared)
    pressed = force / c.piston_area
    if force > 0.0:
        if e.hydrodynamic_lift != 0.0:  # unknown: grooves pump oil under the lining, which lifts it
            pressed = max(pressed - e.hydrodynamic_lift * slip * slip, 0.0)
        if e.friction_lag != 0.0 and v.friction_lag != 0.0:
            # second law: asperities creep under load, two lags of 3 ms a unit (the catalogue: M_C behind one lag)
            dy[LOAD_1] = (pressed - y[LOAD_1]) / (3e-3 * e.friction_lag)
            dy[LOAD_2] = (y[LOAD_1] - y[LOAD_2]) / (3e-3 * e.friction_lag)
            pressed = y[LOAD_2]
        star = c.piston_contact_pressure + pressed
        coulomb = max(0.0, c.clutch_coulomb_slope * star + c.clutch_coulomb_intercept)
        viscous = max(0.0, c.clutch_viscous_slope * star + c.clutch_viscous_intercept)
        beta = c.clutch_beta_inf
        beta = min(1.0, beta + (1.0 - beta) * exp(-(star - c.clutch_beta_onset) / c.clutch_beta_scale))
        ratio = 1.0
        if slip != 0.0:
            ratio += (beta - 1.0) * exp(-c.clutch_stribeck_speed / abs(slip))
        ratio = clutch.fallen(ratio, beta, slip, c, e, v)
        coulomb = clutch.coulomb(coulomb, pressed, kelvin, c, e, v)
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
        coulomb_factor, viscous_factor = clutch.faded(coulomb * m, y[HEAT_1], y[HEAT_2], y[HEAT_3], e, v)
        rubbed = coulomb * m * coulomb_factor
        if e.direction_asymmetry != 0.0 and v.direction_asymmetry == 0.0:
            rubbed = clutch.leaning(rubbed, m, e, v)
        root = slip * speed_squared ** (-1.0 / 3.0)  # gamma = 1/3, which is not uncertain
        torque = rubbed + viscous_factor * viscous * clutch.viscosity_ratio(kelvin, c) * root
        if e.direction_asymmetry != 0.0 and v.direction_asymmetry != 0.0:
            torque = clutch.leaning(torque, slip, e, v)
        if e.squeeze_film != 0.0:
            # squeezed out as Reynolds says, 0.1 bar s times 2^form a unit; it comes back within 0.1 s of parting
            dy[FILM] = pressed / (0.1 * 2.0**f.squeeze_film * BAR * clutch.thinned(kelvin))
            torque *= clutch.carried(y[FILM], e, v)
        if e.friction_level != 0.0:
            torque *= clutch.level(time, y[WORK], e, v)
        if e.shaft_angle_ripple != 0.0:
            torque *= 1.0 + e.shaft_angle_ripple * clutch.wobble(
                y[ANGLE], clutch.order(f.shaft_angle_ripple, 1.0, 4.0), v.shaft_angle_ripple
            )
        if e.torque_bursts != 0.0:  # unknown: the lining chatters now and then, bursts at random
            torque += e.torque_bursts * burst * direction
    elif e.squeeze_film != 0.0:
        dy[FILM] = -y[FILM] / 0.1
    if e.position_ripple != 0.0:
        torque += e.position_ripple * clutch.wobble(
            y[ANGLE], clutch.order(f.position_ripple, 3.0, 10.0), v.position_ripple
        )
    return torque + clutch.drag(slip, y[X], pressed, kelvin, c, e, v)


@njit(error_model="numpy")
def _resting(y, force, towards, q, time, burst, c, e, f, v, work):
    """Torque [Nm] at zero slip were the friction state but a share `q` of its way from `towards` to where it is."""
    moved = work[3]
    moved[:] = y
    moved[SLIP] = 0.0
    for state in (M, M_SLOW):
        moved[state] = towards + (y[state] - towards) * q
    return friction(moved, force, towards, time, burst, c, e, f, v, work[4])


@njit(error_model="numpy")
def margin(y, applied, force, time, burst, c, e, f, v, work):
    """By how much [Nm] plates that stick could bear more than what is `applied`; negative where it is too much for them."""
    low = _resting(y, force, -1.0, 0.0, time, burst, c, e, f, v, work)
    high = _resting(y, force, 1.0, 0.0, time, burst, c, e, f, v, work)
    return min(applied - low, high - applied)


@njit(error_model="numpy")
def broken_away(y, applied, force, time, burst, c, e, f, v, work):
    """Direction in which plates slide that can just not bear what is `applied` [Nm]; sets their state."""
    low = _resting(y, force, -1.0, 0.0, time, burst, c, e, f, v, work)
    high = _resting(y, force, 1.0, 0.0, time, burst, c, e, f, v, work)
    way = 1.0 if applied - low > high - applied else -1.0
    y[M] = y[M_SLOW] = way
    return way


@njit(error_model="numpy")
def turned(y, applied, force, time, burst, c, e, f, v, work):
    """Direction in which plates slide on whose slip has just become zero under `applied` [Nm]; 0 where they stick."""
    q = exp(-c.clutch_attraction * LANDS)
    low = _resting(y, force, -1.0, q, time, burst, c, e, f, v, work)
    high = _resting(y, force, 1.0, q, time, burst, c, e, f, v, work)
    if low <= applied <= high:
        return 0.0
    return 1.0 if applied > high else -1.0
