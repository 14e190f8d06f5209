"""How the truth's rig moves: rates of all its states, and a step with what happens within it.

Equation        rig.md 1 to 3, 6 to 8; plates, 4 and 5, in truth_plates; laws of the effects in truth_valve, truth_clutch,
                truth_drive, unknown ones here
Integration     Bogacki & Shampine 1989, order 3, all states together; contact, the piston's rest, break-away and zero slip
                of the plates are located and stepped onto
Assumptions     inputs are held over a step
Not modelled    what rig.md does not

`y`: states (STATES,); `c`: parameters; `e`, `f`, `v`: strengths, forms and laws of the effects; `way`: truth_plates.
"""

from math import copysign, pi, sin, tanh

from numba import njit

from benchmarks.battery import truth_clutch as clutch
from benchmarks.battery import truth_drive as drive
from benchmarks.battery import truth_valve as valve
from benchmarks.battery.truth_plates import broken_away, friction, margin, rigid, sprung, turned
from benchmarks.battery.truth_states import (
    ANGLE,
    ASKED,
    BENT,
    DRIVE,
    HEAT_1,
    HEAT_2,
    HEAT_3,
    INTEGRAL,
    KELVIN,
    LINE,
    LOAD_1,
    LOAD_2,
    M_SLOW,
    MOTOR,
    PV,
    PV_RATE,
    SEAL,
    SLIP,
    SPUN,
    STATES,
    TWIST,
    WORK,
    M,
    P,
    X,
)

BAR = 1e5  # Pa
_EVENTS = 8  # most within a step
_BEARS = 1e-6  # Nm: plates that could bear no more than this break away
# in `out`, what is known beside the states
TORQUE_OUT, MOTOR_OUT, FORCE_OUT, SPEED_OUT, FLOW_OUT, DRIVEN_OUT = range(6)


