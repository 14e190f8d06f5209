"""Break-away of a mass under a growing force: lower the quicker the force grows (Johannes et al. 1973; figs 2.6, 4.1)."""

import numpy as np

from plant_sim.friction.coupled import slide_mass
from tests.plant_sim.friction.models import F_C, F_S, LOAD, SPAN, V_S, Case, K, every_model

MASS = 0.02  # kg; MASS/STEP is above the steepest fall of s(v) and above the bristle damping, as `coupled` needs
STEP = 1e-5  # s
RATES = V_S * K * np.array([0.02, 0.2, 2.0, 20.0])  # N/s; the last one stretches a spring K at 20 V_S
PEAK = 1e-6 * F_S  # N


def push_mass(case: Case, rate: float, rest: float = 0.0) -> np.ndarray:
    """Friction without viscous part [N] on a mass under a force that grows at `rate` [N/s] until it is well off.

    The contact has slid to and fro and then stood still for `rest` [s], if that is not 0.
    """
    state = case.model.rest()
    if rest:
        slid = case.model.trace(np.array([0.0, 1e-3, 0.0]), 0.1, LOAD).state[-1]
        _, state = case.model.step(slid, 0.0, rest, LOAD)
    dt = min(STEP, F_S / rate / 1000.0)
    force = rate * dt * np.arange(1, int((1.2 * case.highest / rate + 2e-3) / dt))
    motion = np.empty((force.size, 3))
    slide_mass(
        case.model.law, case.model.parameters, state, MASS, 0.0, 0.0, (0.0, 0.0), force, np.full(force.size, LOAD),
        dt, np.zeros(force.size), motion, 1,
    )  # fmt: skip
    assert motion[-1, 0] > 5.0 * SPAN
    return motion[:, 2] - case.viscous * np.abs(motion[:, 1]) ** case.exponent


@every_model
def test_break_away_force_falls_with_the_rate(case: Case) -> None:
    """From F_S towards F_C. A model whose force does not fall after break-away has no such force."""
    traces = [push_mass(case, rate) for rate in RATES]
    peaks = np.array([friction.max() for friction in traces])
    breaks = all(friction.max() > friction[-1] + PEAK for friction in traces)
    falls = breaks and bool(np.all(np.diff(peaks) <= PEAK)) and peaks[-1] < peaks[0] - 0.1 * F_S
    case.check_claim("break_away_falls", falls)
    if falls:
        assert F_C < peaks[-1] < peaks[0] <= F_S + PEAK
        assert peaks[0] > 0.8 * F_S


@every_model
def test_break_away_does_not_depend_on_the_time_at_rest(case: Case) -> None:
    """None of these models knows dwell time: only the asperities of the generic models do."""
    briefly, long = (push_mass(case, RATES[1], rest) for rest in (1.0, 1000.0))
    np.testing.assert_array_equal(briefly, long)
