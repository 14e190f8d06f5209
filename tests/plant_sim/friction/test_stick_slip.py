"""A mass pulled through a spring: stick-slip below a critical speed, steady sliding above, higher with load (sec. 4.1.5)."""

import numpy as np

from plant_sim.friction.coupled import slide_mass
from tests.plant_sim.friction.models import LOAD, V_S, Case, every_loaded_model, every_model

MASS, SPRING, DAMPING = 1.0, 1000.0, 4.0  # kg, N/m, Ns/m: 5 Hz, damped by 6 %
STEP = 5e-4  # s
SPEEDS = V_S * np.array([0.5, 2.0, 30.0, 60.0])  # m/s


def find_least_speed(case: Case, pull: float, load: float = LOAD) -> float:
    """Lowest velocity over `pull` in the second half of a long pull at `pull` [m/s] from rest: 0 or less is stick-slip."""
    period = 2.0 * np.pi * np.sqrt(MASS / SPRING)
    build = 2.0 * case.highest * load / LOAD / SPRING / pull  # s, in which the spring is stretched from -F_S to F_S
    count = int((10.0 * period + 4.0 * build) / STEP)
    motion = np.empty((count, 3))
    slide_mass(
        case.model.law, case.model.parameters, case.model.rest(), MASS, DAMPING, SPRING, (0.0, 0.0),
        np.zeros(count), np.full(count, load), STEP, pull * STEP * np.arange(1, count + 1), motion, 1,
    )  # fmt: skip
    return float(motion[count // 2 :, 1].min() / pull)


@every_model
def test_stick_slip_below_a_critical_speed_and_steady_sliding_above(case: Case) -> None:
    sticks = np.array([find_least_speed(case, speed) < 0.1 for speed in SPEEDS])
    one_border = bool(sticks[0] and not sticks[-1] and np.count_nonzero(np.diff(sticks)) == 1)
    case.check_claim("stick_slip", one_border)
    if "stick_slip" in case.fails:
        assert not sticks[-1]


@every_loaded_model
def test_critical_speed_grows_with_load(case: Case) -> None:
    if "stick_slip" in case.fails:
        return
    borders = []
    for load in (LOAD, 2.0 * LOAD, 4.0 * LOAD):
        low, high = 0.1 * V_S, 100.0 * V_S
        while high / low > 1.1:
            middle = np.sqrt(low * high)
            low, high = (middle, high) if find_least_speed(case, middle, load) < 0.1 else (low, middle)
        borders.append(low)
    assert borders[0] < borders[1] < borders[2]
