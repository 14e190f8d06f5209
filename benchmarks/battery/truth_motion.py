"""Motion of the truth's rig: time derivatives of its states, and an integration step that stops at events.

Equation        docs/rig.md, eq. 1 to 3 and 6 to 8 here, eq. 4 and 5 in truth_plates. Laws of the effects are in truth_valve,
                truth_clutch and truth_drive; unknown effects are here
Integration     Bogacki & Shampine 1989, order 3, all states together. Events split a step: the plates touch or part, the piston
                reaches its stop, the plates break away, the slip becomes zero
Assumptions     inputs are constant over a step
Not modelled    as in docs/rig.md

`y`: states (STATES,); `c`: parameters; `e`, `f`, `v`: strength, form (-1..1) and law (0 or 1) of each effect, by its name.
`slide_direction`: see truth_plates.
"""

from math import copysign, pi, sin, tanh

from numba import njit

from benchmarks.battery import truth_clutch as clutch
from benchmarks.battery import truth_drive as drive
from benchmarks.battery import truth_valve as valve
from benchmarks.battery.truth_plates import (
    break_away,
    direction_after_stop,
    friction_torque,
    has_spring,
    sticking_margin,
    sticks_rigidly,
)
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
_MOST_EVENTS = 8  # most events located within a step; chosen: more than the four kinds of events
# Nm: plates whose margin is smaller break away; chosen: far below a step of the torque's converter
_LEAST_RESERVE = 1e-6
# index of each algebraic quantity in `out`: torques [Nm], normal force [N], piston speed [m/s], flow [m^3/s], shaft torque [Nm]
TORQUE_OUT, MOTOR_OUT, FORCE_OUT, SPEED_OUT, FLOW_OUT, DRIVEN_OUT = range(6)