@njit(error_model="numpy")
def rates(y, demand, asked, time, burst, way, c, e, f, v, dy, out):
    """Time derivatives `dy` of the states `y`, and what else is known of them, `out`. `way`: truth_plates."""
    dy[:] = 0.0
    p, x, kelvin, slip, angle = y[P], y[X], y[KELVIN], y[SLIP], y[ANGLE]
    # valve, rig.md 1. valve_asymmetry (unknown): the solenoid opens it quicker than the spring closes it
    frequency = c.valve_frequency
    if e.valve_asymmetry != 0.0:
        frequency *= 1.0 + e.valve_asymmetry * tanh(y[PV_RATE] / (5.0 * BAR))
    damping = valve.damped(c.valve_damping, e, v)
    dy[PV] = y[PV_RATE]
    dy[PV_RATE] = frequency * (frequency * (demand - y[PV]) - 2.0 * damping * y[PV_RATE])
    # line and cylinder, rig.md 2. pump_ripple (unknown): 37 Hz and its double, from the pump, behind the valve
    before = y[PV]
    if e.pump_ripple != 0.0:
        before += e.pump_ripple * (sin(2.0 * pi * 37.0 * time) + 0.3 * sin(2.0 * pi * 74.0 * time))
    flow = c.hydraulics_conductance * (before - p)
    if e.line_resonance != 0.0:  # unknown: inertia of the oil in the line, so that it swings against the cylinder
        dy[LINE] = (before - p - y[LINE] / c.hydraulics_conductance) / e.line_resonance
        flow = y[LINE]
    out[FLOW_OUT] = flow
    flow -= clutch.leaked(p, kelvin, e, v)
    # piston, rig.md 3
    force, _ = clutch.stack(x - clutch.touch(y[WORK], c, e, v), c, e, v)
    thrust = p
    if e.centrifugal_pressure != 0.0:
        dy[SPUN] = (slip - y[SPUN]) / 0.3
        thrust += clutch.turned(slip, y[SPUN], x, c, e, v)
    seal, _ = clutch.seal(y[SEAL], p, 0.0, e, f, v)
    speed = (c.piston_area * thrust - clutch.spring(x, c, e, v) - force - seal) / c.piston_damping
    if x <= 0.0 and speed < 0.0:
        speed = 0.0
    dy[X] = speed
    _, dy[SEAL] = clutch.seal(y[SEAL], p, speed, e, f, v)
    rate = (flow - c.piston_area * speed) / clutch.capacity(p, c, e, v)
    dy[P] = max(rate, 0.0) if p <= 0.0 else rate
    out[FORCE_OUT], out[SPEED_OUT] = force, speed
    # motor, rig.md 8. demand_filter (unknown): the drive smooths its demand
    if e.demand_filter != 0.0:
        dy[ASKED] = (asked - y[ASKED]) / e.demand_filter
        asked = y[ASKED]
    error = asked - (y[MOTOR] if sprung(e) else slip)
    wanted = c.motor_proportional_gain * error + c.motor_integral_gain * y[INTEGRAL]
    given = min(max(wanted, -c.motor_torque_limit), c.motor_torque_limit)
    dy[INTEGRAL] = error if wanted == given else 0.0
    if e.drive_lag != 0.0:  # unknown: current loop of finite speed
        dy[DRIVE] = (given - y[DRIVE]) / e.drive_lag
        given = y[DRIVE]
    given *= drive.rippling(angle, 6.0 * clutch.order(f.motor_torque_ripple, 1.0, 4.0), e, v)
    out[MOTOR_OUT] = given
    driven, share = given, drive.plate_share(v)
    plate, rotor = share * c.motor_inertia, (1.0 - share) * c.motor_inertia
    if sprung(e):
        driven = drive.shaft(y[TWIST], y[MOTOR] - slip, plate * rotor / c.motor_inertia, e, f, v)
    out[DRIVEN_OUT] = driven
    # plates, rig.md 4 to 6
    torque = friction(y, force, way, time, burst, c, e, f, v, dy)
    stuck = way == 0.0 and force > 0.0 and rigid(c, e)
    if stuck:
        torque = driven
    out[TORQUE_OUT] = torque
    # oil, rig.md 7. cooling_flow (unknown): grooves pump more oil through the gap the faster they turn
    power = abs(torque * slip)
    dy[WORK] = power
    if e.friction_fade != 0.0:
        dy[HEAT_1] = power - y[HEAT_1] / 0.3
        dy[HEAT_2] = power - y[HEAT_2] / 2.0
        dy[HEAT_3] = power - y[HEAT_3] / 12.0
    cooling = c.oil_heat_transfer
    if e.cooling_flow != 0.0:
        cooling *= 1.0 + e.cooling_flow * abs(slip) / 20.0
    dy[KELVIN] = (power - cooling * (kelvin - c.oil_sump_temperature)) / c.oil_heat_capacity
    opposed = torque + e.bearing_drag * slip  # unknown: the plate's bearings, which the torque sensor does not carry
    if sprung(e):
        dy[TWIST], dy[MOTOR] = y[MOTOR] - slip, (given - driven) / rotor
    dy[SLIP] = 0.0 if stuck else (driven - opposed) / (plate if sprung(e) else c.motor_inertia)
    dy[ANGLE] = slip


@njit(error_model="numpy")
def _stepped(y, k1, h, demand, asked, time, burst, way, c, e, f, v, work, out, after):
    """States `after` a step of `h` [s] from `y`, whose rates are `k1`: Bogacki & Shampine 1989, order 3."""
    k2, k3, trial = work[0], work[1], work[2]
    for i in range(STATES):
        trial[i] = y[i] + 0.5 * h * k1[i]
    rates(trial, demand, asked, time + 0.5 * h, burst, way, c, e, f, v, k2, out)
    for i in range(STATES):
        trial[i] = y[i] + 0.75 * h * k2[i]
    rates(trial, demand, asked, time + 0.75 * h, burst, way, c, e, f, v, k3, out)
    for i in range(STATES):
        after[i] = y[i] + h * (2.0 * k1[i] + 3.0 * k2[i] + 4.0 * k3[i]) / 9.0


