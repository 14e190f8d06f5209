"""Effects in cylinder, piston and friction: laws of the truth, called at every stage of an integration step.

Each law names its source and how it differs from that of the catalogue. `c`: parameters; `e`, `f`, `v`: strength (0 is off),
form (-1..1) and law (0 or 1) of each effect, by its name.
"""

from math import acos, cos, exp, log10, pi, sqrt, tanh

from numba import njit

BAR = 1e5  # Pa
ATMOSPHERE = 101325.0  # Pa
VISCOSITY_REFERENCE = 343.15  # K, 70 degC: the sump, docs/rig.md, eq. 7


@njit(error_model="numpy")
def relative_viscosity(kelvin):
    """Return the viscosity over that at 70 degC [-] by Andrade's law, exp(B (1/T - 1/T_0)), B = 2600 K of a transmission oil.

    The catalogue uses Vogel's law for drag and squeeze film.
    """
    return exp(2600.0 * (1.0 / kelvin - 1.0 / VISCOSITY_REFERENCE))


@njit(error_model="numpy")
def cylinder_capacity(p, c, e, v):
    """Return the hydraulic capacity of the cylinder [m^3/Pa] with entrapped air.

    First law: polytropic air, exponent 1.3 (Merritt 1967, ch. 2: fast changes). Second law: air dissolves as the pressure
    rises, its share falls as exp(-p/1.5 bar) (Henry's law and the time to dissolve, lumped). The catalogue has isothermal air
    that does not dissolve. Strength: volume [m^3] at atmospheric pressure.
    """
    air = e.entrapped_air
    if air == 0.0:
        return c.hydraulics_capacity
    above = max(p, 0.0)
    if v.entrapped_air == 0.0:
        return c.hydraulics_capacity + air / (1.3 * ATMOSPHERE) * (ATMOSPHERE / (ATMOSPHERE + above)) ** (
            1.0 + 1.0 / 1.3
        )
    return c.hydraulics_capacity + air / ATMOSPHERE * exp(-above / (1.5 * BAR))


@njit(error_model="numpy")
def leakage_flow(p, kelvin, e, v):
    """Return the internal leakage flow [m^3/s].

    First law: orifice, square root of the pressure, rounded below 0.2 bar. Second law: laminar gap, flow over viscosity, which
    falls with temperature (Merritt 1967, ch. 3). The catalogue has the second law since version 5 of the engine. Strength:
    flow over pressure at 3.4 bar and 70 degC [m^3/(s Pa)].
    """
    if e.internal_leakage == 0.0:
        return 0.0
    if v.internal_leakage == 0.0:
        return e.internal_leakage * p * sqrt(3.4 * BAR) / sqrt(abs(p) + 0.2 * BAR)
    return e.internal_leakage * p / relative_viscosity(kelvin)


@njit(error_model="numpy")
def centrifugal_pressure(slip, oil_speed, x, c, e, v):
    """Return the centrifugal pressure [Pa].

    First law: the oil follows the speed of the cylinder with a lag of 0.3 s; `oil_speed` [rad/s] is a state (spin-up of
    a cavity: Greenspan 1968). Second law: the cylinder is filled in part. The catalogue has a full cylinder whose oil
    turns with it. Strength: coefficient [Pa/(rad/s)^2].
    """
    if v.centrifugal_pressure == 0.0:
        return e.centrifugal_pressure * oil_speed * oil_speed
    return e.centrifugal_pressure * slip * slip * max(x, 0.0) / (max(x, 0.0) + 0.3 * c.piston_clearance)


