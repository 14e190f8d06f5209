"""Friction models of the position axis, identified from one run of it.

What            the run has growing pre-sliding loops, slow reversals and sliding, then slow reversals under other loads; every
                model is fitted to the same samples
Equation        min sum (M x'' + F_model(x) - F_m)^2 over mass and model parameters, x and F_m through one zero-phase low-pass
                GMS: break points in geometric progression are given, their limits W_i are fitted; F_S = sum W_i, k_i = W_i/x_i
                XGMS: the GMS model, and the load law of eq 4.2 through the static friction at all loads
Assumptions     those of `friction.identification.fit`; models without load are fitted to the part at nominal load
Valid range     the velocities and loads of the run
Not modelled    noise of the encoder in x
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
from plant_sim.rigs.position_feedforward import Feedforward, join_trajectories, multisine, sine

LOAD_FACTORS = (1.0, 0.5, 1.75)  # load over nominal load, one after the other: at, below and above it
NOMINAL_TIME = 16.0  # s at nominal load
OTHER_LOAD_TIME = 6.0  # s at each other load
SIGNAL_CORNER = 150.0  # Hz, low-pass of position and force: above the bandwidth, below the noise of the differences
PRESLIDING_TIME = 6.0  # s of the part at nominal load, in loops that hardly slide
FIT_RATE = 500.0  # Hz, rate of the samples that are fitted
LOAD_CORNER = 5.0  # Hz, low-pass of the load, which changes only at rest
SLIDING_SPEED = 1e-3  # m/s: a static model is fitted to faster samples
# m, first and last break point of the GMS elements: from a few encoder steps to far beyond that of a guide
BREAK_POINT_RANGE = (5e-7, 5e-5)
CURVE_START = {"static_force": 20.0, "beta": 0.8, "stribeck_velocity": 2e-3, "viscous": 20.0}
CURVE_BOUNDS = {
    "static_force": (0.1, 1e3),
    "beta": (0.05, 1.5),
    "stribeck_velocity": (1e-5, 1.0),
    "viscous": (0.0, 1e4),
}


@dataclass(frozen=True)
class MovedMass:
    """A mass on friction whose position is given: the model of the motor force."""

    mass: float
    friction: FrictionModel

    def trace(self, position: Array, dt: float, load: Array | float = 1.0) -> Trace:
        """Return the motor force [N] (n,) for `position` [m] (n,), samples `dt` [s] apart."""
        friction = self.friction.trace(position, dt, load)
        inertia = np.zeros(position.size)
        inertia[1:-1] = self.mass * np.diff(position, 2) / dt**2
        return Trace(friction.force + inertia, friction.state)


@dataclass(frozen=True)
class _SlidingOnly:
    """A model that is fitted only where the axis slides: at `slow` samples, bool (n,), it returns the `measured` force (n,)."""

    model: MovedMass
    slow: Array
    measured: Array

    def trace(self, position: Array, dt: float, load: Array | float = 1.0) -> Trace:
        trace = self.model.trace(position, dt, load)
        return Trace(np.where(self.slow, self.measured, trace.force), trace.state)


@dataclass(frozen=True)
class IdentifiedFeedforward:
    """A `feedforward`, and the `estimate` of its parameters."""

    feedforward: Feedforward
    estimate: Estimate


def run_experiment(axis: PositionAxis, seed: int = 0) -> Run:
    """Simulate the run from which all models are identified, under PID control without feedforward."""
    time = axis.times(NOMINAL_TIME + OTHER_LOAD_TIME * (len(LOAD_FACTORS) - 1))
    at = np.searchsorted(NOMINAL_TIME + OTHER_LOAD_TIME * np.arange(len(LOAD_FACTORS) - 1), time, side="right")
    return axis.simulate(_make_excitation(), float(time[-1]), load=axis.load * np.array(LOAD_FACTORS)[at], seed=seed)


def _make_excitation() -> Trajectory:
    """Make the trajectory: growing pre-sliding loops, slow reversals, sliding; then slow reversals at each other load."""

    def make_loops(time: Array) -> Array:
        return 1e-4 * (time / PRESLIDING_TIME) ** 2 * np.sin(2.0 * np.pi * time)  # 0 to 100 um in 6 s

    reversals, sliding = sine(1.5e-3, 0.5), multisine(1.5e-3, 0.5, 10.0, 2.0, seed=1)
    other = [(sine(1.5e-3, 0.5), OTHER_LOAD_TIME)] * (len(LOAD_FACTORS) - 1)
    return join_trajectories(
        (make_loops, PRESLIDING_TIME), (reversals, 4.0), (sliding, NOMINAL_TIME - PRESLIDING_TIME - 4.0), *other
    )


def identify_coulomb(run: Run, mass: float) -> IdentifiedFeedforward:
    """Identify static friction along a Stribeck curve from the samples that slide; `mass` [kg] is known."""
    trace = _filter_run(run, NOMINAL_TIME)
    slow = np.abs(np.gradient(trace.position, trace.dt)) < SLIDING_SPEED

    def build(values: Mapping[str, float]) -> Coulomb:
        return Coulomb(_make_curve(values))

    estimate = fit(
        lambda v: _SlidingOnly(MovedMass(mass, build(v)), slow, trace.force),
        list(CURVE_START),
        CURVE_START,
        CURVE_BOUNDS,
        trace,
    )
    return IdentifiedFeedforward(Feedforward(mass, build({name: estimate[name] for name in CURVE_START})), estimate)


def identify_lugre(run: Run, mass: float) -> IdentifiedFeedforward:
    """Identify LuGre; `mass` [kg] is known."""
    start = CURVE_START | {"stiffness": 2e6, "damping": 100.0}
    bounds = CURVE_BOUNDS | {"stiffness": (1e4, 1e9), "damping": (0.0, 1e5)}

    def build(values: Mapping[str, float]) -> LuGre:
        return LuGre(_make_curve(values), values["stiffness"], values["damping"])

    estimate = fit(lambda v: MovedMass(mass, build(v)), list(start), start, bounds, _filter_run(run, NOMINAL_TIME))
    return IdentifiedFeedforward(Feedforward(mass, build({name: estimate[name] for name in start})), estimate)


def identify_gms(run: Run, mass: float, elements: int = 10) -> IdentifiedFeedforward:
    """Identify GMS with `elements` elements, and the mass, whose search starts at `mass` [kg]."""
    points = (
        np.geomspace(*BREAK_POINT_RANGE, elements)
        if elements > 1
        else np.array([np.sqrt(BREAK_POINT_RANGE[0] * BREAK_POINT_RANGE[1])])
    )
    names = [f"limit_{i + 1}" for i in range(elements)]

    def build(values: Mapping[str, float]) -> GMS:
        limits = np.array([values[name] for name in names])
        curve = _make_curve({**values, "static_force": limits.sum()})
        return GMS(curve, limits / points, limits / limits.sum(), values["attraction"])

    start = {name: CURVE_START[name] for name in CURVE_START if name != "static_force"} | {"attraction": 500.0}
    start |= dict.fromkeys(names, CURVE_START["static_force"] / elements)
    bounds = CURVE_BOUNDS | {"attraction": (1.0, 1e6)} | dict.fromkeys(names, (1e-6, 1e3))
    start["mass"], bounds["mass"] = mass, (0.2 * mass, 5.0 * mass)
    estimate = fit(lambda v: MovedMass(v["mass"], build(v)), list(start), start, bounds, _filter_run(run, NOMINAL_TIME))
    return IdentifiedFeedforward(
        Feedforward(estimate["mass"], build({name: estimate[name] for name in start})), estimate
    )


def identify_xgms(run: Run, known: IdentifiedFeedforward, load: float) -> IdentifiedFeedforward:
    """Identify XGMS: the GMS model `known` of the nominal `load` [N], and a load law fitted to the whole run."""
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
    trace = _filter_run(run, np.inf)
    estimate = fit(lambda v: MovedMass(mass, build(v)), list(start), start, bounds, trace)
    return IdentifiedFeedforward(Feedforward(mass, build({name: estimate[name] for name in start})), estimate)


def _make_curve(values: Mapping[str, float]) -> Stribeck:
    return Stribeck(values["static_force"], values["beta"], values["stribeck_velocity"], values["viscous"])


def _filter_run(run: Run, end: float) -> Measured:
    """Filter position, motor force and load up to `end` [s]. The force at a sample is the mean of the periods around it."""
    period = float(run.time_s[1] - run.time_s[0])
    every = max(round(1.0 / (FIT_RATE * period)), 1)
    part = slice(0, int(np.searchsorted(run.time_s, end)), every)
    low_pass, slow = (butter(2, corner, fs=1.0 / period, output="sos") for corner in (SIGNAL_CORNER, LOAD_CORNER))
    force = 0.5 * (run.motor_force + np.append(0.0, run.motor_force[:-1]))
    position, force = sosfiltfilt(low_pass, run.position)[part], sosfiltfilt(low_pass, force)[part]
    return Measured(position, every * period, force, np.maximum(sosfiltfilt(slow, run.normal_load)[part], 0.0))
