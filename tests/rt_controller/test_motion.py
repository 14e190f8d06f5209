"""Motion of the plates from the encoder. Each test has the module as argument, so that it can run on mutants
(tests/mutation)."""

from types import ModuleType
from typing import Any

import pytest

import rt_controller.law.motion
from rt_controller.law.record import make_record

# Binary fractions, so that sums are exact. An eighth of a second at 0.5 rad/s is the standing angle, at 4 rad/s half a radian.
SETTINGS = {
    "standing_angle": 0.0625, "rest_time": 0.25, "coarse_angle": 1.0, "coarse_speed": 4.0, "coarse_time": 0.5,
    "stick_angle": 1.0, "stick_time": 0.5,
}  # fmt: skip
STEP = 0.125


@pytest.fixture(scope="module")
def motion() -> ModuleType:
    return rt_controller.law.motion


class Plates:
    """The function `motion` of a module with a record of its own."""

    def __init__(self, module: ModuleType, **changed: float) -> None:
        self._module = module
        self.state: Any = make_record(module.MOTION)
        self._settings: Any = make_record(module.MOTION_SETTINGS, SETTINGS | changed)

    def show(self, *speeds: float, acceleration: float = 0.0, step: float = STEP) -> Any:
        for speed in speeds:
            self._module.advance_motion(self.state, self._settings, speed, acceleration, step)
        return self.state

    def list_moves(self, *speeds: float) -> list[bool]:
        return [bool(self.show(speed).moves) for speed in speeds]


def test_plates_move_until_the_encoder_has_stood_for_the_stick_time(motion: ModuleType) -> None:
    assert Plates(motion).list_moves(*[0.0] * 6) == [True, True, True, False, False, False]


def test_a_slide_is_told_from_rest_at_once_and_either_way(motion: ModuleType) -> None:
    for speed in (16.0, -16.0):
        plates = Plates(motion)
        plates.show(*[0.0] * 6)
        assert plates.list_moves(speed, *[0.0] * 4) == [True, True, True, True, False]


def test_an_angle_up_to_the_stick_angle_is_rest(motion: ModuleType) -> None:
    plates = Plates(motion)
    plates.show(*[0.0] * 6)
    assert not plates.show(8.0).moves, "8 rad/s for 0.125 s are 1 rad"
    assert plates.show(0.25).moves


def test_a_slow_slide_moves_by_the_angle_it_adds_up(motion: ModuleType) -> None:
    assert all(Plates(motion).list_moves(*[4.0] * 40)), "more than 1 rad in 0.5 s"
    assert Plates(motion).list_moves(*[1.0] * 5)[-1] is False, "0.5 rad in 0.5 s"


def test_the_angle_is_summed_with_its_sign_and_begins_anew_where_the_plates_have_moved(motion: ModuleType) -> None:
    plates = Plates(motion)
    plates.show(*[0.0] * 6)
    assert plates.show(4.0).angle == 0.5
    assert plates.show(-2.0).angle == 0.25
    assert not plates.show(-2.0).moves
    assert plates.show(16.0).angle == plates.state.still == 0.0


def test_a_cycle_without_a_sample_changes_nothing(motion: ModuleType) -> None:
    for speed in (20.0, -20.0, 1.0, 0.0):
        plates = Plates(motion)
        before = plates.show(3.0).copy()
        assert plates.show(speed, acceleration=9.0, step=0.0) == before


def test_the_speed_at_the_end_of_a_sample_is_the_mean_and_half_of_what_it_gained(motion: ModuleType) -> None:
    for sign in (1.0, -1.0):
        plates = Plates(motion)
        state = plates.show(8.0 * sign, acceleration=32.0 * sign)
        assert (state.begin, state.end) == (0.0, 10.0 * sign)
        state = plates.show(6.0 * sign, acceleration=-16.0 * sign)
        assert (state.begin, state.end) == (10.0 * sign, 5.0 * sign)
        assert not state.turns


def test_without_a_count_the_speed_goes_on_from_what_it_was_until_it_turns_or_is_zero(motion: ModuleType) -> None:
    for sign in (1.0, -1.0):
        plates = Plates(motion)
        plates.show(2.0 * sign)
        state = plates.show(0.5 * sign, acceleration=-32.0 * sign)
        assert (state.begin, state.end, bool(state.turns)) == (2.0 * sign, -2.0 * sign, True)
        state = plates.show(-0.5 * sign, acceleration=8.0 * sign)
        assert (state.begin, state.end, bool(state.turns)) == (-2.0 * sign, 0.0, False)
        plates.show(2.0 * sign)
        assert not plates.show(0.0, acceleration=-16.0 * sign).turns, "it ends at 0"


def test_plates_turn_in_the_sample_in_which_the_speed_passes_zero_and_in_no_other(motion: ModuleType) -> None:
    plates = Plates(motion)
    assert [bool(plates.show(speed).turns) for speed in (-2.0, 2.0, 2.0, 0.0, -2.0, -2.0, 0.625)] == [
        False, True, False, False, False, False, True
    ]  # fmt: skip
    assert not plates.show(2.0, acceleration=-16.0).turns, "2 rad/s less 1 are 1"
    assert plates.show(1.0, acceleration=-32.0).turns, "1 rad/s less 2 are -1"


