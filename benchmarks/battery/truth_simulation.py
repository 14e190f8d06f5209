"""Simulation of the battery's own wet-clutch rig, which produces the cases.

It implements docs/rig.md a second time without any code of plant_sim. So no case is an inverse crime: the model that is
fitted is not the code that made the data.

Equation        docs/rig.md, eq. 1 to 9: motion in truth_motion, friction in truth_plates, acquisition and control here.
                Laws of the effects are in truth_valve, truth_clutch, truth_drive and truth_sensors; unknown effects in
                truth_motion and here
Integration     steps of 0.125 ms, truth_motion. (plant_sim: 0.1 ms, Runge-Kutta 4 for the piston, exact exponential for
                friction, midpoint rule for the motor, no events.)
Assumptions     laws of valve and sensors see constant inputs over a step
Not modelled    as in docs/rig.md

In closed loop the voltage comes from the pressure regulator of docs/rig.md, or from a torque controller on the motor torque.
Both see measured signals.
"""

from collections.abc import Mapping
from dataclasses import dataclass, field
from math import exp, floor, pi
from pathlib import Path

import numpy as np
from numba import njit

from benchmarks.battery import truth_sensors as sensors
from benchmarks.battery import truth_valve as valve
from benchmarks.battery.truth_laws import LAW_RECORD
from benchmarks.battery.truth_motion import (
    FLOW_OUT,
    FORCE_OUT,
    MOTOR_OUT,
    SPEED_OUT,
    TORQUE_OUT,
    advance,
    compute_rates,
)
from benchmarks.battery.truth_rig import BAR, ZERO_CELSIUS, draw_rig
from benchmarks.battery.truth_states import ANGLE, ASKED, KELVIN, MOTOR, SLIP, SPUN, STATES, P, X

PERIOD = 1e-3  # s, sampling period of outputs and inputs: docs/rig.md, signals of a recorded run
# integration steps of 0.125 ms in a sample; chosen: another step than plant_sim's, as accurate (test_truth.py)
SUBSTEPS = 8
OPEN, PRESSURE, TORQUE = range(3)  # mode of a run: open loop, pressure regulator, torque controller
COLUMNS = (
    "cylinder_pressure_bar", "oil_temperature_degc", "motor_torque_nm", "clutch_torque_nm", "shaft_angle_rad",
    "slip_speed_rad_s",
)  # fmt: skip
TRUTH_COLUMNS = ("slip", "pressure", "position", "normal_force", "piston_speed")  # rad/s, bar, m, N, m/s: no sensor's
ANALOG_COUNT = 4  # the first four of COLUMNS are analog channels
MEMORY_RECORD = np.dtype(
    [(name, np.float64) for name in (
        "solenoid", "solenoid_last", "spool", "spool_last", "spool_slides", "spool_rest", "amplifier", "drawn",
        "leak_fast", "leak_slow", "sheath", "element", "integral", "trim", "motor_torque", "slide_direction",
    )]
    + [(name, np.float64, (6,)) for name in ("delay", "pressure_past", "torque_past")]
    + [("line", np.float64, (valve.LINE,)), ("line_at", np.float64)]
)  # fmt: skip


@njit(error_model="numpy")
def _regulate_pressure(demand, measured, contact, w):
    """Return the voltage [V] of the pressure regulator of docs/rig.md for demanded and measured pressure [bar].

    contact: contact pressure [bar] assumed by the regulator; it integrates above it.
    """
    if demand <= 0.0:
        w.integral = 0.0
        return 0.0
    error = demand - measured
    if measured > contact and demand > contact:
        w.integral += PERIOD * error
    return min(max((demand + 0.45 * error + 6.0 * w.integral) / 2.5, 0.0), 10.0)


@njit(error_model="numpy")
def _demand_pressure(torque, speed, pressure, motor_torque, w):
    """Return the pressure demand [bar] of the torque controller for a torque [Nm].

    Feedforward: inverse of docs/rig.md, eq. 5, at the speed demand. Feedback: integral of the error of the motor torque.
    """
    w.motor_torque += PERIOD / 0.05 * (motor_torque - w.motor_torque)
    if torque <= 0.0:
        w.trim = 0.0
        return 0.0
    ratio = 1.0 + (0.7078 - 1.0) * exp(-11.52 / max(abs(speed), 0.1))  # beta = 0.7078 at 3.4 bar: docs/rig.md
    viscous = abs(speed) ** (1.0 / 3.0)
    if pressure > 2.6:
        w.trim += PERIOD * 0.15 * (torque - abs(w.motor_torque))  # bar/(Nm s): 2 rad/s with 14 Nm/bar of the clutch
    return min((torque + 25.1 * ratio + 6.49 * viscous) / (10.8 * ratio + 2.67 * viscous) + w.trim, 4.5)


