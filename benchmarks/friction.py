"""`python -m benchmarks friction`: the friction models of `plant_sim` and those of other packages side by side, in one run.

What            time of a step; drift of a mass under a bias and a small oscillation; closure error of an inner hysteresis loop
Method          time of a step: the best of many short windows, models in turn, because other programs use the machine
                too. Measured twice: in steady sliding, and at worst, which is random motion in which most elements
                switch while the load changes at every step. Models of `plant_sim` are compiled into the loop over the path.
                A rig calls them through a pointer (`kernel.LAW`), which adds about 20 ns. OpenSees is called from
                Python at each step. MuJoCo and Exudyn make all steps of a sliding mass of 1 kg in one call
Assumptions     all models have the stiffness K, the static friction F_S and, where they can, the same decrease with speed
References      docs/friction.md has the results
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

# The contact; chosen: round numbers, with a break-away displacement F_S/K of 10 um as on a ball-screw axis.
STIFFNESS = 1e5  # N/m
STATIC_FORCE = 1.0  # N
BETA, STRIBECK_VELOCITY, VISCOUS, EXPONENT = 0.85, 1e-3, 0.2, 1 / 3  # -, m/s, (s/m)^gamma, -: every term of eq 1.4 acts
ATTRACTION = 69.0  # 1/s, Janssens 2010, eq 6.7
ELEMENTS = 10  # chosen: the larger number of sec. 5.5 of the thesis
LIMITS = np.full(ELEMENTS, STATIC_FORCE / ELEMENTS)
STIFFNESSES = STIFFNESS * np.linspace(1.9, 0.1, ELEMENTS) / ELEMENTS  # N/m, break-away from 5 um to 100 um

# 0.3 ms of XGMS; chosen: shorter than a time slice of the scheduler. The call itself costs 1 ns per step
WINDOW_STEPS = 5000
WINDOW_COUNT = 40  # windows measured, of which the best counts; chosen: some are not disturbed
DT = 1e-4  # s, step; chosen: that of the plant kernel
SLIDING_MOTION = (np.full(WINDOW_STEPS, 1e-6), np.ones(WINDOW_STEPS))  # displacements [m], loads [N]
SWITCHING_MOTION = (
    np.random.default_rng(1).normal(0.0, 3.0 * STATIC_FORCE / STIFFNESS, WINDOW_STEPS),
    np.random.default_rng(2).uniform(0.2, 2.0, WINDOW_STEPS),
)
MOTIONS = (SLIDING_MOTION, SWITCHING_MOTION)

# of the drift: bias and amplitude [F_S], frequency [Hz], duration [s], time of the bias to rise [s]; chosen: below break-away
BIAS, SWING_AMPLITUDE, FREQUENCY, DURATION, SETTLING = 0.5, 0.3, 10.0, 4.0, 0.2
# of the inner loop, over LOOP_AMPLITUDE; chosen: it closes at -0.5
TURNING_POINTS = np.array([0.0, 1.0, -0.5, 0.3, -0.5])
LOOP_AMPLITUDE = 1.5 * STATIC_FORCE / STIFFNESS  # m; chosen: some elements slip, others stick
REQUIRED_COST, REQUIRED_RATIO = 60.0, 10.0  # ns, -: goals of this project for XGMS


@njit
def _sum_forces(law, parameters, state, displacement, dt, load):
    """Return the sum of the forces [N] over all steps; without the sum the compiler would skip the calls."""
    total = 0.0
    for i in range(displacement.size):
        total += law(parameters, state, displacement[i], dt, load[i], state)
    return total


@dataclass(frozen=True, eq=False)
class OwnModel:
    """A model of `plant_sim`, with the methods of an `Oracle`."""

    name: str
    model: FrictionModel

    def measure_cost(self, displacement: Array, load: Array) -> float:
        """Return the time of a step [s]."""
        model, state = self.model, self.model.rest()
        start = time.perf_counter()
        _sum_forces(model.law, model.parameters, state, displacement, DT, load)
        return (time.perf_counter() - start) / displacement.size

    def compute_force(self, position: Array, dt: float) -> Array:
        """Return the force [N] (n,) along `position` [m] (n,)."""
        return self.model.trace(position, dt).force

    def simulate_slide(self, force: Array, dt: float) -> Array:
        """Return the position [m] (n,) of the mass under `force` [N] (n,)."""
        motion = np.empty((force.size, 3))
        free, load = np.zeros(force.size), np.ones(force.size)
        model = self.model
        coupled.slide_mass(
            model.law, model.parameters, model.rest(), MASS, DAMPING, 0.0, (0.0, 0.0), force, load, dt, free, motion, 1
        )
        return motion[:, 0]


def make_own_models() -> tuple[OwnModel, ...]:
    """Make all models of `plant_sim`, of the contact above."""
    curve = Stribeck(STATIC_FORCE, BETA, STRIBECK_VELOCITY, STATIC_FORCE * VISCOUS, EXPONENT)
    rising = LoadLaw(STATIC_FORCE / (1.0 - 0.5 * np.exp(-1.0)), 2.0, 1.0)  # eq 4.2, F_S under a load of 1 N
    weights = LIMITS / STATIC_FORCE
    shape = (BETA, STRIBECK_VELOCITY, VISCOUS, EXPONENT, ATTRACTION)
    return (
        OwnModel("Coulomb", Coulomb(curve)),
        OwnModel("Dahl", Dahl(STATIC_FORCE, STIFFNESS)),
        OwnModel("LuGre", LuGre(curve, STIFFNESS)),
        OwnModel("elasto-plastic", ElastoPlastic(curve, STIFFNESS)),
        OwnModel(f"Leuven, {ELEMENTS} elements", Leuven(curve, STIFFNESSES, 1.5 * LIMITS)),
        OwnModel(f"Maxwell-slip, {ELEMENTS} elements", MaxwellSlip(STIFFNESSES, LIMITS)),
        OwnModel(f"GMS, {ELEMENTS} elements", GMS(curve, STIFFNESSES, weights, ATTRACTION * STATIC_FORCE)),
        OwnModel(f"XGMS as Maxwell-slip, {ELEMENTS} elements", XGMS(Amontons(STATIC_FORCE), STIFFNESSES, weights)),
        OwnModel(f"XGMS, {ELEMENTS} elements", XGMS(rising, STIFFNESSES, weights, *shape)),
    )


def make_oracles() -> tuple[Oracle, ...]:
    """Make the models of other packages, of the contact above."""
    return (
        OpenSees(STIFFNESSES, LIMITS),
        MuJoCo(STIFFNESS, BETA * STATIC_FORCE, STATIC_FORCE, STRIBECK_VELOCITY),
        Exudyn(STIFFNESS, BETA * STATIC_FORCE, (1.0 - BETA) * STATIC_FORCE, STRIBECK_VELOCITY),
    )


def measure_drift(contestant: Any) -> float:
    """Measure the drift [m] of the mean position in 4 s under 0.5 F_S and a sine of 0.3 F_S at 10 Hz, from 0.3 s on."""
    dt = 2e-4  # s, 500 steps a period
    t = np.arange(1, round(DURATION / dt) + 1) * dt
    force = BIAS * STATIC_FORCE * np.minimum(t / SETTLING, 1.0) + SWING_AMPLITUDE * STATIC_FORCE * np.sin(
        2.0 * np.pi * FREQUENCY * t
    )
    position = contestant.simulate_slide(force, dt)
    period = round(1.0 / FREQUENCY / dt)
    first = round(SETTLING / dt) + period
    return float(abs(position[-period:].mean() - position[first : first + period].mean()))


def measure_closure(contestant: Any) -> float:
    """Measure the closure error [F_S] of the inner loop 0, A, -A/2, 0.3 A, -A/2 at a constant speed of 0.1 um/ms.

    It is the difference of the force between the two visits of -A/2.
    """
    dt, step = 1e-3, 1e-7
    parts = [np.zeros(1)]
    for start, end in pairwise(TURNING_POINTS):
        count = round(abs(end - start) * LOOP_AMPLITUDE / step)
        parts.append(LOOP_AMPLITUDE * np.linspace(start, end, count + 1)[1:])
    force = contestant.compute_force(np.concatenate(parts), dt)
    return float(abs(force[-1] - force[sum(map(len, parts[:3])) - 1]) / STATIC_FORCE)


def measure_friction_models(
    progress: Callable[[int, int], None] = lambda done, total: None,
) -> tuple[list[tuple[str, ...]], list[Target], dict[str, Any]]:
    """Measure all models that are installed; return rows of the table, header first, targets of XGMS, and a document.

    `progress(done, total)` is called after each window and each model.
    """
    all_oracles = make_oracles()
    contestants: list[Any] = [*make_own_models(), *(oracle for oracle in all_oracles if oracle.is_installed())]
    total = WINDOW_COUNT + len(contestants)
    windows = []
    for i in range(-1, WINDOW_COUNT):  # the first window loads code and does not count
        costs = [[contestant.measure_cost(path, load) for contestant in contestants] for path, load in MOTIONS]
        windows += [costs] * (i >= 0)
        progress(i + 1, total)
    best = 1e9 * np.min(windows, axis=0)  # ns (motions, contestants)
    measured: dict[str, dict[str, float]] = {}
    for i, contestant in enumerate(contestants):
        measured[contestant.name] = {
            "sliding_ns": float(best[0, i]),
            "switching_ns": float(best[1, i]),
            "drift_m": measure_drift(contestant),
            "closure": measure_closure(contestant),
        }
        progress(WINDOW_COUNT + i + 1, total)
    rows: list[tuple[str, ...]] = [
        ("model", "sliding [ns/step]", "at worst [ns/step]", "drift [m]", "closure error [F_S]")
    ]
    rows += [(name, *(f"{value:.3g}" for value in values.values())) for name, values in measured.items()]
    missing = {oracle.name: oracle.install_command() for oracle in all_oracles if not oracle.is_installed()}
    rows += [(name, f"not installed: {command}", "", "", "") for name, command in missing.items()]
    document = {
        "models": measured,
        "not_installed": missing,
        "note": f"best of {WINDOW_COUNT} windows of {WINDOW_STEPS} steps, contestants in turn",
    }
    targets = _make_targets(measured)
    document["targets"] = [vars(target) | {"met": target.is_met} for target in targets]
    return rows, targets, document


def _make_targets(measured: dict[str, dict[str, float]]) -> list[Target]:
    """Make the targets of XGMS: 60 ns per step, ten times as fast as the fastest other model with memory, loops that close."""
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
