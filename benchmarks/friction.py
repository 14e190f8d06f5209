"""`python -m benchmarks friction`: our friction models and those of other packages side by side, in one run.

What            cost of a step; drift of a mass under a bias and a small oscillation; closure of an inner hysteresis loop
Method          cost: the best of many short windows, the contestants in turn, because the machine is shared; twice, in steady
                sliding and at worst: random motion in which most elements switch, under a load that changes at every step.
                Ours are compiled into the loop that plays the path; through the pointer that a rig holds (`kernel.LAW`), about
                20 ns are to be added. OpenSees gets a list and fills an array, by Python calls for each step. MuJoCo and
                Exudyn make all steps of a sliding mass of 1 kg in one call
Assumptions     all models have the stiffness K, the static friction F_S and, where they can, the same fall with speed
References      docs/friction.md has what was measured
"""

import time
from collections.abc import Callable
from dataclasses import dataclass
from itertools import pairwise
from typing import Any

import numpy as np
from numba import njit

from benchmarks.friction_oracles import DAMPING, MASS, Exudyn, MuJoCo, OpenSees, Oracle
from benchmarks.loop import Target
from plant_sim.friction import coupled
from plant_sim.friction.coulomb import Coulomb
from plant_sim.friction.dahl import Dahl
from plant_sim.friction.elasto_plastic import ElastoPlastic
from plant_sim.friction.gms import GMS
from plant_sim.friction.leuven import Leuven
from plant_sim.friction.load_law import Amontons, LoadLaw
from plant_sim.friction.lugre import LuGre
from plant_sim.friction.maxwell_slip import MaxwellSlip
from plant_sim.friction.model import Array, FrictionModel
from plant_sim.friction.stribeck import Stribeck
from plant_sim.friction.xgms import XGMS

# The contact is ours: round numbers, a break-away displacement F_S/K of 10 um as on a ball-screw axis.
STIFFNESS = 1e5  # N/m
STATIC = 1.0  # N
BETA, STRIBECK_VELOCITY, VISCOUS, EXPONENT = 0.85, 1e-3, 0.2, 1 / 3  # -, m/s, (s/m)^gamma, -: all of eq 1.4 is at work
ATTRACTION = 69.0  # 1/s, Janssens 2010, eq 6.7
ELEMENTS = 10
LIMITS = np.full(ELEMENTS, STATIC / ELEMENTS)
STIFFNESSES = STIFFNESS * np.linspace(1.9, 0.1, ELEMENTS) / ELEMENTS  # N/m, break-away from 5 um to 100 um

WINDOW = 5000  # steps: 0.3 ms of XGMS, shorter than a turn of the scheduler; the call itself is 1 ns of a step
ROUNDS = 40
DT = 1e-4  # s
SLIDING = (np.full(WINDOW, 1e-6), np.ones(WINDOW))  # displacements [m], loads [N]
SWITCHING = (
    np.random.default_rng(1).normal(0.0, 3.0 * STATIC / STIFFNESS, WINDOW),
    np.random.default_rng(2).uniform(0.2, 2.0, WINDOW),
)
MOTIONS = (SLIDING, SWITCHING)

BIAS, SWING, FREQUENCY, DURATION, SETTLING = 0.5, 0.3, 10.0, 4.0, 0.2  # F_S, F_S, Hz, s, s: ours, below break-away
TURNS = np.array([0.0, 1.0, -0.5, 0.3, -0.5])  # of the amplitude
AMPLITUDE = 1.5 * STATIC / STIFFNESS  # m
REQUIRED_COST, REQUIRED_RATIO = 60.0, 10.0  # ns, -


@njit
def _walk(law, parameters, state, displacement, dt, load):
    """Sum of the forces [N] over all steps, so that none is left out."""
    total = 0.0
    for i in range(displacement.size):
        total += law(parameters, state, displacement[i], dt, load[i], state)
    return total


@dataclass(frozen=True, eq=False)
class Ours:
    """One of our models, measured as the oracles are."""

    name: str
    model: FrictionModel

    def cost(self, displacement: Array, load: Array) -> float:
        """Time of a step [s]."""
        model, state = self.model, self.model.rest()
        began = time.perf_counter()
        _walk(model.law, model.parameters, state, displacement, DT, load)
        return (time.perf_counter() - began) / displacement.size

    def force(self, position: Array, dt: float) -> Array:
        """Force [N] (n,) along `position` [m] (n,)."""
        return self.model.trace(position, dt).force

    def slide(self, force: Array, dt: float) -> Array:
        """Position [m] (n,) of the mass under `force` [N] (n,)."""
        motion = np.empty((force.size, 3))
        free, load = np.zeros(force.size), np.ones(force.size)
        model = self.model
        coupled.slide_mass(
            model.law, model.parameters, model.rest(), MASS, DAMPING, 0.0, (0.0, 0.0), force, load, dt, free, motion, 1
        )
        return motion[:, 0]


