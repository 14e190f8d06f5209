"""Our friction models against those of other packages, each skipped where its package is missing."""

import numpy as np
import pytest

from benchmarks.friction_oracles import Exudyn, MuJoCo, OpenSees, Oracle
from plant_sim.friction.gms import GMS
from plant_sim.friction.lugre import LuGre
from plant_sim.friction.maxwell_slip import MaxwellSlip
from plant_sim.friction.stribeck import Stribeck

STIFFNESS, LEVEL = 1e5, 1.0  # N/m, N
BREAK_AWAY = LEVEL / STIFFNESS  # m


def needs(oracle: type[Oracle]) -> pytest.MarkDecorator:
    """Skip a test where the package of `oracle` is missing."""
    return pytest.mark.needs(oracle.package)


@needs(OpenSees)
@pytest.mark.parametrize("elements", [1, 4, 10])
@pytest.mark.parametrize("amplitude", [0.02, 0.3, 3.0])
def test_maxwell_slip_is_elastic_perfectly_plastic_elements_in_parallel(elements, amplitude):
    """To 1e-12 of the force, for random elements on a random path, far below to far above break-away."""
    rng = np.random.default_rng(elements)
    stiffness, limits = rng.uniform(0.2, 2.0, elements) * STIFFNESS, rng.uniform(0.1, 1.0, elements) * LEVEL
    position = np.cumsum(rng.normal(0.0, amplitude * BREAK_AWAY, 5000))
    position -= position[0]
    theirs = OpenSees(stiffness, limits).compute_force(position, 1e-3)
    ours = MaxwellSlip(stiffness, limits).trace(position, 1e-3).force
    assert np.abs(ours).max() > 0.1 * min(1.0, amplitude) * limits.sum()  # it does something
    np.testing.assert_allclose(ours, theirs, rtol=0.0, atol=1e-12 * limits.sum())


def make_wandering_velocity(dt: float) -> np.ndarray:
    """A velocity [m/s] of two sines for 0.4 s: pre-sliding, sliding, reversals on both sides."""
    t = np.arange(0.0, 0.4, dt)
    return 5e-4 * np.sin(2.0 * np.pi * 5.0 * t) + 2e-4 * np.sin(2.0 * np.pi * 13.0 * t)


@needs(MuJoCo)
def test_lugre_bristle_and_force_are_those_of_mujoco():
    """Both solve the bristle exactly over a step of constant velocity: equal to rounding at any step."""
    for dt in (1e-2, 1e-3, 1e-4):
        velocity = make_wandering_velocity(dt)
        deflection, force = MuJoCo(STIFFNESS, LEVEL, LEVEL, damping=50.0).simulate_bristle(velocity, dt)
        ours = LuGre(Stribeck(LEVEL), STIFFNESS, 50.0).trace(np.concatenate([[0.0], np.cumsum(velocity * dt)]), dt)
        np.testing.assert_allclose(ours.state[:, 0] * STIFFNESS, deflection * STIFFNESS, rtol=0.0, atol=1e-11 * LEVEL)
        np.testing.assert_allclose(ours.force, force, rtol=0.0, atol=1e-11 * LEVEL)


@needs(MuJoCo)
def test_mujoco_as_sampled_by_its_step_converges_to_ours_with_first_order():
    """`mj_step` leaves the force of the start of the step; the rest of its error is that shift."""
    errors = []
    for dt in (1e-3, 1e-4, 1e-5):
        velocity = make_wandering_velocity(dt)
        ours = LuGre(Stribeck(LEVEL), STIFFNESS).trace(np.concatenate([[0.0], np.cumsum(velocity * dt)]), dt).force
        theirs = MuJoCo(STIFFNESS, LEVEL, LEVEL).sample_force(velocity, dt)
        errors.append(np.abs(ours[1:] - theirs).max() / LEVEL)
    assert errors[-1] < 1e-3
    np.testing.assert_allclose(np.diff(np.log10(errors)), -1.0, atol=0.1)


@needs(MuJoCo)
@pytest.mark.parametrize("velocity", [-1e-2, -1e-3, -2e-4, 2e-4, 1e-3, 1e-2])
def test_lugre_slides_at_the_level_of_mujoco_where_the_curves_meet(velocity):
    """Their level at one speed, given to our curve, gives their force, for both directions."""
    theirs = MuJoCo(STIFFNESS, 1.0, 1.5, stribeck_velocity=1e-3)
    level = 1.0 + 0.5 * np.exp(-((velocity / 1e-3) ** 2))
    dt, count = 1e-3, 3000
    force = theirs.simulate_bristle(np.full(count, velocity), dt)[1][-1]
    ours = LuGre(Stribeck(level), STIFFNESS).trace(velocity * dt * np.arange(count + 1), dt).force[-1]
    assert ours == pytest.approx(np.sign(velocity) * level, rel=1e-9)
    assert ours == pytest.approx(force, rel=1e-9)


def make_sine(amplitude: float, dt: float) -> np.ndarray:
    """Position [m], two periods of 5 Hz that begin slowly."""
    t = np.arange(0.0, 0.4 + dt / 2, dt)
    return amplitude * np.minimum(t / 0.1, 1.0) ** 2 * np.sin(2.0 * np.pi * 5.0 * t)


@needs(Exudyn)
def test_one_element_is_exudyns_bristle_before_sliding():
    """Below break-away both are the same spring."""
    position = make_sine(0.9 * BREAK_AWAY, 1e-3)
    ours = GMS(Stribeck(LEVEL), [STIFFNESS], [1.0]).trace(position, 1e-3).force
    assert np.abs(ours).max() == pytest.approx(0.9 * LEVEL, rel=1e-3)
    np.testing.assert_allclose(
        ours, Exudyn(STIFFNESS, LEVEL).compute_force(position, 1e-3), rtol=0.0, atol=1e-9 * LEVEL
    )


@needs(Exudyn)
def test_one_element_is_exudyns_bristle_in_sliding_within_the_error_of_its_reversals():
    """It finds the reversal within a step, where the speed is v' dt: an error of second order in the step."""
    errors = []
    for dt in (1e-3, 1e-4):
        position = make_sine(2.5 * BREAK_AWAY, dt)
        ours = GMS(Stribeck(LEVEL), [STIFFNESS], [1.0]).trace(position, dt).force
        errors.append(np.abs(ours - Exudyn(STIFFNESS, LEVEL).compute_force(position, dt)).max() / LEVEL)
    assert errors[0] < 5e-3
    assert errors[1] < errors[0] / 50.0


@needs(Exudyn)
@pytest.mark.parametrize("velocity", [-5e-3, -5e-4, 5e-4, 5e-3])
def test_one_element_slides_at_the_level_of_exudyn_where_the_curves_meet(velocity):
    """Their level at one speed, given to our curve, gives their force, for both directions."""
    level = 1.0 + 0.5 * np.exp(-abs(velocity) / 1e-3)
    position = velocity * 1e-3 * np.arange(201)
    theirs = Exudyn(STIFFNESS, 1.0, 0.5, decay_velocity=1e-3).compute_force(position, 1e-3)[-1]
    ours = GMS(Stribeck(level), [STIFFNESS], [1.0]).trace(position, 1e-3).force[-1]
    assert ours == pytest.approx(np.sign(velocity) * level, rel=1e-9)
    assert ours == pytest.approx(theirs, rel=1e-6)