def _delete_stale_kernel() -> None:
    """Delete the cached kernel if the file of a law is newer. Numba checks only the file of the kernel itself."""
    folder = Path(__file__).parent
    newest = max(path.stat().st_mtime_ns for path in folder.glob("truth_*.py"))
    for kernel in folder.glob("__pycache__/truth_simulation.*.nbi"):
        if kernel.stat().st_mtime_ns < newest:
            kernel.unlink(missing_ok=True)


_delete_stale_kernel()


@njit(cache=True, error_model="numpy")
def _simulate(
    command, speed, mode, contact, kelvin, burst, noise, quantised, rigs, strengths, forms, laws, rows, voltages
):
    """Fill `rows` (n, COLUMNS and TRUTH_COLUMNS) and `voltages` (n,) [V]. Arguments: see `simulate`."""
    c, e, f, v = rigs[0], strengths[0], forms[0], laws[0]
    memory = np.zeros(1, MEMORY_RECORD)
    w = memory[0]
    y, k1, after, work = np.zeros(STATES), np.zeros(STATES), np.zeros(STATES), np.zeros((5, STATES))
    out = np.zeros(6)
    y[KELVIN], y[SLIP], y[MOTOR], y[ASKED], y[SPUN] = kelvin, speed[0], speed[0], speed[0], speed[0]
    w.sheath = w.element = kelvin
    h = PERIOD / SUBSTEPS
    full = c.sensors_input_range
    w.slide_direction = np.sign(speed[0])
    compute_rates(y, 0.0, speed[0], 0.0, burst[0], w.slide_direction, c, e, f, v, k1, out)
    torque, pressure, temperature = out[TORQUE_OUT], y[P], kelvin
    for k in range(command.size):
        time = k * PERIOD
        # sample, docs/rig.md, eq. 9. ground_loop (unknown): the motor's current couples into the pressure channel.
        # torque_flange_speed (unknown): a rotating flange measures a torque in proportion to its speed squared
        shown_pressure = sensors.distort_pressure(pressure, y[KELVIN], time, e, v) + e.ground_loop * out[MOTOR_OUT]
        shown_torque = sensors.distort_torque(torque, y[KELVIN], time, e, v) + e.torque_flange_speed * y[SLIP] * y[SLIP]
        volts_pressure = c.sensors_pressure_sensitivity * (shown_pressure + noise[k, 0])
        volts_temperature = c.sensors_temperature_sensitivity * (temperature - ZERO_CELSIUS + noise[k, 1])
        volts_motor = c.sensors_motor_torque_sensitivity * (out[MOTOR_OUT] + noise[k, 2])
        volts_torque = c.sensors_clutch_torque_sensitivity * (shown_torque + noise[k, 3])
        volts_torque = sensors.saturate(volts_torque, e.sensor_saturation)
        if v.sensor_saturation == 0.0:  # both channels on one rail; second law: torque alone
            volts_pressure = sensors.saturate(volts_pressure, e.sensor_saturation)
        volts_pressure = sensors.quantise_coarsely(volts_pressure, e.coarse_quantisation, v.coarse_quantisation)
        volts_torque = sensors.quantise_coarsely(volts_torque, e.coarse_quantisation, v.coarse_quantisation)
        angle = y[ANGLE]
        if quantised:
            volts_pressure = sensors.convert_to_levels(volts_pressure, c.sensors_pressure_bits, full)
            volts_temperature = sensors.convert_to_levels(volts_temperature, c.sensors_temperature_bits, full)
            volts_motor = sensors.convert_to_levels(volts_motor, c.sensors_motor_torque_bits, full)
            volts_torque = sensors.convert_to_levels(volts_torque, c.sensors_clutch_torque_bits, full)
            lines = c.sensors_encoder_counts / (2.0 * pi)
            angle = floor(angle * lines) / lines
        row = rows[k]
        # V/bar, V/degC, V/Nm of the data sheets: docs/rig.md, eq. 9
        row[0], row[1], row[2] = volts_pressure / 1.0, volts_temperature / 0.05, volts_motor / 0.2
        row[3], row[4] = volts_torque / 0.2, angle
        row[5] = (angle - rows[k - 1, 4]) / PERIOD if k > 0 else y[SLIP]
        row[6], row[7], row[8], row[9], row[10] = y[SLIP], y[P] / BAR, y[X], out[FORCE_OUT], out[SPEED_OUT]
        # inputs of this row
        if mode == OPEN:
            volts = command[k]
        elif mode == PRESSURE:
            volts = _regulate_pressure(command[k], row[0], contact, w)
        else:
            volts = _regulate_pressure(_demand_pressure(command[k], speed[k], row[0], row[2], w), row[0], contact, w)
        if quantised:
            volts = floor(volts * 6553.6) / 6553.6  # 16 bit over 10 V
        voltages[k] = volts
        last_demand = -1.0
        for j in range(SUBSTEPS):
            now = time + j * h
            demand = valve.apply_gain_error(c.valve_gain * valve.apply_dead_band(volts, e, v), now, c, e, v)
            demand = valve.apply_stiction(valve.apply_hysteresis(demand, e, f, v, w), h, e, f, v, w)
            demand = valve.lag_amplifier(valve.delay_demand(demand, h, e, v, w), h, e, v, w)
            demand, supply = valve.sag_supply(demand, out[FLOW_OUT], h, c, e, f, v, w)
            demand = min(max(demand, 0.0), supply)  # docs/rig.md, eq. 1
            if demand != last_demand:  # `k1` holds the rates of another demand, or of the speed demand of the last row
                compute_rates(y, demand, speed[k], now, burst[k], w.slide_direction, c, e, f, v, k1, out)
                last_demand = demand
            advance(y, k1, h, demand, speed[k], now, burst[k], c, e, f, v, w, work, out, after)
            pressure = sensors.delay_pressure(y[P], h, e, v, w)
            torque = sensors.leak_torque(sensors.delay_torque(out[TORQUE_OUT], h, e, v, w), h, e, v, w)
            temperature = sensors.lag_temperature(y[KELVIN], y[SLIP], h, e, v, w)


