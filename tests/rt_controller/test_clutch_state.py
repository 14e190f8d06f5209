"""State of the plates by name. Each test has the module as argument, so that it can run on mutants
(tests/mutation)."""

from types import ModuleType

import pytest

import rt_controller.law.clutch_state


@pytest.fixture(scope="module")
def clutch_state() -> ModuleType:
    return rt_controller.law.clutch_state


def test_plates_that_do_not_touch_are_open_whatever_moves(clutch_state: ModuleType) -> None:
    of, names = clutch_state.find_clutch_state, clutch_state.ClutchState
    assert [of(False, moves, lock) for moves in (True, False) for lock in (True, False)] == [names.OPEN] * 4


def test_plates_that_touch_slide_while_they_move(clutch_state: ModuleType) -> None:
    of, names = clutch_state.find_clutch_state, clutch_state.ClutchState
    assert of(True, True, True) == of(True, True, False) == names.SLIDING


def test_plates_that_touch_and_do_not_move_stick_or_are_locked(clutch_state: ModuleType) -> None:
    of, names = clutch_state.find_clutch_state, clutch_state.ClutchState
    assert of(True, False, False) == names.STICKING
    assert of(True, False, True) == names.LOCKED


def test_the_numbers_of_a_run_are_kept(clutch_state: ModuleType) -> None:
    assert [(state.value, state.name) for state in clutch_state.ClutchState] == [
        (0, "OPEN"), (1, "SLIDING"), (2, "STICKING"), (3, "LOCKED")
    ]  # fmt: skip
