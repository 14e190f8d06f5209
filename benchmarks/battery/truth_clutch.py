"""What may be wrong with cylinder, piston and friction: laws of the truth, called in every stage of a step.

Each law names its source and how it differs from the catalogue's. `e` holds strengths (0 is off), `f` a form in -1..1
that shapes the law, `v` which of two laws it is; all by identifier.
"""

from math import acos, cos, exp, log10, pi, sqrt, tanh

from numba import njit

BAR = 1e5  # Pa
ATMOSPHERE = 101325.0  # Pa
SUMP = 343.15  # K, at which viscosities are taken relative


@njit(error_model="numpy")
def thinned(kelvin):
    """Viscosity over that at 70 degC: Andrade's law, exp(B (1/T - 1/T_0)) with B = 2600 K of a transmission oil.

    The catalogue's drag and film use Vogel's.
    """
    return exp(2600.0 * (1.0 / kelvin - 1.0 / SUMP))


@njit(error_model="numpy")
def capacity(p, c, e, v):
    """Entrapped air. First law: polytropic with 1.3 (Merritt 1967, ch. 2: fast changes); second: air dissolves as
    pressure rises, its share falling as exp(-p/1.5 bar) (Henry's law and time to dissolve, lumped).

    The catalogue has isothermal air that stays. Strength: volume [m^3] at atmospheric pressure.
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
def leaked(p, kelvin, e, v):
    """Internal leakage [m^3/s]. First law: orifice, square root of the pressure, rounded below 0.2 bar; second: laminar
    gap whose oil thins as it warms (Merritt 1967, ch. 3).

    The catalogue has a constant laminar gap. Strength: flow at 3.4 bar and 70 degC over pressure [m^3/(s Pa)].
    """
    if e.internal_leakage == 0.0:
        return 0.0
    if v.internal_leakage == 0.0:
        return e.internal_leakage * p * sqrt(3.4 * BAR) / sqrt(abs(p) + 0.2 * BAR)
    return e.internal_leakage * p / thinned(kelvin)


@njit(error_model="numpy")
def turned(slip, spun, x, c, e, v):
    """Centrifugal pressure [Pa]. First law: of oil that follows the cylinder within 0.3 s (`spun` is its speed, spin-up
    of a cavity: Greenspan 1968); second: of the part of the cylinder that is filled.

    The catalogue has oil that turns with the cylinder and fills it. Strength: coefficient [Pa/(rad/s)^2].
    """
    if v.centrifugal_pressure == 0.0:
        return e.centrifugal_pressure * spun * spun
    return e.centrifugal_pressure * slip * slip * max(x, 0.0) / (max(x, 0.0) + 0.3 * c.piston_clearance)


@njit(error_model="numpy")
def spring(x, c, e, v):
    """Force of the return springs [N]. First law: preload lost by setting, stiffness unchanged; second: a set that also
    bends the characteristic, as of conical springs (Almen & Laszlo 1936).

    The catalogue scales preload and stiffness alike. Strength: share of the force that is lost.
    """
    lost = e.return_spring_change
    if v.return_spring_change == 0.0:
        return c.piston_preload * (1.0 - lost) + c.piston_spring_stiffness * x
    bent = 1.0 - 1.5 * lost * x / c.piston_clearance
    return c.piston_preload * (1.0 - 0.8 * lost) + c.piston_spring_stiffness * x * bent


@njit(error_model="numpy")
def touch(work, c, e, v):
    """Position [m] at which the plates touch. First law: worn evenly, all of it before the run; second: 80 % of it, the
    rest worn away by the run's own work, 50 kJ (Archard 1953).

    The catalogue has a constant change; with it the plates come at once, here (`stack`) over a fifth of the change.
    Strength: more clearance [m].
    """
    change = e.clearance_change
    if v.clearance_change == 0.0:
        return c.piston_clearance + change
    return c.piston_clearance + change * (0.8 + 0.2 * (1.0 - exp(-work / 50e3)))


@njit(error_model="numpy")
def stack(gap, c, e, v):
    """Force on the plates [N] `gap` [m] beyond the touch of their mean planes, and the gap at which they part.

    Waviness, first law: sine waves, crests of arcsine density; second: crests of exponential density (Greenwood &
    Williamson 1966). The catalogue has saw-tooth waves. Strength: height [m]. Worn plates (clearance_change) touch over
    a fifth of the wear.
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
        pressed = max(gap + rough, 0.0)
        return k * pressed * pressed / (4.0 * rough), -rough
    return k * max(gap, 0.0), 0.0