@dataclass(frozen=True, eq=False)
class Inputs:
    """Inputs of a run.

    `command` (n,): voltage [V], pressure [bar] or torque [Nm], depending on `mode`. `speed` (n,): speed demand [rad/s].
    `celsius`: oil temperature at the start [degC]. `burst` (n,): shape of the torque that torque_bursts adds, in units
    of its strength. `contact`: contact pressure [bar] assumed by the pressure regulator, Table 6.3.
    """

    title: str
    mode: int
    command: np.ndarray
    speed: np.ndarray
    celsius: float
    burst: np.ndarray
    contact: float = 2.35

    def with_voltage(self, voltage: np.ndarray) -> "Inputs":
        """Return the inputs of this run in open loop with `voltage` (n,) [V]."""
        return Inputs(self.title, OPEN, voltage, self.speed, self.celsius, self.burst)


@dataclass(frozen=True)
class HiddenEffects:
    """Effects hidden in a run, each by its name.

    `strengths`: in SI units. `forms`: -1..1, shapes the law. `laws`: which of the two laws, 0 where not given.
    """

    strengths: Mapping[str, float] = field(default_factory=dict)
    forms: Mapping[str, float] = field(default_factory=dict)
    laws: Mapping[str, int] = field(default_factory=dict)

    def make_records(self) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Return the strengths, forms and laws as the kernel takes them: records (1,) of LAW_RECORD."""
        records = np.zeros((3, 1), LAW_RECORD)
        for record, values in zip(records, (self.strengths, self.forms, self.laws), strict=True):
            for name, value in values.items():
                record[name] = value
        return records[0], records[1], records[2]


@dataclass(frozen=True)
class Response:
    """Outputs of a run: `rows` (n, COLUMNS and TRUTH_COLUMNS) in their units, `voltage` (n,) [V]."""

    rows: np.ndarray
    voltage: np.ndarray

    def __getitem__(self, name: str) -> np.ndarray:
        return self.rows[:, (*COLUMNS, *TRUTH_COLUMNS).index(name)]


def simulate(
    inputs: Inputs,
    hidden: HiddenEffects = HiddenEffects(),
    plant: np.ndarray | None = None,
    noise: np.ndarray | None = None,
) -> Response:
    """Simulate a run.

    plant: record of `truth_rig.draw_rig`, None is nominal. noise (n, ANALOG_COUNT): sensor noise in SI units; outputs are then
    rounded to the levels of the converters. None: neither noise nor rounding.
    """
    n = len(inputs.command)
    rows, voltages = np.zeros((n, len(COLUMNS) + len(TRUTH_COLUMNS))), np.zeros(n)
    noise_values = np.zeros((n, ANALOG_COUNT)) if noise is None else noise
    _simulate(
        np.ascontiguousarray(inputs.command), np.ascontiguousarray(inputs.speed), inputs.mode, inputs.contact,
        inputs.celsius + ZERO_CELSIUS, inputs.burst, noise_values, noise is not None,
        draw_rig() if plant is None else plant, *hidden.make_records(), rows, voltages,
    )  # fmt: skip
    return Response(rows, voltages)
