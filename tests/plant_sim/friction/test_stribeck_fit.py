"""Fits of Stribeck curves and of the load law: Nelder-Mead and bounded least squares."""

import numpy as np
import pytest

from plant_sim.friction.identification.stribeck_fit import (
    CLUTCH,
    DEPTH,
    LOAD,
    STRIBECK,
    SteadyLaw,
    fit_by_simplex,
    fit_least_squares,
    fit_stribeck,
)
from plant_sim.friction.load_law import LoadLaw
from plant_sim.friction.stribeck import Stribeck
from protocols.errors import InputError

SPEED = np.linspace(0.5, 50.0, 40)
TRUTH = {"static_force": 0.7, "a_1": 1.6, "v_s": 3.0, "sigma_v": 0.03, "gamma": 0.6}
CURVE = Stribeck.from_depth(0.7, 1.6, 3.0, 0.03, 0.6)(SPEED)
NOISE = 0.003
LOADS = np.array([50.0, 100.0, 200.0, 280.0, 400.0, 560.0, 840.0, 1120.0])  # N, range of fig 4.14
CLUTCH_SPEED = np.linspace(0.2, 26.0, 60)  # rad/s, range of fig 4.16


def make_noisy_curve(seed: int = 0, size: float = NOISE) -> np.ndarray:
    return CURVE + np.random.default_rng(seed).normal(0.0, size, SPEED.size)


@pytest.mark.parametrize(
    ("law", "x", "truth"),
    [
        (STRIBECK, SPEED, (20.0, 0.4, 5.0, 1.0, 0.5)),
        (DEPTH, SPEED, tuple(TRUTH.values())),
        (CLUTCH, CLUTCH_SPEED, (11.6, 0.704, 11.52, 2.59, 1.0 / 3.0)),  # tables 6.4 and 6.5 at 3.4 bar, eq 6.5
        (LOAD, LOADS, (0.25, 1.8, 200.0)),  # 0.25 down to about 0.11 (fig 4.14)
    ],
)
def test_both_methods_return_the_parameters_of_a_clean_curve(
    law: SteadyLaw, x: np.ndarray, truth: tuple[float, ...]
) -> None:
    y = law.evaluate(x, *truth)
    np.testing.assert_allclose(fit_least_squares(law, x, y).values, truth, rtol=1e-5)
    np.testing.assert_allclose(list(fit_by_simplex(law, x, y).values.values()), truth, rtol=1e-3)


@pytest.mark.parametrize("seed", range(5))
def test_both_methods_find_the_same_minimum(seed: int) -> None:
    """Same RMSE, and parameters that differ by a small part of what the noise leaves open."""
    simplex, bounded = (
        fit_by_simplex(DEPTH, SPEED, make_noisy_curve(seed)),
        fit_least_squares(DEPTH, SPEED, make_noisy_curve(seed)),
    )
    assert simplex.rmse == pytest.approx(bounded.rmse, rel=1e-6)
    width = np.ptp(bounded.intervals, axis=1)
    assert (np.abs(np.array(list(simplex.values.values())) - bounded.values) < 0.02 * width).all()
    assert bounded.evaluations < simplex.evaluations


def test_rmse_is_that_of_the_fitted_curve() -> None:
    result = fit_least_squares(DEPTH, SPEED, make_noisy_curve())
    assert result.rmse == pytest.approx(
        np.sqrt(np.mean((Stribeck.from_depth(*result.values)(SPEED) - make_noisy_curve()) ** 2))
    )
    assert result.rmse == pytest.approx(NOISE * np.sqrt(35 / 40), rel=0.3)


def test_two_forms_are_one_curve() -> None:
    """Eq 4.1 is eq 1.4 with beta = 1 - 1/a_1 and C_v = F_s sigma_v."""
    plain, depth = (
        fit_least_squares(STRIBECK, SPEED, make_noisy_curve()),
        fit_least_squares(DEPTH, SPEED, make_noisy_curve()),
    )
    assert plain.rmse == pytest.approx(depth.rmse, rel=1e-9)
    assert plain["beta"] == pytest.approx(1.0 - 1.0 / depth["a_1"], rel=1e-4)
    assert plain["viscous"] == pytest.approx(depth["static_force"] * depth["sigma_v"], rel=1e-3)


