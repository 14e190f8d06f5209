"""State of the plates from the encoder. Each check takes the module, so that mutants can be put in its place
(test_state_mutation.py)."""

from types import ModuleType
from typing import Any

import pytest

import rt_controller.clutch_state
from rt_controller.record import record

# Binary fractions, so that sums are exact.
SETTINGS = {"standing_speed": 0.5, "coarse_speed": 4.0, "coarse_time": 0.5, "stick_angle": 1.0, "stick_time": 0.5}
STEP = 0.125


@pytest.fixture(scope="module")
def clutch_state() -> ModuleType:
    return rt_controller.clutch_state


class Motion:
    """The module's `motion` on a record of its own."""

    def __init__(self, module: ModuleType) -> None:
        self._module = module
        self.state: Any = record(module.MOTION)
        self._settings: Any = record(module.MOTION_SETTINGS, SETTINGS)

    def at(self, speed: float, slip: float | None = None, step: float = STEP) -> Any:
        self._module.motion(self.state, self._settings, speed, speed if slip is None else slip, step)
        return self.state


def test_plates_move_until_the_encoder_has_stood_for_the_stick_time(clutch_state: ModuleType) -> None:
    motion = Motion(clutch_state)
    assert [bool(motion.at(0.0).moves) for _ in range(6)] == [True, True, True, False, False, False]


def test_a_slide_is_told_from_rest_at_once_and_either_way(clutch_state: ModuleType) -> None:
    for speed in (16.0, -16.0):
        motion = Motion(clutch_state)
        for _ in range(6):
            motion.at(0.0)
        assert motion.at(speed).moves
        assert [bool(motion.at(0.0).moves) for _ in range(4)] == [True, True, True, False]


def test_an_angle_up_to_the_stick_angle_is_rest(clutch_state: ModuleType) -> None:
    motion = Motion(clutch_state)
    for _ in range(6):
        motion.at(0.0)
    assert not motion.at(8.0).moves, "8 rad/s for 0.125 s are 1 rad"
    assert motion.at(0.25).moves


def test_a_slow_slide_moves_by_the_angle_it_adds_up(clutch_state: ModuleType) -> None:
    motion = Motion(clutch_state)
    assert all(motion.at(4.0).moves for _ in range(40)), "more than 1 rad in 0.5 s"
    motion = Motion(clutch_state)
    for _ in range(4):
        motion.at(1.0)
    assert not motion.at(1.0).moves, "0.5 rad in 0.5 s"


def test_the_angle_is_summed_with_its_sign(clutch_state: ModuleType) -> None:
    motion = Motion(clutch_state)
    for _ in range(6):
        motion.at(0.0)
    assert motion.at(4.0).angle == 0.5
    assert motion.at(-2.0).angle == 0.25
    assert not motion.at(-2.0).moves


def test_a_cycle_without_a_sample_changes_nothing(clutch_state: ModuleType) -> None:
    motion = Motion(clutch_state)
    before = motion.at(3.0).copy()
    assert motion.at(-20.0, step=0.0) == before


def test_plates_stand_at_a_speed_that_cannot_be_seen(clutch_state: ModuleType) -> None:
    for sign in (1.0, -1.0):
        motion = Motion(clutch_state)
        motion.at(8.0 * sign)
        assert motion.at(0.5 * sign, slip=sign).stands
        assert not motion.at(0.625 * sign, slip=sign).stands


def test_plates_stand_when_the_observer_is_past_zero_or_at_it(clutch_state: ModuleType) -> None:
    motion = Motion(clutch_state)
    assert not motion.at(2.0, slip=1.0).stands
    assert not motion.at(2.0, slip=1e-300).stands
    assert motion.at(2.0, slip=-1e-300).stands
    assert motion.at(2.0, slip=-1.0).stands
    assert motion.at(2.0, slip=0.0).stands


def test_plates_stand_in_the_sample_in_which_the_speed_turns(clutch_state: ModuleType) -> None:
    motion = Motion(clutch_state)
    assert not motion.at(-2.0).stands, "begun so"
    motion.at(0.625)
    assert motion.at(-0.625).stands, "however little"
    motion.at(2.0)
    assert motion.at(-2.0).stands
    assert not motion.at(-2.0).stands


def test_plates_rest_after_two_samples_at_rest(clutch_state: ModuleType) -> None:
    motion = Motion(clutch_state)
    motion.at(8.0)
    assert not motion.at(0.5).rests
    assert motion.at(-0.5).rests
    assert not motion.at(0.625).rests
    assert not motion.at(0.0).rests
    assert motion.at(0.0).rests


def test_a_slow_speed_is_smoothed_and_a_fast_one_is_not(clutch_state: ModuleType) -> None:
    motion = Motion(clutch_state)
    assert motion.at(8.0).smooth == 8.0
    assert motion.at(4.0).smooth == 7.0, "a quarter of the way in a quarter of the coarse time"
    assert motion.at(4.0, step=2.0).smooth == 4.0
    assert motion.at(4.125).smooth == 4.125
    assert motion.at(-4.0, step=0.25).smooth == 0.0625


def test_the_state_by_name(clutch_state: ModuleType) -> None:
    of, names = clutch_state.clutch_state, clutch_state.ClutchState
    assert [of(False, moves, lock) for moves in (True, False) for lock in (True, False)] == [names.OPEN] * 4
    assert of(True, True, True) == of(True, True, False) == names.SLIDING
    assert of(True, False, False) == names.STICKING
    assert of(True, False, True) == names.LOCKED
    assert [state.value for state in names] == [0, 1, 2, 3]
