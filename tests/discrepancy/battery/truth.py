"""The battery's own wet-clutch rig: rig.md written a second time, without a line of plant_sim, so that no case is an
inverse crime.

Equation        rig.md 1 to 9; laws of the effects in truth_valve, truth_clutch, truth_drive, truth_sensors, unknown
                ones here
Integration     Bogacki & Shampine 1989, order 3, all states together, 0.125 ms; contact and the piston's rest are located
                and stepped onto. (plant_sim: Runge-Kutta 4 for the piston, exact exponential for friction, midpoint
                rule for the motor, 0.1 ms, no events.)
Assumptions     valve and sensor laws see inputs held over a step. Below 1 mrad/s sign(omega) and |omega|^gamma are rounded:
                with a corner there, plates that reverse under load chatter from step to step at any step
Not modelled    what rig.md does not

In closed loop a regulator of rig.md, or a torque controller on motor torque, makes the voltage from measured signals.
"""

from collections.abc import Mapping
from dataclasses import dataclass, field
from math import copysign, exp, floor, pi, sin, sqrt, tanh
from pathlib import Path

import numpy as np
from numba import njit

from tests.discrepancy.battery import truth_clutch as clutch
from tests.discrepancy.battery import truth_drive as drive
from tests.discrepancy.battery import truth_sensors as sensors
from tests.discrepancy.battery import truth_valve as valve
from tests.discrepancy.battery.truth_laws import BY_NAME
from tests.discrepancy.battery.truth_rig import BAR, ZERO_CELSIUS, rig

PERIOD = 1e-3  # s, of samples and inputs: rig.md
SUBSTEPS = 8
# rad/s, a fortieth of a count of the encoder in a sample; five times that for the lighter plate behind a spring
RESTING = 1e-3
OPEN, PRESSURE, TORQUE = range(3)  # what makes the voltage: itself, the pressure regulator, the torque controller
COLUMNS = (
    "cylinder_pressure_bar", "oil_temperature_degc", "motor_torque_nm", "clutch_torque_nm", "shaft_angle_rad",
    "slip_speed_rad_s",
)  # fmt: skip
TRUTH = ("slip", "pressure", "position", "normal_force", "piston_speed")  # rad/s, bar, m, N, m/s: no sensor's
ANALOG = 4  # the first columns are analog channels

# states
PV, PV_RATE, P, X, M, KELVIN, SLIP, INTEGRAL, ANGLE = range(9)  # of rig.md
SEAL, SPUN, M_SLOW, LOAD_1, LOAD_2, HEAT_1, HEAT_2, HEAT_3, FILM, BENT = range(9, 19)  # of effects
TWIST, MOTOR, LINE, DRIVE, ASKED, WORK = range(19, 25)
STATES = 25
TORQUE_OUT, MOTOR_OUT, FORCE_OUT, SPEED_OUT, FLOW_OUT = range(5)

MEMORY = np.dtype(
    [(name, np.float64) for name in (
        "solenoid", "solenoid_last", "spool", "spool_last", "spool_slides", "spool_rest", "amplifier", "drawn",
        "leak_fast", "leak_slow", "sheath", "element", "integral", "trim", "motor_torque",
    )]
    + [(name, np.float64, (6,)) for name in ("delay", "pressure_past", "torque_past")]
)  # fmt: skip


@njit(error_model="numpy")
def _rates(y, demand, asked, time, burst, c, e, f, v, dy, out):
    """Time derivatives `dy` of the states `y`, and what else is known of them, `out`."""
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
    # friction, rig.md 4 to 6
    sprung = e.shaft_compliance != 0.0 or e.backlash != 0.0
    speed_squared = slip * slip + (25.0 if sprung else 1.0) * RESTING * RESTING
    torque, direction = 0.0, slip / sqrt(speed_squared)
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
                angle, clutch.order(f.shaft_angle_ripple, 1.0, 4.0), v.shaft_angle_ripple
            )
        if e.torque_bursts != 0.0:  # unknown: the lining chatters now and then, bursts at random
            torque += e.torque_bursts * burst * direction
    elif e.squeeze_film != 0.0:
        dy[FILM] = -y[FILM] / 0.1
    if e.position_ripple != 0.0:
        torque += e.position_ripple * clutch.wobble(
            angle, clutch.order(f.position_ripple, 3.0, 10.0), v.position_ripple
        )
    torque += clutch.drag(slip, x, pressed, kelvin, c, e, v)
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
    # motor, rig.md 8. demand_filter (unknown): the drive smooths its demand
    if e.demand_filter != 0.0:
        dy[ASKED] = (asked - y[ASKED]) / e.demand_filter
        asked = y[ASKED]
    error = asked - (y[MOTOR] if sprung else slip)
    wanted = c.motor_proportional_gain * error + c.motor_integral_gain * y[INTEGRAL]
    given = min(max(wanted, -c.motor_torque_limit), c.motor_torque_limit)
    dy[INTEGRAL] = error if wanted == given else 0.0
    if e.drive_lag != 0.0:  # unknown: current loop of finite speed
        dy[DRIVE] = (given - y[DRIVE]) / e.drive_lag
        given = y[DRIVE]
    given *= drive.rippling(angle, 6.0 * clutch.order(f.motor_torque_ripple, 1.0, 4.0), e, v)
    out[MOTOR_OUT] = given
    opposed = torque + e.bearing_drag * slip  # unknown: the plate's bearings, which the torque sensor does not carry
    if sprung:
        share = drive.plate_share(v)
        plate, rotor = share * c.motor_inertia, (1.0 - share) * c.motor_inertia
        lead = y[MOTOR] - slip
        through = drive.shaft(y[TWIST], lead, plate * rotor / c.motor_inertia, e, f, v)
        dy[TWIST], dy[MOTOR], dy[SLIP] = lead, (given - through) / rotor, (through - opposed) / plate
    else:
        dy[SLIP] = (given - opposed) / c.motor_inertia
    dy[ANGLE] = slip


