"""Rates of runs: starting values do not depend on the rate at which a run was recorded, also where 20 ms are no whole rows."""

import numpy as np
import pytest

from clutch_hil.fitting.model import Columns
from clutch_hil.identify.stepwise import estimate_motor, estimate_oil, take_samples

INERTIA, PROPORTIONAL, INTEGRAL = 0.05, 0.8, 8.0  # kg m^2, Nm s/rad, Nm/rad
CAPACITY, TRANSFER, SUMP = 500.0, 3.0, 60.0  # J/K, W/K, degC
RATES = (75.0, 128.0, 1000.0)  # Hz: of 20 ms, 2, 3 and 20 rows are 26.7, 23.4 and 20 ms
NEAR = 0.02  # relative: trapezoids of means of 27 ms over a motion of 1 Hz are off by 0.5 %


def record(rate: float, seconds: float = 20.0) -> Columns:
    """Record a motor that turns a clutch at a speed that varies by 1 Hz; the oil warms by the friction."""
    fine = 1e-4  # s
    time = np.arange(0.0, seconds, fine)
    slip = 12.0 + 3.0 * np.sin(2.0 * np.pi * time)
    torque = 10.0 + np.sin(2.0 * np.pi * 0.31 * time)
    motor = torque + INERTIA * np.gradient(slip, fine)
    error = np.zeros_like(time)  # dM_m = k_p de + k_i e dt
    celsius = np.full_like(time, 70.0)
    change = np.diff(motor)
    for k in range(len(time) - 1):
        error[k + 1] = error[k] + (change[k] - INTEGRAL * error[k] * fine) / PROPORTIONAL
        heat = torque[k] * slip[k] - TRANSFER * (celsius[k] - SUMP)
        celsius[k + 1] = celsius[k] + heat * fine / CAPACITY
    at = np.arange(0.0, seconds - 1.0 / rate, 1.0 / rate)
    shown = {
        "valve_voltage_v": np.ones_like(time), "cylinder_pressure_bar": np.ones_like(time), "slip_speed_rad_s": slip,
        "motor_speed_demand_rad_s": slip + error, "clutch_torque_nm": torque, "motor_torque_nm": motor,
        "oil_temperature_degc": celsius,
    }  # fmt: skip
    return {"time_s": at, **{name: np.interp(at, time, values) for name, values in shown.items()}}


@pytest.mark.parametrize("rates", [*((rate,) for rate in RATES), RATES])
def test_starting_values_are_those_of_the_rig_at_any_rate(rates: tuple[float, ...]) -> None:
    samples = take_samples([record(rate) for rate in rates])
    motor, oil = estimate_motor(samples, limit=50.0), estimate_oil(samples)
    assert oil is not None
    assert motor["motor.inertia"] == pytest.approx(INERTIA, rel=NEAR)
    assert motor["motor.proportional_gain"] == pytest.approx(PROPORTIONAL, rel=NEAR)
    assert motor["motor.integral_gain"] == pytest.approx(INTEGRAL, rel=NEAR)
    assert oil["oil.heat_capacity"] == pytest.approx(CAPACITY, rel=NEAR)
    assert oil["oil.heat_transfer"] == pytest.approx(TRANSFER, rel=NEAR)
    assert oil["oil.sump_temperature"] == pytest.approx(SUMP, rel=NEAR)
