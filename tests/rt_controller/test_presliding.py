"""Elements of plates that bend: memory of reversals, and the torque of XGMS. Each test has the module as argument, so that it
can run on mutants (tests/mutation)."""

from math import exp
from types import ModuleType
from typing import Any

import numpy as np
import pytest

import rt_controller.law.presliding
from plant_sim.friction.load_law import Amontons
from plant_sim.friction.maxwell_slip import MaxwellSlip
from plant_sim.friction.xgms import XGMS
from rt_controller.law.record import make_record

# Binary fractions, so that sums are exact: the elements break away at 1/8, 1/4, 1/2 and 1 rad.
ANGLE, SPREAD = 1.0, 2.0
REACHES = np.array([0.125, 0.25, 0.5, 1.0])
CAPACITY = 8.0  # Nm
STEP = 0.125  # s
ROUNDING = 1e-13  # of 1


@pytest.fixture(scope="module")
def presliding() -> ModuleType:
    return rt_controller.law.presliding


class Plates:
    """The function `bend` of a module with a record of its own; m and `slides` are results of the last step."""

    def __init__(self, module: ModuleType, angle: float = ANGLE, spread: float = SPREAD) -> None:
        self._module = module
        self.state: Any = make_record(module.PRESLIDING)
        self._settings: Any = make_record(module.PRESLIDING_SETTINGS, angle=angle, spread=spread)
        self.m, self.slide = 0.0, False

    def turn(
        self,
        *angles: float,
        level: float = 1.0,
        attraction: float = 8.0,
        capacity: float = CAPACITY,
        step: float = STEP,
    ) -> float:
        for turned in angles:
            m, slide = self._module.bend(self.state, self._settings, turned, level, attraction, capacity, step)
            self.m, self.slide = float(m), bool(slide)
        return self.m

    def straighten(self) -> None:
        self._module.straighten(self.state)

    @property
    def shares(self) -> list[float]:
        return [float(share) for share in self.state.share]

    @property
    def latches(self) -> list[float]:
        return [float(latch) for latch in self.state.latch]


def compute_virgin_share(angle: float) -> float:
    """Return the share of the capacity that plates without history carry after a turn of `angle` [rad]."""
    return float(np.minimum(angle / REACHES, 1.0).mean())


def make_path(seed: int, count: int) -> np.ndarray:
    """Return angle steps [rad] of slow and fast motion in both directions; some are zero."""
    random = np.random.default_rng(seed)
    steps = 0.2 * random.normal(size=count) + 0.1 * np.sin(np.arange(count) / 5.0)
    return np.where(random.random(count) < 0.1, 0.0, steps)


def test_fresh_plates_break_away_one_element_after_the_other(presliding: ModuleType) -> None:
    for sign in (1.0, -1.0):
        plates = Plates(presliding)
        for count in range(1, 11):
            assert sign * plates.turn(0.125 * sign) == compute_virgin_share(0.125 * count)
            slip = 0.125 * count >= REACHES
            assert plates.latches == list(sign * slip)
            assert plates.slide == slip.all()


def test_one_turn_bends_as_many_small_ones(presliding: ModuleType) -> None:
    for angle in (0.0625, 0.3125, 0.75, 2.0):
        assert (
            Plates(presliding).turn(angle)
            == Plates(presliding).turn(*[angle / 64.0] * 64)
            == compute_virgin_share(angle)
        )


def test_without_a_spread_the_plates_are_one_spring(presliding: ModuleType) -> None:
    plates = Plates(presliding, angle=2.0, spread=1.0)
    assert plates.turn(0.5) == 0.25
    assert plates.turn(1.0) == 0.75
    assert plates.latches == [0.0] * 4
    assert plates.turn(1.0) == 1.0
    assert plates.slide


def test_a_loop_closes_where_it_began_and_is_forgotten(presliding: ModuleType) -> None:
    """Return-point memory."""
    plates = Plates(presliding)
    begun, shares = plates.turn(0.375), plates.shares
    assert plates.turn(-0.125) < begun
    assert plates.turn(0.0625, -0.0625) < begun, "a loop in the loop"
    assert plates.turn(0.125) == begun
    assert plates.shares == shares
    assert plates.turn(0.25) == compute_virgin_share(0.625), "as if there had been none"


