"""Symmetries and bounds: odd in the motion, no element above its limit, no order of elements, force scaled with load."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st

from plant_sim.friction.gms import GMS
from plant_sim.friction.leuven import Leuven
from plant_sim.friction.load_law import Amontons
from plant_sim.friction.maxwell_slip import MaxwellSlip
from plant_sim.friction.xgms import XGMS
from tests.plant_sim.friction.models import (
    CASES,
    F_S,
    LOAD,
    SPAN,
    V_S,
    Case,
    K,
    every_element_model,
    every_loaded_model,
    every_model,
    split,
)

DT = 1e-3  # s
ROUNDING = 1e-12  # of F_S


def make_random_path(seed: int, count: int = 3000, dt: float = DT) -> np.ndarray:
    """Positions [m] of a random motion: rest, pre-sliding and sliding at all speeds in both directions."""
    random = np.random.default_rng(seed)
    speed = V_S * 10.0 ** random.uniform(-4.0, 1.5, count) * random.choice([-1.0, 0.0, 1.0], count, p=[0.45, 0.1, 0.45])
    held = np.repeat(speed, random.integers(1, 20, count))[:count]
    return np.concatenate([[0.0], np.cumsum(held) * dt])


def swell(seed: int, count: int = 3001) -> np.ndarray:
    """Loads [N] that rise, fall, jump and go to 0."""
    random = np.random.default_rng(seed)
    held = np.repeat(LOAD * random.choice([0.0, 0.2, 0.7, 1.0, 3.0], count), random.integers(1, 100, count))[:count]
    ramp = LOAD * (1.0 + np.sin(np.arange(count) * 0.03))
    return np.where(np.arange(count) % 1000 < 500, held, ramp)


@every_model
def test_odd(case: Case) -> None:
    for seed in range(3):
        position, loads = make_random_path(seed), swell(seed)
        there, mirrored = (case.model.trace(sign * position, DT, loads).force for sign in (1.0, -1.0))
        np.testing.assert_array_equal(mirrored, -there)


@every_model
def test_force_is_bounded(case: Case) -> None:
    excess = 0.0
    for seed, dt in enumerate((1e-2, 1e-3, 1e-5)):
        position = make_random_path(seed, dt=dt)
        velocity = np.diff(position, prepend=0.0) / dt
        viscous = np.sign(velocity) * case.viscous * np.abs(velocity) ** case.exponent
        force = case.model.trace(position, dt, LOAD).force
        excess = max(excess, float(np.abs(force - viscous).max()) - case.highest)
    case.check_gap("bounded", excess, max(case.accuracy, ROUNDING) * F_S, 1e-3 * F_S)


@settings(max_examples=40, derandomize=True)
@given(st.lists(st.tuples(st.floats(-1e3, 1e3), st.floats(1e-9, 1e6), st.floats(0.0, 1e6)), min_size=1, max_size=12))
@example([(1.0, 1.0, 1e-310), (1.0, 0.5, 4.0)])  # a load that has decayed to next to nothing, then jumps
def test_any_steps_are_finite_and_below_the_bound(steps: list[tuple[float, float, float]]) -> None:
    """Huge and tiny displacements, times and loads, in any order."""
    for case in CASES:
        state = case.model.rest()
        for displacement, time, load in steps:
            force, state = case.model.step(state, displacement, time, load)
            assert np.isfinite(force), case.name
            assert np.isfinite(state).all(), case.name
            if isinstance(case.model, XGMS):
                limits = case.model.weights * case.model.friction(load) * max(1.0, case.beta)
                assert np.all(np.abs(case.model.forces(state)) <= limits * (1.0 + ROUNDING)), case.name
            elif isinstance(case.model, GMS):
                limits = case.model.weights * case.highest
                assert np.all(np.abs(case.model.forces(state)) <= limits * (1.0 + ROUNDING)), case.name


@every_element_model
def test_order_of_elements_does_not_matter(case: Case) -> None:
    model = case.model
    n = model.stiffness.size
    order = np.random.default_rng(1).permutation(n)
    other = "limits" if isinstance(model, MaxwellSlip) else "weights"
    shuffled = replace(model, stiffness=model.stiffness[order], **{other: getattr(model, other)[order]})
    position, loads = make_random_path(7), swell(7)
    here, there = model.trace(position, DT, loads), shuffled.trace(position, DT, loads)
    np.testing.assert_array_equal(there.state[:, :n], here.state[:, order])
    np.testing.assert_allclose(there.force, here.force, rtol=0.0, atol=ROUNDING * 3.0 * case.highest)


def test_order_of_elements_does_not_matter_to_leuven() -> None:
    stiffness, weights = split(4)
    case = next(case for case in CASES if case.name == "leuven")
    shuffled = Leuven(case.model.stribeck, stiffness[::-1], 1.2 * F_S * weights[::-1], case.model.power)
    position = make_random_path(7)
    np.testing.assert_allclose(
        shuffled.trace(position, DT).force, case.model.trace(position, DT).force, rtol=0.0, atol=1e-8 * F_S
    )


@pytest.mark.parametrize("same", ["gms-4", "gms-1", "gms-flat"])
def test_two_equal_halves_make_one_element(same: str) -> None:
    """An element and the two halves of it are the same friction."""
    model = next(case.model for case in CASES if case.name == same)
    halves = replace(model, stiffness=np.repeat(model.stiffness / 2.0, 2), weights=np.repeat(model.weights / 2.0, 2))
    position = make_random_path(9)
    np.testing.assert_allclose(
        halves.trace(position, DT).force, model.trace(position, DT).force, rtol=0.0, atol=ROUNDING * 3.0 * F_S
    )


@every_model
def test_force_scales_with_load_and_stiffness(case: Case) -> None:
    """Amontons: lambda times the load on lambda times as stiff a contact is lambda times the force, at any motion."""
    factor, position, loads = 2.5, make_random_path(11), swell(11)
    stiffer = (
        replace(case.model, stiffness=factor * np.asarray(case.model.stiffness)[()])
        if hasattr(case.model, "stiffness")
        else case.model
    )
    force = case.model.trace(position, DT, loads).force
    scaled = stiffer.trace(position, DT, factor * loads).force / factor
    gap = float(np.abs(scaled - force).max())
    case.check_gap("load_scaling", gap, ROUNDING * 10.0 * F_S, 1e-2 * F_S)


@every_model
def test_no_force_is_left_without_load(case: Case) -> None:
    """And when the load comes back, the springs begin from 0: no force without displacement, K |dx| at most."""
    position = np.concatenate([np.linspace(0.0, 5.0 * SPAN, 500), np.full(10, 5.0 * SPAN)])
    loads = np.where(np.arange(510) < 505, LOAD, 0.0)
    gone = case.model.trace(position, DT, loads)
    case.check_gap("follows_load", abs(float(gone.force[-1])), 0.0, 0.5 * F_S)
    if "follows_load" in case.fails:
        return
    force, state = case.model.step(gone.state[-1], 0.0, DT, 10.0 * LOAD)
    assert force == 0.0
    force, state = case.model.step(state, 0.01 * SPAN, DT, LOAD)
    viscous = case.viscous * (0.01 * SPAN / DT) ** case.exponent
    assert force == pytest.approx(0.01 * SPAN * K + viscous, rel=1e-9)


@every_loaded_model
@pytest.mark.parametrize("moving", [True, False])
def test_no_element_is_above_its_limit_after_unloading(case: Case, moving: bool) -> None:
    for seed in range(3):
        position, loads = make_random_path(seed), swell(seed + 20)
        if not moving:  # stretched, then unloaded at rest
            position = np.minimum.accumulate(position)
            position[1500:] = position[1500]
        trace = case.model.trace(position, DT, loads)
        limits = np.multiply.outer(case.model.friction(loads), case.model.weights) * max(1.0, case.beta)
        assert np.all(np.abs(case.model.forces(trace.state)) <= limits * (1.0 + ROUNDING) + 1e-300)


def test_standstill_under_more_load_keeps_the_force() -> None:
    model = XGMS(Amontons(0.25), *split(4))
    trace = model.trace(np.array([0.0, 0.4, 0.4, 0.4]) * SPAN, DT, np.array([12.0, 12.0, 50.0, 12.0]))
    assert trace.force[1] == trace.force[2] == trace.force[3] > 0.0