@njit(error_model="numpy")
def _gap(y, c, e, v):
    """How far the plates are beyond the position at which they part [m]."""
    gap = y[X] - clutch.touch(y[WORK], c, e, v)
    return gap - clutch.stack(gap, c, e, v)[1]


@njit(error_model="numpy")
def _sign(value):
    return 1.0 if value > 0.0 else -1.0 if value < 0.0 else 0.0


@njit(error_model="numpy")
def _share(before, after):
    """Share of a step at which a quantity passes through zero; 2 where it does not."""
    return before / (before - after) if before * after < 0.0 else 2.0


@njit(error_model="numpy")
def _bears(y, k1, demand, asked, time, burst, c, e, f, v, work, out):
    """By how much [Nm] plates that stick could bear more; sets `k1` and `out` of plates that stick."""
    rates(y, demand, asked, time, burst, 0.0, c, e, f, v, k1, out)
    return margin(y, out[DRIVEN_OUT], out[FORCE_OUT], time, burst, c, e, f, v, work)


@njit(error_model="numpy")
def advance(y, k1, h, demand, asked, time, burst, c, e, f, v, w, work, out, after):
    """Move `y` and its rates `k1` on by `h` [s] with inputs held, stepping onto events. `work`: (5, STATES)."""
    left = h
    for attempt in range(_EVENTS):
        pressed = _gap(y, c, e, v) > 0.0
        if not pressed:
            w.way = _sign(y[SLIP])
        sticks = pressed and w.way == 0.0 and rigid(c, e)
        bears = _bears(y, k1, demand, asked, time, burst, c, e, f, v, work, out) if sticks else 0.0
        if sticks and bears < _BEARS:  # break-away
            w.way = broken_away(y, out[DRIVEN_OUT], out[FORCE_OUT], time, burst, c, e, f, v, work)
            rates(y, demand, asked, time, burst, w.way, c, e, f, v, k1, out)
            sticks = False
        _stepped(y, k1, left, demand, asked, time, burst, w.way, c, e, f, v, work, out, after)
        step, turns = left, False
        if attempt < _EVENTS - 1:
            beyond = _gap(after, c, e, v)
            touches, rests = _share(_gap(y, c, e, v), beyond), _share(y[X], after[X])
            breaks, stops = 2.0, 2.0
            if sticks:
                breaks = _share(bears, _bears(after, work[2], demand, asked, time + left, burst, c, e, f, v, work, out))
            elif pressed and rigid(c, e) and after[SLIP] * w.way < 0.0:
                stops = max(_share(y[SLIP], after[SLIP]), 0.0) if y[SLIP] != 0.0 else 0.0
            first = min(touches, rests, breaks, stops)
            if first < 1.0:
                step = max(first, 1e-6) * left
                _stepped(y, k1, step, demand, asked, time, burst, w.way, c, e, f, v, work, out, after)
                turns = first == stops
                if first == touches:  # exactly there, on the far side
                    after[X] += copysign(1e-12, beyond) - _gap(after, c, e, v)
                elif first == rests:
                    after[X] = 0.0
        y[:] = after
        if y[X] < 0.0:  # the oil that it did not displace stays in the cylinder
            y[P] += y[X] * c.piston_area / clutch.capacity(y[P], c, e, v)
            y[X] = 0.0
        y[P] = max(y[P], 0.0)
        time += step
        left -= step
        if _gap(y, c, e, v) <= 0.0:
            y[M] = y[M_SLOW] = y[LOAD_1] = y[LOAD_2] = y[BENT] = 0.0  # rig.md 4
            w.way = _sign(y[SLIP])
        elif rigid(c, e) and (turns or y[SLIP] * w.way < 0.0):
            y[SLIP] = 0.0
            rates(y, demand, asked, time, burst, w.way, c, e, f, v, k1, out)
            w.way = turned(y, out[DRIVEN_OUT], out[FORCE_OUT], time, burst, c, e, f, v, work)
        rates(y, demand, asked, time, burst, w.way, c, e, f, v, k1, out)
        if left <= 1e-12:
            return
