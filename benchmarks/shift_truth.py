"""Truth of the power-shift rig: an independent integration that shares no code with the plant or the fit.

Equation        each clutch by the laws of the battery (benchmarks/battery/truth_motion.py), docs/rig.md, eq. 1 to 7
                slip s_k = w_in - i_k w_out;  J_m dw_in/dt = M_m - M_a - M_b;  J_v dw_out/dt = i_a M_a + i_b M_b - T_road
                T_road = m g r (c_r cos(alpha) w/sqrt(w^2 + e^2) + sin(alpha)) + rho/2 c_d A r^3 |w| w     docs/power_shift.md
Integration     Bogacki & Shampine 1989, order 3, all states together, steps of 0.1 ms without events
Assumptions     plates near standstill: eq. 6.9 holds there too (docs/rig.md, `standstill.lag`), signs rounded below 1 mrad/s
Effects         drag of the open plates and a delay of the valve, by the laws of the battery (truth_clutch.py, truth_valve.py)
Not modelled    other effects
"""

from dataclasses import dataclass
from math import atan, cos, floor, pi, sin, sqrt

import numpy as np
from numba import njit

from benchmarks.battery import truth_sensors as sensors
from benchmarks.battery import truth_valve as valve
from benchmarks.battery.truth_motion import TORQUE_OUT, compute_rates
from benchmarks.battery.truth_rig import ZERO_CELSIUS
from benchmarks.battery.truth_simulation import MEMORY_RECORD, PERIOD, HiddenEffects, _regulate_pressure
from benchmarks.battery.truth_states import ANGLE, KELVIN, SLIP, STATES, M, P, X

_ROUNDING = 1e-4  # rad/s, of the road's sign: a grade may nearly balance the rolling resistance
_STEPS = 10  # in a sample
ROAD_RECORD = np.dtype(
    [
        (name, np.float64)
        for name in ("ratio_a", "ratio_b", "inertia", "rolling", "grade", "drag", "motor", "kp", "ki", "limit")
    ]
)
CLUTCH_COLUMNS = ("voltage", "pressure", "slip", "angle", "temperature", "torque")  # V, bar, rad/s, rad, degC, Nm


def make_road_record(
    rig: np.ndarray,
    ratios: tuple[float, float],
    inertia: float,
    radius: float,
    rolling: float,
    area: float,
    grade: float,
) -> np.ndarray:
    """Return the shafts, (1,) of ROAD_RECORD. rig: record with the motor; inertia [kg m^2], radius [m], area [m^2]."""
    weight, slope = inertia * 9.80665 / radius, atan(grade)
    values = (
        *ratios, inertia, weight * rolling * cos(slope), weight * sin(slope), 0.5 * 1.204 * area * radius**3,
        *(float(rig[f"motor_{name}"][0]) for name in ("inertia", "proportional_gain", "integral_gain", "torque_limit")),
    )  # fmt: skip
    return np.array([values], dtype=ROAD_RECORD)


@njit(error_model="numpy")
def _rates(y, shafts, demands, speed_demand, rigs, road, e, f, v, dy, out, dshafts):
    """Compute the time derivatives of both clutches `y` (2, STATES) and the shafts (3,).

    Shafts: input speed, output speed, integral of the motor's controller.
    """
    r = road[0]
    w_in, w_out, integral = shafts[0], shafts[1], shafts[2]
    ratios = (r.ratio_a, r.ratio_b)
    carried = output = 0.0
    for k in range(2):
        y[k, SLIP] = w_in - ratios[k] * w_out
        compute_rates(y[k], demands[k], 0.0, 0.0, 0.0, 0.0, rigs[k], e[k], f[k], v[k], dy[k], out[k])
        carried += out[k, TORQUE_OUT]
        output += ratios[k] * out[k, TORQUE_OUT]
    error = speed_demand - w_in
    asked = r.kp * error + r.ki * integral
    motor = min(max(asked, -r.limit), r.limit)
    road_torque = r.rolling * w_out / sqrt(w_out * w_out + _ROUNDING**2) + r.grade + r.drag * abs(w_out) * w_out
    dshafts[0] = (motor - carried) / r.motor
    dshafts[1] = (output - road_torque) / r.inertia
    dshafts[2] = error if asked == motor else 0.0
    for k in range(2):
        dy[k, SLIP] = 0.0
    return motor