def test_plates_rest_after_the_rest_time_without_a_count(motion: ModuleType) -> None:
    for sign in (1.0, -1.0):
        plates = Plates(motion)
        speeds = (8.0, 0.5, -0.5, 0.5, 0.625, 0.0, 0.0, 8.0)
        assert [bool(plates.show(sign * speed).rests) for speed in speeds] == [
            False, False, True, True, False, False, True, False
        ]  # fmt: skip


def test_plates_that_turn_without_a_count_do_not_rest_however_long_the_sample(motion: ModuleType) -> None:
    plates = Plates(motion, rest_time=STEP)
    plates.show(2.0)
    assert not plates.show(0.0, acceleration=-32.0).rests, "2 rad/s less 4 are -2"
    assert plates.show(0.0).rests


def test_quiet_is_the_time_since_the_encoder_has_moved(motion: ModuleType) -> None:
    plates = Plates(motion)
    assert [float(plates.show(speed).quiet) for speed in (0.0, 0.5, -0.625, 0.0, 0.25)] == [
        0.125,
        0.25,
        0.0,
        0.125,
        0.25,
    ]


def test_a_fast_speed_needs_no_timing(motion: ModuleType) -> None:
    for sign in (1.0, -1.0):
        plates = Plates(motion)
        plates.show(2.0 * sign)
        state = plates.show(4.125 * sign)
        assert (state.slow, state.turned, state.taken) == (4.125 * sign, 0.0, 0.0)
        assert plates.show(4.0 * sign).turned == 0.5 * sign, "at the coarse speed counts are timed"


def test_a_slow_speed_is_an_angle_over_the_time_it_took(motion: ModuleType) -> None:
    for sign in (1.0, -1.0):
        plates = Plates(motion)
        state = plates.show(2.0 * sign, 3.0 * sign)
        assert (state.turned, state.taken, state.slow) == (0.625 * sign, 0.25, 0.0)
        state = plates.show(3.0 * sign)
        assert (state.turned, state.taken) == (0.0, 0.0)
        assert state.slow == pytest.approx(sign * 8.0 / 3.0, rel=1e-15), "1 rad in 0.375 s"
        assert plates.show(4.0 * sign, 4.0 * sign).slow == 4.0 * sign, "the next begins anew"
        assert plates.show(0.0).slow == 1.0 * sign, "less than a count of 0.125 rad in 0.125 s"
        plates.show(4.0 * sign, 3.0 * sign, 0.5 * sign, 0.5 * sign)
        assert plates.show(1.0 * sign).taken == 0.125, "the next begins anew, though the last count was a half"


def test_until_the_angle_is_there_the_speed_is_at_most_what_the_time_gone_by_allows(motion: ModuleType) -> None:
    for sign in (1.0, -1.0):
        plates = Plates(motion)
        plates.show(4.0 * sign, 4.0 * sign)
        assert plates.show(2.0 * sign).slow == 3.0 * sign, "0.25 rad and a count of 0.125 in 0.125 s"
        assert plates.show(0.0).slow == 1.5 * sign
        assert plates.show(0.0, 0.0).slow == 0.75 * sign
        assert plates.show(3.0 * sign).slow == 0.75 * sign, "0.75 rad in 0.625 s would be more, but are not told yet"


def test_plates_that_turn_are_timed_anew_and_have_the_speed_of_what_there_is(motion: ModuleType) -> None:
    for sign in (1.0, -1.0):
        plates = Plates(motion)
        plates.show(4.0 * sign, 4.0 * sign, 2.0 * sign)
        state = plates.show(-1.0 * sign)
        assert (state.turned, state.taken, state.slow) == (-0.125 * sign, 0.125, -1.0 * sign)


def test_plates_that_turn_after_a_rest_have_been_on_their_way_since_their_last_count(motion: ModuleType) -> None:
    plates = Plates(motion)
    plates.show(4.0, 4.0, 2.0, 0.0, 0.0)
    state = plates.show(-3.0)
    assert (state.turned, state.taken, state.slow) == (-0.375, 0.375, -1.0)


def test_plates_that_break_away_have_taken_the_coarse_time_at_most(motion: ModuleType) -> None:
    for sign in (1.0, -1.0):
        plates = Plates(motion)
        plates.show(2.0 * sign, *[0.0] * 4)
        state = plates.show(1.0 * sign)
        assert (state.turned, state.taken) == (0.375 * sign, 0.75), "0.5 s of rest are not beyond the coarse time"
        plates.show(*[0.0] * 7)
        state = plates.show(2.0 * sign)
        assert (state.turned, state.taken) == (0.25 * sign, 0.625), "what was before 0.875 s of rest is forgotten"
        assert plates.show(4.0 * sign, 2.0 * sign).slow == sign * 1.0 / 0.875


def test_half_a_count_is_no_break_away(motion: ModuleType) -> None:
    plates = Plates(motion)
    plates.show(2.0, *[0.0] * 7)
    state = plates.show(0.5)
    assert (state.turned, state.taken) == (0.3125, 1.125)
    assert plates.show(0.75).taken == 0.625
