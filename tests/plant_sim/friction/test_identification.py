"""Identification: virgin curve, break points, Maxwell-slip elements, and asymmetric loops."""

from itertools import pairwise
from math import inf

import numpy as np
import pytest

from plant_sim.friction.dahl import Dahl
from plant_sim.friction.identification.asymmetric import ShapedElements, TwoSidedElements, fit_shaped, fit_two_sided
from plant_sim.friction.identification.break_points import CurvatureSpacing, EqualSpacing
from plant_sim.friction.identification.maxwell_slip import compute_error, make_matrix, solve, virgin_force
from plant_sim.friction.identification.maxwell_slip import fit as fit_elements
from plant_sim.friction.identification.virgin_curve import VirginCurve, find_reversals, from_half_loop, from_loops
from plant_sim.friction.maxwell_slip import MaxwellSlip
from plant_sim.friction.shaped import ShapedMaxwellSlip
from protocols.errors import InputError

REACH = 15e-6  # m
MODEL = MaxwellSlip([3e6, 2e6, 1e6, 0.5e6], [3.0, 4.0, 5.0, 6.0])  # slip at 1, 2, 5, 12 um
BREAKS = MODEL.limits / MODEL.stiffness
X = np.linspace(0.0, 20e-6, 2001)
SMOOTH = VirginCurve(X, 10.0 * (1.0 - np.exp(-X / 3e-6)))  # most of its curvature near the origin
SPRING = VirginCurve(X, SMOOTH.force + 2e5 * X)  # never saturates


def make_path(turns: np.ndarray, samples: int) -> np.ndarray:
    """Positions through `turns`, `samples` a stroke."""
    return np.append(np.concatenate([np.linspace(a, b, samples + 1)[:-1] for a, b in pairwise(turns)]), turns[-1])


def make_triangle(reach: float, samples: int, cycles: int = 1) -> np.ndarray:
    """Virgin loading to `reach`, then full cycles, `samples` a stroke."""
    return make_path(np.array([0.0, reach, *[-reach, reach] * cycles]), samples)


def make_half_loop(model: MaxwellSlip = MODEL) -> tuple[np.ndarray, np.ndarray]:
    position = make_triangle(REACH, 600)
    return position[1200:], model.trace(position, 1e-3).force[1200:]


# --- virgin curve ---------------------------------------------------------------------------------------------------------


def test_half_a_loop_is_the_virgin_curve_twice_as_large() -> None:
    position = make_triangle(REACH, 600)
    force = MODEL.trace(position, 1e-3).force
    for stroke in (slice(600, 1201), slice(1200, 1801)):  # down, up
        curve = from_half_loop(position[stroke], force[stroke])
        assert curve.stroke == pytest.approx(REACH)
        np.testing.assert_allclose(curve.force, virgin_force(MODEL, curve.position), atol=1e-12)


def test_virgin_curve_predicts_any_branch() -> None:
    """Masing: the same curve gives a branch from any reversal, also an inner one."""
    curve = from_half_loop(*make_half_loop())
    turn, back = 7e-6, -2e-6
    position = np.concatenate([np.linspace(0.0, turn, 141), np.linspace(turn, back, 181)[1:]])
    force = MODEL.trace(position, 1e-3).force
    np.testing.assert_allclose(curve.branch(position[140:], turn, force[140]), force[140:], atol=1e-10)


def test_virgin_curve_is_odd() -> None:
    np.testing.assert_array_equal(SMOOTH(-X), -SMOOTH(X))


@pytest.mark.parametrize("side", [-1, 0, 1])
def test_noise_of_many_cycles_averages_out(side: int) -> None:
    """Force noise of 3 % of the height, offset and noise of the position: the curve is right within 1 %."""
    rng = np.random.default_rng(1)
    position = REACH * np.sin(2.0 * np.pi * np.arange(20000) * 1e-3)
    force = MODEL.trace(position, 1e-3).force + 0.7 + rng.normal(0.0, 0.5, position.size)
    curve = from_loops(position + rng.normal(0.0, 2e-8, position.size), force, side=side)
    assert np.abs(curve.force - virgin_force(MODEL, curve.position)).max() < 0.01 * MODEL.limits.sum()