@njit(cache=True, error_model="numpy")
def _simulate(pressures, speed, contacts, kelvin, noise, rigs, road, e, f, v, shown, motors, shaft):
    """Fill `shown` (2, n, CLUTCH_COLUMNS), `motors` (n,) [Nm] and `shaft` (n, 2) [rad/s]. Arguments: see `simulate`."""
    y, trial, after = np.zeros((2, STATES)), np.zeros((2, STATES)), np.zeros((2, STATES))
    k1, k2, k3, out = np.zeros((2, STATES)), np.zeros((2, STATES)), np.zeros((2, STATES)), np.zeros((2, 6))
    shafts, shaft_trial = np.array([speed[0], 0.0, 0.0]), np.zeros(3)
    s1, s2, s3 = np.zeros(3), np.zeros(3), np.zeros(3)
    memory = np.zeros(2, MEMORY_RECORD)
    y[:, KELVIN] = kelvin
    h = PERIOD / _STEPS
    held, demands = np.zeros(2), np.zeros(2)
    asked = speed[0]
    for n in range(speed.size):
        motor = _rates(y, shafts, demands, asked, rigs, road, e, f, v, k1, out, s1)
        for k in range(2):
            c = rigs[k]
            full = c.sensors_input_range
            # V/bar, V/degC, V/Nm of the data sheets: docs/rig.md, eq. 9
            volts = sensors.convert_to_levels((y[k, P] + noise[k, n, 0]) / 1e5, c.sensors_pressure_bits, full)
            warm = sensors.convert_to_levels(
                0.05 * (y[k, KELVIN] - ZERO_CELSIUS + noise[k, n, 1]), c.sensors_temperature_bits, full
            )
            torque = sensors.convert_to_levels(
                0.2 * (out[k, TORQUE_OUT] + noise[k, n, 3]), c.sensors_clutch_torque_bits, full
            )
            if k == 0:
                motors[n] = (
                    sensors.convert_to_levels(0.2 * (motor + noise[0, n, 2]), c.sensors_motor_torque_bits, full) / 0.2
                )
            lines = c.sensors_encoder_counts / (2.0 * pi)
            angle = floor(y[k, ANGLE] * lines) / lines
            row = shown[k, n]
            row[1], row[4], row[5], row[3] = volts, warm / 0.05, torque / 0.2, angle
            row[2] = (angle - shown[k, n - 1, 3]) / PERIOD if n > 0 else y[k, SLIP]
            row[0] = floor(_regulate_pressure(pressures[k, n], volts, contacts[k], memory[k]) * 6553.6) / 6553.6
            held[k] = min(max(c.valve_gain * row[0], 0.0), c.valve_supply_pressure)
        shaft[n, 0], shaft[n, 1] = shafts[0], shafts[1]
        asked = speed[n]
        for _ in range(_STEPS):
            for k in range(2):
                demands[k] = valve.delay_demand(held[k], h, e[k], v[k], memory[k])
            _rates(y, shafts, demands, asked, rigs, road, e, f, v, k1, out, s1)
            trial[:] = y + 0.5 * h * k1
            shaft_trial[:] = shafts + 0.5 * h * s1
            _rates(trial, shaft_trial, demands, asked, rigs, road, e, f, v, k2, out, s2)
            trial[:] = y + 0.75 * h * k2
            shaft_trial[:] = shafts + 0.75 * h * s2
            _rates(trial, shaft_trial, demands, asked, rigs, road, e, f, v, k3, out, s3)
            after[:] = y + h * (2.0 * k1 + 3.0 * k2 + 4.0 * k3) / 9.0
            shafts += h * (2.0 * s1 + 3.0 * s2 + 4.0 * s3) / 9.0
            for k in range(2):
                if after[k, X] < 0.0:  # the oil that the piston did not displace stays in the cylinder
                    after[k, P] += after[k, X] * rigs[k].piston_area / rigs[k].hydraulics_capacity
                    after[k, X] = 0.0
                after[k, P] = max(after[k, P], 0.0)
                if after[k, X] <= rigs[k].piston_clearance:
                    after[k, M] = 0.0  # docs/rig.md, eq. 4: out of contact
            y[:] = after


@dataclass(frozen=True)
class Shown:
    """Outputs of a run: `clutches` (2, n, CLUTCH_COLUMNS), motor (n,) [Nm], true speeds of the `shafts` (n, 2) [rad/s]."""

    clutches: np.ndarray
    motor: np.ndarray
    shafts: np.ndarray

    def make_columns(self, time: np.ndarray, speed: np.ndarray) -> dict[str, np.ndarray]:
        """Return the columns of a recorded run."""
        names = (
            "valve_voltage_{}_v", "cylinder_pressure_{}_bar", "slip_speed_{}_rad_s", "slip_angle_{}_rad",
            "oil_temperature_{}_degc", "clutch_torque_{}_nm",
        )  # fmt: skip
        columns = {"time_s": time, "input_speed_demand_rad_s": speed, "motor_torque_nm": self.motor}
        for clutch, rows in zip("ab", self.clutches, strict=True):
            columns |= {name.format(clutch): rows[:, k].copy() for k, name in enumerate(names)}
        return columns


def simulate(
    pressures: np.ndarray, speed: np.ndarray, contacts: np.ndarray, celsius: float, rigs: tuple[np.ndarray, np.ndarray],
    road: np.ndarray, noise: np.ndarray, hidden: tuple[HiddenEffects, HiddenEffects] = (HiddenEffects(), HiddenEffects()),
) -> Shown:  # fmt: skip
    """Simulate a run from rest. pressures (2, n): demands [bar]; speed (n,): demand [rad/s]; contacts (2,): contact pressures
    that the regulators believe in [bar]. rigs: a record (1,) of each clutch; noise (2, n, 4) [Pa, K, Nm, Nm]; hidden: drag and
    delay of each clutch."""
    strengths, forms, laws = (
        np.concatenate(records) for records in zip(*(h.make_records() for h in hidden), strict=True)
    )
    both = np.concatenate(rigs)
    both["standstill_lag"] = 1.0
    n = len(speed)
    shown, motors, shaft = np.zeros((2, n, len(CLUTCH_COLUMNS))), np.zeros(n), np.zeros((n, 2))
    _simulate(
        np.ascontiguousarray(pressures), np.ascontiguousarray(speed), contacts, celsius + ZERO_CELSIUS, noise, both, road,
        strengths, forms, laws, shown, motors, shaft,
    )  # fmt: skip
    return Shown(shown, motors, shaft)
