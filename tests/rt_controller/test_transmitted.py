"""Estimate of the torque of plates that rest, break away and slide, from the applied motor torque, sample by sample."""

from typing import Any

import pytest

from protocols.can.frames import load_frames
from rt_controller.law.estimator import coulomb_torque
from rt_controller.law.record import make_record
from rt_controller.law.sample import SAMPLE
from rt_controller.law.transmitted import TORQUE_SETTINGS, estimate, make_torque_at_rest, make_torque_settings
from rt_controller.loop.parameter_sets import load_controller_parameters

BAR, CELSIUS = 1e5, 273.15
STEP = 1e-3  # s
PRESSURE = 3.2 * BAR
COUNT = load_frames()["ENCODER"].scale["shaft_angle"] / STEP  # rad/s: a count of the encoder in a sample
SETTINGS: Any = make_record(TORQUE_SETTINGS, make_torque_settings(load_controller_parameters(), True, True))
CAPACITY = float(coulomb_torque(SETTINGS.model, PRESSURE))  # Nm, of plates of level 1
DOUBT = 0.03  # of the torque at rest: what the motor's gain error and a creep that no encoder shows may be


class Clutch:
    """The torque estimator with plates under constant pressure."""

    def __init__(self) -> None:
        self.torque = make_torque_at_rest()

    def feels(self, applied: float, speed: float = 0.0, times: int = 1) -> Any:
        """Estimate for `times` samples with the motor torque `applied` [Nm] and the encoder `speed` [rad/s]; return TORQUE."""
        sample = make_record(
            SAMPLE, pressure=PRESSURE, temperature=70.0 + CELSIUS, motor_torque=applied, applied=applied, known=True,
            speed=speed, slip=speed,
        )  # fmt: skip
        for _ in range(times):
            estimate(self.torque, SETTINGS, True, True, 0.0, False, sample, STEP)
        return self.torque

    def shows(self, share: float, speed: float = 0.0, times: int = 1) -> float:
        """Estimate with a motor torque that is a share of the capacity; return the friction level [-]."""
        return float(self.feels(share * CAPACITY, speed, times).level)


@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_plates_at_rest_carry_what_is_applied(sign: float) -> None:
    clutch = Clutch()
    for applied in (0.0, 2.0, 5.0, 0.95 * CAPACITY, -3.0, 0.0):
        assert float(clutch.feels(sign * applied, times=5).estimate) == pytest.approx(sign * applied, abs=1e-12)
        assert clutch.torque.stands
        assert clutch.torque.level == 1.0


@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_plates_that_rest_under_more_than_they_are_believed_to_carry_show_their_level(sign: float) -> None:
    clutch = Clutch()
    assert clutch.shows(0.9 * sign, times=100) == 1.0
    assert clutch.shows(1.2 * sign) == 1.0, "in one sample the motor would not have turned by a count"
    assert clutch.shows(1.2 * sign, times=100) == pytest.approx(1.2 / (1.0 + DOUBT), rel=DOUBT)
    assert float(clutch.torque.estimate) == pytest.approx(1.2 * sign * CAPACITY, rel=1e-4)
    assert clutch.shows(0.5 * sign, times=100) > 1.2 / (1.0 + 2.0 * DOUBT), "they have been able to once"


def test_what_plates_at_rest_show_stays_within_the_bounds_of_a_friction_level() -> None:
    assert Clutch().shows(5.0, times=1000) == SETTINGS.adaptation.level_high


@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_plates_that_break_away_show_that_they_carry_no_more(sign: float) -> None:
    clutch = Clutch()
    assert clutch.shows(0.8 * sign, times=100) == 1.0
    counts = int(SETTINGS.motion.stick_angle / (COUNT * STEP))
    assert clutch.shows(0.8 * sign, sign * COUNT, times=counts) > 0.95, "a few counts are no slide"
    assert clutch.shows(0.8 * sign, sign * COUNT, times=2) == pytest.approx(0.8, abs=DOUBT)


def test_plates_that_break_away_from_little_are_no_weaker_than_a_friction_level_can_be() -> None:
    clutch = Clutch()
    clutch.shows(0.1, times=100)
    assert clutch.shows(0.1, COUNT, times=12) >= SETTINGS.adaptation.level_low


def test_plates_that_have_only_just_stopped_show_nothing_when_they_go_on() -> None:
    clutch = Clutch()
    clutch.shows(1.0, 1.0, times=100)
    clutch.shows(0.3, times=10)
    assert clutch.shows(0.3, COUNT, times=10) > 0.8, "a break-away would be one from 0.6 at most"


def test_without_adaptation_nothing_is_learnt() -> None:
    fixed = SETTINGS.copy()
    fixed.adapts = False
    clutch = Clutch()
    sample = make_record(SAMPLE, pressure=PRESSURE, temperature=70.0 + CELSIUS, motor_torque=1.2 * CAPACITY)
    for _ in range(200):
        estimate(clutch.torque, fixed, True, True, 0.0, False, sample, STEP)
    assert clutch.torque.level == 1.0


def test_a_motor_that_turns_when_the_run_begins_shows_no_torque() -> None:
    clutch = Clutch()
    sample = make_record(SAMPLE, pressure=0.0, temperature=70.0 + CELSIUS, speed=10.0, slip=10.0, known=True)
    for _ in range(10):
        estimate(clutch.torque, SETTINGS, False, False, 10.0, False, sample, STEP)
        assert clutch.torque.observed == 0.0
    estimate(clutch.torque, SETTINGS, False, False, 11.0, False, sample, STEP)
    for _ in range(3):
        estimate(clutch.torque, SETTINGS, False, False, 11.0, False, sample, STEP)
    assert clutch.torque.observed > 0.0, "a later demand makes the motor's torque jump"
