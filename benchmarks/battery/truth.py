"""The battery's own wet-clutch rig: rig.md written a second time, without a line of plant_sim, so that no case is an
inverse crime.

Equation        rig.md 1 to 9: truth_motion, truth_plates; here how a run is recorded and controlled. Laws of the effects in
                truth_valve, truth_clutch, truth_drive, truth_sensors, unknown ones in truth_motion and here
Integration     0.125 ms: truth_motion. (plant_sim: Runge-Kutta 4 for the piston, exact exponential for friction, midpoint
                rule for the motor, 0.1 ms, no events.)
Assumptions     valve and sensor laws see inputs held over a step
Not modelled    what rig.md does not

In closed loop a regulator of rig.md, or a torque controller on motor torque, makes the voltage from measured signals.
"""

from collections.abc import Mapping
from dataclasses import dataclass, field
from math import exp, floor, pi
from pathlib import Path

import numpy as np
from numba import njit

from benchmarks.battery import truth_sensors as sensors
from benchmarks.battery import truth_valve as valve
from benchmarks.battery.truth_laws import BY_NAME
from benchmarks.battery.truth_motion import FLOW_OUT, FORCE_OUT, MOTOR_OUT, SPEED_OUT, TORQUE_OUT, advance, rates
from benchmarks.battery.truth_rig import BAR, ZERO_CELSIUS, rig
from benchmarks.battery.truth_states import ANGLE, ASKED, KELVIN, MOTOR, SLIP, SPUN, STATES, P, X

PERIOD = 1e-3  # s, of samples and inputs: rig.md
SUBSTEPS = 8
OPEN, PRESSURE, TORQUE = range(3)  # what makes the voltage: itself, the pressure regulator, the torque controller
COLUMNS = (
    "cylinder_pressure_bar", "oil_temperature_degc", "motor_torque_nm", "clutch_torque_nm", "shaft_angle_rad",
    "slip_speed_rad_s",
)  # fmt: skip
TRUTH = ("slip", "pressure", "position", "normal_force", "piston_speed")  # rad/s, bar, m, N, m/s: no sensor's
ANALOG = 4  # the first columns are analog channels
MEMORY = np.dtype(
    [(name, np.float64) for name in (
        "solenoid", "solenoid_last", "spool", "spool_last", "spool_slides", "spool_rest", "amplifier", "drawn",
        "leak_fast", "leak_slow", "sheath", "element", "integral", "trim", "motor_torque", "way",
    )]
    + [(name, np.float64, (6,)) for name in ("delay", "pressure_past", "torque_past")]
)  # fmt: skip


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
    y, k1, after, work = np.zeros(STATES), np.zeros(STATES), np.zeros(STATES), np.zeros((5, STATES))
    out = np.zeros(6)
    y[KELVIN], y[SLIP], y[MOTOR], y[ASKED], y[SPUN] = kelvin, speed[0], speed[0], speed[0], speed[0]
    w.sheath = w.element = kelvin
    h = PERIOD / SUBSTEPS
    full = c.sensors_input_range
    w.way = np.sign(speed[0])
    rates(y, 0.0, speed[0], 0.0, burst[0], w.way, c, e, f, v, k1, out)
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
                rates(y, demand, speed[k], now, burst[k], w.way, c, e, f, v, k1, out)
                held = demand
            advance(y, k1, h, demand, speed[k], now, burst[k], c, e, f, v, w, work, out, after)
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
