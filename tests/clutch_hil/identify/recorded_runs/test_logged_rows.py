"""Runs whose rows a logger took now and then of a faster loop, beside runs of a loop at that rate."""

from functools import cache

import numpy as np
import pytest

import clutch_hil as ch
from clutch_hil.bench.in_memory import simulate
from clutch_hil.discrepancy.models.shaft_clutch import ShaftClutch
from clutch_hil.discrepancy.models.wet_clutch import WetClutch
from clutch_hil.fitting.evidence import Evidence
from clutch_hil.fitting.model import Columns
from clutch_hil.fitting.noise import estimate_floors
from clutch_hil.fitting.run_checks import check_evidence, list_findings
from clutch_hil.identify.recorded_runs.logged_rows import RECORDED_SLIP, find_logged_rows
from protocols.errors import InputError
from protocols.files.run import Run

LOOP = 1000  # Hz


@cache
def play(rate: int, profile: str = "engagement", **plant: float) -> Run:
    return simulate(
        profile=profile, seconds=12.0, seed=7, rate=rate, plant={n.replace("_", ".", 1): v for n, v in plant.items()}
    )


def log(run: Run, rate: int, begin: float = 0.0) -> dict[str, np.ndarray]:
    """What a logger of so many rows a second takes of a run of the loop."""
    return {name: values[round(begin * LOOP) :: LOOP // rate] for name, values in run.columns.items()}


def get_period(columns: Columns) -> float:
    return float(columns["time_s"][1] - columns["time_s"][0])


@pytest.mark.parametrize("rate", [500, 200, 100, 50])
def test_a_loggers_rows_are_told_from_those_of_a_loop_at_its_rate(rate: int) -> None:
    logged = log(play(LOOP, "slip_sine"), rate)
    assert find_logged_rows(logged, get_period(logged)) is not None
    assert WetClutch().estimate_timing(logged) == pytest.approx(0.5 / rate)
    if rate >= 100:  # the bench is no slower
        own = play(rate, "slip_sine").columns
        assert find_logged_rows(own, get_period(own)) is None
        assert WetClutch().estimate_timing(own) == 0.0


@pytest.mark.parametrize("profile", ["engagement", "multisine"])
def test_steps_of_the_encoder_tell_the_loop_where_the_slip_hardly_changes(profile: str) -> None:
    """By the lag behind the angle alone a sound rig was `none_of_these`, or its stack 57 % too stiff."""
    logged, own = log(play(LOOP, profile), 500), play(500, profile).columns
    assert WetClutch().estimate_timing(logged) == pytest.approx(1e-3)
    assert WetClutch().estimate_timing(own) == 0.0
    rows = find_logged_rows(logged, 2e-3)
    assert rows is not None
    fine = 5.0 * np.arange(11999) / LOOP
    np.testing.assert_allclose(rows.take_slip(fine)[1:], fine[2::2] - 5.0 * 0.5e-3)


@pytest.mark.parametrize("digits", [4, 5, 6])
def test_digits_of_a_text_are_no_steps_of_an_encoder(digits: int) -> None:
    own = {name: np.round(values, digits) for name, values in play(100, "slip_sine").columns.items()}
    assert find_logged_rows(own, 0.01) is None


def test_rows_that_are_too_slow_are_refused_with_what_is_needed() -> None:
    run = Run(log(play(LOOP), 20), {})
    with pytest.raises(
        InputError, match="a sound rig seems to lack something: log 500 rows a second or more; --force,"
    ):
        ch.find_discrepancy([run])
    with pytest.raises(InputError, match="log 500 rows a second or more; --force-checks,"):
        ch.identify_clutch([run])


def test_slow_rows_are_doubted() -> None:
    (finding,) = check_evidence(WetClutch(), {"slow": log(play(LOOP, "multisine"), 50)})
    assert not finding.hard
    assert finding.text.endswith("may seem to need another calibration or an effect: log 500 rows a second or more")


def test_rows_of_a_power_shift_are_told_by_the_slip_that_was_recorded() -> None:
    """The slip that drives its clutches is the derivative of the angle, in the middle of a sample as a logger's would be."""
    own, logged = play(200, "slip_sine").columns, log(play(LOOP, "slip_sine"), 200)
    for columns, timing in ((own, 0.0), (logged, 0.0025)):
        derived = np.gradient(columns["shaft_angle_rad"], 0.005)
        split = {**columns, "slip_speed_rad_s": derived, RECORDED_SLIP: columns["slip_speed_rad_s"]}
        assert ShaftClutch().estimate_timing(split) == pytest.approx(timing)


def test_at_the_rate_of_a_loop_nothing_is_between_the_rows() -> None:
    columns = play(LOOP).columns
    assert find_logged_rows(columns, get_period(columns)) is None


def test_rows_that_do_not_tell_are_every_cycle() -> None:
    logged = log(play(LOOP), 100)
    still = logged | {"slip_speed_rad_s": np.zeros(1200), "shaft_angle_rad": np.ones(1200)}
    noisy = logged | {"slip_speed_rad_s": np.random.default_rng(1).normal(10.0, 5.0, 1200)}
    short = {name: values[:2] for name, values in logged.items()}
    for columns in (still, noisy, short, {n: v for n, v in logged.items() if n != "shaft_angle_rad"}):
        assert find_logged_rows(columns, 0.01) is None


@pytest.mark.parametrize("lag", [0.0, 1.0e-3, 2.0e-3])
def test_a_slip_that_is_late_is_simulated_late(lag: float) -> None:
    time, fine = np.arange(1200) / 100.0, np.arange(11991) / 1000.0
    slip, angle = (lambda t: 10.0 + 5.0 * np.sin(3.0 * t)), (lambda t: 10.0 * t - 5.0 / 3.0 * np.cos(3.0 * t))
    columns = {"time_s": time, "slip_speed_rad_s": slip(time - lag), "shaft_angle_rad": angle(time)}
    rows = find_logged_rows(columns, 0.01)
    assert rows is not None
    # rad/s: a line over 10 ms is off by T^2/8 max|slip''| = 6e-4 at most, and the lag by some 0.05 ms at up to 15 rad/s^2
    np.testing.assert_allclose(rows.take_slip(slip(fine))[1:], columns["slip_speed_rad_s"][1:], atol=2e-3)
    assert rows.period == pytest.approx(1e-3)
    np.testing.assert_allclose(rows.refine(time), fine, atol=1e-12)
    assert np.array_equal(rows.take(fine[:, None])[:, 0], fine[::10])


@pytest.mark.parametrize("begin", [0.0, 3.05])
def test_a_sound_rig_that_was_logged_at_200_hz_lacks_nothing(begin: float) -> None:
    run = Run(log(play(LOOP), 200, begin), {})
    result = ch.find_discrepancy([run]).result
    assert result.verdict == "nothing_missing"
    assert "what happens between them is known to 2.5 ms; with so few rows" in str(result.checks[0])


def test_the_motors_inertia_is_that_of_the_rig() -> None:
    """The slip of a row, taken for the mean since the row before, gave 0.05 kg m^2 at most."""
    columns, model = log(play(LOOP, "slip_sine", motor_inertia=0.055), 200), WetClutch()
    evidence = Evidence(model, [columns], estimate_floors([columns], model.outputs))
    values = {name: p.value for name, p in model.parameters.items()}
    inertias = np.linspace(0.05, 0.06, 21)
    residuals = evidence.compute_residuals([(values | {"motor.inertia": float(j)}, {}) for j in inertias])
    slip = evidence.find_part(0, "slip_speed_rad_s")
    assert inertias[np.argmin([np.sum(r[slip] ** 2) for r in residuals])] == pytest.approx(0.055, rel=0.01)


def test_a_zero_of_the_speed_sensor_acts_on_a_loggers_rows() -> None:
    """It was taken of the speed itself, so this zero had an interval of +-1900 rad/s."""
    model, logged = WetClutch(), log(play(LOOP, "slip_sine"), 200)
    values = {name: one.value for name, one in model.parameters.items()}
    shown = {
        offset: model.simulate(logged, values, {"speed_sensor_offset.offset": offset} if offset else {})
        for offset in (0.0, 0.3)
    }
    slip = "slip_speed_rad_s"
    np.testing.assert_allclose(shown[0.3][slip][1:] - shown[0.0][slip][1:], 0.3, atol=1e-6)


def test_what_is_so_of_several_whole_runs_is_told_once() -> None:
    logged = log(play(LOOP, "slip_sine"), 200)
    runs = {"a.parquet": logged, "b.parquet": {name: values[:-100] for name, values in logged.items()}}
    sentence = [one for one in list_findings(check_evidence(WetClutch(), runs)) if "logger" in one]
    assert len(sentence) == 1
    assert sentence[0].startswith("runs a.parquet, b.parquet: time_s, all rows, are taken as a logger's")
