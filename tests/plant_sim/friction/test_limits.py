"""Models that must be others in the limit, and closed forms."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from plant_sim.friction.coulomb import Coulomb
from plant_sim.friction.dahl import Dahl
from plant_sim.friction.elasto_plastic import ElastoPlastic
from plant_sim.friction.gms import GMS
from plant_sim.friction.leuven import Leuven
from plant_sim.friction.load_law import Amontons, LoadLaw
from plant_sim.friction.lugre import LuGre
from plant_sim.friction.maxwell_slip import MaxwellSlip
from plant_sim.friction.passive_xgms import PassiveXGMS
from plant_sim.friction.stribeck import Stribeck
from plant_sim.friction.xgms import XGMS
from tests.plant_sim.friction.models import BETA, F_S, LOAD, SLOW, SPAN, V_S, C, K, make_curve, make_path, split
from tests.plant_sim.friction.test_invariance import DT, make_random_path

ROUNDING = 1e-11 * F_S  # N


def test_one_element_without_lag_is_a_spring_with_a_stribeck_slider() -> None:
    """N = 1, C -> infinity: F = k x up to S(v), and S(v) from there on."""
    velocity = np.concatenate([np.full(500, SLOW), np.linspace(SLOW, 5.0 * V_S, 1000), np.full(50, -SLOW)])
    displacement = velocity * 1e-4
    position = np.concatenate([[0.0], np.cumsum(displacement)])
    force = GMS(make_curve(), [K], [1.0]).trace(position, 1e-4).force[1:]
    expected, spring = np.empty_like(force), 0.0
    for i, step in enumerate(displacement):
        level = F_S * (1.0 + (BETA - 1.0) * np.exp(-V_S / abs(velocity[i])))
        slides = step > 0.0 and spring + K * step >= level
        spring = level if slides else spring + K * step
        expected[i] = spring
    np.testing.assert_allclose(force, expected, rtol=0.0, atol=ROUNDING)
    assert force.max() == pytest.approx(F_S)


def test_infinitely_stiff_is_the_stribeck_curve() -> None:
    """k -> infinity (and C -> infinity): at every velocity but 0 the force is S(v)."""
    stiff = 1e12
    position = make_random_path(1)
    moving = np.concatenate([[False], np.diff(position) != 0.0])
    rigid = Coulomb(make_curve()).trace(position, DT).force
    stiffness, weights = split(4)
    for model in (
        GMS(make_curve(), stiffness * stiff / K, weights),
        XGMS(Amontons(F_S / LOAD), stiffness * stiff / K, weights, BETA, V_S),
        LuGre(make_curve(), stiff),
        ElastoPlastic(make_curve(), stiff),
        Leuven(make_curve(), stiffness * stiff / K, 1.2 * F_S * weights),
    ):
        force = model.trace(position, DT, LOAD).force
        np.testing.assert_allclose(force[moving], rigid[moving], rtol=0.0, atol=1e-7 * F_S)


@settings(max_examples=25, derandomize=True)
@given(
    parts=st.lists(st.floats(0.05, 1.0), min_size=1, max_size=8),
    attraction=st.sampled_from([10.0, 1e4, np.inf]),
    seed=st.integers(0, 1000),
)
def test_gms_and_xgms_without_stribeck_effect_are_maxwell_slip(parts, attraction, seed) -> None:
    weights = np.array(parts) / np.sum(parts)
    stiffness = K * weights[::-1]
    position = make_random_path(seed, 500)
    expected = MaxwellSlip(stiffness, F_S * weights).trace(position, DT).force
    for model in (
        GMS(Stribeck(F_S), stiffness, weights, attraction * F_S),
        XGMS(Amontons(F_S / LOAD), stiffness, weights, attraction=attraction),
    ):
        np.testing.assert_allclose(model.trace(position, DT, LOAD).force, expected, rtol=0.0, atol=ROUNDING)


def test_xgms_under_constant_load_is_gms_and_the_passive_one_while_its_springs_can_follow() -> None:
    """The attraction of XGMS is that of the normalised force, C/F_S. In creep the bound on growth acts: less force."""
    shape = (Amontons(F_S / LOAD), *split(4), BETA, V_S, 0.6 / F_S, 0.5, C)
    gms, xgms, passive = (
        GMS(make_curve(viscous=0.6, exponent=0.5), *split(4), C * F_S),
        XGMS(*shape),
        PassiveXGMS(*shape),
    )
    sliding = np.cumsum(V_S * (2.0 + 1.8 * np.sin(np.arange(4000) * 0.02)) * 1e-4)
    creep = np.concatenate([sliding, sliding[-1] + np.cumsum(np.full(300, 1e-5 * SPAN))])
    expected = gms.trace(creep, 1e-4).force
    np.testing.assert_allclose(xgms.trace(creep, 1e-4, LOAD).force, expected, rtol=0.0, atol=ROUNDING)
    bounded = passive.trace(creep, 1e-4, LOAD).force
    np.testing.assert_allclose(bounded[: sliding.size], expected[: sliding.size], rtol=0.0, atol=ROUNDING)
    assert bounded[-1] < expected[-1] - 0.01 * F_S


@pytest.mark.parametrize("n", [10, 100, 1000])
def test_flat_distribution_of_limits_gives_a_parabola(n: int) -> None:
    """Equal stiffness, limits spread evenly from 0 to 2 F_S/n: F = K x - K x^2/(2 x_m), x_m = 2 F_S/K."""
    limits = (np.arange(n) + 0.5) * 2.0 * F_S / n**2
    whole = 2.0 * F_S / K
    x = np.linspace(0.0, whole, 201)
    force = GMS(Stribeck(F_S), np.full(n, K / n), limits / limits.sum()).trace(x, x[1] / SLOW).force
    gap = np.abs(force - (K * x - K * x**2 / (2.0 * whole))).max()
    assert gap <= F_S / (4.0 * n**2) + ROUNDING  # half a spacing of the break points, squared, times K/(2 x_m)
    assert force[-1] == pytest.approx(F_S)


def test_virgin_curve_is_the_sum_of_the_elements() -> None:
    stiffness, weights = split(6)
    x = np.linspace(0.0, 5.0 * SPAN, 400)
    force = GMS(make_curve(), stiffness, weights, C * F_S).trace(x, x[1] / SLOW).force
    expected = np.minimum(np.outer(x, stiffness), F_S * weights).sum(axis=1)
    np.testing.assert_allclose(force, expected, rtol=0.0, atol=ROUNDING)


def test_element_that_never_slips_is_a_spring() -> None:
    model = MaxwellSlip([K, 2.0 * K], [F_S, np.inf])
    x, _ = make_path(np.array([0.0, 9.0, -9.0]) * SPAN, SPAN / 10.0)
    np.testing.assert_allclose(
        model.trace(x, DT).force - MaxwellSlip([K], [F_S]).trace(x, DT).force, 2.0 * K * x, rtol=0.0, atol=ROUNDING
    )


@pytest.mark.parametrize("shape", [0.5, 1.0, 1.7, 3.0])
def test_dahl_solves_its_equation(shape: float) -> None:
    """dF/dx by differences equals sigma |1 - F/F_C|^i, loading and after a reversal."""
    x, _ = make_path(np.array([0.0, 1.2, -0.7]) * SPAN, SPAN / 2000.0)
    force = Dahl(F_S, K, shape).trace(x, DT).force
    step = np.diff(x)
    middle = 0.5 * (force[1:] + force[:-1])
    expected = K * np.maximum(1.0 - np.sign(step) * middle / F_S, 0.0) ** shape
    away = np.abs(np.diff(force) / step) > 1e-2 * K
    np.testing.assert_allclose((np.diff(force) / step)[away], expected[away], rtol=1e-4)


def test_lugre_without_stribeck_effect_is_dahl() -> None:
    position = make_random_path(3)
    np.testing.assert_allclose(
        LuGre(Stribeck(F_S), K).trace(position, DT).force, Dahl(F_S, K).trace(position, DT).force, atol=ROUNDING
    )


def test_elasto_plastic_is_a_spring_below_break_away() -> None:
    x, _ = make_path(np.array([0.0, 0.69, -0.69, 0.3]) * SPAN, SPAN / 100.0)
    np.testing.assert_allclose(ElastoPlastic(make_curve(), K).trace(x, DT).force, K * x, rtol=0.0, atol=ROUNDING)


@pytest.mark.parametrize("power", [1.0, 2.0])
def test_leuven_with_one_spring_that_never_slips_follows_its_equation(power: float) -> None:
    """F_h = K z: dF/dx = K (1 - (F/F_S)^n); n = 1 is LuGre, n = 2 a hyperbolic tangent."""
    x = np.linspace(0.0, 4.0 * SPAN, 20_001)
    force = Leuven(Stribeck(F_S), [K], [np.inf], power).trace(x, x[1] / SLOW).force
    expected = F_S * (1.0 - np.exp(-K * x / F_S)) if power == 1.0 else F_S * np.tanh(K * x / F_S)
    np.testing.assert_allclose(force, expected, rtol=0.0, atol=1e-4 * F_S)  # implicit steps of SPAN/5000, first order


def test_stribeck_curve_at_its_ends() -> None:
    """F_S at rest with all slopes 0, beta F_S far above V_S; eq 4.1 is the same curve with beta = 1 - 1/a_1."""
    shape = Stribeck(F_S, BETA, V_S, 2.0, 0.5)
    assert shape(0.0) == 0.0
    assert shape(1e-4 * V_S) == pytest.approx(F_S + 2.0 * np.sqrt(1e-4 * V_S), rel=1e-12)
    assert shape.s(1e6 * V_S) == pytest.approx(BETA * F_S, rel=1e-5)
    np.testing.assert_array_equal(shape(np.array([-0.1, 0.1])), [-shape(0.1), shape(0.1)])
    v = np.geomspace(1e-4, 1.0, 50)
    printed = F_S * (1.0 - np.exp(-V_S / v) / 2.5 + v ** (1.0 / 3.0) * 0.7)  # 4.1
    np.testing.assert_allclose(Stribeck.from_depth(F_S, 2.5, V_S, 0.7, 1.0 / 3.0)(v), printed, rtol=1e-14)


def test_load_law_at_its_ends() -> None:
    """mu_max at no load, mu_max (1 - 1/a_2) at high load; the force still grows with load (4.2)."""
    friction = LoadLaw(0.25, 2.0, 300.0)
    load = np.linspace(0.0, 3e4, 4000)
    assert friction(0.0) == 0.0
    assert friction(1.0) == pytest.approx(0.25, rel=1e-12)
    assert friction(1e7) / 1e7 == pytest.approx(0.125, rel=1e-4)
    assert np.all(np.diff(friction(load)) > 0.0)
    assert np.all(np.diff(friction(load[1:]) / load[1:]) <= 0.0)
    in_kernel = [XGMS(friction, [1e12], [1.0]).trace(np.array([0.0, 1.0]), DT, w).force[-1] for w in load[1::500]]
    np.testing.assert_allclose(in_kernel, friction(load[1::500]), rtol=1e-14)
