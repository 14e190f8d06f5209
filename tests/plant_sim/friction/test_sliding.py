"""Gross sliding: the Stribeck curve is reached from anywhere, and the force lags behind it."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from plant_sim.friction.gms import GMS
from plant_sim.friction.load_law import Amontons
from plant_sim.friction.xgms import XGMS
from tests.plant_sim.friction.models import (
    BETA,
    F_C,
    F_S,
    LOAD,
    V_S,
    C,
    Case,
    K,
    compute_stribeck,
    every_model,
    make_curve,
    split,
)

SPEEDS = V_S * np.array([0.02, 0.3, 1.0, 4.0, 30.0])  # m/s
STEADY = 1e-9  # of F_S
MIDDLE, SWING = 2.0 * V_S, 1.5 * V_S  # m/s, of the sliding in which the lag is measured


def _settle_force(case: Case, velocity: float, before: float) -> float:
    """Force [N] after 4 s at `velocity`, once slid at `before` [m/s]."""
    velocities = np.concatenate([np.full(100, before), np.full(400, velocity)])
    position = np.concatenate([[0.0], np.cumsum(velocities) * 0.01])
    return float(case.model.trace(position, 0.01, LOAD).force[-1])


@every_model
@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_constant_velocity_ends_on_the_stribeck_curve(case: Case, sign: float) -> None:
    for speed in SPEEDS:
        expected = compute_stribeck(case, sign * speed)
        for before in (0.0, 10.0 * speed, -0.1 * speed):
            assert _settle_force(case, sign * speed, before) == pytest.approx(expected, rel=STEADY)
    np.testing.assert_allclose(
        case.model.steady_state(sign * SPEEDS, LOAD), compute_stribeck(case, sign * SPEEDS), rtol=1e-14, atol=0.0
    )


@settings(max_examples=30, derandomize=True)
@given(parts=st.lists(st.floats(0.05, 1.0), min_size=1, max_size=12), speed=st.floats(0.1, 20.0), sign=st.booleans())
def test_steady_state_is_the_same_for_any_number_and_split_of_elements(parts, speed, sign) -> None:
    weights = np.array(parts) / np.sum(parts)
    velocity = (1.0 if sign else -1.0) * speed * V_S
    expected = np.sign(velocity) * F_S * (1.0 + (BETA - 1.0) * np.exp(-V_S / abs(velocity)))
    for model in (
        GMS(make_curve(), K * weights[::-1], weights, C * F_S),
        XGMS(Amontons(F_S / LOAD), K * weights[::-1], weights, BETA, V_S, attraction=C),
    ):
        force = model.trace(np.arange(400) * velocity * 0.01, 0.01, LOAD).force[-1]
        assert force == pytest.approx(expected, rel=STEADY)


def _integrate_loop(case: Case, frequency: float, samples: int = 4000) -> float:
    """Loop integral of force over velocity in unidirectional sliding [W]: positive if the force is higher accelerating."""
    dt = 1.0 / frequency / samples
    velocity = MIDDLE + SWING * np.sin(2.0 * np.pi * (np.arange(2 * samples) + 0.5) / samples)
    position = np.concatenate([[0.0], np.cumsum(velocity) * dt])
    force, velocity = case.model.trace(position, dt, LOAD).force[-samples:], velocity[-samples:]
    return 0.5 * float(np.sum((force + np.roll(force, 1)) * (velocity - np.roll(velocity, 1))))


@every_model
def test_friction_lag(case: Case) -> None:
    """More force accelerating than decelerating; the loop grows with the frequency and vanishes with it."""
    areas = [_integrate_loop(case, frequency) / SWING / F_S for frequency in (4.0, 16.0, 64.0)]
    lags = 1e-6 < areas[0] < areas[1] < areas[2] and areas[0] < 0.3 * areas[1]  # in proportion to f when f is low
    case.check_claim("friction_lag", lags)


def test_lag_vanishes_as_the_attraction_grows() -> None:
    slow, quick, without = (
        _integrate_loop(Case("gms", GMS(make_curve(), *split(4), attraction * F_S)), 16.0, 20_000)
        for attraction in (1000.0, 10_000.0, np.inf)
    )
    assert slow / quick == pytest.approx(10.0, rel=0.05)  # a narrow loop is as wide as 1/C
    assert abs(without) <= 1e-12 * (F_S - F_C) * SWING


def test_rising_curve_turns_the_loop_round() -> None:
    """Velocity strengthening: the force still lags, so it is lower accelerating (sec. 4.1.3, lubricated)."""
    for model in (
        GMS(make_curve(beta=1.5), *split(4), C * F_S),
        XGMS(Amontons(F_S / LOAD), *split(4), 1.5, V_S, attraction=C),
    ):
        assert _integrate_loop(Case("rising", model, beta=1.5), 16.0) < -1e-2 * SWING * F_S


def test_lag_is_the_same_under_any_load() -> None:
    """Sec. 6.2.3: the tangential dynamics are those of the normalised force."""
    model = XGMS(Amontons(F_S / LOAD), *split(4), BETA, V_S, attraction=C)
    velocity = MIDDLE + SWING * np.sin(np.linspace(0.0, 4.0 * np.pi, 4000))
    position = np.cumsum(velocity) * 1e-4
    light, heavy = (model.trace(position, 1e-4, load).force[-2000:] / load for load in (LOAD, 3.0 * LOAD))
    np.testing.assert_allclose(light, heavy, rtol=1e-12)
