"""What may be wrong with valve and supply: laws of the truth, called once a step with the voltage held.

Each law names its source and how it differs from the catalogue's. `e` holds strengths (0 is off), `f` a form in -1..1
that shapes the law, `v` which of two laws it is, `w` what a law remembers; all by identifier.
"""

from math import copysign, exp, sqrt, tanh

from numba import njit

BAR = 1e5  # Pa
STAGES = 6  # of the distributed delay


@njit(error_model="numpy")
def opened(voltage, e, v):
    """Dead band. First law: hyperbola, an overlap that leaks (Merritt 1967, ch. 5: rounded null); second: tanh.

    The catalogue has the hard dead zone. Strength: width [V].
    """
    width = e.valve_deadband
    if width == 0.0:
        return voltage
    if v.valve_deadband == 0.0:
        return sqrt(voltage * voltage + width * width) - width if voltage >= 0.0 else voltage
    return voltage - width * tanh(voltage / width)


@njit(error_model="numpy")
def amplified(demand, time, c, e, v):
    """Gain. First law: error with 10 % of curvature about 3.4 bar; second: it grows as the coil warms, 10 s (Jelali &
    Kroll 2003).

    The catalogue has a constant factor. Strength: relative error of the gain.
    """
    error = e.valve_gain
    if v.valve_gain == 0.0:
        return demand * (1.0 + error * (1.0 + 0.1 * (demand / (3.4 * BAR) - 1.0)))
    return demand * (1.0 + error * (1.0 - 0.4 * exp(-time / 10.0)))


@njit(error_model="numpy")
def hysteretic(demand, e, f, v, w):
    """Hysteresis of the solenoid. First law: Bouc-Wen with n = 2, beta = gamma (Wen 1976); second: Duhem in
    Coleman-Hodgdon's form.

    Both exact or nearly so for a monotone step. The catalogue has four plays (Prandtl-Ishlinskii). Strength: width [Pa]
    of the saturated loop; it takes half of it, times 2^form, to cross.
    """
    width = e.valve_hysteresis
    if width == 0.0:
        return demand
    rise = (demand - w.solenoid_last) / (0.5 * width * 2.0**f.valve_hysteresis)
    w.solenoid_last = demand
    z = w.solenoid
    if v.valve_hysteresis == 0.0:
        pieces = 1 + int(abs(rise) * 10.0) if abs(rise) < 10.0 else 100  # 0.1 each: Bouc-Wen is an ODE in the demand
        for _ in range(pieces):
            piece = rise / pieces
            middle = z + 0.5 * piece * _bouc_wen(z, piece)
            z = min(max(z + piece * _bouc_wen(middle, piece), -1.0), 1.0)
    else:
        end = copysign(1.0, rise)
        z = end + (z - end) * exp(-abs(rise))
    w.solenoid = z
    return demand - 0.5 * width * z


@njit(error_model="numpy")
def _bouc_wen(z, piece):
    return 1.0 - z * z if z * piece > 0.0 else 1.0


@njit(error_model="numpy")
def stuck(demand, h, e, f, v, w):
    """Stiction of the spool. First law: Karnopp's stick with a spool that slides on viscously, 2 ms at most (Karnopp 1985);
    second: Kano's (Kano et al. 2004): slides along with the command, a constant behind, until the command stops or
    turns.

    The catalogue has He's two-parameter jump. Strength: break-away [Pa]; sliding takes 0.4 of it, times 1.5^form.
    """
    breakaway = e.spool_stiction
    if breakaway == 0.0:
        return demand
    kinetic = min(0.4 * 1.5**f.spool_stiction, 0.9) * breakaway
    ahead, rise = demand - w.spool, demand - w.spool_last
    w.spool_last = demand
    if v.spool_stiction == 0.0:
        if w.spool_slides == 0.0 and abs(ahead) > breakaway:
            w.spool_slides = 1.0
        if w.spool_slides != 0.0:
            if abs(ahead) <= 1.05 * kinetic:
                w.spool_slides = 0.0
            else:
                aim = demand - copysign(kinetic, ahead)
                w.spool += (aim - w.spool) * (1.0 - exp(-h / (2e-3 * min(breakaway / (0.1 * BAR), 1.0))))
        return w.spool
    w.spool_rest = 0.0 if rise != 0.0 else w.spool_rest + h
    if rise * w.spool_slides < 0.0 or w.spool_rest > 2e-3:  # inputs come every millisecond
        w.spool_slides = 0.0
    if abs(ahead) > breakaway:
        w.spool_slides = copysign(1.0, ahead)
    if w.spool_slides != 0.0 and ahead * w.spool_slides > kinetic:
        w.spool = demand - w.spool_slides * kinetic
    return w.spool