def test_more_cycles_average_better() -> None:
    errors = []
    for cycles in (2, 50):
        result = []
        for seed in range(6):
            position = make_triangle(REACH, 300, cycles)
            force = MODEL.trace(position, 1e-3).force + np.random.default_rng(seed).normal(0.0, 1.0, position.size)
            curve = from_loops(position, force, points=30)
            result.append(np.mean((curve.force - virgin_force(MODEL, curve.position)) ** 2))
        errors.append(np.sqrt(np.mean(result)))
    assert errors[1] < errors[0] / 3.0  # the square root of 25 would be 5


def test_inner_loops_of_a_record_are_left_out() -> None:
    turns = np.array([0.0, 1.0, -1.0, 0.2, -1.0, 1.0, -0.3, 1.0, -1.0, 1.0]) * REACH
    position = make_path(turns, 400)
    curve = from_loops(position, MODEL.trace(position, 1e-3).force)
    assert np.abs(curve.force - virgin_force(MODEL, curve.position)).max() < 0.005 * MODEL.limits.sum()


def test_reversals_ignore_noise() -> None:
    position = make_triangle(1.0, 500, 3) + np.random.default_rng(2).normal(0.0, 0.002, 500 * 7 + 1)
    result = find_reversals(position)
    np.testing.assert_allclose(result, np.arange(1, 7) * 500, atol=3)


# --- break points ---------------------------------------------------------------------------------------------------------


def test_equal_spacing_is_equal_and_ends_at_saturation() -> None:
    curve = VirginCurve([0.0, 1.0, 4.0, 10.0], [0.0, 2.0, 3.0, 3.0])
    np.testing.assert_allclose(EqualSpacing().place(curve, 4), [1.0, 2.0, 3.0, 4.0])


def test_distance_is_inverse_to_the_second_derivative() -> None:
    """For f'' proportional to exp(-x/l) the distance of break points times f'' between them is the same everywhere."""
    points = CurvatureSpacing().place(SMOOTH, 12)
    middle = (points[1:-2] + points[2:-1]) / 2.0
    product = np.diff(points)[1:-1] * np.exp(-middle / 3e-6)
    assert product.max() / product.min() < 1.06
    assert np.sum(points < 6e-6) >= 10  # where 86 % of the curvature is


def test_curvature_spacing_gives_elements_of_equal_stiffness() -> None:
    """The thesis's rule in other words; the last element takes what curvature is left before the end."""
    bent, equal = (solve(SMOOTH, s.place(SMOOTH, 12)).stiffness[:-2] for s in (CurvatureSpacing(), EqualSpacing()))
    assert bent.max() / bent.min() < 1.03
    assert equal.max() / equal.min() > 100.0


def test_equal_curvature_gives_equal_spacing() -> None:
    parabola = VirginCurve(X, X * (2.0 * X[-1] - X))
    np.testing.assert_allclose(CurvatureSpacing().place(parabola, 5), EqualSpacing().place(parabola, 5), rtol=1e-3)


def test_break_points_find_the_kinks_of_elements() -> None:
    """The curvature of four elements is at their break points alone, and all but the last point goes there."""
    model = MaxwellSlip([1e6] * 4, np.array([1.0, 2.0, 5.0, 12.0]))
    curve = VirginCurve(X, virgin_force(model, X))
    points = CurvatureSpacing().place(curve, 8)
    distance = np.abs(points[:, None] - np.array([1e-6, 2e-6, 5e-6, 12e-6])).min(axis=1)
    assert distance.max() <= 2e-8  # two samples


# --- elements -------------------------------------------------------------------------------------------------------------


def test_matrix_is_the_sum_written_out() -> None:
    """A k against eq D.2 line by line: the elements before i slip, the others stick."""
    points, stiffness = np.array([1.0, 2.5, 3.0, 7.0]), np.array([4.0, 3.0, 2.0, 1.0])
    heights = [
        sum(stiffness[j] * points[j] for j in range(i)) + sum(stiffness[j] * points[i] for j in range(i, 4))
        for i in range(4)
    ]
    np.testing.assert_allclose(make_matrix(points, points) @ stiffness, heights)


def test_own_break_points_return_the_elements() -> None:
    result = solve(from_half_loop(*make_half_loop()), BREAKS)
    np.testing.assert_allclose(result.stiffness, MODEL.stiffness, rtol=1e-9)
    np.testing.assert_allclose(result.limits, MODEL.limits, rtol=1e-9)


def test_elements_run_through_the_curve_at_break_points() -> None:
    points = CurvatureSpacing().place(SMOOTH, 6)
    np.testing.assert_allclose(virgin_force(solve(SMOOTH, points), points), SMOOTH(points))


