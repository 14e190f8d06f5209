"""Friction models of the position axis, identified from what a run of it measures.

What            one run with growing pre-sliding loops, slow reversals and sliding, then the same under other loads; each model
                fitted to the same samples of it
Equation        min sum (M x'' + F_model(x) - F_m)^2 over mass and model parameters, x and F_m through one zero-phase low-pass
                GMS: break points in geometric progression are given, their limits W_i are fitted; F_S = sum W_i, k_i = W_i/x_i
                XGMS: the GMS model, and the load law of eq 4.2 through the static friction at all loads
Assumptions     as `friction.identification.fit`; models that know no load are fitted to the part at nominal load, their best
Valid range     identified within the velocities and loads of the run
Not modelled    the noise of the encoder in x
References      Janssens 2010, secs. 5.8, 5.9
"""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from scipy.signal import butter, sosfiltfilt

from plant_sim.friction.coulomb import Coulomb
from plant_sim.friction.gms import GMS
from plant_sim.friction.identification.fit import Measured, fit
from plant_sim.friction.identification.least_squares import Estimate
from plant_sim.friction.load_law import LoadLaw
from plant_sim.friction.lugre import LuGre
from plant_sim.friction.model import Array, FrictionModel, Trace
from plant_sim.friction.stribeck import Stribeck
from plant_sim.friction.xgms import XGMS
from plant_sim.rigs.position_axis import PositionAxis, Run, Trajectory
from plant_sim.rigs.position_feedforward import Feedforward, in_turn, multisine, sine

LOADS = (1.0, 0.5, 1.75)  # of the nominal load, one after the other: from below to above it
NOMINAL = 16.0  # s, at nominal load
OTHER = 6.0  # s, at each other load
CORNER = 150.0  # Hz, low-pass for position and force: above the loop's bandwidth, below the noise of the differences
PRESLIDING = 6.0  # s, of the nominal part: loops that hardly slide
FIT_RATE = 500.0  # Hz, of the samples that are fitted
LOAD_CORNER = 5.0  # Hz, low-pass for the load: it changes at rest only
SLIDES = 1e-3  # m/s, speed from which a static model is fitted
BREAKS = (5e-7, 5e-5)  # m, first and last break point of the GMS elements: a few encoder steps to far beyond a guide
CURVE = {"static_force": 20.0, "beta": 0.8, "stribeck_velocity": 2e-3, "viscous": 20.0}
CURVE_BOUNDS = {
    "static_force": (0.1, 1e3),
    "beta": (0.05, 1.5),
    "stribeck_velocity": (1e-5, 1.0),
    "viscous": (0.0, 1e4),
}


@dataclass(frozen=True)
class Table:
    """A mass on friction that is moved as measured: what the motor force is fitted with."""

    mass: float
    friction: FrictionModel

    def trace(self, position: Array, dt: float, load: Array | float = 1.0) -> Trace:
        """Motor force [N] (n,) for `position` [m] (n,), samples `dt` [s] apart."""
        friction = self.friction.trace(position, dt, load)
        inertia = np.zeros(position.size)
        inertia[1:-1] = self.mass * np.diff(position, 2) / dt**2
        return Trace(friction.force + inertia, friction.state)


@dataclass(frozen=True)
class _Sliding:
    """A model that is not asked about the `slow` samples, bool (n,): there it tells what was `measured` (n,)."""

    model: Table
    slow: Array
    measured: Array

    def trace(self, position: Array, dt: float, load: Array | float = 1.0) -> Trace:
        told = self.model.trace(position, dt, load)
        return Trace(np.where(self.slow, self.measured, told.force), told.state)


@dataclass(frozen=True)
class Identified:
    """A `feedforward` with its `estimate`."""

    feedforward: Feedforward
    estimate: Estimate


def experiment(axis: PositionAxis, seed: int = 0) -> Run:
    """The run that all models are identified from, under PID control without feedforward."""
    time = axis.times(NOMINAL + OTHER * (len(LOADS) - 1))
    at = np.searchsorted(NOMINAL + OTHER * np.arange(len(LOADS) - 1), time, side="right")
    return axis.simulate(_excitation(), float(time[-1]), load=axis.load * np.array(LOADS)[at], seed=seed)


def _excitation() -> Trajectory:
    """Pre-sliding loops that grow, slow reversals, sliding; then slow reversals at each other load; each begins at 0."""

    def loops(time: Array) -> Array:
        return 1e-4 * (time / PRESLIDING) ** 2 * np.sin(2.0 * np.pi * time)  # 0 to 100 um in 6 s

    reversals, sliding = sine(1.5e-3, 0.5), multisine(1.5e-3, 0.5, 10.0, 2.0, seed=1)
    other = [(sine(1.5e-3, 0.5), OTHER)] * (len(LOADS) - 1)
    return in_turn((loops, PRESLIDING), (reversals, 4.0), (sliding, NOMINAL - PRESLIDING - 4.0), *other)