def test_plates_that_turn_carry_twice_the_bend_of_fresh_ones(presliding: ModuleType) -> None:
    """Masing's rule."""
    for sign in (1.0, -1.0):
        for angle in (0.125, 0.25, 0.5, 1.0, 2.0, 3.0):
            plates = Plates(presliding)
            assert plates.turn(4.0 * sign) == sign
            assert plates.turn(-angle * sign) == sign * (1.0 - 2.0 * compute_virgin_share(angle / 2.0))
            assert plates.slide == (angle >= 2.0)


def test_the_torque_is_that_of_maxwell_slip_where_nothing_but_the_angle_changes(presliding: ModuleType) -> None:
    plates, theirs = Plates(presliding), MaxwellSlip(0.25 / REACHES, np.full(4, 0.25))
    steps = make_path(1, 400)
    force = theirs.trace(np.concatenate([[0.0], np.cumsum(steps)]), STEP).force[1:]
    assert [plates.turn(turned) for turned in steps] == pytest.approx(force, abs=ROUNDING * len(steps))


def test_the_torque_is_that_of_xgms_under_any_load_and_speed(presliding: ModuleType) -> None:
    beta, stribeck, attraction = 0.7, 0.5, 6.0
    random = np.random.default_rng(2)
    steps, loads = (
        make_path(3, 1000),
        CAPACITY * np.exp(0.5 * np.sin(np.arange(1000) / 7.0) + 0.1 * random.normal(size=1000)),
    )
    plates, state = Plates(presliding), np.zeros(8)
    for turned, load in zip(steps, loads, strict=True):
        level = 1.0 + (beta - 1.0) * exp(-stribeck * STEP / abs(turned)) if turned else 1.0
        # a spring in Nm/rad there, in shares of the capacity here
        model = XGMS(Amontons(1.0), load / 4.0 / REACHES, np.full(4, 0.25), beta, stribeck, 0.0, 1.0, attraction)
        force, state = model.step(state, turned, STEP, load)
        m = plates.turn(turned, level=level, attraction=attraction, capacity=load)
        assert m * load == pytest.approx(force, abs=1e-12 * CAPACITY)


def test_sliding_plates_go_to_their_level_exponentially_whatever_the_step(presliding: ModuleType) -> None:
    for steps in (1, 2, 16):
        plates = Plates(presliding)
        plates.turn(4.0)
        for _ in range(steps):
            plates.turn(1.0, level=0.75, attraction=6.0, step=0.25 / steps)
        assert plates.m == pytest.approx(0.75 + 0.25 * exp(-6.0 * 0.25 / 0.75), abs=ROUNDING)
        assert plates.slide
        assert plates.turn(1.0, level=1.0, attraction=1e6) == 1.0, "and back"


def test_a_stuck_element_slips_at_once_where_it_carries_more_than_sliding_does(presliding: ModuleType) -> None:
    plates = Plates(presliding)
    plates.turn(0.09375)
    shares = plates.shares
    assert shares == [0.75, 0.375, 0.1875, 0.09375]
    plates.turn(0.015625, level=0.5, attraction=4.0, step=0.25)
    assert plates.latches == [1.0, 0.0, 0.0, 0.0]
    assert plates.shares == pytest.approx([0.5 + 0.25 * exp(-2.0), 0.4375, 0.21875, 0.109375], abs=ROUNDING)
    plates.turn(0.015625, level=0.5)
    assert plates.latches == [1.0, 1.0, 0.0, 0.0], "exactly at the level it slips, too"


def test_the_load_alone_changes_the_torque_of_no_spring(presliding: ModuleType) -> None:
    for sign in (1.0, -1.0):
        plates = Plates(presliding)
        torque = plates.turn(0.0625 * sign, capacity=1.0)
        for capacity in (0.5, CAPACITY, 32.0, 1.0):
            shares = np.array(plates.shares) * float(plates.state.capacity)
            assert plates.turn(0.0, capacity=capacity) * capacity == torque
            assert list(np.array(plates.shares) * capacity) == list(shares)