def ours() -> tuple[Ours, ...]:
    """All our models of the one contact."""
    curve = Stribeck(STATIC, BETA, STRIBECK_VELOCITY, STATIC * VISCOUS, EXPONENT)
    rising = LoadLaw(STATIC / (1.0 - 0.5 * np.exp(-1.0)), 2.0, 1.0)  # eq 4.2, F_S under a load of 1 N
    weights = LIMITS / STATIC
    shape = (BETA, STRIBECK_VELOCITY, VISCOUS, EXPONENT, ATTRACTION)
    return (
        Ours("Coulomb", Coulomb(curve)),
        Ours("Dahl", Dahl(STATIC, STIFFNESS)),
        Ours("LuGre", LuGre(curve, STIFFNESS)),
        Ours("elasto-plastic", ElastoPlastic(curve, STIFFNESS)),
        Ours(f"Leuven, {ELEMENTS} elements", Leuven(curve, STIFFNESSES, 1.5 * LIMITS)),
        Ours(f"Maxwell-slip, {ELEMENTS} elements", MaxwellSlip(STIFFNESSES, LIMITS)),
        Ours(f"GMS, {ELEMENTS} elements", GMS(curve, STIFFNESSES, weights, ATTRACTION * STATIC)),
        Ours(f"XGMS as Maxwell-slip, {ELEMENTS} elements", XGMS(Amontons(STATIC), STIFFNESSES, weights)),
        Ours(f"XGMS, {ELEMENTS} elements", XGMS(rising, STIFFNESSES, weights, *shape)),
    )


def oracles() -> tuple[Oracle, ...]:
    """The models of other packages, of the same contact."""
    return (
        OpenSees(STIFFNESSES, LIMITS),
        MuJoCo(STIFFNESS, BETA * STATIC, STATIC, STRIBECK_VELOCITY),
        Exudyn(STIFFNESS, BETA * STATIC, (1.0 - BETA) * STATIC, STRIBECK_VELOCITY),
    )


def drift(contestant: Any) -> float:
    """How far the mean position moves [m] in 4 s under 0.5 F_S and a sine of 0.3 F_S at 10 Hz, after the first 0.3 s."""
    dt = 2e-4  # s, 500 steps a period
    t = np.arange(1, round(DURATION / dt) + 1) * dt
    force = BIAS * STATIC * np.minimum(t / SETTLING, 1.0) + SWING * STATIC * np.sin(2.0 * np.pi * FREQUENCY * t)
    position = contestant.slide(force, dt)
    period = round(1.0 / FREQUENCY / dt)
    first = round(SETTLING / dt) + period
    return float(abs(position[-period:].mean() - position[first : first + period].mean()))


def closure(contestant: Any) -> float:
    """Force [F_S] by which the inner loop 0, A, -A/2, 0.3 A, -A/2 fails to close; constant speed of 0.1 um a ms."""
    dt, step = 1e-3, 1e-7
    parts = [np.zeros(1)]
    for start, end in pairwise(TURNS):
        count = round(abs(end - start) * AMPLITUDE / step)
        parts.append(AMPLITUDE * np.linspace(start, end, count + 1)[1:])
    force = contestant.force(np.concatenate(parts), dt)
    return float(abs(force[-1] - force[sum(map(len, parts[:3])) - 1]) / STATIC)


def friction_benchmark(
    progress: Callable[[int, int], None] = lambda done, total: None,
) -> tuple[list[tuple[str, ...]], list[Target], dict[str, Any]]:
    """Rows of the table, the head first; what is asked of XGMS; and the numbers.

    `progress(done, total)` is called after each round and each model.
    """
    known = oracles()
    contestants: list[Any] = [*ours(), *(oracle for oracle in known if oracle.installed())]
    total = ROUNDS + len(contestants)
    windows = []
    for i in range(-1, ROUNDS):  # the first round loads what it needs and does not count
        turn = [[contestant.cost(path, load) for contestant in contestants] for path, load in MOTIONS]
        windows += [turn] * (i >= 0)
        progress(i + 1, total)
    best = 1e9 * np.min(windows, axis=0)  # ns (motions, contestants)
    measured: dict[str, dict[str, float]] = {}
    for i, contestant in enumerate(contestants):
        measured[contestant.name] = {
            "sliding_ns": float(best[0, i]),
            "switching_ns": float(best[1, i]),
            "drift_m": drift(contestant),
            "closure": closure(contestant),
        }
        progress(ROUNDS + i + 1, total)
    rows: list[tuple[str, ...]] = [
        ("model", "sliding [ns/step]", "at worst [ns/step]", "drift [m]", "closure error [F_S]")
    ]
    rows += [(name, *(f"{value:.3g}" for value in values.values())) for name, values in measured.items()]
    missing = {oracle.name: oracle.install() for oracle in known if not oracle.installed()}
    rows += [(name, f"not installed: {command}", "", "", "") for name, command in missing.items()]
    document = {
        "models": measured,
        "not_installed": missing,
        "note": f"best of {ROUNDS} windows of {WINDOW} steps, contestants in turn",
    }
    targets = _targets(measured)
    document["targets"] = [vars(target) | {"met": target.met} for target in targets]
    return rows, targets, document


def _targets(measured: dict[str, dict[str, float]]) -> list[Target]:
    """What is asked of XGMS: 60 ns a step, ten times the speed of the fastest other model with memory, loops that close."""
    full, plain = measured[f"XGMS, {ELEMENTS} elements"], measured[f"XGMS as Maxwell-slip, {ELEMENTS} elements"]
    targets = [
        Target("XGMS, cost of a step, sliding", full["sliding_ns"], "ns", "at most", REQUIRED_COST),
        Target("XGMS, cost of a step, at worst", full["switching_ns"], "ns", "at most", REQUIRED_COST),
        Target("XGMS, closure error", full["closure"], "F_S", "at most", 0.0),
    ]
    if other := measured.get(OpenSees.name):
        name = "OpenSees' step over that of XGMS"
        same = other["sliding_ns"] / plain["sliding_ns"]
        targets.append(Target(f"{name}, same physics", same, "-", "at least", REQUIRED_RATIO))
        targets.append(Target(name, other["sliding_ns"] / full["sliding_ns"], "-", "at least", REQUIRED_RATIO))
    return targets