@njit(error_model="numpy")
def seal(z, p, speed, e, f, v):
    """Force of the seals [N] and rate of their state `z`. First law: Bouc-Wen with n = 1.5 (Wen 1976), pressed on by 10
    % a bar; second: LuGre with a lip that lifts, 30 % less at 5 mm/s (Canudas de Wit et al. 1995).

    The catalogue has one Maxwell-slip element. Strength: sliding force at no pressure [N]; 8 um times 2^form to slide.
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
def coulomb(torque, pressed, kelvin, c, e, v):
    """M_C with what temperature and load do to it.

    coulomb_temperature, first law: exponential; second: Arrhenius (boundary film, Blok 1940). The catalogue: linear.
    Strength: fall [1/K] at the reference temperature.
    load_dependent_friction, first law: power law of the load (Hertzian asperities, Archard 1957); second: rational
    saturation. The catalogue: 1 - f exp(-L/p). Strength: exponent, and share lost under high load.
    """
    if e.coulomb_temperature != 0.0:
        above = kelvin - c.oil_reference
        if v.coulomb_temperature == 0.0:
            torque *= exp(-e.coulomb_temperature * above)
        else:
            torque *= exp(-e.coulomb_temperature * above * c.oil_reference / kelvin)
    if e.load_dependent_friction != 0.0:
        load = max(pressed, 0.0) / BAR
        if v.load_dependent_friction == 0.0:
            torque *= (1.0 + load / 0.3) ** -e.load_dependent_friction
        else:
            torque *= 1.0 - e.load_dependent_friction * load / (1.0 + load)
    return torque


@njit(error_model="numpy")
def fallen(ratio, depth, slip, c, e, v):
    """Stribeck curve s_n. First law: another fall of Gaussian shape, at 8 rad/s (Bo & Pavelescu 1982); second: of
    exponential shape (Tustin 1947).

    The catalogue changes depth and speed of the thesis's own shape, exp(-V_S/v). Strength: further depth over 1 - beta.
    """
    more = e.stribeck_change
    if more == 0.0:
        return ratio
    speed = abs(slip) / 8.0
    fall = 1.0 - exp(-speed * speed) if v.stribeck_change == 0.0 else 1.0 - exp(-speed)
    return max(ratio - more * (1.0 - depth) * fall, 0.05)


@njit(error_model="numpy")
def faded(friction, heat_fast, heat_middle, heat_slow, e, v):
    """Factors on Coulomb and viscous part by the heat at the interface. First law: heat that diffuses into the plates,
    three nodes of 0.3, 2 and 12 s in place of the square-root-of-time kernel (Carslaw & Jaeger 1959), 1/(1 + k Q);
    second: one node, exponential, Coulomb part alone.

    The catalogue has one node, linear, both parts. Strength: fade [1/J].
    """
    fade = e.friction_fade
    if fade == 0.0:
        return 1.0, 1.0
    if v.friction_fade == 0.0:
        factor = 1.0 / (1.0 + fade * (0.5 * heat_fast + 0.3 * heat_middle + 0.3 * heat_slow))
        return factor, factor
    return exp(-fade * heat_middle), 1.0


@njit(error_model="numpy")
def carried(film, e, v):
    """Share of the load that summits carry through a film; `film` is what has been squeezed out, 1/lambda^2 beyond the
    first.

    First law: logistic share (fit to Greenwood & Tripp 1971: half at lambda = 1.5); second: exponential growth with the
    impulse of the pressure. The catalogue: exp(-lambda^2/2). Strength: lambda at touch.
    """
    first = e.squeeze_film
    if first == 0.0:
        return 1.0
    if v.squeeze_film == 0.0:
        thickness = first / sqrt(1.0 + first * first * film)
        return 1.0 / (1.0 + (thickness / 1.5) ** 4)
    return 1.0 - first / (first + 1.0) * exp(-film / (0.2 * first))


@njit(error_model="numpy")
def level(time, work, e, v):
    """Factor on all friction. First law: with 10 % of the change run in by 100 kJ; second: settling by a fifth within
    10 s.

    The catalogue has a constant and a drift linear in time. Strength: relative change.
    """
    if v.friction_level == 0.0:
        return 1.0 + e.friction_level * (0.95 + 0.1 * min(work / 100e3, 1.0))
    return 1.0 + e.friction_level * (1.0 + 0.2 * (exp(-time / 10.0) - 0.5))


@njit(error_model="numpy")
def leaning(friction, sliding, e, v):
    """Friction that differs with the direction. First law: Coulomb part alone; second: all of it, over a tanh of the
    slip.

    `sliding`: -1..1, the friction state, or the slip [rad/s]. The catalogue: M + a |M|. Strength: half the relative
    difference.
    """
    if v.direction_asymmetry == 0.0:
        return friction + e.direction_asymmetry * abs(friction)
    return friction * (1.0 + e.direction_asymmetry * tanh(sliding / 0.5))


@njit(error_model="numpy")
def wobble(angle, order, second):
    """A ripple over the turn of amplitude near 1: first law, a quarter of second harmonic in it; second law, a
    triangle.
    """
    if second == 0.0:
        return cos(order * angle + 0.9) + 0.25 * cos(2.0 * order * angle + 2.1)
    turns = (order * angle + 0.9) / (2.0 * pi)
    return 4.0 * abs(turns - float(int(turns + (0.5 if turns >= 0.0 else -0.5)))) - 1.0


@njit(error_model="numpy")
def order(form, low, high):
    """Whole periods a turn between `low` and `high` for a form in -1..1."""
    return float(int(low + 0.5 * (form + 1.0) * (high - low) + 0.5))


@njit(error_model="numpy")
def drag(slip, x, pressed, kelvin, c, e, v):
    """Drag of the open clutch [Nm]. First law: Couette with the peak where air enters, at 30 rad/s (Kitabayashi et al.
    2003); second: shear-thinning oil, power 0.8, gap held open by 0.3 mm.

    The catalogue: Couette with Vogel's viscosity, growing as the gap closes. Strength: torque over slip at rest [Nm
    s/rad].
    """
    drag = e.drag_torque
    if drag == 0.0:
        return 0.0
    share = max(1.0 - pressed / (0.3 * BAR), 0.0)
    gap = max(c.piston_clearance - x, 0.0)
    if v.drag_torque == 0.0:
        close = c.piston_clearance / (gap + 0.25 * c.piston_clearance) * 1.25
        return drag * share * thinned(kelvin) * close * slip / (1.0 + (slip / 30.0) ** 2)
    close = (c.piston_clearance + 0.3e-3) / (gap + 0.3e-3)
    return drag * share * thinned(kelvin) * close * slip * (1.0 + (slip / 10.0) ** 2) ** -0.1


@njit(error_model="numpy")
def viscosity_ratio(kelvin, c):
    """r_T of rig.md 6."""
    mu = c.oil_slope * log10(max(kelvin - c.oil_origin, 1.0)) + c.oil_offset
    return 1.0 + c.oil_viscous_gain * (mu / c.oil_reference_coefficient - 1.0)
