"""Decisions: when two effects are told apart, what gain counts, and whether a further effect is looked for."""

from dataclasses import replace

import numpy as np
import pytest

from clutch_hil.discrepancy.decide import (
    ALIAS,
    CHANCE,
    DECISIVE,
    GAIN,
    MOST,
    RARE,
    RELIEF,
    TIE,
    UNEXPLAINED,
    Weighed,
    aliases,
)


def test_a_rival_is_told_apart_by_more_than_the_best_ones_own_misfit() -> None:
    w = Weighed(base=9000.0, best=1000.0, size=1000, count=1, excess=8.0, rest=0.1, alike=50.0)
    costs = {"best": 1000.0, "near": 1000.0 + 0.9 * (ALIAS * 0.1 * 1000.0 + TIE * 50.0), "far": 1600.0}
    assert aliases(costs, w, {}) == ["best", "near"]
    assert aliases(costs, replace(w, rest=0.0), {}) == ["best"]


def test_one_run_that_tells_is_enough() -> None:
    costs = {"best": 1000.0, "near": 1040.0}
    best, told = np.array([0.2, 0.2]), 0.2 + DECISIVE * 0.2 + UNEXPLAINED
    w = Weighed(base=9000.0, best=1000.0, size=1000, count=1, excess=8.0, rest=0.2)
    assert aliases(costs, w, {"best": best, "near": np.array([0.2, told - 0.01])}) == ["best", "near"]
    assert aliases(costs, w, {"best": best, "near": np.array([0.2, told + 0.01])}) == ["best"]


@pytest.mark.parametrize(("size", "least"), [(100_000, GAIN), (1000, CHANCE / 1000)])
def test_a_gain_that_chance_gives_is_none(size: int, least: float) -> None:
    """Nor one that models are off without any effect missing."""
    base = 1.5 * size
    weighed = Weighed(base, base - 0.9 * least * size, size, count=1, excess=0.5, rest=0.0)
    assert not weighed.gained
    assert replace(weighed, best=base - 1.1 * least * size).gained


def test_a_likelier_calibration_is_a_gain_where_it_is_no_chance() -> None:
    """However little better it fits; and what only fits better because of a rarer calibration is none."""
    base, size, n = 150_000.0, 100_000, 100.0
    likelier = Weighed(base, base - 1.1 * n * RELIEF, size, count=1, excess=0.0, rest=0.0, relief=1.1 * RELIEF, alike=n)
    assert likelier.gained
    assert not replace(likelier, best=base - 0.9 * n * RELIEF, relief=0.9 * RELIEF).gained
    rarer = replace(likelier, best=base - 0.5 * GAIN * size, relief=-1.0)  # fits better by 1.5 GAIN, which costs GAIN
    assert not rarer.gained
    assert replace(rarer, best=base - 1.1 * GAIN * size).gained


def test_behind_a_rare_calibration_a_further_effect_is_looked_for() -> None:
    weighed = Weighed(base=2000.0, best=1250.0, size=500, count=1, excess=3.0, rest=0.0, strain=RARE - 1.0)
    assert not weighed.unfinished
    assert replace(weighed, strain=RARE + 1.0).unfinished


def test_a_rest_that_chance_leaves_is_not_looked_into() -> None:
    weighed = Weighed(base=2000.0, best=1250.0, size=500, count=1, excess=3.0, rest=0.25)
    assert not weighed.unfinished  # 0.1 + 3 root(2/500) = 0.29
    assert replace(weighed, rest=0.31).unfinished
    assert not replace(weighed, rest=0.31, count=MOST).unfinished
