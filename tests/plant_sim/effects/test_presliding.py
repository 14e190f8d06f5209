"""Presliding: the elements by themselves, against Masing's rules, and in the rig."""

from math import pi, sin

import numpy as np
import pytest

from plant_sim.effects.signals import TORQUE
from tests.plant_sim.effects.lone_effect import LoneEffect
from tests.plant_sim.effects.pressed_rig import STEP, find_pressing_voltage, make_rig, press_rig, simulate_states
from tests.plant_sim.effects.test_friction import EXACT, settle_state

DRIFT = 1e-9  # rad a cycle, once the level has settled; measured 4e-10, and half of it in the next
TURN = 1.0  # Nm a step of 0.1 ms: the viscous part turns over; measured 0.32


class Spring:
    """The elements under a sliding torque of 10 Nm, moved by angles."""

    def __init__(self) -> None:
        self.effect = LoneEffect("presliding", angle=0.01)

    def move(self, angle: float) -> float:
        slip = angle / STEP
        level = 10.0 if angle >= 0.0 else -10.0
        return self.effect(TORQUE, STEP, torque=level, slip=slip, contact=1.0, viscous_share=0.0).torque


def test_torque_rises_as_a_spring_and_then_slides_at_the_baseline_s_torque() -> None:
    spring = Spring()
    virgin = [spring.move(0.01 / 80) for _ in range(100)]
    assert virgin[0] == pytest.approx(10.0 * (8 + 4 + 2 + 1) / 4 / 80, rel=EXACT)
    assert (np.diff(virgin) >= 0).all()
    assert virgin[-1] == 10.0


@pytest.mark.parametrize("turn", [0.002, 0.007, 0.03])
def test_reversal_curve_obeys_masing(turn: float) -> None:
    reversed_, virgin = Spring(), Spring()
    top = reversed_.move(turn)
    for way in np.full(40, turn / 20.0):
        after, first = reversed_.move(-way), virgin.move(way / 2.0)
        assert top - after == pytest.approx(2.0 * first, rel=1e-9)


def test_minor_loop_closes() -> None:
    spring = Spring()
    before = spring.move(0.004)
    spring.move(-0.003)
    assert spring.move(0.003) == pytest.approx(before, rel=EXACT)


def test_no_cycle_of_pre_sliding_gives_energy() -> None:
    moves = np.random.default_rng(3).normal(0.0, 2e-3, 2000)
    spring, work, stored = Spring(), 0.0, 0.0
    for move in moves:
        parts = [spring.move(move / 50) for _ in range(50)]
        work += sum(parts) * move / 50
        bent = spring.effect.x.bent
        stored = sum(0.5 * 2.5 * f**2 * 0.01 / 2 ** (3 - i) for i, f in enumerate(bent))
        assert work >= stored - 1e-12


HELD = {"motor.proportional_gain": 1.0, "motor.integral_gain": 0.0}  # the motor's torque is nearly its speed demand


def test_plates_held_below_break_away_bend_and_do_not_drift() -> None:
    of = make_rig(HELD | {"presliding.angle": 0.01})
    begin = press_rig(of, 3.4, 0.0)
    y, _ = simulate_states(of, begin, find_pressing_voltage(3.4), lambda t: 5.0 + 3.0 * sin(2 * pi * 10.0 * t), 1.5)
    cycles = y["angle"][::1000]  # every 0.1 s
    # of four elements the first two slide at 8 Nm: (1 + 1 + 2 u + u)/4 = 8 Nm/M_C; the way back to 2 Nm by Masing's rule
    furthest, nearest = 0.01 * (4.0 * 8.0 / 11.62 - 2.0) / 3.0, 2.0 * 0.01 / 15.0 * 4.0 * 3.0 / 11.62
    assert y["angle"].max() == pytest.approx(furthest, rel=0.1)
    assert y["angle"][-1000:].min() == pytest.approx(furthest - nearest, rel=0.1)
    assert abs(np.diff(cycles)[-1]) < DRIFT


@pytest.mark.parametrize("asymmetry", [0.0, 0.3])
def test_torque_passes_from_one_direction_to_the_other_without_notch_or_jump(asymmetry: float) -> None:
    stiff = {"motor.proportional_gain": 100.0, "motor.integral_gain": 1000.0, "motor.inertia": 0.5}
    stiff |= {"direction_asymmetry.asymmetry": asymmetry}
    of, plain = make_rig(stiff | {"presliding.angle": 0.02}), make_rig(stiff)
    speed = lambda t: 1.0 - 4.0 * min(t, 0.5)  # noqa: E731
    y, other = (
        simulate_states(one, press_rig(one, 3.4, 1.0), find_pressing_voltage(3.4), speed, 0.6)[0] for one in (of, plain)
    )
    turned = int(np.argmax(y["slip_speed"] < 0.0))
    slid = turned + int(np.argmax(y["angle"][turned:] < y["angle"][turned] - 2 * 0.02))
    assert 0 < turned < slid
    torque = y["clutch_torque"][turned + 1 : slid]
    assert torque[0] > 5.0
    assert torque[-1] < -7.0
    assert np.abs(np.diff(y["clutch_torque"][turned - 5 : slid])).max() < TURN
    assert np.diff(torque).max() < 1e-3
    assert y["clutch_torque"][-1] == pytest.approx(other["clutch_torque"][-1], rel=1e-3)


def test_viscous_friction_turns_over_at_once() -> None:
    spring = LoneEffect("presliding", angle=0.01)
    signals = {"contact": 1.0, "viscous_share": 0.2}
    ahead = [spring(TORQUE, STEP, torque=10.0, slip=1.0, **signals).torque for _ in range(200)]
    assert ahead[0] == pytest.approx(2.0 + 8.0 * 15 / 4 * STEP / 0.01, rel=EXACT)
    assert ahead[-1] == pytest.approx(10.0, rel=EXACT)
    back = spring(TORQUE, 0.0, torque=-10.0, slip=-1.0, **signals).torque
    assert back == pytest.approx(8.0 - 2.0, rel=EXACT)


def test_gross_sliding_is_the_baseline() -> None:
    changed = {"presliding.angle": 2e-3, "friction_level.level": 0.9}
    with_, without = (settle_state(one) for one in (changed, {"friction_level.level": 0.9}))
    assert with_["clutch_torque"] == pytest.approx(without["clutch_torque"], rel=1e-6)


def test_open_plates_lose_their_bend() -> None:
    of = make_rig({"presliding.angle": 0.02})
    y, x = simulate_states(of, press_rig(of, 3.0, 10.0), 0.0, 10.0, 0.3)
    assert y["normal_force"][-1] == 0.0
    assert (x[-1] == 0.0).all()