def test_no_element_carries_more_than_its_limit_under_a_smaller_load(presliding: ModuleType) -> None:
    for sign in (1.0, -1.0):
        plates = Plates(presliding)
        plates.turn(0.09375 * sign)
        plates.turn(0.0, capacity=2.0)
        assert plates.shares == [sign, sign, 0.75 * sign, 0.375 * sign]
        plates.turn(0.0, capacity=4.0)
        assert plates.shares == [0.5 * sign, 0.5 * sign, 0.375 * sign, 0.1875 * sign], (
            "what has gone does not come back"
        )


def test_sliding_plates_carry_the_same_share_of_any_load(presliding: ModuleType) -> None:
    plates = Plates(presliding)
    plates.turn(2.0)
    assert plates.turn(0.125, capacity=2.0) == plates.turn(0.125, capacity=32.0) == 1.0


def test_plates_that_turn_under_another_load_keep_the_torque_of_their_springs(presliding: ModuleType) -> None:
    plates = Plates(presliding)
    plates.turn(2.0)
    assert plates.turn(-(2.0**-40), capacity=2.0 * CAPACITY) == pytest.approx(0.5, abs=1e-10)


def test_plates_that_stop_hold_what_they_carry_and_slip_no_more(presliding: ModuleType) -> None:
    for sign in (1.0, -1.0):
        plates = Plates(presliding)
        plates.turn(2.0 * sign)
        assert plates.turn(0.0) == sign
        assert plates.latches == [0.0] * 4
        assert not plates.slide
        assert plates.turn(0.0, capacity=2.0 * CAPACITY) == 0.5 * sign, "no element follows the load"
        assert plates.turn(1.0 * sign, capacity=2.0 * CAPACITY) == sign
        assert plates.slide


def test_plates_slide_when_every_element_does(presliding: ModuleType) -> None:
    """Under a smaller load those that carried most slip at once; one that was bent the other way does not."""
    plates = Plates(presliding)
    plates.turn(2.0, -0.1875)
    assert plates.shares == [-0.5, 0.25, 0.625, 0.8125]
    plates.turn(2.0**-10, capacity=CAPACITY / 2.0)
    assert plates.latches == [0.0, 0.0, 1.0, 1.0]
    assert not plates.slide


def test_still_is_the_time_since_all_elements_have_slipped(presliding: ModuleType) -> None:
    plates = Plates(presliding)
    sentence = []
    for turned in (0.25, 0.0, 0.5, 0.5, 0.5, 0.0, -0.25):
        plates.turn(turned)
        sentence.append(float(plates.state.still))
    assert sentence == [0.125, 0.25, 0.375, 0.0, 0.0, 0.125, 0.25]


def test_left_and_right_are_alike(presliding: ModuleType) -> None:
    one, other = Plates(presliding), Plates(presliding)
    random = np.random.default_rng(5)
    for turned in make_path(4, 300):
        level, capacity = float(random.uniform(0.7, 1.0)), float(random.uniform(1.0, 10.0))
        assert one.turn(turned, level=level, capacity=capacity) == -other.turn(-turned, level=level, capacity=capacity)
        assert one.slide == other.slide


def test_plates_that_have_parted_are_fresh(presliding: ModuleType) -> None:
    plates = Plates(presliding)
    plates.turn(2.0, -0.25)
    plates.straighten()
    assert not any(map(np.any, plates.state.tolist()))
    assert plates.turn(0.375) == compute_virgin_share(0.375)


def test_plates_without_a_capacity_carry_nothing(presliding: ModuleType) -> None:
    plates = Plates(presliding)
    plates.turn(0.25)
    assert plates.turn(0.0, capacity=0.0) == 0.0
    assert plates.turn(0.0) == 0.0, "nor after it"
    assert plates.turn(0.375) == compute_virgin_share(0.375)
