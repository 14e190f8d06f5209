"""Held out: a run is predicted by what the other runs say, within what is known of the baseline."""

import math
from collections.abc import Callable
from types import SimpleNamespace

import numpy as np
import pytest
from scipy.stats import chi2

from clutch_hil.discrepancy.held_out import fit_without_each, note_open_gap
from clutch_hil.discrepancy.result import Gap
from clutch_hil.fitting.fit import CHI2_QUANTILE, FreeParameter, LinearModel

COUNT, LENGTH, RUNS = 30, 200, 3
FREE = tuple(FreeParameter(f"p{i}", 0.1, 1.0, -3.0, 3.0, 0.0) for i in range(COUNT))


def make_linear_model(
    wanted: np.ndarray, bend: Callable[[np.ndarray], np.ndarray] = lambda move: move
) -> tuple[SimpleNamespace, LinearModel]:
    """A model at its known parameters, and runs that ask for others: `wanted` (RUNS, COUNT). bend: what a move really does."""
    jacobian = 100.0 * np.random.default_rng(5).standard_normal((RUNS * LENGTH, COUNT))
    pieces = [slice(k * LENGTH, (k + 1) * LENGTH) for k in range(RUNS)]
    residual = np.concatenate([-jacobian[p] @ w for p, w in zip(pieces, wanted, strict=True)])
    at = LinearModel(({f.name: 0.0 for f in FREE}, {}), FREE, residual, jacobian, 1.0)

    def compute_residuals(points: list) -> list[np.ndarray]:
        moves = [np.array([parameters[f.name] for f in FREE]) for parameters, _ in points]
        return [residual + jacobian @ bend(move) for move in moves]

    evidence = SimpleNamespace(
        runs=[None] * RUNS, pieces=pieces, size=len(residual), compute_residuals=compute_residuals
    )
    return evidence, at


def test_the_run_that_is_left_out_has_no_say() -> None:
    wanted = np.zeros((RUNS, COUNT))
    wanted[2, 0] = 2.0  # of the third run alone
    evidence, at = make_linear_model(wanted)
    firsts = [first[0]["p0"] for first, _ in fit_without_each(evidence, at, at)]
    assert firsts[2] == pytest.approx(0.0, abs=1e-6)
    assert min(firsts[:2]) > 0.5


def test_without_it_the_baseline_is_still_a_likely_one() -> None:
    """Runs that ask for the impossible do not get it where one of them is left out."""
    evidence, at = make_linear_model(np.full((RUNS, COUNT), 2.5))
    for first, _ in fit_without_each(evidence, at, at):
        prior_chi2 = sum(value**2 for value in first[0].values())
        assert prior_chi2 == pytest.approx(chi2.ppf(CHI2_QUANTILE, COUNT), rel=0.11)


@pytest.mark.parametrize(("power", "largest"), [(1.0, 0.99), (8.0, 0.4)])
def test_a_step_that_fits_the_others_worse_is_shortened(power: float, largest: float) -> None:
    """The recovery of a fade went to its bound, and the fitted runs were off by ten floors."""
    wanted = np.zeros((RUNS, COUNT))
    wanted[:2, 0] = 1.0
    evidence, at = make_linear_model(wanted, lambda move: np.sign(move) * ((1.0 + np.abs(move)) ** power - 1.0) / power)
    reached = fit_without_each(evidence, at, at)[2][1][0]["p0"]
    assert reached == pytest.approx(largest, abs=0.06)


@pytest.mark.parametrize(
    ("after", "told"),
    [(0.14, ""), (0.19, "closes 10% of the gap"), (0.25, "closes nothing of the gap")],
)
def test_a_gap_that_stays_open_on_runs_not_fitted_is_noted(after: float, told: str) -> None:
    gaps = {"motor": Gap(0.2, after, 0.05), "oil": Gap(0.1, 0.1, 0.1), "unknown": Gap(math.nan, math.nan, 0.1)}
    notes = note_open_gap(gaps)
    assert len(notes) == bool(told)
    assert all(told in note for note in notes)
    assert note_open_gap({"oil": gaps["oil"]}) == []
