"""Chapter 6 is measured over the controller that the product has, and the documents tell what was measured."""

from functools import cache
from pathlib import Path

import numpy as np
import pytest

from clutch_hil.thesis.check_sheet import Sheet
from clutch_hil.thesis.clutch import clutch_dynamics, clutch_lag, table_6_6
from clutch_hil.thesis.clutch.clutch_experiments import SLOW_RATE, list_cooling_changes, load_nominal, run_experiment
from clutch_hil.thesis.clutch.clutch_fit import TOLERANCE
from clutch_hil.thesis.clutch.clutch_lag import ATTRACTION, LARGEST_ERROR, run_online_estimate
from clutch_hil.thesis.clutch.clutch_response import THESIS_BANDWIDTH, Response, measure_response
from protocols.errors import InputError

ROOT = Path(__file__).parents[3]
THESIS = ROOT / "clutch_hil" / "thesis"
TELLING = (
    "docs/results.md",
    "docs/rig.md",
    "docs/telemetry.md",
    "plant_sim/parameters/janssens2010.toml",
    "rt_controller/parameters/controller.toml",
)


@cache
def as_shipped() -> Response:
    return measure_response()


# --- figure 6.15 -----------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("page", TELLING)
def test_the_bandwidth_is_told_as_it_is_measured(page: str) -> None:
    assert f"{as_shipped().pressure.bandwidth:.2f} Hz" in (ROOT / page).read_text(encoding="utf-8")


@pytest.mark.parametrize(("gain", "faster"), [(0.2, False), (0.9, True)])
def test_another_gain_of_the_controllers_regulator_gives_another_response(gain: float, faster: bool) -> None:
    result = measure_response({"pressure.proportional_gain": gain})
    for changed, before in ((result.pressure, as_shipped().pressure), (result.torque, as_shipped().torque)):
        assert (changed.bandwidth > before.bandwidth + 1.0) if faster else (changed.bandwidth < before.bandwidth - 1.0)
    assert abs(result.pressure.bandwidth / THESIS_BANDWIDTH - 1.0) > TOLERANCE  # the claim would not hold


def test_without_its_integral_the_regulator_does_not_overshoot() -> None:
    result = measure_response({"pressure.integral_gain": 0.0})
    assert as_shipped().pressure.decibel.max() > 1.0  # dB; 1.1 measured
    assert result.pressure.decibel.max() < 0.3


def test_the_torque_is_slower_than_the_pressure_that_makes_it() -> None:
    assert as_shipped().torque.bandwidth < as_shipped().pressure.bandwidth
    assert as_shipped().torque.phase[-1] < as_shipped().pressure.phase[-1]


# --- figure 6.14 -----------------------------------------------------------------------------------------------------


def test_a_controller_that_believes_in_another_lag_errs_by_more() -> None:
    assert run_online_estimate(5.0).error < LARGEST_ERROR
    assert run_online_estimate(5.0, ATTRACTION / 2.0).error > LARGEST_ERROR
    assert run_online_estimate(5.0, clutch_lag.FASTEST_ATTRACTION).error > LARGEST_ERROR


def test_the_width_of_the_loop_is_signed() -> None:
    loop = run_online_estimate(5.0)
    assert loop.measure_loop_width(loop.true) > 0.3  # Nm; 0.53 measured
    assert loop.measure_loop_width(-loop.true) == pytest.approx(-loop.measure_loop_width(loop.true))
    assert abs(loop.measure_loop_width(loop.slip)) < 0.02  # rad/s: branches are compared at equal slip


# --- the rig under its controller ------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    "words", [".advance(", "wet_clutch_regulated", "rt_controller.law", "plant_sim.node.plant_turn"]
)
def test_no_reproduction_regulates_the_clutch_itself(words: str) -> None:
    """Nor steps the plant: plant and controller are played as a whole, by `run_experiment` or a bench."""
    texts = {path: path.read_text(encoding="utf-8") for path in THESIS.rglob("*.py")}
    assert THESIS / "clutch" / "clutch_experiments.py" in texts
    assert not [path.name for path, text in texts.items() if words in text]


def test_a_record_begins_settled_and_has_the_demand_sample_by_sample() -> None:
    demand = 3.0 + 0.1 * np.sin(np.arange(500) / 50.0)
    run = run_experiment(demand, 20.0, load_nominal(**list_cooling_changes()))
    assert run.time.size == 500
    assert np.abs(run.demand - demand).max() <= 2.5e-3 + 1e-9  # bar: the bus carries steps of 5 mbar
    assert abs(run.pressure[:50].mean() - 3.0) < 0.02
    assert abs(run.slip[:50].mean() - 20.0) < 0.2


def test_an_experiment_that_the_controller_ends_is_no_record() -> None:
    with pytest.raises(InputError, match="ended an experiment with fault 3"):
        run_experiment(np.full(2 * SLOW_RATE, 3.6), 20.0, load_nominal(), temperature=149.5, rate=SLOW_RATE)


# --- Table 6.6 -------------------------------------------------------------------------------------------------------


def measure_stepping(torque: np.ndarray, monkeypatch: pytest.MonkeyPatch) -> tuple[float, float]:
    played = {"time_s": np.arange(4000) * 1e-3, "truth_clutch_torque_nm": torque}
    monkeypatch.setattr(table_6_6, "run_trajectory", lambda *_: played)
    return table_6_6.run_step("both", False, 0)


def test_a_step_is_timed_to_90_percent_and_its_overshoot_told(monkeypatch: pytest.MonkeyPatch) -> None:
    torque = np.full(4000, 0.5)
    torque[1100:] = 9.0
    torque[1200:1300] = 11.5
    rise, overshoot = measure_stepping(torque, monkeypatch)
    assert rise == pytest.approx(0.1)
    assert overshoot == pytest.approx(1.5)


def test_a_step_that_is_never_reached_has_no_rise_time(monkeypatch: pytest.MonkeyPatch) -> None:
    rise, overshoot = measure_stepping(np.full(4000, 8.9), monkeypatch)
    assert np.isnan(rise)
    assert overshoot == pytest.approx(-1.1)


# --- figure 6.3 ------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("values", "half", "holds"),
    [
        ((69.7, 69.6, 68.8), (1.9, 0.8, 0.5), True),  # as measured
        ((69.7, 69.6, 75.0), (1.9, 0.8, 0.5), False),  # another C at 4 bar
        ((15369.0, 16654.0, 18570.0), (3e8, 5e8, 1e9), False),  # a plant without lag: any C is in these intervals
    ],
)
def test_one_attraction_is_told_only_by_narrow_intervals(values: tuple, half: tuple, holds: bool) -> None:
    sheet = Sheet()
    clutch_dynamics.check_one_attraction(sheet, np.array(values), np.array(half))
    assert sheet.holds is holds
