"""Trim of the friction level. Each test has the module as argument, so that it can run on mutants
(tests/mutation)."""

from itertools import pairwise
from types import ModuleType
from typing import Any

import pytest

import rt_controller.law.trim
from rt_controller.law.record import make_record

# Binary fractions, so that sums are exact.
WINDOW, FLOOR, STEP = 0.5, 2.0, 0.125
LOW, HIGH = 0.5, 1.5


@pytest.fixture(scope="module")
def trim() -> ModuleType:
    return rt_controller.law.trim


class Level:
    """The trim of a module with a record of its own, for the adapted level `learnt`."""

    def __init__(self, module: ModuleType, learnt: float = 1.0) -> None:
        self._module, self.learnt = module, learnt
        self.state: Any = make_record(module.TRIM)
        self.settings: Any = make_record(module.TRIM_SETTINGS, window=WINDOW, floor=FLOOR)

    def show(self, model: float, observed: float, step: float = STEP, times: int = 1) -> float:
        for _ in range(times):
            self._module.trim(self.state, self.settings, model, observed, step)
        return self.now

    def lower(self, share: float) -> float:
        self._module.lower(self.state, self.settings, self.learnt, share)
        return self.now

    def raise_to(self, share: float) -> float:
        self._module.raise_to(self.state, self.settings, self.learnt, share)
        return self.now

    @property
    def now(self) -> float:
        return float(self._module.compute_level(self.state, self.settings, self.learnt, LOW, HIGH))


def test_where_nothing_has_been_shown_the_level_is_the_adapted_one(trim: ModuleType) -> None:
    assert [Level(trim, learnt).now for learnt in (0.75, 1.0, 1.25)] == [0.75, 1.0, 1.25]
    assert Level(trim, 0.75).show(0.0, 0.0, times=100) == 0.75


def test_what_is_shown_counts_by_its_torque_against_the_floor(trim: ModuleType) -> None:
    level = Level(trim)
    assert level.show(4.0, 3.0) == 0.875, "a quarter of the window: (3 + 4) of (4 + 4)"
    assert level.show(4.0, 3.0) == 9.25 / 11.0, "(0.75 3 + 3 + 4) of (0.75 4 + 4 + 4)"
    assert level.show(8.0, 4.0, step=WINDOW) == 36.0 / 68.0, "a window later all before is forgotten"
    assert level.show(4.0, 4.0, step=2.0 * WINDOW) == 1.0, "and no more than all"


def test_the_level_is_least_squares_with_what_is_known_before(trim: ModuleType) -> None:
    level, shown = Level(trim, 1.25), [(4.0, 2.0), (-8.0, -6.0), (2.0, 3.0)]
    for model, observed in shown:
        level.show(model, observed)
    weights = [0.25 * 0.75**age for age in (2, 1, 0)]
    xx = sum(w * x * x for w, (x, _) in zip(weights, shown, strict=True))
    xy = sum(w * x * y for w, (x, y) in zip(weights, shown, strict=True))
    assert level.now == pytest.approx((xy + FLOOR**2 * 1.25) / (xx + FLOOR**2), rel=1e-15)


def test_a_large_torque_shown_for_long_says_all(trim: ModuleType) -> None:
    for sign in (1.0, -1.0):
        assert Level(trim).show(sign * 2000.0, sign * 1500.0, times=200) == pytest.approx(0.75, abs=1e-6)


def test_the_level_stays_within_its_bounds(trim: ModuleType) -> None:
    assert Level(trim).show(100.0, 300.0, times=100) == HIGH
    assert Level(trim).show(100.0, 10.0, times=100) == LOW


def test_plates_that_break_away_lower_the_level_and_never_raise_it(trim: ModuleType) -> None:
    for learnt in (0.75, 1.25):
        level = Level(trim, learnt)
        assert level.lower(0.625) == 0.625
        assert level.lower(1.0) == 0.625
        level.show(8.0, 8.0, times=3)
        assert level.lower(0.75) == pytest.approx(0.75, rel=1e-15)
        before = level.state.copy()
        assert level.lower(1.0) == pytest.approx(0.75, rel=1e-15)
        assert level.state == before


def test_plates_that_rest_raise_the_level_and_never_lower_it(trim: ModuleType) -> None:
    for learnt in (0.75, 1.25):
        level = Level(trim, learnt)
        assert level.raise_to(1.375) == 1.375
        assert level.raise_to(1.0) == 1.375
        level.show(8.0, 6.0, times=3)
        assert level.raise_to(1.25) == pytest.approx(1.25, rel=1e-15)
        before = level.state.copy()
        assert level.raise_to(1.0) == pytest.approx(1.25, rel=1e-15)
        assert level.state == before


def test_what_breaking_away_and_resting_tell_is_forgotten_as_the_balance_shows_another_level(trim: ModuleType) -> None:
    for sentence in (Level.lower, Level.raise_to):
        level = Level(trim)
        sentence(level, 0.625 if sentence is Level.lower else 1.375)
        shown = [abs(level.show(20.0, 20.0) - 1.0) for _ in range(20)]
        assert all(after < before for before, after in pairwise(shown))
        assert shown[-1] < 1e-3


def test_a_trim_that_forgets_begins_anew(trim: ModuleType) -> None:
    level = Level(trim, 0.75)
    level.show(8.0, 8.0)
    level.raise_to(1.25)
    trim.forget(level.state)
    assert level.now == 0.75
    assert level.show(4.0, 3.0) == 0.75