@pytest.mark.parametrize("spacing", [EqualSpacing(), CurvatureSpacing(0.5)])
def test_error_falls_with_the_square_of_the_number(spacing: EqualSpacing | CurvatureSpacing) -> None:
    errors = [compute_error(solve(SMOOTH, spacing.place(SMOOTH, n)), SMOOTH) for n in (16, 32, 64)]
    assert (np.divide(errors[:-1], errors[1:]) > 3.5).all()  # 4 in the limit


def test_few_elements_fit_better_where_the_curve_bends() -> None:
    for number in (2, 4):
        equal, bent = (
            compute_error(solve(SMOOTH, s.place(SMOOTH, number)), SMOOTH) for s in (EqualSpacing(), CurvatureSpacing())
        )
        assert bent < equal


def test_root_of_the_curvature_makes_the_error_even() -> None:
    """Distances inverse to the root of f'' give every piece the same error, so the largest is smaller than with either rule."""
    for number in (4, 8, 16, 32):
        rules = (EqualSpacing(), CurvatureSpacing(1.0), CurvatureSpacing(0.5))
        equal, thesis, root = (compute_error(solve(SMOOTH, rule.place(SMOOTH, number)), SMOOTH) for rule in rules)
        assert root < 0.5 * min(equal, thesis)


def test_element_that_never_slips_carries_the_slope_beyond() -> None:
    """Its model goes on rising beyond the record; the saturating one does not."""
    points = EqualSpacing().place(SPRING, 8)
    free, bounded = (solve(SPRING, points, saturating) for saturating in (False, True))
    assert free.limits[-1] == inf
    x = np.array([20e-6, 40e-6])
    assert np.ptp(virgin_force(bounded, x)) == 0.0
    assert np.ptp(virgin_force(free, x)) == pytest.approx(2e5 * 20e-6, rel=0.05)
    np.testing.assert_allclose(virgin_force(free, points), SPRING(points))


def test_least_squares_is_the_nearest() -> None:
    """Nearer than the elements that run through the points, and no single stiffness can be bettered."""
    points = CurvatureSpacing(0.5).place(SMOOTH, 4)

    def square(model: MaxwellSlip) -> float:
        return float(np.mean((virgin_force(model, X) - SMOOTH.force) ** 2))

    best = fit_elements(SMOOTH, points)
    assert square(best) < square(solve(SMOOTH, points))
    for i in range(4):
        for factor in (0.99, 1.01):
            stiffness = best.stiffness * np.where(np.arange(4) == i, factor, 1.0)
            assert square(MaxwellSlip(stiffness, stiffness * points)) > square(best)


def test_identified_model_plays_the_measured_record() -> None:
    """From a noisy record to elements, then a record they have not seen, with inner loops: within 2 % of the height."""
    rng = np.random.default_rng(4)
    position = make_triangle(REACH, 500, 10)
    truth = Dahl(10.0, 4e6)  # not a Maxwell-slip model, but with no inner loop it is nearly one
    force = MODEL.trace(position, 1e-3).force + rng.normal(0.0, 0.3, position.size)
    curve = from_loops(position, force)
    model = fit_elements(curve, CurvatureSpacing(0.5).place(curve, 10))
    time = np.arange(4000) * 1e-3
    other = 8e-6 * np.sin(2 * np.pi * time) + 5e-6 * np.sin(2 * np.pi * 3.7 * time)
    seen, wanted = model.trace(other, 1e-3).force, MODEL.trace(other, 1e-3).force
    assert np.sqrt(np.mean((seen - wanted) ** 2)) < 0.02 * MODEL.limits.sum()
    assert np.sqrt(np.mean((truth.trace(other, 1e-3).force - wanted) ** 2)) > 0.02 * MODEL.limits.sum()


# --- asymmetric loops -----------------------------------------------------------------------------------------------------

UP, DOWN = MaxwellSlip([2e6, 1e6], [2.0, 4.0]), MaxwellSlip([3e6, 1e6], [3.0, 3.0])  # equal heights, unequal sums
LEVEL = MaxwellSlip([2.5e6, 0.5e6], [2.0, 4.0])  # same sum and height as UP


def test_unequal_sums_of_stiffness_drift_with_every_cycle() -> None:
    pair = TwoSidedElements(UP, DOWN, 8e-6)
    stroke, cycles = 0.5e-6, 40
    _, force = pair.play(np.tile([0.0, stroke], cycles + 1)[:-1])
    assert force[-1] == pytest.approx(-cycles * 1e6 * stroke)
    condition = pair.equal_stiffness()
    assert not condition.holds
    assert condition.violation == pytest.approx(-1e6)
    assert "drifts 1e+06 N down" in condition.statement


