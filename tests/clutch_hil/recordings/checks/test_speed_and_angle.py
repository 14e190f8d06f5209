"""A slip that is a multiple of the rate of its angle is told; what differs in another way is not."""

import numpy as np
import pytest
from scipy.integrate import cumulative_trapezoid
from scipy.signal import lfilter

from clutch_hil.recordings.checks.knowledge import Recorded
from clutch_hil.recordings.checks.speed_and_angle import ANGLE, SPEED, find_scaled_speed

ROWS = 6000
TIME = 1e-3 * np.arange(ROWS)
SLIP = 20.0 + 8.0 * np.sin(1.3 * TIME) + 3.0 * np.sin(40.0 * TIME)  # rad/s
NOISE = 0.05 * np.random.default_rng(1).standard_normal(ROWS)
TRUE_ANGLE = 0.3 + cumulative_trapezoid(SLIP, TIME, initial=0.0)  # rad


def find(speed: np.ndarray, angle: np.ndarray = TRUE_ANGLE) -> list[str]:
    run = Recorded("r", {"time_s": TIME, SPEED: speed, ANGLE: angle}, {})
    return [str(finding) for finding in find_scaled_speed(run)]


@pytest.mark.parametrize("ratio", [1.03, 0.98, -1.0, 2.5, 60.0 / (2.0 * np.pi), 1.0 / 3.0])
@pytest.mark.parametrize("zero", [0.0, 0.4])
def test_another_scale_is_told_with_its_ratio(ratio: float, zero: float) -> None:
    (text,) = find(ratio * SLIP + zero + NOISE)
    assert float(text.partition(", is ")[2].split()[0]) == pytest.approx(ratio, rel=5e-4)
    assert f"times the rate of {ANGLE}" in text


def test_an_angle_of_another_scale_is_told() -> None:
    (text,) = find(SLIP + NOISE, 1.1 * TRUE_ANGLE)
    assert "is 0.909" in text


@pytest.mark.parametrize(
    ("speed", "angle"),
    [
        (SLIP + NOISE, TRUE_ANGLE),
        (1.005 * SLIP, TRUE_ANGLE),
        (SLIP + 0.5, TRUE_ANGLE),  # the zero of a tachometer
        (np.roll(SLIP, 30), TRUE_ANGLE),  # 30 ms late
        (lfilter([0.01], [1.0, -0.99], SLIP, zi=[0.99 * SLIP[0]])[0], TRUE_ANGLE),  # a filter of 100 ms
        (SLIP + NOISE, np.mod(TRUE_ANGLE, 2.0 * np.pi)),  # `wrapped` tells this
        (SLIP + NOISE, np.zeros(ROWS)),
        (np.full(ROWS, 20.6), 20.0 * TIME),  # at one speed a ratio and a zero are the same
        (np.zeros(ROWS), TRUE_ANGLE),
    ],
)
def test_what_is_no_other_scale_gives_no_finding(speed: np.ndarray, angle: np.ndarray) -> None:
    assert find(speed, angle) == []


def test_a_short_run_gives_no_finding() -> None:
    columns = {"time_s": TIME[:300], SPEED: 2.0 * SLIP[:300], ANGLE: TRUE_ANGLE[:300]}
    assert find_scaled_speed(Recorded("r", columns, {})) == []