@njit(error_model="numpy")
def spring_force(x, c, e, v):
    """Return the force of the return springs [N] at the piston position `x` [m].

    First law: the springs have set, so that preload is lost; the stiffness is unchanged. Second law: preload is lost and the
    characteristic is bent, as of conical springs (Almen & Laszlo 1936). The catalogue scales preload and stiffness by one
    factor. Strength: lost share of the force [-].
    """
    loss = e.return_spring_change
    if v.return_spring_change == 0.0:
        return c.piston_preload * (1.0 - loss) + c.piston_spring_stiffness * x
    bent = 1.0 - 1.5 * loss * x / c.piston_clearance
    return c.piston_preload * (1.0 - 0.8 * loss) + c.piston_spring_stiffness * x * bent


@njit(error_model="numpy")
def touch_position(work, c, e, v):
    """Return the piston position [m] at which the plates touch.

    First law: all wear happened before the run. Second law: 80 % of the wear happened before; the rest grows with the friction
    work of the run, scale 50 kJ (Archard 1953). The catalogue has a constant change and abrupt contact; here contact begins
    gradually over a fifth of the change (`stack_force`). Strength: added clearance [m].
    """
    change = e.clearance_change
    if v.clearance_change == 0.0:
        return c.piston_clearance + change
    return c.piston_clearance + change * (0.8 + 0.2 * (1.0 - exp(-work / 50e3)))


@njit(error_model="numpy")
def stack_force(gap, c, e, v):
    """Return the normal force on the plates [N], and the position [m] at which they part.

    gap: piston position beyond the contact of the mean planes [m]. Waviness, first law: sine waves, heights of arcsine density.
    Second law: heights of exponential density (Greenwood & Williamson 1966). The catalogue has saw-tooth waves. Strength:
    height [m]. Contact of worn plates (clearance_change) begins gradually over a fifth of the wear.
    """
    k = c.piston_stack_stiffness
    wave = e.plate_waviness
    if wave > 0.0:
        if v.plate_waviness != 0.0:
            return (k * (gap + wave * exp(-(gap + wave) / wave)) if gap > -wave else 0.0), -wave
        if gap >= wave:
            return k * gap, -wave
        if gap <= -wave:
            return 0.0, -wave
        angle = acos(-gap / wave)
        return k / pi * (gap * angle + sqrt(wave * wave - gap * gap)), -wave
    rough = 0.1 * abs(e.clearance_change)
    if rough > 0.0:
        if gap >= rough:
            return k * gap, -rough
        overlap = max(gap + rough, 0.0)
        return k * overlap * overlap / (4.0 * rough), -rough
    return k * max(gap, 0.0), 0.0


@njit(error_model="numpy")
def seal_friction(z, p, speed, e, f, v):
    """Return the friction force of the seals [N] and time derivative of their state `z` [-].

    First law: Bouc-Wen, exponent 1.5 (Wen 1976). Second law: LuGre, the force falls by 30 % with a Stribeck speed of 5 mm/s
    (Canudas de Wit et al. 1995). In both the force grows by 10 % per bar. The catalogue has one Maxwell-slip element. Strength:
    sliding force without pressure [N]. The break-away displacement is 8 um times 2^form.
    """
    force = e.piston_seal_friction
    if force == 0.0:
        return 0.0, 0.0
    rate = speed / (8e-6 * 2.0**f.piston_seal_friction)
    if v.piston_seal_friction == 0.0:
        loaded = abs(z) ** 1.5 if rate * z > 0.0 else 0.0
        return force * z * (1.0 + 0.1 * p / BAR), rate * (1.0 - loaded)
    level = 0.7 + 0.3 * exp(-((speed / 5e-3) ** 2))
    return force * z * (1.0 + 0.1 * p / BAR), rate - abs(rate) * z / level