def test_equal_sums_of_stiffness_do_not_drift_in_small_strokes() -> None:
    pair = TwoSidedElements(UP, LEVEL, 8e-6)
    _, force = pair.play(np.tile([0.0, 0.5e-6], 1001)[:-1])
    assert abs(force[-1]) < 1e-12
    assert pair.equal_stiffness().holds


def test_equal_sums_alone_do_not_close_the_loops() -> None:
    """Condition 2 is one of its own, and its statement gives the gap that playing the loop shows."""
    pair = TwoSidedElements(UP, LEVEL, 8e-6)
    condition = pair.return_through_extreme()
    assert not condition.holds
    stroke = float(condition.statement.split()[-2])
    _, force = pair.play([stroke, 0.0, stroke])
    assert -force[-1] == pytest.approx(condition.violation, rel=1e-4)
    assert force[-1] != pytest.approx(0.0, abs=0.1)


def test_first_condition_is_the_slope_of_the_second() -> None:
    pair = TwoSidedElements(UP, DOWN, 8e-6)
    assert pair.gap(1e-9) / 1e-9 == pytest.approx(-pair.equal_stiffness().violation)


def test_same_elements_on_both_sides_meet_both_conditions() -> None:
    pair = TwoSidedElements(UP, UP, 8e-6)
    assert pair.equal_stiffness().holds
    assert pair.return_through_extreme().holds


def test_constrained_fit_meets_what_the_free_fit_violates() -> None:
    up = VirginCurve(X, 10.0 * (1.0 - np.exp(-X / 3e-6)))
    down = VirginCurve(X, 9.0 * (1.0 - np.exp(-X / 2e-6)))
    points = CurvatureSpacing(0.5).place(up, 6)
    free, tied = (fit_two_sided(up, down, points, constrained) for constrained in (False, True))
    assert not free.equal_stiffness().holds
    assert abs(free.gap(2.0 * X[-1])) > 1.0
    assert tied.equal_stiffness().holds
    assert abs(tied.gap(2.0 * X[-1])) < 1e-6
    assert np.abs(tied.gap(2.0 * X)).max() < np.abs(free.gap(2.0 * X)).max()
    misfit = [np.abs(virgin_force(s.up, X) - up.force).max() for s in (free, tied)]
    assert misfit[1] > misfit[0]  # the conditions cost fit


def test_shaped_elements_are_asymmetric_and_still_close_every_loop() -> None:
    shaped = ShapedElements(MODEL, [0.4, 0.1], REACH)
    turns = np.array([0.0, 1.0, -1.0, 1.0, 0.1, 0.6, 0.1, 1.0]) * REACH
    position = make_path(turns, 300)
    force = shaped.force(position)
    highest, lowest = force[900], force[600]
    assert abs(highest) > 1.5 * abs(lowest)  # asymmetric
    assert force[-1] == pytest.approx(highest, rel=1e-12)  # condition 2
    assert force[1800] == pytest.approx(force[1200], rel=1e-12)  # the inner loop closes
    small = REACH * (0.5 + 0.02 * np.sin(np.arange(200000) * 2 * np.pi / 200))
    played = shaped.force(np.append(0.0, small))
    assert played[-200:].mean() == pytest.approx(
        played[400:600].mean(), rel=1e-9
    )  # condition 1: no drift in 1000 cycles


def test_shaped_fit_returns_elements_and_shape() -> None:
    position = make_triangle(REACH, 400, 2)
    truth = ShapedElements(MODEL, np.array([0.4, -0.1]), REACH)
    result = fit_shaped(position, truth.force(position), BREAKS)
    np.testing.assert_allclose(result.shape, truth.shape, atol=1e-6)
    np.testing.assert_allclose(result.elements.stiffness, MODEL.stiffness, rtol=1e-5)


