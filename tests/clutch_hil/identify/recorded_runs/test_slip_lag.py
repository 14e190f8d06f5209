"""The slip of other rigs: at the instant of a row, filtered, or late; and recordings without noise, of other simulations."""

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest
from scipy.signal import butter, lfilter

import clutch_hil as ch
from clutch_hil.identify.identification import identify_clutch
from clutch_hil.identify.recorded_runs.shaft_angle import complete_angle
from clutch_hil.identify.recorded_runs.slip_lag import SLIP_LAG, add_slip_lag, delay_slip
from plant_sim.rigs import wet_clutch
from protocols.files.run import Run

SLIP, ANGLE = "slip_speed_rad_s", "shaft_angle_rad"
MEASURED = (SLIP, "cylinder_pressure_bar", "clutch_torque_nm", "motor_torque_nm", "oil_temperature_degc")
PROFILES = ("engagement", "multisine", "stribeck_staircase")
NOISE = 0.02  # rad/s
LATER = 0.2e-3  # s
WEAR = {"clearance_change.change": 0.3}


def at_once(slip: np.ndarray) -> np.ndarray:
    return slip


def filtered(slip: np.ndarray) -> np.ndarray:
    """Of first order, 50 Hz: a time constant of 3.18 ms."""
    b, a = butter(1, 2.0 * 50.0 * 1e-3)
    return slip[0] + lfilter(b, a, slip - slip[0])


def second_order(slip: np.ndarray) -> np.ndarray:
    """Butterworth, 20 Hz: slow signals are 11.25 ms late."""
    b, a = butter(2, 2.0 * 20.0 * 1e-3)
    return slip[0] + lfilter(b, a, slip - slip[0])


def filtered_and_late(slip: np.ndarray) -> np.ndarray:
    """A tachometer with a filter, on a bus that takes 5 ms."""
    return np.concatenate([np.full(5, slip[0]), filtered(slip)[:-5]])


def late(slip: np.ndarray) -> np.ndarray:
    return np.concatenate([np.full(20, slip[0]), slip[:-20]])


@pytest.fixture(scope="module")
def runs() -> list[Run]:
    return [ch.simulate(profile=name, seed=seed) for seed, name in enumerate(PROFILES)]


def with_slip(run: Run, change: Callable[[np.ndarray], np.ndarray], noise: float = NOISE) -> Run:
    """Return a run whose slip is the true one at each row, changed, with noise."""
    true = run["truth_slip_speed_rad_s"]
    shown = change(true) + noise * np.random.default_rng(1).standard_normal(len(true))
    return replace(run, columns={**run.columns, SLIP: shown})


@pytest.mark.parametrize(
    ("change", "delay", "first"), [(at_once, -0.5e-3, 0.0), (filtered, 0.0, 2.68e-3), (late, 19.5e-3, 0.0)]
)
def test_a_lag_is_found(runs: list[Run], change: Callable, delay: float, first: float) -> None:
    for run in runs:
        seen = add_slip_lag(with_slip(run, change).columns)
        lag = [seen[name][0] for name in SLIP_LAG]
        assert lag == pytest.approx([delay, first, 0.0], abs=0.1e-3)  # 0.05 ms measured


@pytest.mark.parametrize(("change", "later"), [(second_order, 10.75e-3), (filtered_and_late, 7.68e-3)])
def test_a_lag_of_higher_order_is_found(runs: list[Run], change: Callable, later: float) -> None:
    for run in runs:
        delay, first, second = (add_slip_lag(with_slip(run, change, 0.005).columns)[name][0] for name in SLIP_LAG)
        assert second > 0.0
        assert delay + first == pytest.approx(later, abs=LATER)


def test_the_slip_of_the_bench_and_a_noisy_one_stay_as_they_are(runs: list[Run]) -> None:
    for run in runs:
        assert add_slip_lag(run.columns) is run.columns
        noisy = with_slip(run, at_once, noise=1.0).columns  # hides half a sample
        assert add_slip_lag(noisy) is noisy


def test_a_simulated_slip_gets_the_lag(runs: list[Run]) -> None:
    for change in (at_once, filtered, second_order, filtered_and_late, late):
        run = with_slip(runs[0], change, 0.0)
        shown = delay_slip(runs[0][SLIP], add_slip_lag(run.columns))
        assert np.std((shown - run[SLIP])[10:]) < 0.02  # the encoder's rounding is 0.016


@pytest.mark.parametrize("bad", [np.zeros(0), np.zeros(1), np.zeros(50), np.full(2000, np.nan)])
def test_nothing_is_said_of_runs_that_show_nothing(bad: np.ndarray) -> None:
    columns = {"time_s": 1e-3 * np.arange(len(bad)), SLIP: bad, ANGLE: bad}
    assert add_slip_lag(columns) is columns
    assert add_slip_lag({"time_s": bad, SLIP: bad[:1], ANGLE: bad}).keys() == columns.keys()


@pytest.mark.parametrize("bad", [np.zeros(3), np.full(12000, np.nan)])
def test_other_columns_that_are_refused_later_are_no_error_here(bad: np.ndarray) -> None:
    exact = make_exact("engagement", {}, False).columns
    columns = complete_angle({**exact, "motor_torque_nm": bad})
    assert add_slip_lag(columns) is columns


@pytest.mark.parametrize("change", [at_once, filtered, second_order, filtered_and_late, late])
def test_nothing_is_missing_on_a_rig_whose_slip_lags(runs: list[Run], change: Callable) -> None:
    outcome = ch.find_discrepancy([with_slip(run, change) for run in runs])
    assert str(outcome).startswith("nothing missing")
    assert "of a sample, and is simulated like this, as a" in outcome.result.notes[0]


def make_exact(profile: str, effects: dict[str, float], angle: bool) -> Run:
    """Return a run as another simulation would write it: exact values, without noise and converters."""
    run = ch.simulate(profile=profile, plant=effects)
    exact = {name: run[f"truth_{name}"] for name in MEASURED}
    return replace(run, columns={n: v for n, v in {**run.columns, **exact}.items() if angle or n != ANGLE})


@pytest.mark.parametrize("angle", [True, False])
@pytest.mark.parametrize("effects", [{}, WEAR])
def test_exact_values_of_another_simulation_are_compared(effects: dict[str, float], angle: bool) -> None:
    """An open clutch has a torque of exactly 0, and a worn one is open for longer than its baseline: it is not frozen."""
    outcome = ch.find_discrepancy([make_exact(name, effects, angle) for name in PROFILES])
    assert outcome.result.effects == [*dict.fromkeys(name.partition(".")[0] for name in effects)], str(outcome)


def test_exact_values_of_another_simulation_are_identified() -> None:
    profiles = (*PROFILES, "pressure_steps", "reversals", "slip_sine")
    runs = [make_exact(name, {}, False) for name in profiles]
    identified = identify_clutch(runs)
    declared = wet_clutch.load_nominal()
    values = {one.name: one for one in identified.calibration.parameters}
    outside = [n for n, one in values.items() if not one.interval[0] <= declared[n].value <= one.interval[1]]
    assert len(values) > 20
    assert len(outside) <= 2, outside  # of 26, each outside with a probability of 5 %
    assert max(identified.misfit.values()) < 1.0
    assert not [text for text in identified.calibration.warnings if "above their noise" in text]
