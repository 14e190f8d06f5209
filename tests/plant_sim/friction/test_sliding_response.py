"""Friction as a damper: the closed form is what the models do, and it says whether a drive on them is stable."""

import numpy as np
import pytest

from plant_sim.friction.coulomb import Coulomb
from plant_sim.friction.coupled import slide_mass
from plant_sim.friction.gms import GMS
from plant_sim.friction.load_law import Amontons, LoadLaw
from plant_sim.friction.lugre import LuGre
from plant_sim.friction.passive_xgms import PassiveXGMS
from plant_sim.friction.stribeck import Stribeck
from plant_sim.friction.xgms import XGMS
from protocols.errors import InputError
from tests.plant_sim.friction.models import BETA, F_S, LOAD, V_S, C, K, make_curve, split

VISCOUS, EXPONENT = 2.0, 0.5  # N/(m/s)^gamma, -
CURVE = make_curve(viscous=VISCOUS, exponent=EXPONENT)
XGMS_SHAPE = (Amontons(F_S / LOAD), *split(4), BETA, V_S, VISCOUS / F_S, EXPONENT, C)
MODELS = {
    "coulomb": Coulomb(CURVE),
    "lugre": LuGre(CURVE, K),
    "lugre-damped": LuGre(CURVE, K, 50.0),
    "gms": GMS(CURVE, *split(4), C * F_S),
    "gms-no-lag": GMS(CURVE, *split(4)),
    "gms-rising": GMS(make_curve(beta=1.5), *split(4), C * F_S),
    "xgms": XGMS(*XGMS_SHAPE),
    "passive-xgms": PassiveXGMS(*XGMS_SHAPE),
}
SAMPLES = 20_000  # of a period
# of the response: the force is that at the end of a step, the velocity that of its middle, pi/SAMPLES of a turn before;
# the curvature of s over the swing is of second order, below 1e-6
ACCURACY = 1e-3
every_sliding_model = pytest.mark.parametrize("name", MODELS)


def measure_response(model, velocity: float, frequency: float, load: float = LOAD) -> complex:
    """First harmonic of the force over that of the velocity [Ns/m] after long sliding."""
    swing, dt = 1e-3 * velocity, 1.0 / frequency / SAMPLES
    phase = 2.0 * np.pi * np.arange(2 * SAMPLES + 1) / SAMPLES
    begin = velocity * np.linspace(-1.0, 0.0, 2001)
    state = model.trace(begin, 1.0 / 2000, load).state[-1]
    position = velocity * dt * np.arange(phase.size) + swing / (2.0 * np.pi * frequency) * np.sin(phase)
    force = model.trace(position, dt, load, state).force[-SAMPLES:]
    middle = phase[-SAMPLES:] - np.pi / SAMPLES
    return complex(2.0 * np.mean(force * np.exp(-1j * middle)) / swing)


@every_sliding_model
@pytest.mark.parametrize("velocity", [0.4 * V_S, -0.4 * V_S, 3.0 * V_S])
@pytest.mark.parametrize("frequency", [3.0, 80.0])
def test_the_response_is_that_of_the_model(name: str, velocity: float, frequency: float) -> None:
    response = MODELS[name].linearise(velocity, LOAD)
    measured = measure_response(MODELS[name], velocity, frequency)
    scale = abs(response.falling) + abs(response.viscous)
    assert abs(measured - response.at(frequency)) <= ACCURACY * scale


@every_sliding_model
def test_slow_changes_see_the_slope_of_the_steady_curve(name: str) -> None:
    model, velocity = MODELS[name], 0.7 * V_S
    step = 1e-5 * velocity
    slope = float(np.diff(model.steady_state(velocity + step * np.array([-1.0, 1.0]), LOAD))[0] / (2.0 * step))
    response = model.linearise(velocity, LOAD)
    assert response.damping == pytest.approx(slope, rel=1e-7)
    assert response.at(0.0) == pytest.approx(slope, rel=1e-7)
    assert response.at(1e9).real == pytest.approx(
        response.viscous + (response.falling * response.lead / response.lag if response.lag else response.falling),
        rel=1e-4,
    )


def test_the_lag_of_the_clutch_is_that_of_the_rig() -> None:
    """3.4 bar, 20 rad/s: s_n/C = 12.1 ms; M_C, beta and C_v there as in the design of the rig."""
    clutch = XGMS(Amontons(1.0), [1e9], [1.0], 0.7078, 11.52, 2.588 / 11.62, 1.0 / 3.0, 69.0)
    response = clutch.linearise(20.0, 11.62)
    assert response.lag == pytest.approx(12.1e-3, rel=5e-3)
    assert response.falling == pytest.approx(-11.62 * (1.0 - 0.7078) * 11.52 / 400.0 * np.exp(-0.576), rel=1e-12)
    assert response.viscous == pytest.approx(2.588 / 3.0 * 20.0 ** (-2.0 / 3.0), rel=1e-12)
    assert all(clutch.linearise(float(slip), 11.62).damping > 0.0 for slip in np.geomspace(0.1, 26.0, 50))  # no judder


