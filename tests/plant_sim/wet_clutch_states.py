"""States of the simulated wet clutch under held inputs, and the inputs of several tests."""

from collections.abc import Iterable
from typing import Any

import numpy as np

from plant_sim.rigs import wet_clutch
from tests.plant_sim.wet_clutch_reference import A_CYL, BAR, K_S, K_STACK, KELVIN, P_CONTACT

SUBSTEPS = 10  # of 0.1 ms at 1 kHz: the shipped integration step
Piece = tuple[float, float, int]  # voltage [V], speed demand [rad/s], cycles


def make_rig(**changed: float) -> wet_clutch.Rig:
    names = {name.replace("__", "."): value for name, value in changed.items()}
    return wet_clutch.Rig(wet_clutch.load_nominal().with_values(names))


NOMINAL = make_rig()


def run(
    state: np.ndarray,
    pieces: Iterable[Piece],
    rig: Any = NOMINAL,
    period: float = 1e-3,
    substeps: int = SUBSTEPS,
) -> np.ndarray:
    """States after every cycle; effects begin at rest."""
    states = [wet_clutch.Whole(state, rig.table.make_rest_states())]
    for voltage, speed, cycles in pieces:
        for _ in range(cycles):
            states.append(rig.advance(states[-1], voltage, speed, 1e9, period, substeps))
    return np.concatenate([state.y for state in states[1:]])


def make_rest_state(speed: float, celsius: float = 70.0, rig: wet_clutch.Rig = NOMINAL) -> np.ndarray:
    return rig.make_rest_state(speed, celsius + KELVIN).y


def find_pressing_voltage(p_star: float) -> float:
    """Valve voltage at which the plates feel `p_star` [bar] in steady state: docs/rig.md, eq. 3 and 4 solved by hand."""
    deflection = (p_star - P_CONTACT) * A_CYL * BAR / K_STACK
    return (p_star + K_S * deflection / (A_CYL * BAR)) / 2.5


def press_plates(p_star: float, speed: float, rig: wet_clutch.Rig = NOMINAL, celsius: float = 70.0) -> np.ndarray:
    """State after a second at `p_star`, the temperature set back."""
    state = run(rig.fill(speed, celsius + KELVIN).y, [(find_pressing_voltage(p_star), speed, 1000)], rig)[-1:]
    state["temperature"] = celsius + KELVIN
    return state


def make_triangle(low: float, high: float, seconds: float, speed: float) -> list[Piece]:
    """A staircase of 20 ms up and down between two valve pressures [bar], `seconds` each way."""
    up = np.linspace(low, high, round(seconds / 0.02))
    return [(p / 2.5, speed, 20) for p in (*up, *up[::-1])]


STEP = [(3.4 / 2.5, 20.0, 350)]