@njit(error_model="numpy")
def _stepped(y, k1, h, demand, asked, time, burst, c, e, f, v, k2, k3, trial, out, after):
    """States `after` a step of `h` [s] from `y`, whose rates are `k1`: Bogacki & Shampine 1989, order 3."""
    for i in range(STATES):
        trial[i] = y[i] + 0.5 * h * k1[i]
    _rates(trial, demand, asked, time + 0.5 * h, burst, c, e, f, v, k2, out)
    for i in range(STATES):
        trial[i] = y[i] + 0.75 * h * k2[i]
    _rates(trial, demand, asked, time + 0.75 * h, burst, c, e, f, v, k3, out)
    for i in range(STATES):
        after[i] = y[i] + h * (2.0 * k1[i] + 3.0 * k2[i] + 4.0 * k3[i]) / 9.0


@njit(error_model="numpy")
def _gap(y, c, e, v):
    """How far the plates are beyond the position at which they part [m]."""
    gap = y[X] - clutch.touch(y[WORK], c, e, v)
    return gap - clutch.stack(gap, c, e, v)[1]


@njit(error_model="numpy")
def _share(before, after):
    """Share of a step at which a quantity passes through zero; 2 where it does not."""
    return before / (before - after) if before * after < 0.0 else 2.0


@njit(error_model="numpy")
def _advance(y, k1, h, demand, asked, time, burst, c, e, f, v, k2, k3, trial, out, after):
    """Move `y` and its rates `k1` on by `h` [s] with inputs held, stepping onto events."""
    left = h
    for attempt in range(5):
        _stepped(y, k1, left, demand, asked, time, burst, c, e, f, v, k2, k3, trial, out, after)
        step = left
        if attempt < 4:
            beyond = _gap(after, c, e, v)
            touches, rests = _share(_gap(y, c, e, v), beyond), _share(y[X], after[X])
            first = min(touches, rests)
            if first < 1.0:
                step = max(first, 1e-6) * left
                _stepped(y, k1, step, demand, asked, time, burst, c, e, f, v, k2, k3, trial, out, after)
                if first == touches:  # exactly there, on the far side
                    after[X] += copysign(1e-12, beyond) - _gap(after, c, e, v)
                else:
                    after[X] = 0.0
        y[:] = after
        if y[X] < 0.0:  # the oil that it did not displace stays in the cylinder
            y[P] += y[X] * c.piston_area / clutch.capacity(y[P], c, e, v)
            y[X] = 0.0
        y[P] = max(y[P], 0.0)
        if _gap(y, c, e, v) <= 0.0:
            y[M] = y[M_SLOW] = y[LOAD_1] = y[LOAD_2] = y[BENT] = 0.0  # rig.md 4
        time += step
        left -= step
        _rates(y, demand, asked, time, burst, c, e, f, v, k1, out)
        if left <= 1e-12:
            return


@njit(error_model="numpy")
def _regulated(wanted, measured, w):
    """Voltage of the pressure regulator of rig.md for pressures wanted and measured [bar]."""
    if wanted <= 0.0:
        w.integral = 0.0
        return 0.0
    error = wanted - measured
    if measured > 2.35 and wanted > 2.35:  # in contact, Table 6.3
        w.integral += PERIOD * error
    return min(max((wanted + 0.45 * error + 6.0 * w.integral) / 2.5, 0.0), 10.0)