@njit(error_model="numpy")
def late(demand, h, e, v, w):
    """Dead time. First law: all-pass, Pade of order 2 (Padé 1892); second: six equal lags, a distributed delay
    (Erlang).

    The catalogue has a pure delay. Strength: delay [s].
    """
    delay = e.valve_delay
    if delay == 0.0:
        return demand
    if v.valve_delay == 0.0:
        return pade(demand, delay, h, w.delay)
    return lags(demand, delay, STAGES, h, w.delay)


@njit(error_model="numpy")
def pade(value, delay, h, past):
    """Output of the Pade all-pass of order 2 for `value` held over `h` [s]; midpoint rule. past: (2,) at least."""
    k = 6.0 * h / (delay * delay)
    rate = (past[1] + k * (value - past[0])) / (1.0 + 0.5 * k * (h + delay))  # at the middle
    past[0] += h * rate
    past[1] = 2.0 * rate - past[1]
    return value - delay * rate


@njit(error_model="numpy")
def lags(value, delay, stages, h, past):
    """Output of `stages` equal lags of mean `delay` [s] in all. past: (stages,) at least."""
    share = 1.0 - exp(-h * stages / delay)
    for i in range(stages):
        past[i] += share * (value - past[i])
        value = past[i]
    return value


@njit(error_model="numpy")
def slowed(demand, h, e, v, w):
    """Slower valve, first law: a lag of amplifier and coil before it (Watton 2009). The second is `damped`.

    The catalogue lowers the natural frequency. Strength: lag [s] (second law: 20 ms a unit of relative damping).
    """
    if e.slower_valve == 0.0 or v.slower_valve != 0.0:
        return demand
    w.amplifier += (1.0 - exp(-h / e.slower_valve)) * (demand - w.amplifier)
    return w.amplifier


@njit(error_model="numpy")
def damped(damping, e, v):
    """Slower valve, second law: more viscous friction on the spool (Merritt 1967, ch. 5), natural frequency
    unchanged.
    """
    return damping * (1.0 + e.slower_valve / 20e-3) if v.slower_valve != 0.0 else damping


@njit(error_model="numpy")
def supplied(demand, flow, h, c, e, f, v, w):
    """Demand that is left of a sagging supply, and the supply pressure.

    First law: a gas accumulator, polytropic with 1.2, refilled within 30 ms times 2^form (Watton 2009); second: loss in
    the feed line that grows with the flow squared, behind 10 ms. The catalogue has a droop in proportion to the flow,
    behind a lag. Strength: share of the supply that a flow of 1.3e-4 m^3/s takes for as long as it takes to recover.
    """
    supply = c.valve_supply_pressure
    sag = e.supply_sag
    if sag == 0.0:
        return demand, supply
    drawn = max(flow, 0.0) / 1.3e-4
    if v.supply_sag == 0.0:
        recovery = 30e-3 * 2.0**f.supply_sag
        w.drawn += (1.0 - exp(-h / recovery)) * (drawn - w.drawn)
        left = (1.0 + w.drawn * sag / 1.2) ** -1.2  # p V^1.2 constant
    else:
        w.drawn += (1.0 - exp(-h / 10e-3)) * (drawn * drawn - w.drawn)
        left = max(1.0 - sag * w.drawn, 0.05)
    return demand * left, supply * left
