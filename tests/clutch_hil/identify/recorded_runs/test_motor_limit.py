"""The limit of a motor that no column tells, by steps of its speed demand."""

import numpy as np
import pytest

from clutch_hil.fitting.model import Columns
from clutch_hil.identify.recorded_runs.motor_limit import find_limit_at_steps

DECLARED = 40.0  # Nm
INERTIA, GAIN, INTEGRAL, LOAD = 0.01, 1.0, 10.0, 3.0  # kg m^2, Nm s/rad, Nm/rad, Nm
NOISE = 0.02  # Nm, standard deviation
STEPS = (20.0, 5.0, 28.0, 2.0, 24.0, 4.0, 30.0)  # rad/s, one every 0.5 s
EXACT = 0.005  # of the limit: the median of four rows and more, with this noise


def play_steps(limit: float, *, lag: float = 0.0, steps: tuple[float, ...] = STEPS, period: float = 1e-3) -> Columns:
    """A motor with a PI regulator that brakes a constant load, limited, and late by a first-order `lag` [s]."""
    demand = np.repeat(steps, round(0.5 / period))
    speed, integral, torque = steps[0], LOAD, LOAD
    rows = []
    for one in demand:
        rows.append((speed, torque))
        asked = GAIN * (one - speed) + integral
        given = min(max(asked, -limit), limit)
        if given == asked:
            integral += INTEGRAL * period * (one - speed)
        torque += (given - torque) * (period / max(lag, period))
        speed += period * (torque - LOAD) / INERTIA
    slip, shown = np.array(rows).T
    shown = shown + np.random.default_rng(1).normal(0.0, NOISE, len(shown))
    return {"motor_speed_demand_rad_s": demand, "slip_speed_rad_s": slip, "motor_torque_nm": shown}


@pytest.mark.parametrize("limit", [12.0, 18.0, 46.0])
def test_a_motor_that_stays_below_what_steps_ask_for_is_at_its_limit(limit: float) -> None:
    scale = limit / 12.0  # as far beyond each limit
    run = play_steps(limit, steps=tuple(scale * one for one in STEPS))
    result, (sentence,) = find_limit_at_steps({"run": run}, DECLARED)
    assert result == pytest.approx(limit, rel=EXACT)
    assert (sentence.check, sentence.hard, sentence.run) == ("limit", False, "run")
    assert "but the declared motor gives 40 Nm" in str(sentence)


def test_a_motor_that_gives_what_it_is_asked_for_is_the_declared_one() -> None:
    assert find_limit_at_steps({"run": play_steps(1e3)}, DECLARED) == (DECLARED, [])


def test_a_motor_at_the_declared_limit_is_the_declared_one() -> None:
    run = play_steps(12.0)
    assert find_limit_at_steps({"run": run}, 12.1) == (12.1, [])


def test_a_motor_that_is_slow_has_no_limit() -> None:
    """It stays below what equal steps ask for by the same."""
    run = play_steps(1e3, lag=0.01, steps=(4.0, 24.0) * 4)
    assert find_limit_at_steps({"run": run}, DECLARED) == (DECLARED, [])


def test_a_limit_that_a_controller_sets_is_not_that_of_the_motor() -> None:
    run = play_steps(12.0)
    limited = {**run, "motor_torque_limit_nm": np.full(len(run["motor_torque_nm"]), 12.0)}
    assert find_limit_at_steps({"run": limited}, DECLARED) == (DECLARED, [])


def test_a_run_without_speeds_tells_no_limit() -> None:
    assert find_limit_at_steps({"run": {"motor_torque_nm": np.full(9, 12.0)}}, DECLARED) == (DECLARED, [])
