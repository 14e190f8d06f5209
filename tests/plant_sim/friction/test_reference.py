"""The laws against the thesis's equations solved by scipy."""

from dataclasses import replace

import numpy as np
import pytest

from plant_sim.friction.gms import GMS
from plant_sim.friction.load_law import LoadLaw
from plant_sim.friction.passive_xgms import PassiveXGMS
from plant_sim.friction.xgms import XGMS
from tests.plant_sim.friction.models import BETA, F_S, LOAD, SPAN, V_S, C, make_curve, split
from tests.plant_sim.friction.reference import Piece, Reference

FRICTION = LoadLaw(0.4, 2.0, 15.0)
STIFFNESS, WEIGHTS = split(4)
ODE = 1e-9 * F_S  # N, of the tolerances of solve_ivp


def _compute_slope(load: float) -> float:
    """dF_s/dW_n of eq 4.2."""
    fall = np.exp(-FRICTION.load_scale / load) / FRICTION.a_2
    return FRICTION.coefficient * (1.0 - fall * (1.0 + FRICTION.load_scale / load))


def _make_gms(attraction: float, beta: float = BETA) -> tuple[GMS, Reference]:
    model = GMS(make_curve(beta=beta), STIFFNESS, WEIGHTS, attraction)
    return model, Reference(lambda w: F_S, lambda w: 0.0, beta, V_S, attraction, STIFFNESS, WEIGHTS, False, False)


def _make_xgms(kind: type[XGMS], attraction: float, beta: float = BETA) -> tuple[XGMS, Reference]:
    model = kind(FRICTION, STIFFNESS, WEIGHTS, beta, V_S, attraction=attraction)
    passive = kind is PassiveXGMS
    reference = Reference(
        lambda w: float(FRICTION(w)), _compute_slope, beta, V_S, attraction, STIFFNESS, WEIGHTS, True, passive
    )
    return model, reference


PAIRS = {
    "gms": _make_gms(C * F_S),
    "gms-slow": _make_gms(0.05 * C * F_S),
    "gms-rising": _make_gms(C * F_S, 1.5),
    "xgms": _make_xgms(XGMS, C),
    "xgms-quick": _make_xgms(XGMS, 50.0 * C),
    "xgms-rising": _make_xgms(XGMS, C, 1.5),
    "passive-xgms": _make_xgms(PassiveXGMS, C),
    "passive-xgms-quick": _make_xgms(PassiveXGMS, 50.0 * C),  # its bound on growth acts at most speeds
    "passive-xgms-rising": _make_xgms(PassiveXGMS, C, 1.5),
}
every_pair = pytest.mark.parametrize("pair", list(PAIRS.values()), ids=list(PAIRS))


@every_pair
@pytest.mark.parametrize("seed", [1, 2])
def test_constant_velocities_under_constant_load_to_rounding(pair, seed: int) -> None:
    """Stick, the change to slip, slip and reversal are exact for any step: one step a piece, from 1/100 to 10 SPAN."""
    model, reference = pair
    random = np.random.default_rng(seed)
    velocity = V_S * 10.0 ** random.uniform(-1.5, 1.0, 40) * random.choice([1.0, 1.0, 1.0, -1.0, 0.0], 40)
    distance = SPAN * 10.0 ** random.uniform(-2.0, 1.0, 40)
    duration = distance / np.maximum(np.abs(velocity), 0.1 * V_S)
    pieces = [Piece(t, lambda _, v=v: v, load=lambda _: LOAD) for t, v in zip(duration, velocity, strict=True)]
    state, forces = model.rest(), []
    for t, v in zip(duration, velocity, strict=True):
        force, state = model.step(state, v * t, t, LOAD)
        forces.append(force)
    np.testing.assert_allclose(forces, reference.play(pieces), rtol=0.0, atol=ODE)


def _make_pieces(swing: float) -> list[Piece]:
    """Half sines of velocity, there and back, from pre-sliding to sliding, under loads that swing, in slip and in stick.

    The load does not fall below what elements carry in stick: see test_invariance for what unloading takes from them.
    """
    frequency = 20.0
    half, turn = 0.5 / frequency, 2.0 * np.pi * 3.3 * frequency  # s, rad/s
    pieces, load = [], LOAD
    for sign, peak, swings in ((1.0, 3.0, swing), (-1.0, 1.0, -swing), (1.0, 0.08, 0.0), (1.0, 6.0, swing)):
        velocity = lambda t, a=sign * peak * V_S: a * np.sin(2.0 * np.pi * frequency * max(t, 1e-9))  # noqa: E731
        pieces.append(
            Piece(
                half,
                velocity,
                lambda t, w=load, a=swings: w * (1.0 + a * np.sin(turn * t)),
                lambda t, w=load, a=swings: w * a * turn * np.cos(turn * t),
            )
        )
        load = pieces[-1].load(half)
    return pieces


def _play_pieces(model, pieces: list[Piece], dt: float) -> np.ndarray:
    """Force [N] at the end of each piece with steps of `dt`, velocity at their middle and load at their end."""
    state, ends = model.rest(), []
    for piece in pieces:
        count = round(piece.duration / dt)
        for i in range(count):
            middle, end = (i + 0.5) * dt, (i + 1) * dt
            force, state = model.step(state, piece.velocity(middle) * dt, dt, piece.load(end))
        ends.append(force)
    return np.array(ends)


@every_pair
def test_changing_velocity_and_load_in_the_limit_of_short_steps(pair) -> None:
    model, reference = pair
    pieces = _make_pieces(0.5 if isinstance(model, XGMS) else 0.0)
    exact = replace(reference, resolution=400).play(pieces)
    coarse, fine = (np.abs(_play_pieces(model, pieces, dt) - exact).max() for dt in (5e-5, 2.5e-6))
    assert fine <= 0.15 * coarse + ODE  # of first order: a twentieth, but for the phase of the slips in their steps
    assert fine <= 1e-3 * F_S
