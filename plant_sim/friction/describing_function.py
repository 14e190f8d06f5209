"""Describing function of friction: the spring and the damper that it is to a reciprocating motion.

What            the first harmonic of the force under x = A sin(omega t), as an equivalent stiffness and damping
Equation        F ~ k x + c x',  k = 2/A <F sin(omega t)>,  c = 2/(A omega) <F cos(omega t)>, <> the mean of a settled period
                what the force creeps over a period, as bristles do for long, is taken off as a ramp
                loss of a period  W = pi c omega A^2
                one Maxwell-slip element beyond its break point x_b = W_1/k_1: theta = arccos(1 - 2 x_b/A),
                k = k_1/pi (theta - sin(2 theta)/2),  W = 4 W_1 (A - x_b)   (used in the tests)
Assumptions     what surrounds the contact lets little through above the first harmonic
Valid range     any model with `trace`; amplitudes from pre-sliding to gross sliding
Not modelled    higher harmonics, drift under a mean force
References      Gelb and Vander Velde 1968, Multiple-Input Describing Functions, ch. 2; the responses that depend on
                the amplitude, Janssens 2010, sec. 3.10, are what such a contact shows
"""

from dataclasses import dataclass
from math import pi

import numpy as np

from plant_sim.friction.model import Array, FrictionModel, check_real, require, require_type
from protocols.errors import InputError

SAMPLES = 4000  # of a period; chosen: the force of a step is of its middle, which turns c omega by pi/4000 towards k
MOST_PERIODS = 1000  # until the parts are as in the period before, to SETTLED; bristles need most, see the tests
SETTLED = 1e-9  # of the larger part; chosen: far below the error of the samples, and above rounding


@dataclass(frozen=True)
class DescribingFunction:
    """Equivalent `stiffness` k [N/m] and `damping` c [Ns/m] (n,) at each `amplitude` A [m] (n,) and one `frequency` [Hz]."""

    amplitude: Array
    frequency: float
    stiffness: Array
    damping: Array

    @property
    def loss(self) -> Array:
        """Energy lost in a period [J] (n,)."""
        return pi * self.damping * 2.0 * pi * self.frequency * self.amplitude**2

    @property
    def complex_stiffness(self) -> Array:
        """k + j omega c [N/m] (n,), to be added to that of the structure."""
        return self.stiffness + 2j * pi * self.frequency * self.damping


def describing_function(
    model: FrictionModel, amplitude: Array | float, frequency: float, load: float = 1.0
) -> DescribingFunction:
    """Return the describing function of `model` at each `amplitude` [m], scalar or (n,), of a sine of `frequency` [Hz].

    `load` [N] on the contact is constant. Raises InputError.
    """
    require_type("model", model, FrictionModel)
    amplitudes = np.atleast_1d(check_real("amplitude", amplitude))
    if amplitudes.ndim != 1 or amplitudes.size == 0:
        raise InputError(f"amplitude has shape {amplitudes.shape}; one value or more is needed, in one dimension")
    require("least amplitude", float(amplitudes.min()), above=0.0, unit="m")
    require("frequency", frequency, above=0.0, unit="Hz")
    require("load", load, least=0.0, unit="N")
    phase = 2.0 * pi * np.arange(SAMPLES + 1) / SAMPLES
    dt = 1.0 / (frequency * SAMPLES)
    values = np.array([_compute_harmonic(model, one, phase, dt, load) / one for one in amplitudes])
    return DescribingFunction(amplitudes, float(frequency), values[:, 0], values[:, 1] / (2.0 * pi * frequency))


def _compute_harmonic(model: FrictionModel, amplitude: float, phase: Array, dt: float, load: float) -> Array:
    """Return the parts of the force [N] (2,) in phase with the position and with the velocity, in a settled period.

    Bristles creep from the first stroke for thousands of periods at a small amplitude. This is a mean force, and no part.
    """
    position, waves = amplitude * np.sin(phase), np.array([np.sin(phase[1:]), np.cos(phase[1:])])
    state, before, end = model.start(None, load), np.full(2, np.inf), 0.0
    for _ in range(MOST_PERIODS):
        trace = model.trace(position, dt, load, state)
        creep, end = (trace.force[-1] - end) / SAMPLES * np.arange(1, SAMPLES + 1), trace.force[-1]
        state, parts = trace.state[-1], 2.0 / SAMPLES * waves @ (trace.force[1:] - creep)
        if np.abs(parts - before).max() <= SETTLED * np.abs(parts).max():
            return parts
        before = parts
    raise InputError(
        f"friction at an amplitude of {amplitude:g} m does not repeat after {MOST_PERIODS} periods: its own dynamics are slow"
        " or hardly damped; try another frequency, or simulate the motion"
    )
