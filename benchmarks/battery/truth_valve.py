"""Effects in valve and supply: laws of the truth, called once an integration step at constant voltage.

Each law names its source and how it differs from that of the catalogue. `c`: parameters; `e`, `f`, `v`: strength (0 is
off), form (-1..1) and law (0 or 1) of each effect, by its name; `w`: memory; `h`: step [s]. `demand`: pressure that the
valve aims at [Pa].
"""

from math import copysign, exp, sqrt, tanh

from numba import njit

BAR = 1e5  # Pa
LINE = 64  # steps that the pure delay holds: 8 ms
DELAY_STAGES = 6  # lags in series of the distributed delay; chosen: neither a pure delay nor one lag


@njit(error_model="numpy")
def apply_dead_band(voltage, e, v):
    """Return the voltage [V] behind a dead band.

    First law: hyperbola, an overlap that leaks (Merritt 1967, ch. 5: rounded null). Second law: tanh. The catalogue has
    the hard dead zone. Strength: width [V].
    """
    width = e.valve_deadband
    if width == 0.0:
        return voltage
    if v.valve_deadband == 0.0:
        return sqrt(voltage * voltage + width * width) - width if voltage >= 0.0 else voltage
    return voltage - width * tanh(voltage / width)


@njit(error_model="numpy")
def apply_gain_error(demand, time, c, e, v):
    """Return the demand [Pa] with a gain error of the valve.

    First law: a tenth of the error is curvature about 3.4 bar. Second law: the error grows as the coil warms, 10 s
    (Jelali & Kroll 2003). The catalogue has a constant factor and one that drifts evenly. Strength: relative error of the
    gain [-].
    """
    error = e.valve_gain
    if v.valve_gain == 0.0:
        return demand * (1.0 + error * (1.0 + 0.1 * (demand / (3.4 * BAR) - 1.0)))
    return demand * (1.0 + error * (1.0 - 0.4 * exp(-time / 10.0)))


@njit(error_model="numpy")
def apply_hysteresis(demand, e, f, v, w):
    """Return the demand [Pa] behind the hysteresis of the solenoid.

    First law: Bouc-Wen, exponent 2, beta = gamma (Wen 1976). Second law: Duhem in the form of Coleman and Hodgdon. Both
    are exact or nearly so for a monotone step. The catalogue has four plays (Prandtl-Ishlinskii). Strength: width of
    the saturated loop [Pa]. A reversal crosses the loop over half the width times 2^form.
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
            middle = z + 0.5 * piece * _bouc_wen_slope(z, piece)
            z = min(max(z + piece * _bouc_wen_slope(middle, piece), -1.0), 1.0)
    else:
        end = copysign(1.0, rise)
        z = end + (z - end) * exp(-abs(rise))
    w.solenoid = z
    return demand - 0.5 * width * z


@njit(error_model="numpy")
def _bouc_wen_slope(z, piece):
    return 1.0 - z * z if z * piece > 0.0 else 1.0


@njit(error_model="numpy")
def apply_stiction(demand, h, e, f, v, w):
    """Return the demand [Pa] behind the stiction of the spool.

    First law: Karnopp's stick; the spool then slides on viscously, 2 ms at most (Karnopp 1985). Second law: Kano's; the
    spool slides with the command, a constant behind it, until the command stops or turns (Kano et al. 2004). The
    catalogue has He's two-parameter jump. Strength: break-away [Pa]; sliding takes 0.4 of it times 1.5^form.
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
def delay_demand(demand, h, e, v, w):
    """Return the demand [Pa] behind a dead time.

    First law: all-pass, Pade of order 2 (Pade 1892). Second law: six equal lags, a distributed delay (Erlang). The
    catalogue has a pure delay. Third law, only for identification: a pure delay, its mean over the step. Strength: delay [s].
    """
    delay = e.valve_delay
    if delay == 0.0:
        return demand
    if v.valve_delay == 2.0:
        steps = min(delay / h, LINE - 2.0)
        whole = int(steps)
        w.line[int(w.line_at)] = demand
        now, before = w.line[int(w.line_at - whole) % LINE], w.line[int(w.line_at - whole - 1) % LINE]
        w.line_at = (w.line_at + 1.0) % LINE
        return now + (steps - whole) * (before - now)
    if v.valve_delay == 0.0:
        return pade_delay(demand, delay, h, w.delay)
    return lag_chain(demand, delay, DELAY_STAGES, h, w.delay)


@njit(error_model="numpy")
def pade_delay(value, delay, h, past):
    """Return the output of the Pade all-pass of order 2 for `value` held over `h` [s]; midpoint rule.

    past: its states, at least (2,).
    """
    k = 6.0 * h / (delay * delay)
    rate = (past[1] + k * (value - past[0])) / (1.0 + 0.5 * k * (h + delay))  # at the middle
    past[0] += h * rate
    past[1] = 2.0 * rate - past[1]
    return value - delay * rate


@njit(error_model="numpy")
def lag_chain(value, delay, stages, h, past):
    """Return the output of `stages` equal lags with a total mean delay of `delay` [s].

    past: their states, at least (stages,).
    """
    share = 1.0 - exp(-h * stages / delay)
    for i in range(stages):
        past[i] += share * (value - past[i])
        value = past[i]
    return value


@njit(error_model="numpy")
def lag_amplifier(demand, h, e, v, w):
    """Return the demand [Pa] behind a slower valve. First law: a lag of amplifier and coil (Watton 2009).

    Second law: `spool_damping`. The catalogue has a lower natural frequency, such a lag and, since version 5 of the engine,
    such a damping. Strength: lag [s]; for the second law 20 ms per unit of relative damping.
    """
    if e.slower_valve == 0.0 or v.slower_valve != 0.0:
        return demand
    w.amplifier += (1.0 - exp(-h / e.slower_valve)) * (demand - w.amplifier)
    return w.amplifier


@njit(error_model="numpy")
def spool_damping(damping, e, v):
    """Return the damping ratio [-] of a slower valve, second law: more viscous friction on the spool (Merritt 1967, ch. 5).

    The natural frequency is unchanged.
    """
    return damping * (1.0 + e.slower_valve / 20e-3) if v.slower_valve != 0.0 else damping


@njit(error_model="numpy")
def sag_supply(demand, flow, h, c, e, f, v, w):
    """Return the demand and supply pressure [Pa] when the supply sags.

    First law: a gas accumulator, polytropic exponent 1.2, refilled within 30 ms times 2^form (Watton 2009). Second law:
    a loss in the feed line that grows with the square of the flow, behind a lag of 10 ms. The catalogue has a droop in
    proportion to the flow, behind a lag. Strength: share of the supply pressure that a lasting flow of 1.3e-4 m^3/s
    takes away [-].
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
