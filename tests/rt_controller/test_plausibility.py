"""Plausibility: each check acts at its limit after its dwell, and not before. Each test has the module as argument, so that it
can run on mutants (tests/mutation)."""

from types import ModuleType
from typing import Any

import pytest

import rt_controller.law.plausibility
from rt_controller.law.record import make_record

# Binary fractions, so that sums are exact.
LIMITS = {
    "torque_mismatch": 8.0, "mismatch_dwell": 0.5, "standing_error": 2.0, "frozen_change": 4.0, "frozen_dwell": 0.5,
    "lost_pressure": 16.0, "lost_dwell": 0.25,
}  # fmt: skip
STEP = 0.125


@pytest.fixture(scope="module")
def plausibility() -> ModuleType:
    return rt_controller.law.plausibility


class Doubts:
    """Both functions of a module with a record of their own."""

    def __init__(self, module: ModuleType) -> None:
        self._module = module
        self._state: Any = make_record(module.PLAUSIBILITY)
        self._settings: Any = make_record(module.PLAUSIBILITY_SETTINGS, LIMITS)

    def check_torque(
        self,
        mismatch: float = 0.0,
        error: float = 0.0,
        stands: bool = False,
        motor_limited: bool = False,
        step: float = STEP,
    ) -> bool:
        arguments = self._state, self._settings, mismatch, error, stands, motor_limited, step
        return bool(self._module.check_torque(*arguments))

    def check_pressure(self, pressure: float, asked: float, step: float = STEP) -> bool:
        return bool(self._module.check_pressure(self._state, self._settings, pressure, asked, step))


def test_a_mismatch_of_either_sign_is_believed_at_the_end_of_its_dwell(plausibility: ModuleType) -> None:
    for sign in (1.0, -1.0):
        doubts = Doubts(plausibility)
        assert [doubts.check_torque(8.125 * sign) for _ in range(5)] == [False, False, False, True, True]


def test_a_mismatch_at_the_limit_is_none(plausibility: ModuleType) -> None:
    doubts = Doubts(plausibility)
    assert not any(doubts.check_torque(sign * 8.0) for sign in (1.0, -1.0) for _ in range(20))


def test_a_doubt_begins_at_nothing_however_long_all_was_well(plausibility: ModuleType) -> None:
    doubts = Doubts(plausibility)
    for _ in range(3):
        assert not doubts.check_torque(0.0, 0.0)
        assert not doubts.check_pressure(20.0, 20.0)
    assert [doubts.check_torque(9.0, 4.0, stands=True) for _ in range(4)] == [False, False, False, True]
    assert [doubts.check_torque(0.0, 4.0, stands=True) for _ in range(1)] == [True]
    assert [doubts.check_pressure(15.0, 20.0) for _ in range(2)] == [False, True]
    for arguments in ((0.0, 4.0, True), (9.0,)):
        doubts = Doubts(plausibility)
        assert not doubts.check_torque(0.0, 0.0)
        assert [doubts.check_torque(*arguments) for _ in range(4)] == [False, False, False, True]


def test_a_mismatch_that_goes_begins_anew(plausibility: ModuleType) -> None:
    doubts = Doubts(plausibility)
    assert not any(doubts.check_torque(mismatch) for _ in range(5) for mismatch in (9.0, 9.0, 9.0, 0.0))


def test_plates_that_stand_while_the_motor_is_to_turn_are_believed_for_a_while(plausibility: ModuleType) -> None:
    for error in (4.0, -4.0):
        doubts = Doubts(plausibility)
        assert [doubts.check_torque(0.0, error, stands=True) for _ in range(5)] == [False, False, False, True, True]


def test_the_error_is_summed_over_time(plausibility: ModuleType) -> None:
    doubts = Doubts(plausibility)
    assert [doubts.check_torque(0.0, 2.0, stands=True) for _ in range(8)] == [False] * 7 + [True]


def test_plates_that_slide_or_a_motor_that_pushes_begin_it_anew(plausibility: ModuleType) -> None:
    for other in ({"stands": False}, {"stands": True, "motor_limited": True}):
        doubts = Doubts(plausibility)
        for _ in range(4):
            assert not any(doubts.check_torque(0.0, 4.0, stands=True) for _ in range(3))
            assert not doubts.check_torque(0.0, 400.0, **other)
    doubts = Doubts(plausibility)
    assert not any(doubts.check_torque(0.0, 0.0, stands=True) for _ in range(50)), "a motor that is to stand"


def test_a_pressure_below_the_springs_is_lost_after_its_dwell(plausibility: ModuleType) -> None:
    doubts = Doubts(plausibility)
    assert [doubts.check_pressure(15.0, 0.0) for _ in range(3)] == [False, True, True]
    assert not doubts.check_pressure(16.0, 0.0)
    assert not doubts.check_pressure(15.0, 0.0)


def test_a_pressure_at_the_limit_is_there(plausibility: ModuleType) -> None:
    doubts = Doubts(plausibility)
    assert not any(doubts.check_pressure(16.0, 0.0) for _ in range(20))


def test_a_signal_that_stands_still_while_more_is_asked_for_is_lost(plausibility: ModuleType) -> None:
    for change in (5.0, -5.0):
        doubts = Doubts(plausibility)
        assert not doubts.check_pressure(20.0, 20.0)
        assert [doubts.check_pressure(20.0, 20.0 + change) for _ in range(5)] == [False, False, False, True, True]


def test_a_signal_may_stand_still_while_no_more_is_asked_for(plausibility: ModuleType) -> None:
    doubts = Doubts(plausibility)
    assert not doubts.check_pressure(20.0, 20.0)
    assert not any(doubts.check_pressure(20.0, 24.0) for _ in range(20))
    assert not any(doubts.check_pressure(20.0, 16.0) for _ in range(20))


def test_a_signal_that_moves_by_a_count_is_one(plausibility: ModuleType) -> None:
    doubts = Doubts(plausibility)
    for k in range(10):
        assert not any(doubts.check_pressure(20.0 + k % 2, 20.0 + 5.0 * k) for _ in range(4)), k


def test_the_time_it_stands_still_counts_once_what_is_asked_for_has_moved(plausibility: ModuleType) -> None:
    doubts = Doubts(plausibility)
    for _ in range(8):
        assert not doubts.check_pressure(20.0, 20.0)
    assert [doubts.check_pressure(20.0, 30.0) for _ in range(4)] == [False, False, False, True]


def test_a_signal_that_moves_begins_that_time_anew(plausibility: ModuleType) -> None:
    doubts = Doubts(plausibility)
    for k in range(4):
        assert not doubts.check_pressure(20.0 + k, 20.0)
        assert not any(doubts.check_pressure(20.0 + k, 30.0) for _ in range(3)), k
