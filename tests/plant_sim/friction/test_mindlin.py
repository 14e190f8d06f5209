"""Sphere on a flat: the closed forms of appendix B against each other and against a sphere made of asperities."""

import numpy as np
import pytest

from clutch_hil.thesis.asperities.asperity_stiffness import make_mindlin_sphere
from plant_sim.friction.mindlin import Material, SphereOnFlat, stiffness_ratio
from protocols.errors import InputError

STEEL, RUBBER = Material(210e9, 0.3), Material(5e6, 0.49)
BALL = SphereOnFlat(0.01, STEEL, STEEL)
LOADS = np.array([0.1, 1.0, 10.0, 100.0])
# A central difference over 1e-4 of the value is wrong by 1e-9 of curvature and 1e-12 of rounding.
DIFFERENCE = 1e-7
SPRINGS, DISCRETE = 2000, 1e-4  # the edge of the contact falls between springs: order 1/SPRINGS^1.5


def test_load_and_deflection_are_inverse() -> None:
    assert BALL.load(BALL.deflection(LOADS)) == pytest.approx(LOADS, rel=1e-12)
    assert BALL.load(-1e-6) == 0.0


def test_normal_stiffness_is_the_slope_of_the_load() -> None:
    depth = BALL.deflection(LOADS)
    slope = (BALL.load(depth * 1.0001) - BALL.load(depth * 0.9999)) / (2e-4 * depth)
    assert BALL.normal_stiffness(LOADS) == pytest.approx(slope, rel=DIFFERENCE)


def test_global_normal_stiffness_is_two_thirds_of_the_local_one() -> None:
    assert LOADS / BALL.deflection(LOADS) == pytest.approx(2.0 / 3.0 * BALL.normal_stiffness(LOADS), rel=1e-12)


def test_tangential_stiffness_is_the_slope_of_the_force() -> None:
    force = np.array([0.3, 1.0, 2.0, 2.9])  # N, below mu W = 3 N
    step = 1e-4 * (3.0 - force)
    moved = BALL.tangential_deflection(10.0, 0.3, force + step) - BALL.tangential_deflection(10.0, 0.3, force - step)
    slope = 2.0 * step / moved
    assert BALL.tangential_stiffness(10.0, 0.3, force) == pytest.approx(slope, rel=DIFFERENCE)


@pytest.mark.parametrize("poisson", [-0.5, 0.0, 0.3, 0.5])
@pytest.mark.parametrize("radius", [1e-6, 1e-2])
def test_ratio_in_full_stick_depends_on_poisson_alone(poisson: float, radius: float) -> None:
    material = Material(70e9, poisson)
    contact = SphereOnFlat(radius, material, material)
    ratio = contact.normal_stiffness(LOADS) / contact.tangential_stiffness(LOADS)
    assert ratio == pytest.approx(np.full(4, stiffness_ratio(poisson)), rel=1e-12)


def test_a_soft_sphere_on_a_hard_flat_is_as_stiff_as_half_as_soft_a_pair() -> None:
    hard = SphereOnFlat(0.01, RUBBER, Material(1e20, 0.3))
    pair = SphereOnFlat(0.01, RUBBER, RUBBER)
    assert hard.plane_modulus == pytest.approx(2.0 * pair.plane_modulus, rel=1e-9)
    assert hard.tangential_modulus == pytest.approx(2.0 * pair.tangential_modulus, rel=1e-9)


def test_stiffness_vanishes_at_gross_sliding() -> None:
    assert BALL.tangential_stiffness(10.0, 0.3, 3.0) == 0.0


def test_asperities_at_depths_of_a_sphere_give_hertz_and_mindlin() -> None:
    """An independent path: the life cycle of 2000 asperities ends in the closed form."""
    used = np.linspace(0.0, 1.0, 101)
    position = BALL.tangential_deflection(10.0, 0.3, used * 3.0)
    seen = make_mindlin_sphere(BALL, 10.0, 0.3, SPRINGS).observe(position, 1.0)
    assert seen.normal_force == pytest.approx(np.full(101, 10.0), rel=DISCRETE)
    assert seen.force / 3.0 == pytest.approx(used, abs=DISCRETE)


def test_asperities_of_a_sphere_obey_masing_at_reversal() -> None:
    """Mindlin and Deresiewicz: the branch after a reversal is the virgin curve, doubled and turned."""
    body = make_mindlin_sphere(BALL, 10.0, 0.3, SPRINGS)
    used = np.linspace(0.0, 0.8, 41)
    virgin = BALL.tangential_deflection(10.0, 0.3, used * 3.0)
    back = virgin[-1] - 2.0 * virgin
    force = body.observe(np.concatenate((virgin, back)), 1.0).force[41:]
    assert force / 3.0 == pytest.approx(0.8 - 2.0 * used, abs=DISCRETE)


def test_bad_values_are_named() -> None:
    with pytest.raises(InputError, match=r"Poisson coefficient is 0\.6; allowed is a number above -1 and at most 0\.5"):
        Material(210e9, 0.6)
    with pytest.raises(InputError, match="Young's modulus is 0 Pa"):
        Material(0.0, 0.3)
    with pytest.raises(InputError, match="radius is -1 m"):
        SphereOnFlat(-1.0, STEEL, STEEL)
    with pytest.raises(InputError, match=r"tangential force is up to 1\.3.* of mu W; allowed is 0 to 1"):
        BALL.tangential_deflection(10.0, 0.3, 4.0)
