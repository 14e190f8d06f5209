"""The driveline behind measured torques: what plates that stick pass between two samples."""

import numpy as np
import pytest

from plant_sim.rigs import power_shift
from plant_sim.rigs.driveline_run import MOTOR_RECORD, MOTOR_TORQUE, SLIP_A, SLIP_B, run

PERIOD, FINE = 1e-3, 200  # s, and steps in it of the integration below
SPEED = 20.0  # rad/s of the input shaft at the start
RAMP = 10.0  # rad/s^2 of the demand: half a step of it is 0.02 Nm of the motor


@pytest.fixture
def road() -> np.ndarray:
    """A driveline on a level road without resistance: all torque goes into the inertias."""
    free = {f"driveline.{name}": 0.0 for name in ("rolling_resistance", "drag_area", "grade")}
    return power_shift.make_driveline_record(power_shift.load_nominal().with_values(free))


@pytest.fixture
def drive() -> np.ndarray:
    p = power_shift.load_nominal().list_si("motor")
    return np.array([(p["inertia"], p["proportional_gain"], p["integral_gain"], p["torque_limit"])], MOTOR_RECORD)


def simulate_locked(demand: np.ndarray, drive: np.ndarray, road: np.ndarray) -> np.ndarray:
    """Both shafts as one inertia, clutch a closed: motor's and clutch's torque at the samples (n, 2) [Nm]. Forward Euler."""
    m, d = drive[0], road[0]
    behind = d["inertia"] / d["ratio_a"] ** 2
    speed, integral, asked = SPEED, 0.0, demand[0]
    h, shown = PERIOD / FINE, np.empty((len(demand), 2))
    for k, wanted in enumerate(demand):
        torque = m["proportional"] * (asked - speed) + m["integral"] * integral
        shown[k] = torque, torque * behind / (m["inertia"] + behind)
        asked = wanted
        for _ in range(FINE):
            error = asked - speed
            speed += h * (m["proportional"] * error + m["integral"] * integral) / (m["inertia"] + behind)
            integral += h * error
    return shown


def simulate_behind(
    torque: np.ndarray, demand: np.ndarray, drive: np.ndarray, road: np.ndarray, passed: float
) -> np.ndarray:
    shown, none = np.empty((len(demand), 3)), np.zeros(len(demand))
    out = SPEED / float(road["ratio_a"][0])
    run(torque, none, np.full(len(demand), passed), none, demand, SPEED, out, 0.0, drive, road, PERIOD, 8, shown)
    return shown


def test_plates_that_stick_pass_the_steps_of_the_demand(drive: np.ndarray, road: np.ndarray) -> None:
    demand = SPEED + RAMP * PERIOD * np.arange(300)
    motor, clutch = simulate_locked(demand, drive, road).T
    m, d = drive[0], road[0]
    share = d["inertia"] / (d["inertia"] + d["ratio_a"] ** 2 * m["inertia"])
    clutch = np.ascontiguousarray(clutch)
    shown = simulate_behind(clutch, demand, drive, road, share)
    np.testing.assert_allclose(shown[:, MOTOR_TORQUE], motor, atol=2e-3)
    np.testing.assert_allclose(shown[1:, SLIP_A], 0.0, atol=1e-3)
    lost = simulate_behind(clutch, demand, drive, road, 0.0)[:, MOTOR_TORQUE] - motor
    half = 0.5 * float(m["proportional"]) * RAMP * PERIOD * share
    assert lost[-1] == pytest.approx(-half, rel=0.02)  # measured 0.4 %


def test_without_steps_of_the_demand_the_measured_torque_is_all(drive: np.ndarray, road: np.ndarray) -> None:
    demand, torque = np.full(200, SPEED), np.full(200, 5.0)
    one, other = (simulate_behind(torque, demand, drive, road, passed) for passed in (0.0, 1.0))
    np.testing.assert_array_equal(one, other)
    speed = road["ratio_a"][0] * 5.0 * PERIOD * 199 / road["inertia"][0]  # of the output shaft, by its torque alone
    ratios = float(road["ratio_b"][0] - road["ratio_a"][0])
    assert (one[-1, SLIP_A] - one[-1, SLIP_B]) / ratios == pytest.approx(
        SPEED / float(road["ratio_a"][0]) + speed, rel=1e-3
    )
