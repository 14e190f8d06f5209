"""Lock: how much the plates are asked to hold above what they carry, and how fast that changes."""

from math import exp

import pytest

from rt_controller.law.estimator import MODEL, coulomb_torque
from rt_controller.law.lock import LOCK_SETTINGS, hold, motor_limit
from rt_controller.law.record import make_record
from rt_controller.loop.parameter_sets import load_controller_parameters

STEP = 1e-3  # s
EULER = 1e-3  # relative: steps of a thousandth of the time constant
PARAMETERS = load_controller_parameters()
SETTINGS = make_record(LOCK_SETTINGS, PARAMETERS.list_si("lock"))
CLUTCH = make_record(MODEL, PARAMETERS.list_si("model"))
MOST = float(coulomb_torque(CLUTCH, SETTINGS.pressure_limit))  # Nm, at friction level 1
STUCK = 10.0  # Nm, what plates carry that stick
HELD = (1.0 + SETTINGS.margin) * STUCK  # Nm, more than STUCK + least


def play(
    capacity: float, seconds: float, *, present: float = 0.0, carried: float = STUCK, moving: bool = False
) -> float:
    """The capacity after some seconds [Nm], at friction level 1."""
    for _ in range(round(seconds / STEP)):
        capacity = hold(capacity, SETTINGS, CLUTCH, 1.0, present, carried, moving, STEP)
    return capacity


def test_it_begins_at_the_capacity_that_the_plates_have() -> None:
    assert play(0.0, STEP, present=12.0, moving=True) == pytest.approx(12.0 + SETTINGS.rate * STEP)


def test_while_the_plates_slide_it_rises_at_its_rate() -> None:
    assert play(5.0, 0.1, moving=True) == pytest.approx(5.0 + 0.1 * SETTINGS.rate)


def test_it_ends_at_what_the_highest_pressure_holds() -> None:
    assert play(5.0, 10.0, moving=True) == pytest.approx(MOST)
    assert hold(5.0, SETTINGS, CLUTCH, 0.8, 0.0, 2.0 * MOST, False, 10.0) == pytest.approx(0.8 * MOST)


@pytest.mark.parametrize("carried", [0.1, STUCK])
def test_plates_that_stick_are_held_with_a_margin_that_comes_at_the_rate(carried: float) -> None:
    required = max((1.0 + SETTINGS.margin) * carried, carried + SETTINGS.least)
    assert play(0.5 * required, STEP, carried=carried) == pytest.approx(0.5 * required + SETTINGS.rate * STEP)
    assert play(0.5 * required, 2.0, carried=carried) == required


def test_noise_of_the_torque_does_not_move_it() -> None:
    assert play(HELD, STEP, carried=STUCK / (1.0 + 0.9 * SETTINGS.margin)) == HELD


def test_what_is_needed_no_more_goes_with_the_time_constant() -> None:
    left = play(20.0, SETTINGS.time_constant, carried=1.0)
    required = max(1.0 + SETTINGS.margin, 1.0 + SETTINGS.least)
    assert left - required == pytest.approx(exp(-1.0) * (20.0 - required), rel=EULER)


def test_the_motor_may_give_what_the_highest_pressure_holds_with_the_margin() -> None:
    most = motor_limit(SETTINGS, CLUTCH, 0.9)
    assert hold(100.0, SETTINGS, CLUTCH, 0.9, 0.0, most, False, STEP) == pytest.approx((1.0 + SETTINGS.margin) * most)
