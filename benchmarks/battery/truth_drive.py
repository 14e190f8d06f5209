"""Effects in the drive: laws of the truth.

`c`: parameters; `e`, `f`, `v`: strength (0 is off), form (-1..1) and law (0 or 1) of each effect, by its name.
"""

from math import cos, sqrt, tanh

from numba import njit


@njit(error_model="numpy")
def motor_ripple_factor(angle, order, e, v):
    """Return the factor [-] on the motor's torque.

    First law: one order and its second harmonic. Second law: one order and a third of it (rotor eccentricity). The catalogue
    has one order. Strength: amplitude [-].
    """
    if e.motor_torque_ripple == 0.0:
        return 1.0
    if v.motor_torque_ripple == 0.0:
        return 1.0 + e.motor_torque_ripple * (cos(order * angle + 0.9) + 0.25 * cos(2.0 * order * angle + 2.1))
    return 1.0 + e.motor_torque_ripple * (cos(order * angle + 0.9) + 0.2 * cos(order * angle / 3.0 + 2.1))


@njit(error_model="numpy")
def plate_inertia_share(v):
    """Return the share [-] of the plate in the whole inertia, where a shaft or splines separate it from the motor."""
    return 0.3 if v.shaft_compliance != 0.0 or v.backlash != 0.0 else 0.2


@njit(error_model="numpy")
def shaft_torque(twist, lead, inertia, e, f, v):
    """Return the torque [Nm] of shaft or splines for `twist` [rad] and speed difference `lead` [rad/s], both motor minus plate.

    inertia: reduced inertia of motor and plate [kg m^2].

    shaft_compliance, first law: a coupling that hardens (Duffing: cubic, twice as stiff at 30 Nm), damping ratio 0.06
    times 2^form; second: linear, heavier plate, strongly damped (rubber coupling). The catalogue: linear, 0.03.
    Strength: compliance [rad/Nm].
    backlash, first law: impact after Hunt & Crossley 1975, flanks of 20 kNm/rad; second: 20 kNm/rad with
    friction in the gap. The catalogue: Kelvin-Voigt flanks. Strength: gap [rad].
    """
    if e.shaft_compliance != 0.0:
        stiffness = 1.0 / e.shaft_compliance
        ratio = 0.06 * 2.0**f.shaft_compliance if v.shaft_compliance == 0.0 else 0.2
        spring = stiffness * twist
        if v.shaft_compliance == 0.0:
            wound = spring / 30.0
            spring *= 1.0 + wound * wound
        return spring + 2.0 * ratio * sqrt(stiffness * inertia) * lead
    half = 0.5 * e.backlash
    over = twist - half if twist > half else twist + half if twist < -half else 0.0
    if v.backlash == 0.0:
        return 20e3 * over * max(1.0 + 2.0 * (lead if over > 0.0 else -lead), 0.0)
    rubbing = 0.3 * tanh(lead / 0.1)
    if over == 0.0:
        return rubbing
    torque = 20e3 * over + 2.0 * 0.25 * sqrt(20e3 * inertia) * lead
    return rubbing + (max(torque, 0.0) if over > 0.0 else min(torque, 0.0))
