"""Bandwidth of the pressure loop of a battery rig by linear analysis: the true value of what `identify` measures.

Equation        x' = A x + B u of docs/rig.md, 1 to 3, with the plates in contact: valve pressure and its rate, cylinder
                pressure, piston. The voltage is held over a period T of 1 ms:
                P(z) = C (z - exp(A T))^-1 int_0^T exp(A t) dt B k_v
                regulator: K(z) = 0.45 + 6 T z/(z - 1), u = (p_d + K (p_d - p))/(2.5 bar/V)
                p_cyl/p_d = P (1 + K)/2.5/(1 + P K/2.5)
Assumptions     plates stay in contact, the valve within its limits
References      docs/rig.md; Astrom and Wittenmark 1997, Computer-controlled systems, ch. 2
"""

import numpy as np
from scipy.linalg import expm
from scipy.optimize import brentq

from benchmarks.battery.truth_rig import BAR
from benchmarks.battery.truth_simulation import PERIOD

_PROPORTIONAL, _INTEGRAL, _GAIN = 0.45, 6.0, 2.5  # -, 1/s, bar/V: docs/rig.md
_SCANNED = np.arange(0.5, 40.0, 0.05)  # Hz


def compute_loop(rig: np.ndarray, frequency: np.ndarray, delay: float = 0.0) -> np.ndarray:
    """Return p_cyl/p_d [bar/bar], complex (n,), at `frequency` (n,) [Hz] of a rig's record (1,), SI; delay [s] of its valve."""
    c = rig[0]
    w = c["valve_frequency"]
    area, damping, capacity = c["piston_area"], c["piston_damping"], c["hydraulics_capacity"]
    flow = c["hydraulics_conductance"]
    stiff = c["piston_spring_stiffness"] + c["piston_stack_stiffness"]
    # p_v, p_v', p, x; the piston moves by (A p - k x)/c
    a = np.array([
        [0.0, 1.0, 0.0, 0.0],
        [-w * w, -2.0 * c["valve_damping"] * w, 0.0, 0.0],
        [flow / capacity, 0.0, -(flow + area * area / damping) / capacity, area * stiff / damping / capacity],
        [0.0, 0.0, area / damping, -stiff / damping],
    ])  # fmt: skip
    b = np.array([0.0, w * w * c["valve_gain"] / BAR, 0.0, 0.0])  # bar/V
    a = np.diag([1.0, 1.0, 1.0, BAR]) @ a @ np.diag([1.0, 1.0, 1.0, 1.0 / BAR])  # states in Pa, and m times BAR
    whole = expm(PERIOD * np.block([[a, b[:, None]], [np.zeros((1, 5))]]))
    step, held = whole[:4, :4], whole[:4, 4]
    loop = np.empty(len(frequency), complex)
    for k, hertz in enumerate(frequency):
        z = np.exp(2j * np.pi * hertz * PERIOD)
        plant = np.linalg.solve(z * np.eye(4) - step, held)[2] / _GAIN * np.exp(-2j * np.pi * hertz * delay)
        regulator = _PROPORTIONAL + _INTEGRAL * PERIOD * z / (z - 1.0)
        loop[k] = plant * (1.0 + regulator) / (1.0 + plant * regulator)
    return loop


def find_bandwidth(rig: np.ndarray, delay: float = 0.0) -> float:
    """Return the frequency [Hz] at which p_cyl/p_d first falls below 1/sqrt(2); delay [s] of the valve."""

    def measure_beyond(hertz: float) -> float:
        return float(np.abs(compute_loop(rig, np.array([hertz]), delay)[0])) - np.sqrt(0.5)

    first = int(np.flatnonzero(np.abs(compute_loop(rig, _SCANNED, delay)) < np.sqrt(0.5))[0])
    return float(brentq(measure_beyond, _SCANNED[first - 1], _SCANNED[first]))