def coulomb(run: Run, mass: float) -> Identified:
    """Static friction along a Stribeck curve, fitted to the samples that slide; `mass` [kg] is known."""
    trace = _measured(run, NOMINAL)
    slow = np.abs(np.gradient(trace.position, trace.dt)) < SLIDES

    def build(values: Mapping[str, float]) -> Coulomb:
        return Coulomb(_curve(values))

    estimate = fit(
        lambda v: _Sliding(Table(mass, build(v)), slow, trace.force), list(CURVE), CURVE, CURVE_BOUNDS, trace
    )
    return Identified(Feedforward(mass, build({name: estimate[name] for name in CURVE})), estimate)


def lugre(run: Run, mass: float) -> Identified:
    """LuGre; `mass` [kg] is known."""
    start = CURVE | {"stiffness": 2e6, "damping": 100.0}
    bounds = CURVE_BOUNDS | {"stiffness": (1e4, 1e9), "damping": (0.0, 1e5)}

    def build(values: Mapping[str, float]) -> LuGre:
        return LuGre(_curve(values), values["stiffness"], values["damping"])

    estimate = fit(lambda v: Table(mass, build(v)), list(start), start, bounds, _measured(run, NOMINAL))
    return Identified(Feedforward(mass, build({name: estimate[name] for name in start})), estimate)


def gms(run: Run, mass: float, elements: int = 10) -> Identified:
    """GMS with `elements` elements; `mass` [kg] is the guess."""
    points = np.geomspace(*BREAKS, elements) if elements > 1 else np.array([np.sqrt(BREAKS[0] * BREAKS[1])])
    names = [f"limit_{i + 1}" for i in range(elements)]

    def build(values: Mapping[str, float]) -> GMS:
        limits = np.array([values[name] for name in names])
        curve = _curve({**values, "static_force": limits.sum()})
        return GMS(curve, limits / points, limits / limits.sum(), values["attraction"])

    start = {name: CURVE[name] for name in CURVE if name != "static_force"} | {"attraction": 500.0}
    start |= dict.fromkeys(names, CURVE["static_force"] / elements)
    bounds = CURVE_BOUNDS | {"attraction": (1.0, 1e6)} | dict.fromkeys(names, (1e-6, 1e3))
    start["mass"], bounds["mass"] = mass, (0.2 * mass, 5.0 * mass)
    estimate = fit(lambda v: Table(v["mass"], build(v)), list(start), start, bounds, _measured(run, NOMINAL))
    return Identified(Feedforward(estimate["mass"], build({name: estimate[name] for name in start})), estimate)


def xgms(run: Run, known: Identified, load: float) -> Identified:
    """XGMS: the GMS model `known`, identified at nominal `load` [N], with the load law fitted to the whole run."""
    model = known.feedforward.friction
    assert isinstance(model, GMS)
    curve = model.stribeck
    static = curve.static_force

    def build(values: Mapping[str, float]) -> XGMS:
        a_2, scale = 1.0 / values["fall"], values["load_scale"]
        coefficient = static / float(LoadLaw(1.0, a_2, scale)(load))  # F_s at nominal load is known
        return XGMS(
            LoadLaw(coefficient, a_2, scale), model.stiffness, model.weights, curve.beta, curve.stribeck_velocity,
            curve.viscous / static, curve.exponent, model.attraction / static,
        )  # fmt: skip

    start = {"fall": 0.3, "load_scale": load}
    bounds = {"fall": (1e-3, 0.999), "load_scale": (0.05 * load, 20.0 * load)}
    mass = known.feedforward.mass
    trace = _measured(run, np.inf)
    estimate = fit(lambda v: Table(mass, build(v)), list(start), start, bounds, trace)
    return Identified(Feedforward(mass, build({name: estimate[name] for name in start})), estimate)


def _curve(values: Mapping[str, float]) -> Stribeck:
    return Stribeck(values["static_force"], values["beta"], values["stribeck_velocity"], values["viscous"])


def _measured(run: Run, end: float) -> Measured:
    """Filtered position and motor force up to `end` [s]; a force held over a period counts half to both its ends."""
    period = float(run.time_s[1] - run.time_s[0])
    every = max(round(1.0 / (FIT_RATE * period)), 1)
    part = slice(0, int(np.searchsorted(run.time_s, end)), every)
    low_pass, slow = (butter(2, corner, fs=1.0 / period, output="sos") for corner in (CORNER, LOAD_CORNER))
    force = 0.5 * (run.motor_force + np.append(0.0, run.motor_force[:-1]))
    position, force = sosfiltfilt(low_pass, run.position)[part], sosfiltfilt(low_pass, force)[part]
    return Measured(position, every * period, force, np.maximum(sosfiltfilt(slow, run.normal_load)[part], 0.0))