def test_the_load_scales_the_response_and_leaves_the_lag() -> None:
    law = LoadLaw(0.25, 2.0, 20.0)
    model = XGMS(law, *split(4), BETA, V_S, 0.3, 0.5, C)
    light, heavy = model.linearise(V_S, LOAD), model.linearise(V_S, 5.0 * LOAD)
    ratio = float(law(5.0 * LOAD) / law(LOAD))
    assert heavy.falling / light.falling == pytest.approx(ratio)
    assert heavy.viscous / light.viscous == pytest.approx(ratio)
    assert heavy.lag == light.lag
    assert model.linearise(V_S, 0.0).damping == 0.0


@pytest.mark.parametrize("name", ["lugre", "gms", "xgms"])
@pytest.mark.parametrize("share", [0.5, 1.5])
def test_a_mass_on_a_spring_grows_below_the_needed_damping_and_not_above(name: str, share: float) -> None:
    """Pulled at 0.5 V_S with a share of the needed damping c_n: a small vibration grows as exp((c_n - c) t/2 m)."""
    model, mass, frequency, velocity, dt = MODELS[name], 2.0, 40.0, 0.5 * V_S, 4e-6
    spring = mass * (2.0 * np.pi * frequency) ** 2
    needed = float(model.linearise(velocity, LOAD).needed_damping(frequency))
    damping = share * needed
    time = dt * np.arange(1, round(0.3 / dt) + 1)
    begin = velocity * np.linspace(-1.0, 0.0, 2001)
    state = model.trace(begin, 1.0 / 2000, LOAD).state[-1]
    pull = np.full(time.size, float(model.steady_state(velocity, LOAD)) + damping * velocity)
    motion = np.empty((time.size, 3))
    slide_mass(
        model.law, model.parameters, state, mass, damping, spring, (0.0, 1.01 * velocity), pull, np.full(time.size, LOAD),
        dt, velocity * time, motion, 1,
    )  # fmt: skip
    beat, period = motion[:, 1] - velocity, round(1.0 / frequency / dt)
    assert np.abs(beat).max() < 0.05 * velocity  # it stays small
    first, last = np.ptp(beat[:period]), np.ptp(beat[-period:])
    expected = (needed - damping) / (2.0 * mass) * (time[-period] - time[0])
    assert np.log(last / first) == pytest.approx(expected, rel=0.1)


def test_a_frequency_above_the_lag_hides_the_falling_curve() -> None:
    """Friction lag helps: at a resonance far above 1/T less damping is needed."""
    response = MODELS["gms"].linearise(0.5 * V_S, LOAD)
    needed = response.needed_damping(np.array([0.0, 10.0, 100.0, 1e4]))
    assert np.all(np.diff(needed) < 0.0) or needed[-1] == 0.0
    assert needed[0] == -response.damping
    assert MODELS["gms-rising"].linearise(0.5 * V_S, LOAD).needed_damping(10.0) == 0.0


@pytest.mark.parametrize("speed", [1e-300, 1e-6 * V_S, V_S, 1e6 * V_S, 1e15])
@pytest.mark.parametrize("stribeck_velocity", [V_S, np.inf])
def test_slopes_are_finite_at_any_speed(speed: float, stribeck_velocity: float) -> None:
    falling, viscous = Stribeck(F_S, BETA, stribeck_velocity, VISCOUS, 1.0).slopes(np.array([-speed, speed]))
    assert np.isfinite(falling).all()
    assert np.isfinite(viscous).all()
    assert falling[0] == falling[1] <= 0.0
    assert viscous[0] == viscous[1] == VISCOUS


def test_the_curve_falls_most_at_half_the_stribeck_velocity() -> None:
    """s'(V_S/2) = -4 F_S (1 - beta)/(e^2 V_S), the steepest of all."""
    speed = np.geomspace(0.05, 20.0, 4001) * V_S
    falling, _ = make_curve().slopes(speed)
    assert speed[np.argmin(falling)] == pytest.approx(0.5 * V_S, rel=2e-3)
    assert falling.min() == pytest.approx(-4.0 * F_S * (1.0 - BETA) / np.exp(2.0) / V_S, rel=1e-5)


@every_sliding_model
@pytest.mark.parametrize("velocity", [0.0, float("nan"), float("inf"), "fast", None, [1.0, 2.0]])
def test_what_is_no_sliding_is_refused(name: str, velocity: object) -> None:
    with pytest.raises(InputError, match="sliding velocity"):
        MODELS[name].linearise(velocity)


def test_a_frequency_below_0_is_refused() -> None:
    with pytest.raises(InputError, match="least frequency is -1 Hz; allowed is a number at least 0"):
        MODELS["gms"].linearise(V_S).at(-1.0)
    with pytest.raises(InputError, match=r"least speed is 0 m/s; allowed is a number above 0"):
        make_curve().slopes(0.0)
