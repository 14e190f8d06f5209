"""Plates at or near standstill: they stick, break away, creep, or pass through zero slip.

Equation        J dw/dt = D - M(m, w) of one clutch; D drives its slip, M is the torque of `clutch_unit.slide`
    stick       w = 0 and M = D while M(-1, 0) <= D <= M(1, 0): the plates carry the applied torque, up to their capacity.
                The state is the share of the capacity, m = D/M_C. It has no lag here, because friction builds up only in
                sliding (GMS: stick dF/dt = k w, slip from |F| = s(0) = M_C on; here k -> infinity). So plates keep sticking
                when M_C changes, as long as they can carry D
    break-away  D beyond one of the limits: the plates slide, with m = +-1 there
    turn        w passes 0 within the step: m follows eq. 6.9 without a jump. The plates stick if eq. 6.9 can bring m within the
                step h to the value that holds D. At standstill s_n = 1 and sign(w) is any number in [-1, 1] (Filippov), so
                that m can reach all of [-1 + (m + 1) q, 1 + (m - 1) q], q = exp(-C h)
    lag L > 0   (`standstill.lag`) the m of sticking plates follows D as in a turn, with C/L for C. With L = 1 eq. 6.9 holds
                at standstill too. Plates creep where m cannot follow, or not fast enough
Integration     steps of at most LONGEST_STEP. Below SLOW_SLIP: backward Euler in w, as |w|^gamma has an infinite slope at 0,
                with m at mid-step. Its equation w = w_0 + h/J (D - M(m, w)) has one root unless M falls steeply with w. No
                step makes the slip chatter
Assumptions     D is constant over the step
Not modelled    elastic plates: effect `presliding`, with which M(-1, 0) = M(1, 0), so that only its spring holds
References      Janssens 2010, sec. 5.2 and eq. 6.9; Filippov 1988, Differential Equations with Discontinuous Righthand Sides,
                ch. 2; Moreau 1988 (set-valued friction in time stepping)

Arguments are those of `clutch_unit`.
"""

from math import copysign, exp

from numba import njit

from plant_sim.rigs.clutch_unit import slide

# rad/s: above it the slope of |w|^gamma times a step of 0.1 ms is below 1 (at 0.05 kg m^2, 15 Nm (s/rad)^gamma: 5e-3)
SLOW_SLIP = 0.1
# s, longest step of plates nearly at rest, which reverse within some ms. 0.5 ms gives errors of 0.3 Nm (10 rad/s, 2.5 Hz).
LONGEST_STEP = 1e-4
_TURNING_SLIP = 1e-9  # rad/s: slip in a step at whose end the plates stop without sticking yet
_ROOT_TOLERANCE = 1e-10  # of the surplus of torque: where the search for a root ends
_MOST_TRIALS = 60  # of that search; measured: 9


@njit(inline="always")
def nearly_at_rest(pressure, begin, middle):
    """Return whether pressed plates may stick in a step.

    Slip [rad/s]: `begin` at its start and `middle`, expected at its middle.
    """
    return pressure > 0.0 and (abs(middle) < SLOW_SLIP or begin * (2.0 * middle - begin) <= 0.0)


@njit(error_model="numpy")
def torque_capacity(pressure, viscosity, s, c, e):
    """Return the smallest and largest torque [Nm] that sticking plates can carry. Changes no state."""
    _, low = slide(-1.0, pressure, 0.0, viscosity, s, c, e, 0.0)
    _, high = slide(1.0, pressure, 0.0, viscosity, s, c, e, 0.0)
    return low, high


@njit(error_model="numpy")
def hold(m, drive, low, high):
    """Return the state m, torque [Nm] at zero slip, and whether plates of capacity `low` to `high` [Nm] hold `drive` [Nm]."""
    if low <= drive <= high:
        return ((2.0 * drive - (low + high)) / (high - low) if high > low else m), drive, True
    return (1.0, high, False) if drive > high else (-1.0, low, False)


@njit(error_model="numpy")
def step_near_standstill(m, begin, drive, inertia, pressure, viscosity, s, c, e, h):
    """Return the state m and slip [rad/s] for the step, and whether the plates stick in it.

    The step starts at slip `begin` [rad/s].

    drive [Nm] acts on `inertia` [kg m^2] over the step `h` [s]. Changes no state.
    """
    low, high = torque_capacity(pressure, viscosity, s, c, e)
    share, _, sticks = hold(m, drive, low, high)
    if begin == 0.0:
        lag = c.standstill_lag
        sticks = sticks and (lag == 0.0 or _is_reachable(m, share, c.clutch_attraction / lag, h))
        if sticks:
            return share, 0.0, True
        way = copysign(1.0, share - m) if share != m else share
        m = way if lag == 0.0 else way + (m - way) * exp((1.0 - 1.0 / lag) * c.clutch_attraction * h)
    _, present = slide(m, pressure, 0.0, viscosity, s, c, e, 0.0)
    end = begin + h / inertia * (drive - present)  # if the torque stayed at its value at zero slip
    if begin * end < 0.0 and sticks and _is_reachable(m, share, c.clutch_attraction, h):
        return share, 0.0, True
    if end == 0.0:
        return m, 0.0, False
    way = copysign(1.0, end)
    grown = 0.25 * (high - low) * (way - m) * (1.0 - exp(-c.clutch_attraction * h))  # Nm, by mid-step, where s_n = 1
    end -= h / inertia * grown
    if end * way <= 0.0:
        return m, way * _TURNING_SLIP, False
    return m, _creep(m, end, present, inertia, pressure, viscosity, s, c, e, h), False


@njit(inline="always")
def _is_reachable(m, share, rate, h):
    """Return whether `m` can become `share` within a step `h` [s] at standstill, at a rate C [1/s]."""
    q = exp(-rate * h)
    return -1.0 + (m + 1.0) * q <= share <= 1.0 + (m - 1.0) * q  # eq. 6.9 with s_n = 1


@njit(error_model="numpy")
def _creep(m, end, present, inertia, pressure, viscosity, s, c, e, h):
    """Return the root w [rad/s] of w = end - h/J (M(w) - M(0)), with M(0) `present` [Nm], by the Illinois rule in |w|^gamma."""
    exponent = c.clutch_viscous_exponent
    low, high = 0.0, abs(end) ** exponent
    below, above, side = -abs(end), 0.0, 0
    slip = end
    for k in range(_MOST_TRIALS):
        trial = high if k == 0 else (low * above - high * below) / (above - below)
        slip = copysign(trial ** (1.0 / exponent), end)
        _, torque = slide(m, pressure, slip, viscosity, s, c, e, 0.0)
        off = copysign(1.0, end) * (slip - end + h / inertia * (torque - present))
        if abs(off) <= _ROOT_TOLERANCE * abs(end) or (k == 0 and off <= 0.0):
            break  # where the torque falls with slip: as good as the explicit step
        if off > 0.0:
            high, above = trial, off
            if side > 0:
                below *= 0.5
            side = 1
        else:
            low, below = trial, off
            if side < 0:
                above *= 0.5
            side = -1
    return slip
