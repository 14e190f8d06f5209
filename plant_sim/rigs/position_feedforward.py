"""Friction feedforward of the position axis: inertia and friction model along the desired motion (fig 5.10).

What            the motor force that moves a model of the axis along the desired motion
Equation        F_ff = M x_d'' + F(x_d, N) + offset, over a control period; the desired motion is taken at its middle
Assumptions     the model begins at rest; it uses only the desired motion, never the measured one
Valid range     motions that PID control keeps close to the desired motion
Not modelled    -
References      Janssens 2010, sec. 5.9
"""

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from scipy.interpolate import PPoly

from plant_sim.friction.kernel import law
from plant_sim.friction.model import Array, FrictionModel, check_real, require, require_type
from plant_sim.friction.whole_number import require_whole
from plant_sim.rigs.position_axis import LEAST_SAMPLES, Trajectory
from protocols.errors import InputError

MOST_LINES = 1e5  # of a multisine; chosen: each is summed at each sample
FADE_TIME = 0.5  # s over which a trajectory fades to 0 before the next one; chosen


@law
def frictionless(parameters, state, displacement, dt, load, new_state):
    """Return no friction, 0 N; the state is empty."""
    return 0.0


@dataclass(frozen=True)
class Frictionless(FrictionModel):
    """The null model: with it a feedforward contains only the inertia."""

    law = staticmethod(frictionless)

    @cached_property
    def parameters(self) -> Array:
        """Empty vector."""
        return np.empty(0)

    def rest(self, load: float = 1.0) -> Array:
        """Return an empty state."""
        return np.empty(0)

    def steady_state(self, velocity: Array | float, load: float = 1.0) -> Array:
        """Return 0 N."""
        return np.zeros(np.shape(velocity))


@dataclass(frozen=True)
class Feedforward:
    """Inertia of `mass` [kg], `friction`, and a constant force `offset` [N]. Raises InputError."""

    mass: float
    friction: FrictionModel
    offset: float = 0.0

    def __post_init__(self) -> None:
        require("mass of the feedforward", self.mass, least=0.0, unit="kg")
        require_type("friction of the feedforward", self.friction, FrictionModel)
        require("offset of the feedforward", self.offset, unit="N")

    def force(self, trajectory: Trajectory, time: Array, load: Array | float = 1.0) -> Array:
        """Return the force [N] (n,) for each control period that begins at `time` [s] (n,).

        `load` [N] as measured, scalar or (n,). `time` is equidistant, n is 2 or more. Raises InputError.
        """
        time, load = check_real("time [s]", time), check_real("load [N]", load)
        if time.ndim != 1 or time.size < LEAST_SAMPLES:
            raise InputError(
                f"time has shape {time.shape}; {LEAST_SAMPLES} values or more are needed, in one dimension"
            )
        if load.shape not in ((), time.shape):
            raise InputError(f"load has shape {load.shape}; allowed is one value, or one for each of {time.size} times")
        period = float(time[1] - time[0])
        require("control period", period, above=0.0, unit="s")
        middle = trajectory(np.append(time - 0.5 * period, time[-1] + 0.5 * period + np.array([0.0, period])))
        acceleration = np.diff(middle, 2) / period**2
        friction = self.friction.trace(
            middle[:-1], period, np.append(np.ravel(load)[:1], np.broadcast_to(load, time.size))
        )
        return self.mass * acceleration + friction.force[1:] + self.offset


def sine(amplitude: float, frequency: float) -> Trajectory:
    """Return the sine of `amplitude` [m] and `frequency` [Hz] that grows from rest over its first period. Raises InputError."""
    require("amplitude", amplitude, unit="m")
    require("frequency", frequency, above=0.0, unit="Hz")
    return lambda time: amplitude * _smooth_step(time * frequency) * np.sin(2.0 * np.pi * frequency * time)


def multisine(rms: float, lowest: float, highest: float, period: float, seed: int) -> Trajectory:
    """Return the random-phase multisine of `rms` [m], all harmonics of 1/`period` [s] from `lowest` to `highest` [Hz].

    Amplitudes fall with the frequency, so that every line has the same velocity; grows from rest over the first period.
    Raises InputError.
    """
    require("rms of the multisine", rms, least=0.0, unit="m")
    require("lowest frequency", lowest, least=0.0, unit="Hz")
    require("highest frequency", highest, least=lowest, unit="Hz")
    require("period of the multisine", period, above=0.0, unit="s")
    require("number of its lines", highest * period, most=MOST_LINES)
    lines = np.arange(round(lowest * period), round(highest * period) + 1) / period
    if lines.size == 0 or not lines[0] > 0.0:
        raise InputError(
            f"multisine has lines from {lowest:g} to {highest:g} Hz; frequencies that rise from above 0 are needed"
        )
    phases = np.random.default_rng(seed).uniform(0.0, 2.0 * np.pi, lines.size)
    amplitudes = rms * np.sqrt(2.0 / np.sum(lines**-2.0)) / lines

    def position(time: Array) -> Array:
        angle = 2.0 * np.pi * np.multiply.outer(np.asarray(time, float), lines) + phases
        return _smooth_step(time / period) * (np.sin(angle) @ amplitudes)

    return position


def trapezoidal_strokes(distance: float, speed: float, acceleration: float, dwell: float, strokes: int) -> Trajectory:
    """Return `strokes` moves of `distance` [m] to and fro, each after `dwell` [s], with trapezoidal velocity.

    Raises InputError.
    """
    for name, value in (("distance", distance), ("speed", speed), ("acceleration", acceleration), ("dwell", dwell)):
        require(name, value, above=0.0)
    require_whole("number of strokes", strokes)
    ramp = speed / acceleration
    cruise = distance / speed - ramp
    require("time at full speed", cruise, above=0.0, unit="s")
    durations = np.tile([dwell, ramp, cruise, ramp], strokes)
    senses = np.repeat(np.where(np.arange(strokes) % 2 == 0, 1.0, -1.0), 4)
    accelerations = senses * np.tile([0.0, acceleration, 0.0, -acceleration], strokes)
    breaks = np.concatenate([[-1.0], np.cumsum(durations), [np.sum(durations) + 1e5]])
    return PPoly([np.concatenate([accelerations, [0.0]])], breaks).antiderivative(2)


def join_trajectories(*parts: tuple[Trajectory, float]) -> Trajectory:
    """Join trajectories: each lasts its time [s], more than FADE_TIME, and fades to rest at 0 at its end."""
    for _, seconds in parts:
        require("time of a trajectory", seconds, above=FADE_TIME, unit="s")
    ends = np.cumsum([0.0, *(seconds for _, seconds in parts)])

    def position(time: Array) -> Array:
        time = np.asarray(time, float)
        whole = np.zeros(time.shape)
        for (trajectory, seconds), start in zip(parts, ends[:-1], strict=True):
            own = np.clip(time - start, 0.0, seconds)
            whole += trajectory(own) * _smooth_step((seconds - own) / FADE_TIME)
        return whole

    return position


def _smooth_step(turns: Array) -> Array:
    """Return the polynomial from 0 at `turns` 0 to 1 at `turns` 1, constant outside, smooth to the second derivative."""
    x = np.clip(turns, 0.0, 1.0)
    return x**3 * (10.0 - 15.0 * x + 6.0 * x**2)
