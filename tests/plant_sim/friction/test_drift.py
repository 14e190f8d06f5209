"""A mass under half of F_C and an oscillation of 0.3 F_C, both below break-away, stays where it is for 1e4 cycles."""

import numpy as np

from plant_sim.friction.coupled import slide_mass
from tests.plant_sim.friction.models import F_C, LOAD, SPAN, Case, every_model

MASS, FREQUENCY = 1.0, 10.0  # kg, Hz; far below the resonance of the mass on the contact
CYCLES, STEPS = 10_000, 20  # STEPS a cycle
SETTLED = 100  # cycles, for the force to come on slowly and the springs to find their loop


def measure_drift(case: Case, cycles: int = CYCLES) -> float:
    """Way [m] of the mass from cycle SETTLED to the last."""
    now = np.arange(1, cycles * STEPS + 1) / STEPS
    bias = 0.5 * F_C * np.minimum(now / (0.5 * SETTLED), 1.0)
    force = bias + 0.3 * F_C * np.sin(2.0 * np.pi * now)
    motion = np.empty((cycles, 3))
    slide_mass(
        case.model.law, case.model.parameters, case.model.rest(), MASS, 0.0, 0.0, (0.0, 0.0), force,
        np.full(force.size, LOAD), 1.0 / FREQUENCY / STEPS, np.zeros(force.size), motion, STEPS,
    )  # fmt: skip
    return float(np.abs(motion[SETTLED:, 0] - motion[SETTLED, 0]).max())


@every_model
def test_drift(case: Case) -> None:
    """Without drift the way is rounding; with it, more than half the pre-sliding length after 3000 cycles."""
    way = measure_drift(case, 3000 if "no_drift" in case.fails else CYCLES)
    case.check_gap("no_drift", way, 1e-9 * SPAN, 0.5 * SPAN)
