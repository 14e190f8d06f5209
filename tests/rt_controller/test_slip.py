"""Slip observer: exact for constant speed and acceleration, stable at every rate, low noise from encoder counts."""

import re
from decimal import Decimal
from math import exp, floor, pi, sqrt

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from rt_controller.law.slip import observe
from rt_controller.loop.parameter_sets import load_controller_parameters

BANDWIDTH = load_controller_parameters()["slip.bandwidth"].si
COUNT = 2 * pi / 163840  # rad
RATES = (20, 50, 100, 250, 500, 1000, 2000, 4000, 10_000)
SETTLING = 40 / BANDWIDTH  # s: exp(-40) of any start is left, times a polynomial of degree 2
# After settling, what is left is rounding of angles up to 600 rad (1e-13 rad) divided by the step once or twice.
SPEED_TOLERANCE, ACCELERATION_TOLERANCE = 1e-8, 1e-4  # rad/s, rad/s^2; at 10 kHz
# Three equal poles are ill-conditioned: eps^(1/3) = 6e-6 is what an eigenvalue solver can tell them apart by.
POLE_TOLERANCE = 3e-5
# Counts at constant speed are not quite white: 0.8 of white noise over 40 random speeds, at some speeds 1.3.
NEARLY_WHITE = 0.6, 1.05


def make_transition(rate: float, bandwidth: float = BANDWIDTH) -> np.ndarray:
    """Return the matrix of the filter in (angle, speed T, acceleration T^2), from calls of the function."""
    step = 1.0 / rate
    scale = np.diag([1.0, step, step * step])
    columns = [observe((float(i == 0), float(i == 1), float(i == 2)), 0.0, step, bandwidth) for i in range(3)]
    return scale @ np.array(columns).T @ np.linalg.inv(scale)


def settle(rate: int, angle: object, speed: float) -> tuple[tuple[float, float, float], float]:
    """Return state and time [s] after the filter has settled on `angle(t)`, from a wrong initial state."""
    state, step = (0.5, speed - 3.0, 10.0), 1.0 / rate
    cycles = max(50, round(SETTLING * rate))
    for k in range(1, cycles + 1):
        state = observe(state, angle(k * step), step, BANDWIDTH)  # type: ignore[operator]
    return state, cycles * step


@pytest.mark.parametrize("rate", RATES)
def test_constant_speed_is_found_exactly(rate: int) -> None:
    (angle, speed, acceleration), time = settle(rate, lambda t: 1.0 + 20.0 * t, 20.0)
    assert angle == pytest.approx(1.0 + 20.0 * time, abs=SPEED_TOLERANCE)
    assert speed == pytest.approx(20.0, abs=SPEED_TOLERANCE)
    assert acceleration == pytest.approx(0.0, abs=ACCELERATION_TOLERANCE)


@pytest.mark.parametrize("rate", RATES)
def test_constant_acceleration_is_followed_without_lag(rate: int) -> None:
    (angle, speed, acceleration), time = settle(rate, lambda t: 5.0 * t - 15.0 * t * t, 5.0)
    assert angle == pytest.approx(5.0 * time - 15.0 * time**2, abs=SPEED_TOLERANCE)
    assert speed == pytest.approx(5.0 - 30.0 * time, abs=SPEED_TOLERANCE)
    assert acceleration == pytest.approx(-30.0, abs=ACCELERATION_TOLERANCE)


def test_a_missed_sample_leaves_constant_speed_exact() -> None:
    state, time = settle(1000, lambda t: 20.0 * t, 20.0)
    for ticks in (1, 7, 2, 1):
        time += ticks * 1e-3
        state = observe(state, 20.0 * time, ticks * 1e-3, BANDWIDTH)
        assert state[1] == pytest.approx(20.0, abs=SPEED_TOLERANCE)


@pytest.mark.parametrize("rate", RATES)
def test_observer_is_stable_with_all_poles_at_exp_minus_w_t(rate: int) -> None:
    poles = np.linalg.eigvals(make_transition(rate))
    assert abs(poles).max() < 1.0
    assert poles == pytest.approx(exp(-BANDWIDTH / rate), abs=POLE_TOLERANCE)


@given(st.floats(20.0, 10_000.0), st.floats(5.0, 2000.0))
def test_observer_is_stable_at_every_rate_and_allowed_bandwidth(rate: float, bandwidth: float) -> None:
    q = exp(-bandwidth / rate)
    result = np.poly(make_transition(rate, bandwidth))
    assert result == pytest.approx(np.poly([q, q, q]), abs=1e-9)  # the characteristic polynomial is well-conditioned


def test_observer_is_linear_and_odd() -> None:
    state, angle = (0.3, -2.0, 5.0), 0.41
    forward = observe(state, angle, 1e-3, BANDWIDTH)
    assert observe((-0.3, 2.0, -5.0), -angle, 1e-3, BANDWIDTH) == tuple(-value for value in forward)


def compute_acceleration_noise(rate: int) -> float:
    """Return the standard deviation of the acceleration [rad/s^2] for white, uniform noise of one count in the angle."""
    step, state = 1.0 / rate, (0.0, 0.0, 0.0)
    response = []
    for k in range(round(SETTLING * rate)):
        state = observe(state, 0.0 if k else 1.0, step, BANDWIDTH)
        response.append(state[2])
    return COUNT / sqrt(12.0) * sqrt(sum(value * value for value in response))


def read_claimed_noise() -> Decimal:
    """Return the number in the source text of `slip.bandwidth` in controller.toml."""
    result = re.search(
        r"noise of a count gives ([\d.]+) rad/s\^2", load_controller_parameters()["slip.bandwidth"].source
    )
    assert result
    return Decimal(result[1])


def test_noise_of_an_encoder_count_is_what_controller_toml_claims() -> None:
    claim = read_claimed_noise()
    assert round(Decimal(compute_acceleration_noise(1000)), -claim.as_tuple().exponent) == claim  # 0.0130 at 1 kHz


def test_a_real_encoder_is_as_noisy_as_white_noise_a_count_wide() -> None:
    generator, squares = np.random.default_rng(5), []
    for speed in generator.uniform(1.0, 25.0, 40):
        state = (0.0, float(speed), 0.0)
        for k in range(2000):
            state = observe(state, floor(speed * k * 1e-3 / COUNT) * COUNT, 1e-3, BANDWIDTH)
            if k * 1e-3 > SETTLING:
                squares.append(state[2] ** 2)
    assert NEARLY_WHITE[0] < sqrt(np.mean(squares)) / compute_acceleration_noise(1000) < NEARLY_WHITE[1]


def test_acceleration_noise_is_far_below_the_adaptations_limit() -> None:
    limit = load_controller_parameters()["adaptation.acceleration_limit"].si
    assert all(compute_acceleration_noise(rate) < 0.05 * limit for rate in RATES)