@njit(error_model="numpy")
def compute_rates(y, demand, speed_demand, time, burst, slide_direction, c, e, f, v, dy, out):
    """Write the time derivatives of the states `y` to `dy`, and algebraic quantities to `out` (6,), see TORQUE_OUT."""
    dy[:] = 0.0
    p, x, kelvin, slip, angle = y[P], y[X], y[KELVIN], y[SLIP], y[ANGLE]
    # valve, docs/rig.md, eq. 1. valve_asymmetry (unknown): the solenoid opens it faster than the spring closes it
    frequency = c.valve_frequency
    if e.valve_asymmetry != 0.0:
        frequency *= 1.0 + e.valve_asymmetry * tanh(y[PV_RATE] / (5.0 * BAR))
    damping = valve.spool_damping(c.valve_damping, e, v)
    dy[PV] = y[PV_RATE]
    dy[PV_RATE] = frequency * (frequency * (demand - y[PV]) - 2.0 * damping * y[PV_RATE])
    # line and cylinder, docs/rig.md, eq. 2. pump_ripple (unknown): 37 Hz and its double, from the pump, behind the valve
    before = y[PV]
    if e.pump_ripple != 0.0:
        before += e.pump_ripple * (sin(2.0 * pi * 37.0 * time) + 0.3 * sin(2.0 * pi * 74.0 * time))
    flow = c.hydraulics_conductance * (before - p)
    if e.line_resonance != 0.0:  # unknown: inertia of the oil in the line, so that it swings against the cylinder
        dy[LINE] = (before - p - y[LINE] / c.hydraulics_conductance) / e.line_resonance
        flow = y[LINE]
    out[FLOW_OUT] = flow
    flow -= clutch.leakage_flow(p, kelvin, e, v)
    # piston, docs/rig.md, eq. 3
    force, _ = clutch.stack_force(x - clutch.touch_position(y[WORK], c, e, v), c, e, v)
    thrust = p
    if e.centrifugal_pressure != 0.0:
        dy[SPUN] = (slip - y[SPUN]) / 0.3
        thrust += clutch.centrifugal_pressure(slip, y[SPUN], x, c, e, v)
    seal, _ = clutch.seal_friction(y[SEAL], p, 0.0, e, f, v)
    speed = (c.piston_area * thrust - clutch.spring_force(x, c, e, v) - force - seal) / c.piston_damping
    if x <= 0.0 and speed < 0.0:
        speed = 0.0
    dy[X] = speed
    _, dy[SEAL] = clutch.seal_friction(y[SEAL], p, speed, e, f, v)
    rate = (flow - c.piston_area * speed) / clutch.cylinder_capacity(p, c, e, v)
    dy[P] = max(rate, 0.0) if p <= 0.0 else rate
    out[FORCE_OUT], out[SPEED_OUT] = force, speed
    # motor, docs/rig.md, eq. 8. demand_filter (unknown): the drive smooths its demand
    if e.demand_filter != 0.0:
        dy[ASKED] = (speed_demand - y[ASKED]) / e.demand_filter
        speed_demand = y[ASKED]
    error = speed_demand - (y[MOTOR] if has_spring(e) else slip)
    torque_demand = c.motor_proportional_gain * error + c.motor_integral_gain * y[INTEGRAL]
    motor_torque = min(max(torque_demand, -c.motor_torque_limit), c.motor_torque_limit)
    dy[INTEGRAL] = error if torque_demand == motor_torque else 0.0
    if e.drive_lag != 0.0:  # unknown: current loop of finite speed
        dy[DRIVE] = (motor_torque - y[DRIVE]) / e.drive_lag
        motor_torque = y[DRIVE]
    motor_torque *= drive.motor_ripple_factor(angle, 6.0 * clutch.ripple_order(f.motor_torque_ripple, 1.0, 4.0), e, v)
    out[MOTOR_OUT] = motor_torque
    driven, share = motor_torque, drive.plate_inertia_share(v)
    plate, rotor = share * c.motor_inertia, (1.0 - share) * c.motor_inertia
    if has_spring(e):
        driven = drive.shaft_torque(y[TWIST], y[MOTOR] - slip, plate * rotor / c.motor_inertia, e, f, v)
    out[DRIVEN_OUT] = driven
    # plates, docs/rig.md, eq. 4 to 6
    torque = friction_torque(y, force, slide_direction, time, burst, c, e, f, v, dy)
    stuck = slide_direction == 0.0 and force > 0.0 and sticks_rigidly(c, e)
    if stuck:
        torque = driven
    out[TORQUE_OUT] = torque
    # oil, docs/rig.md, eq. 7. cooling_flow (unknown): grooves pump more oil through the gap the faster they turn
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
    # bearing_drag (unknown): the plate's bearings, whose torque does not pass through the torque sensor
    opposing_torque = torque + e.bearing_drag * slip
    if has_spring(e):
        dy[TWIST], dy[MOTOR] = y[MOTOR] - slip, (motor_torque - driven) / rotor
    dy[SLIP] = 0.0 if stuck else (driven - opposing_torque) / (plate if has_spring(e) else c.motor_inertia)
    dy[ANGLE] = slip


@njit(error_model="numpy")
def _runge_kutta_step(y, k1, h, demand, speed_demand, time, burst, slide_direction, c, e, f, v, work, out, after):
    """Write the states `h` [s] after `y` to `after`; `k1` are the rates at `y`. Bogacki & Shampine 1989, order 3."""
    k2, k3, trial = work[0], work[1], work[2]
    for i in range(STATES):
        trial[i] = y[i] + 0.5 * h * k1[i]
    compute_rates(trial, demand, speed_demand, time + 0.5 * h, burst, slide_direction, c, e, f, v, k2, out)
    for i in range(STATES):
        trial[i] = y[i] + 0.75 * h * k2[i]
    compute_rates(trial, demand, speed_demand, time + 0.75 * h, burst, slide_direction, c, e, f, v, k3, out)
    for i in range(STATES):
        after[i] = y[i] + h * (2.0 * k1[i] + 3.0 * k2[i] + 4.0 * k3[i]) / 9.0


@njit(error_model="numpy")
def _contact_depth(y, c, e, v):
    """Return the distance [m] of the piston beyond the position at which the plates part; negative while they are apart."""
    gap = y[X] - clutch.touch_position(y[WORK], c, e, v)
    return gap - clutch.stack_force(gap, c, e, v)[1]


@njit(error_model="numpy")
def _sign(value):
    return 1.0 if value > 0.0 else -1.0 if value < 0.0 else 0.0


@njit(error_model="numpy")
def _crossing_share(before, after):
    """Return the share of a step after which a quantity crosses zero, by linear interpolation; 2 without a crossing."""
    return before / (before - after) if before * after < 0.0 else 2.0