# --- bad input ------------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("make", "sentence"),
    [
        (lambda: VirginCurve([0.0, 1.0, 2.0], [0.0, 2.0, 1.5]), "falls from 2 to 1.5 N after 1 m"),
        (lambda: VirginCurve([0.0, 1.0, 1.0], [0.0, 1.0, 2.0]), "does not rise after 1 m"),
        (lambda: VirginCurve([0.0, 1.0, 2.0], [0.5, 1.0, 2.0]), "begins at (0, 0.5)"),
        (lambda: VirginCurve([0.0, 1.0], [0.0, 1.0]), "has 2 points; 3 or more are needed"),
        (lambda: VirginCurve([0.0, 1.0, 2.0], [0.0, np.nan, 2.0]), "force of the virgin curve holds nan"),
        (lambda: VirginCurve([0.0, 1.0, 2.0], [0.0, 1.0]), "vectors of equal length"),
        (lambda: SMOOTH(1.0), "position 1 m is beyond the virgin curve, which ends at 2e-05 m"),
        (lambda: from_half_loop([0.0, 1.0, 0.5], [0.0, 1.0, 0.0]), "reverses or rests"),
        (lambda: from_loops(np.linspace(0, 1, 500), np.linspace(0, 1, 500)), "no reversal"),
        (lambda: from_loops(make_triangle(1.0, 20), make_triangle(1.0, 20)), "60 points need 180 or more"),
        (
            lambda: from_loops(make_triangle(1.0, 300)[:700], make_triangle(1.0, 300)[:700], side=1),
            "no full stroke upwards",
        ),
        (
            lambda: from_loops(make_triangle(1.0, 300), make_triangle(1.0, 300), points=0),
            "number of points is 0; allowed is a",
        ),
        (lambda: from_loops(make_triangle(1.0, 300), make_triangle(1.0, 300), points=-1), "number of points is -1"),
        (lambda: from_loops(make_triangle(1.0, 300), make_triangle(1.0, 300), points=1), "whole number of 2 or more"),
        (lambda: from_loops(make_triangle(1.0, 300), make_triangle(1.0, 300), points=9.5), "number of points is 9.5"),
        (
            lambda: from_loops(make_triangle(1.0, 300), make_triangle(1.0, 300), side=5),
            "side is 5; allowed is 1 (upward",
        ),
        (lambda: from_loops(["a", "b", "c"], [0.0, 1.0, 2.0]), "position of the record is ['a', 'b', 'c']"),
        (lambda: find_reversals([]), "position has shape (0,)"),
        (lambda: find_reversals([0.0, 1.0], np.nan), "dead band is nan"),
        (lambda: from_loops(make_triangle(1.0, 300), -make_triangle(1.0, 300)), "which no Maxwell-slip elements do"),
        (lambda: EqualSpacing().place(SMOOTH, 0), "number of break points is 0"),
        (lambda: CurvatureSpacing(0.0), "exponent of the curvature is 0"),
        (lambda: EqualSpacing().place(SMOOTH, 2.5), "number of break points is 2.5"),
        (lambda: solve(SMOOTH, "ab"), "break points is 'ab'; allowed are numbers"),
        (lambda: solve(SMOOTH, [1e-6, 3e-5]), "break point 3e-05 m is beyond the virgin curve"),
        (lambda: solve(SMOOTH, [2e-6, 1e-6]), "break points do not rise"),
        (lambda: solve(SMOOTH, []), "break points have shape (0,)"),
        (lambda: solve(VirginCurve([0, 1, 2], [0, 1, 3]), [1.0, 2.0]), "element 1 would have a stiffness of -1 N/m"),
        (lambda: ShapedElements(MODEL, [2.0], 1.0), "must be above 0"),
        (lambda: ShapedElements(MODEL, [0.1], -1.0), "reach is -1 m; allowed is a number above 0"),
        (lambda: ShapedElements(MODEL, [0.1], np.inf), "reach is inf m"),
        (lambda: ShapedElements(MODEL, [np.nan], 1.0), "shape holds nan"),
        (lambda: ShapedElements(MODEL, 0.1, 1.0), "shape has shape (); it must be a vector"),
        (lambda: ShapedElements([1.0], [0.1], 1.0), "elements is [1.0]; a MaxwellSlip is needed"),
        (lambda: ShapedMaxwellSlip(ShapedElements(MODEL, [0.1], 1.0), np.nan), "start position is nan m"),
        (lambda: TwoSidedElements(MODEL, MODEL, 0.0), "reach is 0 m; allowed is a number above 0"),
        (lambda: TwoSidedElements(MODEL, 3.0, 1.0), "elements downwards is 3.0; a MaxwellSlip is needed"),
    ],
)
def test_bad_input_is_told_in_one_sentence(make: object, sentence: str) -> None:
    with pytest.raises(InputError) as caught:
        make()  # type: ignore[operator]
    assert sentence in str(caught.value)
