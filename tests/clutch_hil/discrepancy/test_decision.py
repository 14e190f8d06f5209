"""Decisions: when two effects are told apart, what gain counts, and whether a further effect is looked for."""

from dataclasses import replace

import numpy as np
import pytest

from clutch_hil.discrepancy.decision import (
    ALIAS_SHARE,
    CHANCE_GAIN,
    DECISIVE_SHARE,
    DISAGREEMENT,
    LEAST_GAIN,
    MOST_EFFECTS,
    PRIOR_GAIN,
    RARE_CHI2,
    TIE_COST,
    Explanation,
    find_aliases,
)


def test_a_rival_is_told_apart_by_more_than_the_best_ones_own_misfit() -> None:
    w = Explanation(base=9000.0, best=1000.0, size=1000, count=1, excess=8.0, rest=0.1, redundancy=50.0)
    costs = {"best": 1000.0, "near": 1000.0 + 0.9 * (ALIAS_SHARE * 0.1 * 1000.0 + TIE_COST * 50.0), "far": 1600.0}
    assert find_aliases(costs, w, {}) == ["best", "near"]
    assert find_aliases(costs, replace(w, rest=0.0), {}) == ["best"]


def test_one_run_that_tells_is_enough() -> None:
    costs = {"best": 1000.0, "near": 1040.0}
    best, sentence = np.array([0.2, 0.2]), 0.2 + DECISIVE_SHARE * 0.2 + DISAGREEMENT
    w = Explanation(base=9000.0, best=1000.0, size=1000, count=1, excess=8.0, rest=0.2)
    assert find_aliases(costs, w, {"best": best, "near": np.array([0.2, sentence - 0.01])}) == ["best", "near"]
    assert find_aliases(costs, w, {"best": best, "near": np.array([0.2, sentence + 0.01])}) == ["best"]


@pytest.mark.parametrize(("size", "least"), [(100_000, LEAST_GAIN), (1000, CHANCE_GAIN / 1000)])
def test_a_gain_that_chance_gives_is_none(size: int, least: float) -> None:
    """Nor one that models are off without any effect missing."""
    base = 1.5 * size
    explanation = Explanation(base, base - 0.9 * least * size, size, count=1, excess=0.5, rest=0.0)
    assert not explanation.is_significant
    assert replace(explanation, best=base - 1.1 * least * size).is_significant


def test_a_likelier_calibration_is_a_gain_where_it_is_no_chance() -> None:
    """However little better it fits; and what only fits better because of a rarer calibration is none."""
    base, size, n = 150_000.0, 100_000, 100.0
    likelier = Explanation(
        base,
        base - 1.1 * n * PRIOR_GAIN,
        size,
        count=1,
        excess=0.0,
        rest=0.0,
        prior_gain=1.1 * PRIOR_GAIN,
        redundancy=n,
    )
    assert likelier.is_significant
    assert not replace(likelier, best=base - 0.9 * n * PRIOR_GAIN, prior_gain=0.9 * PRIOR_GAIN).is_significant
    rarer = replace(
        likelier, best=base - 0.5 * LEAST_GAIN * size, prior_gain=-1.0
    )  # fits better by 1.5 LEAST_GAIN, which costs LEAST_GAIN
    assert not rarer.is_significant
    assert replace(rarer, best=base - 1.1 * LEAST_GAIN * size).is_significant


def test_behind_a_rare_calibration_a_further_effect_is_looked_for() -> None:
    explanation = Explanation(
        base=2000.0, best=1250.0, size=500, count=1, excess=3.0, rest=0.0, prior_chi2=RARE_CHI2 - 1.0
    )
    assert not explanation.is_incomplete
    assert replace(explanation, prior_chi2=RARE_CHI2 + 1.0).is_incomplete


def test_a_rest_that_chance_leaves_is_not_looked_into() -> None:
    explanation = Explanation(base=2000.0, best=1250.0, size=500, count=1, excess=3.0, rest=0.25)
    assert not explanation.is_incomplete  # 0.1 + 3 root(2/500) = 0.29
    assert replace(explanation, rest=0.31).is_incomplete
    assert not replace(explanation, rest=0.31, count=MOST_EFFECTS).is_incomplete