@njit(error_model="numpy")
def _sticking_reserve(y, k1, demand, speed_demand, time, burst, c, e, f, v, work, out):
    """Return the sticking margin [Nm], see truth_plates; writes `k1` and `out` of sticking plates."""
    compute_rates(y, demand, speed_demand, time, burst, 0.0, c, e, f, v, k1, out)
    return sticking_margin(y, out[DRIVEN_OUT], out[FORCE_OUT], time, burst, c, e, f, v, work)


@njit(error_model="numpy")
def advance(y, k1, h, demand, speed_demand, time, burst, c, e, f, v, w, work, out, after):
    """Advance the states `y` and their rates `k1` by `h` [s] at constant inputs, in several parts where events happen.

    `w`: memory of the rig; `work`: scratch memory (5, STATES).
    """
    time_left = h
    for attempt in range(_MOST_EVENTS):
        pressed = _contact_depth(y, c, e, v) > 0.0
        if not pressed:
            w.slide_direction = _sign(y[SLIP])
        sticks = pressed and w.slide_direction == 0.0 and sticks_rigidly(c, e)
        reserve = _sticking_reserve(y, k1, demand, speed_demand, time, burst, c, e, f, v, work, out) if sticks else 0.0
        if sticks and reserve < _LEAST_RESERVE:  # break-away
            w.slide_direction = break_away(y, out[DRIVEN_OUT], out[FORCE_OUT], time, burst, c, e, f, v, work)
            compute_rates(y, demand, speed_demand, time, burst, w.slide_direction, c, e, f, v, k1, out)
            sticks = False
        _runge_kutta_step(
            y, k1, time_left, demand, speed_demand, time, burst, w.slide_direction, c, e, f, v, work, out, after
        )
        step, stops_first = time_left, False
        if attempt < _MOST_EVENTS - 1:
            beyond = _contact_depth(after, c, e, v)
            touches, rests = _crossing_share(_contact_depth(y, c, e, v), beyond), _crossing_share(y[X], after[X])
            breaks, stops = 2.0, 2.0
            if sticks:
                breaks = _crossing_share(
                    reserve,
                    _sticking_reserve(
                        after, work[2], demand, speed_demand, time + time_left, burst, c, e, f, v, work, out
                    ),
                )
            elif pressed and sticks_rigidly(c, e) and after[SLIP] * w.slide_direction < 0.0:
                stops = max(_crossing_share(y[SLIP], after[SLIP]), 0.0) if y[SLIP] != 0.0 else 0.0
            first = min(touches, rests, breaks, stops)
            if first < 1.0:
                step = max(first, 1e-6) * time_left
                _runge_kutta_step(
                    y, k1, step, demand, speed_demand, time, burst, w.slide_direction, c, e, f, v, work, out, after
                )
                stops_first = first == stops
                if first == touches:  # exactly there, on the far side
                    after[X] += copysign(1e-12, beyond) - _contact_depth(after, c, e, v)
                elif first == rests:
                    after[X] = 0.0
        y[:] = after
        if y[X] < 0.0:  # the oil that the piston did not displace stays in the cylinder
            y[P] += y[X] * c.piston_area / clutch.cylinder_capacity(y[P], c, e, v)
            y[X] = 0.0
        y[P] = max(y[P], 0.0)
        time += step
        time_left -= step
        if _contact_depth(y, c, e, v) <= 0.0:
            y[M] = y[M_SLOW] = y[LOAD_1] = y[LOAD_2] = y[BENT] = 0.0  # docs/rig.md, eq. 4
            w.slide_direction = _sign(y[SLIP])
        elif sticks_rigidly(c, e) and (stops_first or y[SLIP] * w.slide_direction < 0.0):
            y[SLIP] = 0.0
            compute_rates(y, demand, speed_demand, time, burst, w.slide_direction, c, e, f, v, k1, out)
            w.slide_direction = direction_after_stop(y, out[DRIVEN_OUT], out[FORCE_OUT], time, burst, c, e, f, v, work)
        compute_rates(y, demand, speed_demand, time, burst, w.slide_direction, c, e, f, v, k1, out)
        if time_left <= 1e-12:
            return
