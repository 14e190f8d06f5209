"""Runs that begin in the middle of an operation, as what is cut out of a longer recording does."""

from functools import cache

import numpy as np
import pytest

import clutch_hil as ch
from clutch_hil.bench.in_memory import simulate
from clutch_hil.discrepancy.models.wet_clutch import WetClutch
from clutch_hil.fitting.model import Columns, simulate_seen
from clutch_hil.identify.recorded_runs.run_beginning import (
    SETTLING,
    begins_in_operation,
    find_initial_state,
    find_speed_integral,
)
from clutch_hil.identify.two_clutches.driveline import DrivelineModel
from plant_sim.rigs import power_shift, wet_clutch
from protocols.files.run import Run

RATE = 1000
PERIOD = 1.0 / RATE
NOISE = {  # of docs/rig.md, 9, and of the encoder's speed over a sample
    "cylinder_pressure_bar": 0.0052, "clutch_torque_nm": 0.05, "motor_torque_nm": 0.052, "slip_speed_rad_s": 0.022,
    "oil_temperature_degc": 0.11,
}  # fmt: skip
SLACK = 1.4  # of the noise: of 0.7 s of samples, and of the coarser steps of the model
LIMIT = "motor_torque_limit_nm"


@cache
def play(profile: str, effect: str = "") -> Run:
    return simulate(profile=profile, seconds=12.0, seed=5, effects=[effect] if effect else [])


def cut(run: Run, begin: float, end: float = np.inf) -> Run:
    rows = (run["time_s"] >= begin) & (run["time_s"] <= end)
    return Run({name: values[rows] for name, values in run.columns.items()}, run.metadata)


def predict(model: WetClutch, columns: Columns) -> dict[str, np.ndarray]:
    return model.simulate(columns, {name: p.value for name, p in model.parameters.items()}, {})


@pytest.mark.parametrize("begin", [1.3, 2.2, 3.05, 4.7, 6.9])
@pytest.mark.parametrize("profile", ["engagement", "multisine", "table-6.6", "reversals", "slip_sine"])
def test_a_sound_run_is_simulated_to_the_noise_wherever_it_begins(profile: str, begin: float) -> None:
    columns = cut(play(profile), begin).columns
    predicted, rows = predict(WetClutch(), columns), slice(round(SETTLING * RATE), RATE)
    for name, noise in NOISE.items():
        off = float(np.sqrt(np.mean((columns[name][rows] - predicted[name][rows]) ** 2)))
        assert off < SLACK * noise, (name, off)


@pytest.mark.parametrize("begin", [3.3, 4.7])
def test_a_run_from_locked_plates_is_compared_after_they_have_slid(begin: float) -> None:
    columns = cut(play("lock"), begin).columns
    predicted = predict(WetClutch(), columns)
    slid = int(np.flatnonzero(columns["slip_speed_rad_s"])[0]) + round(SETTLING * RATE)
    assert RATE < slid < len(columns["time_s"]) // 2
    for name, noise in NOISE.items():
        assert np.array_equal(predicted[name][:slid], columns[name][:slid])
        off = float(np.sqrt(np.mean((columns[name][slid:] - predicted[name][slid:]) ** 2)))
        assert off < SLACK * noise, (name, off)