@njit(error_model="numpy")
def _wanted_pressure(torque, speed, pressure, motor_torque, w):
    """Pressure [bar] for a torque [Nm]: inverse of rig.md 5 at the speed demand, and an integral of the torque missing
    at the motor.
    """
    w.motor_torque += PERIOD / 0.05 * (motor_torque - w.motor_torque)
    if torque <= 0.0:
        w.trim = 0.0
        return 0.0
    ratio = 1.0 + (0.7078 - 1.0) * exp(-11.52 / max(abs(speed), 0.1))  # beta at 3.4 bar: rig.md
    viscous = abs(speed) ** (1.0 / 3.0)
    if pressure > 2.6:
        w.trim += PERIOD * 0.15 * (torque - abs(w.motor_torque))  # bar/(Nm s): 2 rad/s with 14 Nm/bar of the clutch
    return min((torque + 25.1 * ratio + 6.49 * viscous) / (10.8 * ratio + 2.67 * viscous) + w.trim, 4.5)


def _drop_stale() -> None:
    """Delete the compiled kernel where a law is newer: Numba looks at the kernel's own file alone."""
    folder = Path(__file__).parent
    newest = max(path.stat().st_mtime_ns for path in folder.glob("truth_*.py"))
    for kernel in folder.glob("__pycache__/truth.*.nbi"):
        if kernel.stat().st_mtime_ns < newest:
            kernel.unlink(missing_ok=True)


_drop_stale()


@njit(cache=True, error_model="numpy")
def _simulate(command, speed, mode, kelvin, burst, noise, quantised, rigs, strengths, forms, laws, rows, used):
    """Fill `rows` (n, COLUMNS and TRUTH) and `used` (n,), the voltage. See `simulate`."""
    c, e, f, v = rigs[0], strengths[0], forms[0], laws[0]
    memory = np.zeros(1, MEMORY)
    w = memory[0]
    y, k1, k2, k3, trial, after = (
        np.zeros(STATES), np.zeros(STATES), np.zeros(STATES), np.zeros(STATES), np.zeros(STATES), np.zeros(STATES),
    )  # fmt: skip
    out = np.zeros(5)
    y[KELVIN], y[SLIP], y[MOTOR], y[ASKED], y[SPUN] = kelvin, speed[0], speed[0], speed[0], speed[0]
    w.sheath = w.element = kelvin
    h = PERIOD / SUBSTEPS
    full = c.sensors_input_range
    _rates(y, 0.0, speed[0], 0.0, burst[0], c, e, f, v, k1, out)
    torque, pressure, temperature = out[TORQUE_OUT], y[P], kelvin
    for k in range(command.size):
        time = k * PERIOD
        # sample, rig.md 9. ground_loop (unknown): the motor's current couples into the pressure channel; torque_flange_speed
        # (unknown): a rotating flange shows a torque by its speed alone, in proportion to its square
        shown_pressure = sensors.pressure_shown(pressure, y[KELVIN], time, e, v) + e.ground_loop * out[MOTOR_OUT]
        shown_torque = sensors.torque_shown(torque, y[KELVIN], time, e, v) + e.torque_flange_speed * y[SLIP] * y[SLIP]
        volts_pressure = c.sensors_pressure_sensitivity * (shown_pressure + noise[k, 0])
        volts_temperature = c.sensors_temperature_sensitivity * (temperature - ZERO_CELSIUS + noise[k, 1])
        volts_motor = c.sensors_motor_torque_sensitivity * (out[MOTOR_OUT] + noise[k, 2])
        volts_torque = c.sensors_clutch_torque_sensitivity * (shown_torque + noise[k, 3])
        volts_torque = sensors.bent(volts_torque, e.sensor_saturation)
        if v.sensor_saturation == 0.0:  # both channels on one rail; second law: torque alone
            volts_pressure = sensors.bent(volts_pressure, e.sensor_saturation)
        volts_pressure = sensors.coarse(volts_pressure, e.coarse_quantisation, v.coarse_quantisation)
        volts_torque = sensors.coarse(volts_torque, e.coarse_quantisation, v.coarse_quantisation)
        angle = y[ANGLE]
        if quantised:
            volts_pressure = sensors.converted(volts_pressure, c.sensors_pressure_bits, full)
            volts_temperature = sensors.converted(volts_temperature, c.sensors_temperature_bits, full)
            volts_motor = sensors.converted(volts_motor, c.sensors_motor_torque_bits, full)
            volts_torque = sensors.converted(volts_torque, c.sensors_clutch_torque_bits, full)
            lines = c.sensors_encoder_counts / (2.0 * pi)
            angle = floor(angle * lines) / lines
        row = rows[k]
        row[0], row[1], row[2] = (
            volts_pressure / 1.0,
            volts_temperature / 0.05,
            volts_motor / 0.2,
        )  # data sheets: rig.md 9
        row[3], row[4] = volts_torque / 0.2, angle
        row[5] = (angle - rows[k - 1, 4]) / PERIOD if k > 0 else y[SLIP]
        row[6], row[7], row[8], row[9], row[10] = y[SLIP], y[P] / BAR, y[X], out[FORCE_OUT], out[SPEED_OUT]
        # inputs of this row
        if mode == OPEN:
            volts = command[k]
        elif mode == PRESSURE:
            volts = _regulated(command[k], row[0], w)
        else:
            volts = _regulated(_wanted_pressure(command[k], speed[k], row[0], row[2], w), row[0], w)
        if quantised:
            volts = floor(volts * 6553.6) / 6553.6  # 16 bit over 10 V
        used[k] = volts
        held = -1.0
        for j in range(SUBSTEPS):
            now = time + j * h
            demand = valve.amplified(c.valve_gain * valve.opened(volts, e, v), now, c, e, v)
            demand = valve.stuck(valve.hysteretic(demand, e, f, v, w), h, e, f, v, w)
            demand = valve.slowed(valve.late(demand, h, e, v, w), h, e, v, w)
            demand, supply = valve.supplied(demand, out[FLOW_OUT], h, c, e, f, v, w)
            demand = min(max(demand, 0.0), supply)  # rig.md 1
            if demand != held:  # rates know neither this demand nor, in a row's first step, its speed demand
                _rates(y, demand, speed[k], now, burst[k], c, e, f, v, k1, out)
                held = demand
            _advance(y, k1, h, demand, speed[k], now, burst[k], c, e, f, v, k2, k3, trial, out, after)
            pressure = sensors.pressure_behind(y[P], h, e, v, w)
            torque = sensors.torque_left(sensors.torque_behind(out[TORQUE_OUT], h, e, v, w), h, e, v, w)
            temperature = sensors.probe(y[KELVIN], y[SLIP], h, e, v, w)


