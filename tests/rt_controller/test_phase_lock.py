"""A grid that follows the samples, to the nanosecond. Each test has the module as argument, so that it can run on mutants
(tests/mutation). That the loop locks to samples with jitter is in test_trigger.py."""

from types import ModuleType
from typing import Any

import numpy as np
import pytest

import rt_controller.loop.phase_lock
from protocols.realtime.clock import CLOCK
from tests.mutation.plain import view_records

PERIOD = 1_000_000  # ns
MOST = 20_000  # ns, a period / 50: of a step, and of the drift
DEADLINE, FIRST = 70_000_123_456, 60_000_123_456  # ns: the last slot, and the first one


@pytest.fixture(scope="module")
def phase_lock() -> ModuleType:
    return rt_controller.loop.phase_lock


class Grid:
    """A grid of slots of `period` [ns] that has learnt a drift [ns per period]."""

    def __init__(self, module: ModuleType, drift: float = 0.0, period: int = PERIOD) -> None:
        self._module, self._drifts = module, np.array([drift])
        self._clocks = view_records(np.zeros(1, CLOCK))
        self._clocks["period"], self._clocks["deadline"], self._clocks["first"] = period, DEADLINE, FIRST

    def follow(self, late: int) -> tuple[int, float]:
        """Follow a sample `late` [ns] after its place, a quarter of a period of 1 ms before the slot. See `_follow`."""
        return self._follow(True, DEADLINE - PERIOD // 4 + late)

    def coast(self) -> tuple[int, float]:
        """Follow a cycle without a sample. See `_follow`."""
        return self._follow(False, DEADLINE - PERIOD // 4 + 400_000)

    def _follow(self, complete: bool, arrived: int) -> tuple[int, float]:
        """Return by how much the grid has moved [ns], and the drift."""
        self._module.follow(self._clocks, self._drifts, complete, arrived)
        moved = int(self._clocks["deadline"][0]) - DEADLINE
        assert int(self._clocks["first"][0]) - FIRST == moved, "the slots keep their numbers"
        return moved, float(self._drifts[0])


def approx(moved: int, drift: float) -> Any:
    """The move exactly, and the drift but for rounding."""
    return moved, pytest.approx(drift, rel=1e-12)


def test_a_grid_in_place_stays(phase_lock: ModuleType) -> None:
    for period in (PERIOD, PERIOD + 1):  # an odd period has no half in whole ns
        assert Grid(phase_lock, period=period).follow(0) == (0, 0.0)


def test_a_grid_moves_by_a_fiftieth_of_the_error_and_learns_a_hundredth_of_that(phase_lock: ModuleType) -> None:
    for late in (100_000, 400_000, -100_000, -400_000):
        drift = late // 5_000
        assert Grid(phase_lock).follow(late) == approx(late // 50 + drift, drift)


def test_what_has_been_learnt_adds_up(phase_lock: ModuleType) -> None:
    for sign in (1, -1):
        assert Grid(phase_lock, sign * 300.0).follow(100_000) == approx(2_000 + 20 + sign * 300, 20 + sign * 300)


def test_it_does_not_matter_which_sample_it_was(phase_lock: ModuleType) -> None:
    for periods in (-3, -1, 1, 3):
        assert Grid(phase_lock).follow(100_000 + periods * PERIOD) == approx(2_020, 20.0)


def test_the_grid_goes_the_shorter_way(phase_lock: ModuleType) -> None:
    """At half a period exactly it goes back."""
    assert Grid(phase_lock).follow(499_950) == approx(10_099, 99.99)
    assert Grid(phase_lock).follow(500_000) == approx(-10_100, -100.0)
    assert Grid(phase_lock).follow(-500_000) == approx(-10_100, -100.0)


def test_the_place_of_a_sample_follows_the_period(phase_lock: ModuleType) -> None:
    grid = Grid(phase_lock, period=4 * PERIOD)  # a slot is 1 ms after its sample
    assert grid.follow(-3 * PERIOD // 4) == (0, 0.0)
    grid = Grid(phase_lock, period=4 * PERIOD)
    assert grid.follow(-3 * PERIOD // 4 + 1_000_000) == approx(20_200, 200.0)


def test_without_a_sample_the_grid_goes_on_with_what_it_has_learnt(phase_lock: ModuleType) -> None:
    for drift, moved in ((0.0, 0), (300.0, 300), (-300.0, -300), (0.75, 1), (0.25, 0), (-0.75, -1)):
        assert Grid(phase_lock, drift).coast() == (moved, drift)


def test_a_step_is_at_most_a_fiftieth_of_the_period(phase_lock: ModuleType) -> None:
    for sign in (1, -1):
        assert Grid(phase_lock, sign * 15_000.0).follow(sign * 400_000) == approx(sign * MOST, sign * 15_080.0)


def test_the_drift_is_at_most_a_fiftieth_of_the_period(phase_lock: ModuleType) -> None:
    for sign in (1, -1):
        assert Grid(phase_lock, sign * 19_990.0).follow(sign * 400_000) == (sign * MOST, sign * MOST)
        assert Grid(phase_lock, sign * 19_990.0).follow(-sign * 400_000) == approx(sign * 11_910, sign * 19_910.0)