def test_intervals_hold_the_truth_as_often_as_they_say() -> None:
    """95 % over 80 draws of five parameters; 0.05 is four standard deviations of that mean, were the five independent."""
    inside = np.mean([fit_least_squares(DEPTH, SPEED, make_noisy_curve(seed)).contains(TRUTH) for seed in range(80)])
    assert inside == pytest.approx(0.95, abs=0.05)


def test_covariance_is_the_scatter_of_repeated_fits() -> None:
    fits = [fit_least_squares(DEPTH, SPEED, make_noisy_curve(seed)) for seed in range(80)]
    scatter = np.std([fit.values for fit in fits], axis=0)
    estimated = np.sqrt(np.mean([np.diag(fit.covariance) for fit in fits], axis=0))
    np.testing.assert_allclose(estimated, scatter, rtol=0.25)  # 80 draws tell a scatter within 8 %


def test_viscous_factor_and_exponent_are_hardly_told_apart() -> None:
    result = fit_least_squares(DEPTH, SPEED, make_noisy_curve())
    names = list(result.names)
    assert result.correlation[names.index("sigma_v"), names.index("gamma")] < -0.99
    np.testing.assert_allclose(np.diag(result.correlation), 1.0)
    np.testing.assert_allclose(result.correlation, result.correlation.T)


def test_frozen_parameters_make_the_others_sure() -> None:
    """As in fig 4.16, which keeps v_s and gamma."""
    held = {"v_s": 3.0, "gamma": 0.6}
    free, kept = (
        fit_least_squares(DEPTH, SPEED, make_noisy_curve()),
        fit_least_squares(DEPTH, SPEED, make_noisy_curve(), frozen=held),
    )
    assert kept.names == ("static_force", "a_1", "sigma_v")
    assert kept.frozen == held
    for name in kept.names:
        assert np.ptp(kept.intervals[kept.names.index(name)]) < 0.5 * np.ptp(free.intervals[free.names.index(name)])
    assert kept.contains(TRUTH).all()
    simplex = fit_by_simplex(DEPTH, SPEED, make_noisy_curve(), frozen=held)
    assert simplex.values["gamma"] == 0.6
    np.testing.assert_allclose([simplex.values[name] for name in kept.names], kept.values, rtol=1e-4)


def test_exponent_of_nothing_is_not_identifiable() -> None:
    """Without viscous friction its exponent changes nothing."""
    result = fit_least_squares(
        STRIBECK, SPEED, Stribeck(1.0, 0.5, 3.0)(SPEED), start={"viscous": 0.0}, frozen={"viscous": 0.0}
    )
    assert result.doubts == ("exponent is not identifiable: it has no influence on these data",)
    assert result["beta"] == pytest.approx(0.5)


def test_points_far_above_the_stribeck_velocity_leave_its_effect_open() -> None:
    """At high speed the Stribeck part is flat: static force, depth and velocity are known together at best."""
    speed = np.linspace(40.0, 50.0, 40)
    y = Stribeck.from_depth(*TRUTH.values())(speed) + np.random.default_rng(0).normal(0.0, NOISE, 40)
    assert any("identifiable" in doubt for doubt in fit_least_squares(DEPTH, speed, y).doubts)
    assert fit_least_squares(DEPTH, SPEED, make_noisy_curve()).doubts == ()


def test_load_law_saturates_where_the_data_say() -> None:
    """Friction coefficient falls from 0.25 at 50 N towards 0.11 (fig 4.14): both limits come back with their intervals."""
    truth = {"coefficient": 0.25, "a_2": 1.8, "load_scale": 200.0}
    force = LoadLaw(*truth.values())(LOADS) * (1.0 + np.random.default_rng(3).normal(0.0, 0.005, LOADS.size))
    result = fit_least_squares(LOAD, LOADS, force)
    assert result.contains(truth).all()
    assert fit_by_simplex(LOAD, LOADS, force).rmse == pytest.approx(result.rmse, rel=1e-6)