def test_a_run_that_stays_locked_is_compared_from_its_middle() -> None:
    columns = cut(play("lock"), 3.3, 4.3).columns
    assert not np.any(columns["slip_speed_rad_s"])
    predicted = predict(WetClutch(), columns)["clutch_torque_nm"]
    assert np.count_nonzero(predicted == columns["clutch_torque_nm"]) == pytest.approx(len(predicted) // 2, abs=3)


def test_until_it_has_settled_the_outputs_are_the_measured_ones() -> None:
    columns = cut(play("engagement"), 3.05).columns
    predicted, rows = predict(WetClutch(), columns), round(SETTLING * RATE)
    for name in NOISE:
        assert np.array_equal(predicted[name][:rows], columns[name][:rows])
        assert not np.array_equal(predicted[name][: rows + 1], columns[name][: rows + 1])


def test_of_a_short_run_a_tenth_settles() -> None:
    columns = cut(play("engagement"), 3.0, 4.0).columns
    predicted = predict(WetClutch(), columns)["clutch_torque_nm"]
    assert np.count_nonzero(predicted == columns["clutch_torque_nm"]) == pytest.approx(100, abs=3)


def test_a_run_from_rest_begins_at_rest() -> None:
    columns = play("engagement").columns
    assert not begins_in_operation(columns, PERIOD)
    rig = wet_clutch.Rig(wet_clutch.load_nominal())
    state = find_initial_state(rig, columns, PERIOD, 40.0).read()
    assert (state.pressure, state.position, state.friction_state, state.speed_integral) == (0.0, 0.0, 0.0, 0.0)
    assert state.slip_speed == columns["motor_speed_demand_rad_s"][0]


@pytest.mark.parametrize("effect", ["", "valve_hysteresis"])
def test_the_verdict_on_a_part_is_that_on_the_whole(effect: str) -> None:
    run = play("engagement", effect)
    for part in (run, cut(run, 3.05)):
        outcome = ch.find_discrepancy([part]).result
        assert (outcome.verdict, list(outcome.effects)) == (("named", [effect]) if effect else ("nothing_missing", []))


def test_locked_plates_need_the_limit_of_the_motor() -> None:
    run = play("lock")
    assert np.ptp(run[LIMIT]) > 10.0
    assert ch.find_discrepancy([run]).result.verdict == "nothing_missing"
    without = Run({name: values for name, values in run.columns.items() if name != LIMIT}, run.metadata)
    with pytest.raises(
        ch.InputError, match=f"the plates are locked and the motor is at its limit, which {LIMIT} must state"
    ):
        ch.find_discrepancy([without])


def test_a_limit_that_was_not_recorded_in_some_rows_is_that_of_the_motor() -> None:
    columns = dict(play("engagement").columns)
    whole = predict(WetClutch(), columns)["motor_torque_nm"]
    columns[LIMIT] = np.where(columns["time_s"] < 2.0, np.nan, columns[LIMIT])
    assert np.array_equal(predict(WetClutch(), columns)["motor_torque_nm"], whole)


@pytest.mark.parametrize(
    ("torque", "error", "integral"),
    [
        (10.0, 0.0, 0.25),
        (10.0, 0.5, 0.2),
        (-10.0, 0.0, -0.25),
        (12.0, 10.0, 0.3),  # at its limit, where its integral is held
        (0.0, 0.0, 0.0),
    ],
)
def test_the_integral_of_the_motors_controller_gives_the_measured_torque(
    torque: float, error: float, integral: float
) -> None:
    assert find_speed_integral(torque, error, 12.0, 4.0, 40.0) == pytest.approx(integral)


def test_a_controller_without_an_integral_has_none() -> None:
    assert find_speed_integral(10.0, 0.5, 12.0, 4.0, 0.0) == 0.0


@pytest.mark.parametrize("begin", [0.0, 2.0, 4.0])
def test_a_driveline_moves_as_it_was_measured_wherever_the_run_begins(begin: float) -> None:
    columns = cut(simulate("shift"), begin).columns
    model = DrivelineModel(power_shift.load_nominal(), 1.25e-4)
    values = {name: p.value for name, p in model.parameters.items()}
    predicted = simulate_seen(model, columns, values, {"sticking.passed": 0.5})
    # largest of some thousand rows: a count of the encoder at 500 Hz is 0.02 rad/s, six deviations of the torque are 0.3 Nm
    for name, most in (("slip_speed_a_rad_s", 0.08), ("slip_speed_b_rad_s", 0.08), ("motor_torque_nm", 0.3)):
        assert np.nanmax(np.abs(columns[name] - predicted[name])) < most
