"""Tangential responses of the tribometer: its dry contact, responses at the loads of the thesis, measures of a response."""

from functools import cache
from math import pi

import numpy as np

from plant_sim.friction.load_law import LoadLaw
from plant_sim.friction.maxwell_slip import MaxwellSlip
from plant_sim.rigs.multisine import Multisine
from plant_sim.rigs.tribometer import Tribometer
from plant_sim.rigs.tribometer_responses import (
    DRIFT_STIFFNESS,
    Tangential,
    measure_stepped_sine,
    measure_tangential_response,
)
from plant_sim.rigs.tribometer_structure import compute_response

Array = np.ndarray
OWN_WEIGHT = 58.0  # N, sec. 3.10
LOADS = (OWN_WEIGHT, 280.0, 560.0, 840.0, 1120.0, 1400.0)  # N, sec. 3.10
DT = 1e-4  # s; chosen: a twentieth of a period at 500 Hz. It adds k dt/2 of damping to a contact of stiffness k
SAMPLES = 10_000  # a period of 1 s: lines 1 Hz apart, as the axes of the figures begin at 1 Hz
LINES = np.arange(1, 501)  # 500 Hz of bandwidth, sec. 3.10
BAND = (5.0, 60.0)  # Hz, where levels and slopes are read: above the weak position loop, below the resonances

# 0.25 at 50 N, 0.11 at 1100 N (fig 4.14); the load scale of 100 N is chosen
DRY = LoadLaw(0.2743, 1.524, 100.0)
TRAVEL = 1e-4  # rad, to gross sliding; chosen: below the 4e-4 rad that fig 4.2 commands, because the loop is weak
ELEMENTS = 12  # springs of the contact; chosen: its loops look smooth

_STRUCTURE = Tribometer(MaxwellSlip(np.ones(1), np.ones(1)), sensors=False)  # for its structure, not to be run


def stiffness(load: float) -> float:
    """Tangential stiffness k_kf [Nm/rad] of the contact at first touch under `load` [N]."""
    return float(make_contact(load).stiffness.sum()) * _STRUCTURE.radius**2


@cache
def make_contact(load: float) -> MaxwellSlip:
    """Make the dry contact at `load` [N]: equal springs that slip one after another, evenly up to TRAVEL.

    Its virgin curve is a parabola.
    """
    reach = TRAVEL * _STRUCTURE.radius * np.arange(1, ELEMENTS + 1) / ELEMENTS
    each = float(DRY(load)) / reach.sum()
    return MaxwellSlip(np.full(ELEMENTS, each), each * reach)


@cache
def identify_response(load: float, amplitude: float) -> Tangential:
    """Identify theta/T [rad/Nm] at `load` [N] and `amplitude` [V] of each line."""
    rig = Tribometer(make_contact(load))
    source = Multisine(LINES, rig.parameters["motor.gain"].si * amplitude, SAMPLES)
    return measure_tangential_response(rig, load, source, DT)


@cache
def measure_sines(level: float) -> tuple[Array, Array]:
    """Measure theta/T [rad/Nm] (n,) under the own weight by sines as strong as the multisine of `level` [V].

    Return the frequencies [Hz] (n,), too.
    """
    rig = Tribometer(make_contact(OWN_WEIGHT), sensors=False)
    amplitude = rig.parameters["motor.gain"].si * level * np.sqrt(LINES.size)
    return measure_stepped_sine(rig, OWN_WEIGHT, amplitude, np.geomspace(2.0, 450.0, 50), DT)


def compute_mass_line(frequency: Array) -> Array:
    """Compute theta/T of the motor [rad/Nm] at `frequency` [Hz] without friction: -1/(J omega^2), J above the contact."""
    _, disk, motor = _STRUCTURE.tangential.inertia
    return -1.0 / ((disk + motor) * (2.0 * pi * frequency) ** 2)


def compute_mass_spring(frequency: Array, load: float) -> Array:
    """Compute theta/T of the motor [rad/Nm] at `frequency` [Hz] with the contact as a spring of its first stiffness."""
    spring = stiffness(load)
    a, b = _STRUCTURE.tangential.make_state_space(spring, 0.5 * DT * spring, DRIFT_STIFFNESS)
    return compute_response(a, b[:, 1], np.eye(6)[2], frequency)


def decibel(values: Array) -> Array:
    """20 log10 of the modulus."""
    return 20.0 * np.log10(np.abs(values))


def is_in_band(frequency: Array) -> Array:
    """Which of `frequency` [Hz] are in BAND."""
    return (frequency >= BAND[0]) & (frequency <= BAND[1])


def level(frequency: Array, values: Array) -> float:
    """Median amplitude in BAND [dB]."""
    return float(np.median(decibel(values[is_in_band(frequency)])))


def slope(frequency: Array, values: Array) -> float:
    """Slope of the amplitude in BAND [dB/decade]."""
    inside = is_in_band(frequency)
    return float(np.polyfit(np.log10(frequency[inside]), decibel(values[inside]), 1)[0])


def resonance(frequency: Array, values: Array) -> float:
    """Frequency of the highest amplitude between 100 and 250 Hz [Hz]."""
    inside = np.flatnonzero((frequency >= 100.0) & (frequency <= 250.0))
    return float(frequency[inside[np.argmax(np.abs(values[inside]))]])