@pytest.mark.parametrize("fit", [fit_by_simplex, fit_least_squares])
@pytest.mark.parametrize(
    ("x", "y", "options", "sentence"),
    [
        (SPEED[:4], CURVE[:4], {}, "measured curve has 4 points; 6 or more are needed"),
        (SPEED, CURVE[:-1], {}, "vectors of equal length"),
        (SPEED, np.where(SPEED > 40.0, np.nan, CURVE), {}, "force of the measured curve holds nan"),
        (SPEED - 1.0, CURVE, {}, "has a point at -0.5; allowed are points above 0"),
        (SPEED, CURVE, {"frozen": {"beta": 0.5}}, "parameter 'beta' is not in eq 4.1"),
        (SPEED, CURVE, {"frozen": TRUTH}, "no parameter of eq 4.1 is to be fitted"),
    ],
)
def test_bad_input_is_told_in_one_sentence(
    fit: object, x: np.ndarray, y: np.ndarray, options: dict, sentence: str
) -> None:
    with pytest.raises(InputError) as caught:
        fit(DEPTH, x, y, **options)  # type: ignore[operator]
    assert sentence in str(caught.value)


@pytest.mark.parametrize("fit", [fit_by_simplex, fit_least_squares])
def test_what_no_friction_curve_can_be_is_refused(fit) -> None:
    speed = np.linspace(0.1, 1.0, 30)
    with pytest.raises(InputError, match="mean force -1; allowed is above 0"):
        fit(DEPTH, speed, np.full(30, -1.0))
    with pytest.raises(InputError, match=r"start of a_1 is 0\.5; allowed is a number at least 1"):
        fit(DEPTH, speed, np.full(30, 1.0), start={"a_1": 0.5})


def test_a_curve_that_rises_from_rest_is_found() -> None:
    """Boundary lubrication may strengthen with speed: beta above 1."""
    speed = np.geomspace(1e-3, 1.0, 60)
    noise = np.random.default_rng(0).normal(0.0, 0.01, speed.size)
    result = fit_least_squares(STRIBECK, speed, Stribeck(2.0, 1.3, 0.02, 0.4, 0.7)(speed) + noise)
    low, high = result.intervals[1]
    assert low < 1.3 < high
    assert result.rmse < 0.01


def test_points_of_both_directions_make_one_curve() -> None:
    """A table of speed and force as a user has it: any order, both signs."""
    speed = np.geomspace(1e-3, 1.0, 60) * np.where(np.arange(60) % 3 == 0, -1.0, 1.0)
    truth = Stribeck(2.0, 0.6, 0.02, 0.4, 0.7)
    force = truth(speed) + np.random.default_rng(0).normal(0.0, 0.005, speed.size)
    fitted = fit_stribeck(speed.tolist(), force.tolist())
    assert fitted.estimate.contains(dict(zip(STRIBECK.names, truth.block, strict=True))).all()
    assert fitted.curve(0.1) == pytest.approx(truth(0.1), rel=0.01)
    np.testing.assert_array_equal(fitted.curve(-speed), -fitted.curve(speed))
    np.testing.assert_allclose(fit_stribeck(-speed, -force).estimate.values, fitted.estimate.values, rtol=1e-9)
    linear = fit_stribeck(speed, force, frozen={"exponent": 1.0})
    assert linear.curve.exponent == 1.0
    assert linear.estimate.rmse > fitted.estimate.rmse


@pytest.mark.parametrize(
    ("speed", "force", "sentence"),
    [
        ([1.0, 2.0], [1.0], "speed has shape (2,) and force (1,); they must be vectors of equal length"),
        ([0.0, 1.0, 2.0, 3.0, 4.0, 5.0], np.ones(6), "has a point at 0; allowed are points above 0"),
        (np.arange(1.0, 7.0), -np.ones(6), "mean force -1; allowed is above 0"),
        (["slow"], [1.0], "speed [m/s] is ['slow']; allowed are numbers"),
        ([1.0], [1.0], "measured curve has 1 points; 6 or more are needed"),
    ],
)
def test_a_table_that_is_no_curve_is_refused(speed: object, force: object, sentence: str) -> None:
    with pytest.raises(InputError) as caught:
        fit_stribeck(speed, force)
    assert sentence in str(caught.value)
