"""Identifiability of every model: each parameter moves the output, and a fit of a simulation gives it back (property 17)."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cache
from typing import Any

import numpy as np
import pytest

from plant_sim.friction.coulomb import Coulomb
from plant_sim.friction.dahl import Dahl
from plant_sim.friction.elasto_plastic import ElastoPlastic
from plant_sim.friction.gms import GMS
from plant_sim.friction.identification.fit import Measured, fit
from plant_sim.friction.identification.least_squares import Estimate
from plant_sim.friction.leuven import Leuven
from plant_sim.friction.lift_up import LiftingXGMS, LiftUp
from plant_sim.friction.load_law import LoadLaw
from plant_sim.friction.lugre import LuGre
from plant_sim.friction.maxwell_slip import MaxwellSlip
from plant_sim.friction.model import Trace
from plant_sim.friction.stribeck import Stribeck
from plant_sim.friction.xgms import XGMS

Values = Mapping[str, float]
DT = 1e-3  # s
TIME = np.arange(2000) * DT
MOTION = 1e-5 * (np.sin(2 * np.pi * TIME) + 0.5 * np.sin(2 * np.pi * 3.3 * TIME))
MOTION = MOTION + 2e-3 * np.sin(np.pi * (TIME - 1.0)) ** 3 * (TIME > 1.0)  # m, pre-sliding, then sliding at many speeds
LOAD = 25.0 + 15.0 * np.sin(2 * np.pi * 1.7 * TIME)  # N, over the range in which the coefficient falls
NOISE = 0.05  # N, of about 6
DRAWS = 6
LEAST = 0.005  # change of the output for 100 % of a parameter, rms over rms


@dataclass(frozen=True)
class WithLift:
    """A lifting model whose output is the friction [N], then over the same motion again the lift [1e-5 m]."""

    model: LiftingXGMS

    def trace(self, position: np.ndarray, dt: float, load: np.ndarray) -> Trace:
        once = slice(position.size // 2)
        run = self.model.trace(position[once], dt, load[once])
        return Trace(np.append(run.force, 1e5 * self.model.lift(run.state)), run.state)


@dataclass(frozen=True)
class Subject:
    """A model, made by `build` of values by name, the true ones, and what is done with it."""

    build: Callable[[Values], Any]
    truth: dict[str, float]
    position: np.ndarray = field(default_factory=lambda: MOTION)
    load: np.ndarray | float = 1.0

    @property
    def bounds(self) -> dict[str, tuple[float, float]]:
        """A decade each way; shares stay below 1."""
        highest = {"beta": 0.99, "w1": 0.99, "b": 0.99}
        return {name: (v / 10.0, highest.get(name, v * 10.0)) for name, v in self.truth.items()}

    @property
    def off(self) -> dict[str, float]:
        """A start 15 % beside the truth."""
        return {name: v * (1.15 if i % 2 else 0.85) for i, (name, v) in enumerate(self.truth.items())}

    def make_measurement(self, noise: float, seed: Sequence[int] = (0,)) -> Measured:
        """The output of the true model and `noise` [N]."""
        force = self.build(self.truth).trace(self.position, DT, self.load).force
        return Measured(
            self.position, DT, force + np.random.default_rng(seed).normal(0.0, noise, force.size), self.load
        )


def make_stribeck(p: Values) -> Stribeck:
    return Stribeck(p["F"], p["beta"], p["V"], p["C"], p["g"])


def make_elements(p: Values) -> tuple[list[float], list[float]]:
    return [p["k1"], p["k2"]], [p["w1"], 1.0 - p["w1"]]


def make_xgms(p: Values) -> XGMS:
    friction = LoadLaw(p["mu"], p["a2"], p["L"])
    return XGMS(friction, *make_elements(p), p["beta"], p["V"], p["sv"], p["g"], p["a"])


def make_lifting(p: Values) -> WithLift:
    normal = LiftUp(p["FN"], p["vN"], p["CN"], p["M"], p["K"], p["p"], p["c"])
    return WithLift(LiftingXGMS(make_xgms(p), normal))


CURVE = {"F": 8.0, "beta": 0.7, "V": 1e-3, "C": 60.0, "g": 0.9}
BRISTLE = {"s0": 2e6, "s1": 1500.0}
TWO = {"k1": 2e6, "k2": 5e5, "w1": 0.4}
LOADED = {"mu": 0.3, "a2": 2.0, "L": 20.0, "beta": 0.7, "V": 1e-3, "sv": 8.0, "g": 0.9, "a": 40.0, **TWO}
NORMAL = {"FN": 8.0, "vN": 2e-3, "CN": 80.0, "M": 40.0, "K": 8e5, "p": 1.5, "c": 300.0}
SUBJECTS = {
    "Coulomb": Subject(lambda p: Coulomb(make_stribeck(p)), CURVE),
    "Dahl": Subject(lambda p: Dahl(p["F"], p["s"], p["i"]), {"F": 8.0, "s": 3e6, "i": 1.3}),
    "LuGre": Subject(lambda p: LuGre(make_stribeck(p), p["s0"], p["s1"]), CURVE | BRISTLE),
    "elasto-plastic": Subject(
        lambda p: ElastoPlastic(make_stribeck(p), p["s0"], p["s1"], p["b"]), CURVE | BRISTLE | {"b": 0.6}
    ),
    "Leuven": Subject(  # F_h stays below s, so the last limit is never reached: infinite; soft, as it takes steps
        lambda p: Leuven(make_stribeck(p), [p["k1"], p["k2"]], [p["W1"], np.inf], p["n"], p["s1"]),
        CURVE | {"k1": 6e5, "k2": 2e5, "W1": 3.0, "n": 2.0, "s1": 1500.0},
    ),
    "Maxwell-slip": Subject(
        lambda p: MaxwellSlip([p["k1"], p["k2"]], [p["W1"], p["W2"]]), {"k1": 2e6, "k2": 1e6, "W1": 3.0, "W2": 5.0}
    ),
    "GMS": Subject(lambda p: GMS(make_stribeck(p), *make_elements(p), p["a"]), CURVE | TWO | {"a": 300.0}),
    "XGMS": Subject(make_xgms, LOADED, load=LOAD),
    "lifting XGMS": Subject(make_lifting, LOADED | NORMAL | {"a": 15.0}, np.tile(MOTION, 2), np.tile(LOAD, 2)),
}
every_subject = pytest.mark.parametrize("name", SUBJECTS)


@cache
def clean(name: str) -> Estimate:
    subject = SUBJECTS[name]
    return fit(subject.build, list(subject.truth), subject.off, subject.bounds, subject.make_measurement(0.0))


@cache
def draw_estimates(name: str) -> list[Estimate]:
    """Estimates from draws of the noise. They begin at the truth, as `clean` shows that they find there from beside it."""
    subject = SUBJECTS[name]
    names, draws = list(subject.truth), [(list(SUBJECTS).index(name), draw) for draw in range(DRAWS)]
    return [
        fit(subject.build, names, subject.truth, subject.bounds, subject.make_measurement(NOISE, seed))
        for seed in draws
    ]


@every_subject
def test_every_parameter_moves_the_output(name: str) -> None:
    output = SUBJECTS[name].make_measurement(0.0).force
    truth = np.array(list(SUBJECTS[name].truth.values()))
    moved = np.linalg.norm(clean(name).jacobian, axis=0) * truth / np.linalg.norm(output)
    assert dict(zip(SUBJECTS[name].truth, moved >= LEAST, strict=True)) == dict.fromkeys(SUBJECTS[name].truth, True)


@every_subject
def test_fit_of_a_simulation_returns_its_parameters(name: str) -> None:
    result = clean(name)
    assert result.doubts == ()
    np.testing.assert_allclose(result.values, list(SUBJECTS[name].truth.values()), rtol=1e-4)


@every_subject
def test_fit_of_a_noisy_simulation_is_as_near_as_it_says(name: str) -> None:
    """All parameters within 2.5 intervals (5 standard deviations), and nothing left but the noise."""
    truth = np.array(list(SUBJECTS[name].truth.values()))
    for result in draw_estimates(name):
        assert result.rmse == pytest.approx(NOISE, rel=0.1)
        assert result.doubts == ()
        assert (np.abs(result.values - truth) < 2.5 * np.ptp(result.intervals, axis=1) / 2.0).all()


def test_truth_is_within_95_of_100_intervals() -> None:
    """Over all models, parameters and draws: 75 parameters, 4 draws; 0.95 -+ 0.013 if they were independent."""
    inside = [result.contains(SUBJECTS[name].truth) for name in SUBJECTS for result in draw_estimates(name)]
    assert 0.92 <= np.concatenate(inside).mean() <= 0.98


def test_friction_alone_does_not_tell_the_mass_of_a_lifting_body_from_its_stiffness() -> None:
    """A heavier body on a stiffer contact lifts less, under the same contact force: to divide them takes the lift itself."""
    subject = SUBJECTS["lifting XGMS"]
    force = subject.make_measurement(NOISE).force[: MOTION.size]
    trace = Measured(MOTION, DT, force, LOAD)
    result = fit(lambda p: subject.build(p).model, ["M", "K", "c"], subject.truth, subject.bounds, trace)
    assert result.doubts == (
        "M and K and c are not identifiable separately: these data determine only a combination of them",
    )


def test_last_limit_of_the_leuven_model_is_never_reached() -> None:
    """Its hysteresis force stays below s, so limits beyond that change nothing."""
    truth = SUBJECTS["Leuven"].truth
    made = [
        Leuven(make_stribeck(truth), [truth["k1"], truth["k2"]], [truth["W1"], last], truth["n"], truth["s1"])
        for last in (CURVE["F"], 2.0 * CURVE["F"])
    ]
    one, other = (model.trace(MOTION, DT).force for model in made)
    np.testing.assert_array_equal(one, other)
