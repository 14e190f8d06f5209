"""No motion and no load takes energy out of friction - and the cycle by which GMS does give it out."""

from itertools import pairwise

import numpy as np
import pytest

from plant_sim.friction.gms import GMS
from plant_sim.friction.load_law import Amontons
from plant_sim.friction.lugre import LuGre
from plant_sim.friction.maxwell_slip import MaxwellSlip
from plant_sim.friction.model import FrictionModel
from plant_sim.friction.passive_xgms import PassiveXGMS
from plant_sim.friction.xgms import XGMS
from tests.plant_sim.friction.models import BETA, CASES, F_S, LOAD, SPAN, V_S, C, Case, K, every_model, make_curve

DT = 1e-6  # s; at the highest speed a step is a hundredth of SPAN
UNIT = F_S * SPAN  # J


def make_motions() -> list[np.ndarray]:
    """Displacements [m] per step DT: random ones at all speeds, and those that are fast while loading, slow while slipping."""
    random = np.random.default_rng(3)
    ways = []
    for _ in range(6):
        pieces = []
        while sum(map(len, pieces)) < 20_000:
            speed = V_S * 10.0 ** random.uniform(-2.0, 1.0) * random.choice([-1.0, 1.0])
            count = int(min(random.uniform(0.0, 3.0) * SPAN / abs(speed) / DT, 3000.0)) + 1
            pieces.append(np.full(count, speed * DT))
        ways.append(np.concatenate(pieces))
    for fast in (1.0, 100.0):
        cycle = []
        for sign in (1.0, -1.0):
            step = sign * min(fast * V_S * DT, 0.01 * SPAN)
            cycle += [np.full(int(5.0 * SPAN / abs(step)), step)]  # load and slide
            cycle += [np.full(20_000, sign * 1e-7 * SPAN)]  # creep: time to slip, hardly any way
            cycle += [np.full(1000, -sign * 1e-3 * SPAN)]  # unload
        ways.append(np.concatenate(cycle))
    ways.append(np.concatenate([np.full(3000, 1e-2 * SPAN * s) for s in (1.0, -1.0)]))
    slow_then_fast = [
        np.full(20_000, 1e-3 * SPAN),
        np.full(60, 2.0 * DT),
    ]  # LuGre: bristle bent at rest, then thrown back
    ways.append(np.concatenate(slow_then_fast))
    return ways


def measure_taken_energy(force: np.ndarray, displacement: np.ndarray) -> float:
    """Largest energy [J] that has come out of a model that began at rest: -min of the work done on it so far."""
    return float(-np.cumsum(force * displacement).min(initial=0.0))


def play(case: Case, displacement: np.ndarray, load: np.ndarray | float = LOAD, dt: float = DT):
    return case.model.trace(np.concatenate([[0.0], np.cumsum(displacement)]), dt, load)


@every_model
def test_no_motion_takes_energy_out(case: Case) -> None:
    out = max(measure_taken_energy(play(case, motion).force[1:], motion) for motion in make_motions())
    ways = [(speed, distance) for speed in (5.0 * V_S, 1e3 * V_S) for distance in (0.3, 0.6, 1.0, 2.0)]
    out = max(
        out, *(-measure_cycle_work(case.model, speed, distance * SPAN, 3).min(initial=0.0) for speed, distance in ways)
    )
    case.check_gap("passive", out, 1e-9 * UNIT, 1e-2 * UNIT)


def measure_cycle_work(model: FrictionModel, speed: float, distance: float, count: int) -> np.ndarray:
    """Work [J] done on a model that began at rest, after each half of `count` cycles (2 count,).

    Each half loads over `distance` [m] at `speed` [m/s], then creeps without way, then goes back slowly to where F = 0.
    """
    state, work, halves = model.rest(), 0.0, []
    for half in range(2 * count):
        sign = 1.0 if half % 2 == 0 else -1.0
        loading = [(sign * distance / 100.0, distance / 100.0 / speed)] * 100
        creep = [(sign * 1e-9 * SPAN, 0.01)] * 100  # 1 s
        for way, time in loading + creep:
            force, state = model.step(state, way, time, LOAD)
            work += force * way
        back = -sign * SPAN / 500.0
        for _ in range(2000):
            force, new = model.step(state, back, 1.0, LOAD)
            if force * sign <= 0.0:
                break
            state, work = new, work + force * back
        halves.append(work)
    return np.array(halves)


def test_gms_and_xgms_give_out_energy_every_cycle_and_passive_xgms_does_not() -> None:
    """One spring: fast loading stores (beta F_S)^2/2k, the creep lifts it to F_S^2/2k at no cost, unloading brings it back.

    The bound of the passive model on the growth of an element makes the creep cost what it stores.
    """
    gms = GMS(make_curve(), [K], [1.0], C * F_S)
    xgms = XGMS(Amontons(F_S / LOAD), [K], [1.0], BETA, V_S, attraction=C)
    passive = PassiveXGMS(Amontons(F_S / LOAD), [K], [1.0], BETA, V_S, attraction=C)
    gain = (1.0 - BETA**2) * F_S**2 / (2.0 * K)
    just_slips = 1.001 * BETA * SPAN
    for model in (gms, xgms):
        work = measure_cycle_work(model, 1e3 * V_S, just_slips, 10)
        np.testing.assert_allclose(np.diff(work), -gain, rtol=0.02)  # sums of 100 and 500 steps for the integrals
    assert measure_cycle_work(passive, 1e3 * V_S, just_slips, 10).min() >= 0.0


@pytest.mark.parametrize(
    "case", [c for c in CASES if isinstance(c.model, MaxwellSlip | PassiveXGMS)], ids=lambda case: case.name
)
def test_every_step_pays_for_the_energy_of_the_springs(case: Case) -> None:
    """F v - dW/dt >= 0 at every step, also of loads that move and jump, W the energy in the springs."""
    random = np.random.default_rng(5)
    for motion in make_motions():
        loads = LOAD * (1.0 + 0.8 * np.sin(np.arange(motion.size + 1) * 10.0 ** random.uniform(-4.0, -1.0)))
        jumps = random.integers(0, motion.size, 6)
        for start, end in pairwise(np.sort(jumps)):
            loads[start:end] *= random.choice([0.0, 0.3, 2.0])
        trace = play(case, motion, loads)
        energy = case.model.energy(trace.state)
        assert (trace.force[1:] * motion - np.diff(energy)).min() >= -1e-13 * UNIT


@pytest.mark.parametrize("case", [c for c in CASES if isinstance(c.model, PassiveXGMS)], ids=lambda case: case.name)
def test_a_load_that_falls_gives_no_energy_either(case: Case) -> None:
    """Load fast, then creep for long while the load falls by almost nothing: the springs may not tighten."""
    fast, slow = np.full(500, SPAN / 20.0), np.full(2000, 1e-9 * SPAN)
    motion = np.concatenate([fast, slow])
    loads = LOAD * (1.0 - 1e-9 * np.maximum(np.arange(motion.size + 1) - fast.size, 0))
    trace = play(case, motion, loads, dt=SPAN / 20.0 / (100.0 * V_S))
    energy = case.model.energy(trace.state)
    assert energy[-1] <= energy[fast.size] + UNIT * 1e-4


@pytest.mark.parametrize("case", [c for c in CASES if isinstance(c.model, LuGre)], ids=lambda case: case.name)
def test_lugre_knows_whether_it_is_passive(case: Case) -> None:
    assert case.model.passive == ("passive" not in case.fails)
