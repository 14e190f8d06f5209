"""The oil film between plates that meet: Reynolds' law against its closed form, another integration, and in the rig."""

from math import exp, log

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from plant_sim.blocks.viscosity import relative_viscosity
from plant_sim.effects.signals import TORQUE
from protocols.files.units import BAR, ZERO_CELSIUS
from tests.plant_sim.effects.lone_effect import LoneEffect
from tests.plant_sim.effects.pressed_rig import STEP, find_pressing_voltage, make_rig, simulate_states

EXACT = 1e-10  # relative: the film is read back from a torque through a logarithm
REYNOLDS = 1e-8  # relative: the other integration's; measured 2e-11
REF = 70.0 + ZERO_CELSIUS  # K
CONTACT = 2.35 * BAR  # Pa
FILM, IMPULSE = 3.0, 0.01 * BAR  # lambda_0; Pa s


def compute_film(effect: LoneEffect, load: float, h: float, kelvin: float = REF) -> float:
    """lambda = film over roughness after a step of `h` [s] under `load` [Pa], from the torque just after it."""
    signals = {"contact": 1.0, "friction_pressure": CONTACT + load, "temperature": kelvin, "torque": 1.0}
    effect(TORQUE, h, **signals)
    return (-2.0 * log(effect(TORQUE, 0.0, **signals).torque)) ** 0.5


def make_effect(**changed: float) -> LoneEffect:
    return LoneEffect("squeeze_film", film=FILM, impulse=IMPULSE / BAR, **changed)


@pytest.mark.parametrize("load", [0.1 * BAR, 1.0 * BAR])
def test_constant_force_squeezes_as_one_over_h_squared(load: float) -> None:
    effect = make_effect()
    for k in range(1, 201):
        result = compute_film(effect, load, 1e-3)
        assert 1.0 / result**2 == pytest.approx(1.0 / FILM**2 + k * 1e-3 * load / IMPULSE, rel=EXACT)


def test_film_obeys_reynolds_in_metres_and_newtons() -> None:
    """-dh/dt = F h^3/(kappa eta) under a growing force, integrated independently; the impulse as its source gives it."""
    roughness, viscosity, area = 5e-6, 12e-3, 1.131e-2
    kappa = 2 * np.pi * 0.058 * 6 * 2.8e-3**3  # six lands of 2.8 mm on the mean radius
    effect = LoneEffect("squeeze_film", film=3.0, impulse=kappa * viscosity / (2 * roughness**2 * area) / BAR)
    assert effect.p.impulse == pytest.approx(IMPULSE, rel=0.05)  # the typical value is this, rounded
    rate = 6.0 * BAR  # Pa/s

    def thinning(t: float, h: np.ndarray) -> np.ndarray:
        return -rate * t * area * h**3 / (kappa * viscosity)

    solution = solve_ivp(thinning, (0.0, 0.2), [3.0 * roughness], "LSODA", rtol=1e-10, atol=1e-16)
    for k in range(2000):
        result = compute_film(effect, rate * (k + 0.5) * STEP, STEP)
    assert result == pytest.approx(solution.y[0, -1] / roughness, rel=REYNOLDS)
    assert result < 1.0


def test_film_does_not_depend_on_the_step() -> None:
    one, many = make_effect(), make_effect()
    coarse = compute_film(one, BAR, 0.05)
    for _ in range(500):
        fine = compute_film(many, BAR, 1e-4)
    assert fine == pytest.approx(coarse, rel=EXACT)


def test_torque_of_a_step_is_that_at_its_middle() -> None:
    effect, twin = make_effect(), make_effect()
    load = {"contact": 1.0, "friction_pressure": CONTACT + BAR, "temperature": REF, "torque": 1.0}
    compute_film(twin, BAR, 0.5e-3)
    assert effect(TORQUE, 1e-3, **load).torque == pytest.approx(twin(TORQUE, 0.0, **load).torque, rel=EXACT)


def test_thin_oil_leaves_sooner() -> None:
    warm, hot = make_effect(), make_effect()
    thinner = relative_viscosity(REF + 30.0, REF)
    assert compute_film(hot, BAR, 0.02 * thinner, REF + 30.0) == pytest.approx(compute_film(warm, BAR, 0.02), rel=EXACT)


def test_film_is_full_again_once_the_plates_part() -> None:
    effect = make_effect()
    assert compute_film(effect, BAR, 0.1) < 0.5
    effect(TORQUE, STEP, contact=0.0, torque=0.0)
    assert compute_film(effect, BAR, 0.0) == pytest.approx(FILM, rel=EXACT)


def test_asking_moves_no_film() -> None:
    effect = make_effect()
    compute_film(effect, BAR, 0.01)
    before = effect.x.squeezed
    compute_film(effect, BAR, 0.0)
    effect(TORQUE, 0.0, contact=0.0, torque=0.0)
    assert effect.x.squeezed == before


@pytest.mark.parametrize("torque", [10.0, -10.0])
@pytest.mark.parametrize("initial", [0.0, 1.0, 20.0])
def test_film_only_ever_weakens_friction(torque: float, initial: float) -> None:
    effect = LoneEffect("squeeze_film", film=initial)
    load = {"contact": 1.0, "friction_pressure": CONTACT + 0.1 * BAR, "temperature": REF, "torque": torque}
    ratios = np.array([effect(TORQUE, STEP, **load).torque for _ in range(500)]) / torque
    assert (ratios > 0.0).all()
    assert (ratios <= 1.0).all()
    assert (np.diff(ratios) >= 0.0).all()
    assert (ratios == 1.0).all() == (initial == 0.0)


def simulate_engagement(initial: float, celsius: float = 70.0) -> np.ndarray:
    """Torque [Nm] of plates pressed at 3.4 bar from rest, at 20 rad/s."""
    of = make_rig({"squeeze_film.film": initial, "motor.inertia": 10.0})
    return simulate_states(of, of.make_rest_state(20.0, celsius + ZERO_CELSIUS), find_pressing_voltage(3.4), 20.0, 1.0)[
        0
    ]["clutch_torque"]


def test_torque_builds_up_late_and_arrives_where_it_would() -> None:
    plain, thin, thick = (simulate_engagement(initial) for initial in (0.0, 1.5, 3.0))
    first = [int(np.argmax(torque > 0.5 * plain[-1])) for torque in (plain, thin, thick)]
    assert first[0] < first[1] < first[2]
    touch = int(np.argmax(plain > 0.0))
    assert (thick[touch:] < plain[touch:]).all()
    pressed_for = (10_000 - touch) * STEP  # s, at 1.05 bar but for the rise
    left = 0.5 / (1.0 / 9.0 + 1.05 * pressed_for / 0.01)
    assert thick[-1] / plain[-1] == pytest.approx(exp(-left), abs=0.3 * left)


def test_cold_oil_makes_it_later() -> None:
    warm, cold = (int(np.argmax(simulate_engagement(3.0, celsius) > 10.0)) for celsius in (70.0, 45.0))
    assert cold - warm > 20  # 2 ms
