"""Measures of plates that stand or turn round, on columns made by hand."""

import numpy as np
import pytest

from clutch_hil.bench.judgement.measures import MEASURES
from protocols.can.frames import load_frames

PHASES = {text: value for value, text in load_frames()["CONTROLLER_STATUS"].list_choices("phase").items()}
STEP = 0.01  # s
SAMPLES = 400
TIME = np.arange(SAMPLES) * STEP
LOCKS, STANDS, BREAKS = slice(100, 300), slice(150, 350), 350
SLIP = -5.0  # rad/s, backwards


def make_columns(**changed: np.ndarray) -> dict[str, np.ndarray]:
    """Slides backwards with 8 Nm for 1 s, is locked from 1 to 3 s, stands from 1.5 to 3.5 s, then breaks away at 10 Nm."""
    slip, torque = np.full(SAMPLES, SLIP), np.full(SAMPLES, -8.0)
    slip[STANDS] = 0.0
    torque[STANDS] = np.linspace(-8.0, -10.0, 200)
    phase = np.full(SAMPLES, PHASES["slip control"])
    phase[LOCKS] = PHASES["lock"]
    demand = np.full(SAMPLES, 8.0)
    demand[LOCKS] = 0.0
    made = {
        "time_s": TIME, "torque_demand_nm": demand, "truth_slip_speed_rad_s": slip, "slip_speed_rad_s": slip,
        "truth_clutch_torque_nm": torque, "clutch_torque_nm": torque, "controller_torque_estimate_nm": torque,
        "controller_phase": phase, "shaft_angle_rad": np.cumsum(slip) * STEP,
    }  # fmt: skip
    return made | changed


def measure_column(name: str, **changed: np.ndarray) -> float:
    return float(MEASURES[name].of(make_columns(**changed)))


def test_a_torque_backwards_follows_its_demand_and_lock_does_not_count() -> None:
    error = measure_column("regime_error_nm")
    assert error == pytest.approx(50 * 1.75 / 200, abs=0.01)  # 0.5 s of the 2 s: it stands with 9.5 to 10 Nm, 8 asked
    assert measure_column("max_torque_error_nm") == pytest.approx(2.0)
    assert measure_column("peak_torque_nm") == pytest.approx(10.0)


@pytest.mark.parametrize("size", [0.1, 1.0, 20.0])
def test_shares_of_the_demand_are_those_of_a_clutch_of_any_size(size: float) -> None:
    columns = make_columns()
    larger = {name: size * columns[name] for name in ("torque_demand_nm", "truth_clutch_torque_nm", "clutch_torque_nm")}
    assert measure_column("max_torque_error_share", **larger) == pytest.approx(2.0 / 8.0)
    assert measure_column("regime_error_share", **larger) == pytest.approx(measure_column("regime_error_nm") / 8.0)


def test_nothing_demanded_has_no_share() -> None:
    nothing = np.zeros(SAMPLES)
    assert np.isnan(measure_column("regime_error_share", torque_demand_nm=nothing))
    assert np.isnan(measure_column("max_torque_error_share", torque_demand_nm=nothing))


def test_standing_plates_are_timed() -> None:
    assert measure_column("locked_s") == pytest.approx(1.5)
    assert measure_column("locking_time_s") == pytest.approx(0.5)
    assert measure_column("stopping_time_s") == pytest.approx(1.5)
    assert measure_column("breakaway_torque_nm") == pytest.approx(10.0)


def test_what_never_locks_or_never_stands_has_no_measure() -> None:
    sliding = np.full(SAMPLES, SLIP)
    assert measure_column("locked_s", truth_slip_speed_rad_s=sliding) == 0.0
    assert np.isnan(measure_column("locking_time_s", truth_slip_speed_rad_s=sliding))
    assert np.isnan(measure_column("breakaway_torque_nm", truth_slip_speed_rad_s=sliding))
    assert np.isnan(measure_column("locked_s", controller_phase=np.full(SAMPLES, PHASES["slip control"])))


def test_a_locked_clutch_that_creeps_has_turned() -> None:
    assert measure_column("held_angle_rad") == pytest.approx(0.0)
    angle = make_columns()["shaft_angle_rad"].copy()
    angle[200:] += 0.25
    assert measure_column("held_angle_rad", shaft_angle_rad=angle) == pytest.approx(0.25)


@pytest.mark.parametrize(
    ("at", "measure"),
    [(149, "estimate_error_nm"), (151, "turning_error_nm"), (154, "estimate_error_nm"), (BREAKS, "turning_error_nm")],
)
def test_an_error_of_the_estimate_counts_where_it_is(at: int, measure: str) -> None:
    estimate = make_columns()["truth_clutch_torque_nm"].copy()
    estimate[at] += 3.0
    result = {
        name: measure_column(name, controller_torque_estimate_nm=estimate)
        for name in ("estimate_error_nm", "turning_error_nm")
    }
    assert result.pop(measure) == pytest.approx(3.0)
    assert set(result.values()) == {0.0}


def test_an_estimate_of_the_other_sign_is_wrong() -> None:
    estimate = -make_columns()["truth_clutch_torque_nm"]
    assert measure_column("estimate_error_nm", controller_torque_estimate_nm=estimate) > 16.0