@njit(error_model="numpy")
def coulomb_torque(torque, pressure, kelvin, c, e, v):
    """Return the Coulomb torque M_C [Nm] as changed by temperature and load.

    torque: M_C without effects [Nm]. pressure: normal force over piston area [Pa]. coulomb_temperature, first law:
    exponential. Second law: Arrhenius (boundary film, Blok 1940). The catalogue: linear. Strength: relative decrease at
    the reference temperature [1/K]. load_dependent_friction, first law: power of the load (Hertzian asperities, Archard
    1957); strength: exponent [-]. Second law: rational saturation; strength: share lost under high load [-]. The
    catalogue: 1 - f exp(-L/p).
    """
    if e.coulomb_temperature != 0.0:
        above = kelvin - c.oil_reference
        if v.coulomb_temperature == 0.0:
            torque *= exp(-e.coulomb_temperature * above)
        else:
            torque *= exp(-e.coulomb_temperature * above * c.oil_reference / kelvin)
    if e.load_dependent_friction != 0.0:
        load = max(pressure, 0.0) / BAR
        if v.load_dependent_friction == 0.0:
            torque *= (1.0 + load / 0.3) ** -e.load_dependent_friction
        else:
            torque *= 1.0 - e.load_dependent_friction * load / (1.0 + load)
    return torque


@njit(error_model="numpy")
def stribeck_ratio(ratio, depth, slip, c, e, v):
    """Return the Stribeck curve s_n [-]: `ratio` of docs/rig.md, eq. 5, with a second decrease at 8 rad/s.

    First law: Gaussian shape (Bo & Pavelescu 1982). Second law: exponential shape (Tustin 1947). The catalogue changes depth
    and speed of the thesis's shape, exp(-V_S/v). Strength: depth of the second decrease over 1 - beta [-].
    """
    more = e.stribeck_change
    if more == 0.0:
        return ratio
    speed = abs(slip) / 8.0
    fall = 1.0 - exp(-speed * speed) if v.stribeck_change == 0.0 else 1.0 - exp(-speed)
    return max(ratio - more * (1.0 - depth) * fall, 0.05)


@njit(error_model="numpy")
def fade_factors(friction, heat_fast, heat_middle, heat_slow, e, v):
    """Return the factors [-] on the Coulomb and the viscous part by the heat Q [J] at the interface.

    First law: both parts, 1/(1 + k Q), heat diffuses into the plates; three nodes of 0.3, 2 and 12 s approximate the
    square-root-of-time kernel (Carslaw & Jaeger 1959). Second law: Coulomb part only, exponential, one node. The catalogue:
    both parts, linear, one node. Strength: k [1/J].
    """
    fade = e.friction_fade
    if fade == 0.0:
        return 1.0, 1.0
    if v.friction_fade == 0.0:
        factor = 1.0 / (1.0 + fade * (0.5 * heat_fast + 0.3 * heat_middle + 0.3 * heat_slow))
        return factor, factor
    return exp(-fade * heat_middle), 1.0


@njit(error_model="numpy")
def asperity_load_share(squeezed, e, v):
    """Return the share [-] of the load that asperities carry through an oil film of thickness ratio lambda.

    squeezed: increase of 1/lambda^2 since contact, a state. First law: logistic function of lambda, half at 1.5 (fit to
    Greenwood & Tripp 1971). Second law: exponential growth with the time integral of pressure. The catalogue: exp(-lambda^2/2).
    Strength: lambda at first contact [-].
    """
    first_thickness = e.squeeze_film
    if first_thickness == 0.0:
        return 1.0
    if v.squeeze_film == 0.0:
        thickness = first_thickness / sqrt(1.0 + first_thickness * first_thickness * squeezed)
        return 1.0 / (1.0 + (thickness / 1.5) ** 4)
    return 1.0 - first_thickness / (first_thickness + 1.0) * exp(-squeezed / (0.2 * first_thickness))


@njit(error_model="numpy")
def friction_level_factor(time, work, e, v):
    """Return the factor [-] on all friction.

    First law: 10 % of the change come by running in, over 100 kJ of friction work. Second law: a fifth of the change
    decays with 10 s. The catalogue has a constant and a linear drift. Strength: relative change [-].
    """
    if v.friction_level == 0.0:
        return 1.0 + e.friction_level * (0.95 + 0.1 * min(work / 100e3, 1.0))
    return 1.0 + e.friction_level * (1.0 + 0.2 * (exp(-time / 10.0) - 0.5))