@dataclass(frozen=True, eq=False)
class Inputs:
    """What a test engineer asks for in a run: `command` (n,), voltage [V], pressure [bar] or torque [Nm] as `mode`
    says, `speed` demand (n,) [rad/s], the oil's temperature at the start [degC]. `burst` (n,) is what torque_bursts
    adds, in units of its strength.
    """

    title: str
    mode: int
    command: np.ndarray
    speed: np.ndarray
    celsius: float
    burst: np.ndarray

    def held(self, voltage: np.ndarray) -> "Inputs":
        """The same run in open loop with `voltage` (n,) [V]."""
        return Inputs(self.title, OPEN, voltage, self.speed, self.celsius, self.burst)


@dataclass(frozen=True)
class Hidden:
    """Effects that are hidden: strength by name in SI; `forms` -1..1 that shape them, and which of the two `laws`, 0
    where not said.
    """

    strengths: Mapping[str, float] = field(default_factory=dict)
    forms: Mapping[str, float] = field(default_factory=dict)
    laws: Mapping[str, int] = field(default_factory=dict)

    def records(self) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """As the kernel takes them."""
        records = np.zeros((3, 1), BY_NAME)
        for record, values in zip(records, (self.strengths, self.forms, self.laws), strict=True):
            for name, value in values.items():
                record[name] = value
        return records[0], records[1], records[2]


@dataclass(frozen=True)
class Answer:
    """What a run gave: `rows` (n, COLUMNS and TRUTH), `voltage` (n,) [V]."""

    rows: np.ndarray
    voltage: np.ndarray

    def __getitem__(self, name: str) -> np.ndarray:
        return self.rows[:, (*COLUMNS, *TRUTH).index(name)]


def simulate(
    inputs: Inputs,
    hidden: Hidden = Hidden(),
    plant: np.ndarray | None = None,
    noise: np.ndarray | None = None,
) -> Answer:
    """The rig's answer to a run. With `noise` (n, ANALOG) in SI the data acquisition rounds as well; None is free of
    both.

    plant: record of `truth_rig`, None is nominal.
    """
    n = len(inputs.command)
    rows, used = np.zeros((n, len(COLUMNS) + len(TRUTH))), np.zeros(n)
    given = np.zeros((n, ANALOG)) if noise is None else noise
    _simulate(
        np.ascontiguousarray(inputs.command), np.ascontiguousarray(inputs.speed), inputs.mode,
        inputs.celsius + ZERO_CELSIUS, inputs.burst, given, noise is not None,
        rig() if plant is None else plant, *hidden.records(), rows, used,
    )  # fmt: skip
    return Answer(rows, used)
