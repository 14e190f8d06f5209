"""What a step may be: any length, any number, in place, and without chatter."""

import numpy as np
import pytest

from plant_sim.friction.gms import GMS
from plant_sim.friction.xgms import XGMS
from tests.plant_sim.friction.models import CASES, F_S, LOAD, SPAN, V_S, Case, every_model
from tests.plant_sim.friction.test_invariance import DT, make_random_path, swell

ROUNDING = 1e-12  # of F_S
LATCHED = [case for case in CASES if isinstance(case.model, GMS | XGMS)]


def _collect_states(case: Case) -> list[np.ndarray]:
    """States met on a random way under constant load, from stick to slip in both directions."""
    return list(case.model.trace(make_random_path(2), DT, LOAD).state[50::301])


@every_model
def test_one_step_equals_many_at_the_same_velocity(case: Case) -> None:
    gap = 0.0
    for state in _collect_states(case):
        for speed in V_S * np.array([-3.0, -0.2, 0.01, 1.0, 20.0]):
            for distance in SPAN * np.array([0.1, 0.8, 3.0]) * np.sign(speed):
                forces = []
                for count in (1, 2, 7):
                    now = state
                    for _ in range(count):
                        force, now = case.model.step(now, distance / count, distance / speed / count, LOAD)
                    forces.append(force)
                gap = max(gap, float(np.ptp(forces)))
    case.check_gap("sub_steps", gap, 3.0 * case.accuracy * F_S, 1e-4 * F_S)


@every_model
def test_force_converges_as_the_step_shrinks_where_the_velocity_changes(case: Case) -> None:
    """A velocity that is constant over each step is the only approximation. Its error is of first order.

    Where elements change to slip inside a step the error jumps about that line; |v|^(1/2) makes it of order 1/2 at reversal.
    """
    frequency, steps = 20.0, 500

    def force(refined: int) -> np.ndarray:
        time = np.arange(steps * refined + 1) / (steps * refined) / frequency
        position = 40.0 * SPAN * (1.0 - np.cos(2.0 * np.pi * frequency * time))  # up to 5 V_S
        return case.model.trace(position, time[1], LOAD).force[::refined]

    fine, refinements = force(256), np.array([1, 2, 4, 8, 16, 32])
    errors = np.array([np.sqrt(np.mean((force(refined) - fine) ** 2)) for refined in refinements])
    if errors.max() > 10.0 * case.accuracy * F_S or case.accuracy > 1e-4:
        order = -np.polyfit(np.log(refinements), np.log(errors), 1)[0]
        assert order > 0.5


@every_model
def test_state_may_be_written_in_place(case: Case) -> None:
    position, loads = make_random_path(4), swell(4)
    expected = case.model.trace(position, DT, loads)
    state = case.model.rest()
    for i in range(1, position.size):
        force = case.model.law(case.model.parameters, state, position[i] - position[i - 1], DT, loads[i], state)
        assert force == expected.force[i]
    np.testing.assert_array_equal(state, expected.state[-1])


@every_model
def test_a_trial_step_leaves_the_state(case: Case) -> None:
    state = case.model.trace(make_random_path(5), DT, LOAD).state[-1]
    before = state.copy()
    once = case.model.step(state, 0.3 * SPAN, DT, LOAD)
    again = case.model.step(state, 0.3 * SPAN, DT, LOAD)
    np.testing.assert_array_equal(state, before)
    assert once[0] == again[0]


@every_model
def test_force_is_continuous_at_rest(case: Case) -> None:
    """The force of an ever shorter displacement, from any state, tends to that of none - in both directions."""
    gap = 0.0
    for state in _collect_states(case):
        here = case.model.step(state, 0.0, DT, LOAD)[0]
        for way in (1e-12, -1e-12):
            gap = max(gap, abs(case.model.step(state, way * SPAN, DT, LOAD)[0] - here))
    case.check_gap("continuous_at_rest", gap, 1e-6 * F_S, 1e-2 * F_S)


@every_model
def test_a_contact_at_rest_keeps_its_force_for_any_time(case: Case) -> None:
    """No dwell time: 1 s and 1000 s of rest end in the same state, so break-away after them is the same."""
    for state in _collect_states(case):
        briefly, after_briefly = case.model.step(state, 0.0, 1.0, LOAD)
        long, after_long = case.model.step(state, 0.0, 1000.0, LOAD)
        assert briefly == long
        np.testing.assert_array_equal(after_briefly, after_long)


@pytest.mark.parametrize("case", LATCHED, ids=lambda case: case.name)
@pytest.mark.parametrize("loaded", [False, True])
def test_no_chatter(case: Case, loaded: bool) -> None:
    """An element goes from stick to slip once and back once between two reversals, whatever speed and load do."""
    n = case.model.stiffness.size
    time = np.linspace(0.0, 1.0, 40_001)
    position = 3.0 * SPAN * np.sin(2.0 * np.pi * 7.0 * time) + 2.0 * SPAN * np.sin(2.0 * np.pi * 31.0 * time)
    position = np.round(position, 8)  # with many samples at standstill
    moving = np.sign(np.diff(position))
    moving = moving[moving != 0.0]
    reversals = int(np.count_nonzero(np.diff(moving)))
    stops = int(np.count_nonzero((np.diff(position)[1:] == 0.0) & (np.diff(position)[:-1] != 0.0)))
    loads = LOAD * (1.0 + 0.9 * np.sin(2.0 * np.pi * 300.0 * time)) if loaded else LOAD
    latches = np.sign(case.model.trace(position, time[1], loads).state[:, n : 2 * n])
    switches = np.count_nonzero(np.diff(latches, axis=0), axis=0)
    assert np.all(switches <= 2 * (reversals + stops + 1))
    assert switches.min() >= reversals // 4  # they do slip


@pytest.mark.parametrize("case", LATCHED, ids=lambda case: case.name)
def test_once_slipping_slips_until_the_velocity_reverses_or_is_zero(case: Case) -> None:
    n = case.model.stiffness.size
    random = np.random.default_rng(8)
    speeds = V_S * 10.0 ** random.uniform(-3.0, 2.0, 2000)
    position = np.concatenate([[0.0, 10.0 * SPAN], 10.0 * SPAN + np.cumsum(speeds * DT)])
    latches = np.sign(case.model.trace(position, DT, swell(8, position.size) + 0.1).state[2:, n : 2 * n])
    assert np.all(latches == 1.0)