@njit(error_model="numpy")
def asymmetric_friction(friction, sliding, e, v):
    """Return the friction torque [Nm] that differs with the direction.

    First law: Coulomb part only, M + a |M|. Second law: whole torque, M (1 + a tanh of the slip); `sliding` is then the slip
    [rad/s]. The catalogue: M + a |M|, of both parts or more of one. Strength: a [-], half the relative difference.
    """
    if v.direction_asymmetry == 0.0:
        return friction + e.direction_asymmetry * abs(friction)
    return friction * (1.0 + e.direction_asymmetry * tanh(sliding / 0.5))


@njit(error_model="numpy")
def ripple_wave(angle, order, second):
    """Return the periodic function [-] of the angle [rad], amplitude near 1, `order` periods per turn.

    First law (`second` is 0): sine with a quarter of the second harmonic. Second law: triangle wave.
    """
    if second == 0.0:
        return cos(order * angle + 0.9) + 0.25 * cos(2.0 * order * angle + 2.1)
    turns = (order * angle + 0.9) / (2.0 * pi)
    return 4.0 * abs(turns - float(int(turns + (0.5 if turns >= 0.0 else -0.5)))) - 1.0


@njit(error_model="numpy")
def ripple_order(form, low, high):
    """Return the number of periods per turn, between `low` and `high`, for a form in -1..1."""
    return float(int(low + 0.5 * (form + 1.0) * (high - low) + 0.5))


@njit(error_model="numpy")
def drag_torque(slip, x, pressure, kelvin, c, e, v):
    """Return the drag torque of the open clutch [Nm].

    First law: Couette flow, peak at 30 rad/s where air enters the gap (Kitabayashi et al. 2003). Second law: shear-thinning
    oil, exponent 0.8, gap of at least 0.3 mm. The catalogue: Couette flow with Vogel's viscosity, growing as the gap closes.
    Strength: torque over slip with the piston at rest [Nm s/rad]. Third law, only for identification: that of the catalogue
    (docs/effects.md), oil as by Vogel, 35 mm^2/s at 40 and 7.2 mm^2/s at 100 degC; a fifth of the clearance stays open.
    """
    coefficient = e.drag_torque
    if coefficient == 0.0:
        return 0.0
    if v.drag_torque == 2.0:
        left = 1.0 - max(pressure, 0.0) / (0.35 * BAR)
        least = 0.2 * c.piston_clearance
        close = (c.piston_clearance + least) / (max(c.piston_clearance - x, 0.0) + least)
        thin = exp(765.0 / (kelvin - 170.15) - 765.0 / (VISCOSITY_REFERENCE - 170.15))
        return coefficient * max(left, 0.0) * close * thin * slip
    share = max(1.0 - pressure / (0.3 * BAR), 0.0)
    gap = max(c.piston_clearance - x, 0.0)
    if v.drag_torque == 0.0:
        close = c.piston_clearance / (gap + 0.25 * c.piston_clearance) * 1.25
        return coefficient * share * relative_viscosity(kelvin) * close * slip / (1.0 + (slip / 30.0) ** 2)
    close = (c.piston_clearance + 0.3e-3) / (gap + 0.3e-3)
    return coefficient * share * relative_viscosity(kelvin) * close * slip * (1.0 + (slip / 10.0) ** 2) ** -0.1


@njit(error_model="numpy")
def viscosity_ratio(kelvin, c):
    """Return the ratio r_T [-] of the viscous friction to that at the reference temperature: docs/rig.md, eq. 6."""
    mu = c.oil_slope * log10(max(kelvin - c.oil_origin, 1.0)) + c.oil_offset
    return 1.0 + c.oil_viscous_gain * (mu / c.oil_reference_coefficient - 1.0)
