"""Piezo force sensor with built-in electronics (ICP) and its power unit. It leaks, so that a constant load fades away.

Equation        q' = (F + k_T dT - q) / tau;  V = clip(G S (F + k_T dT - q) + V_0, -V_max, V_max)
                that is tau s/(tau s + 1) on force and warming, then gain and zero error of the power unit   (sec. C.2)
Integration     exact for a load held over the step (zero-order hold): q <- q + (1 - exp(-h/tau)) (F - q)
Assumptions     one time constant for sensor and power unit; warming dT acts as a load; zero error added after the gain
Valid range     loads within the sensor's range; steps of any length
Not modelled    resonance of the sensor, change of the sensitivity with temperature, noise
References      Janssens 2010, appendix C
"""

from dataclasses import dataclass
from math import expm1, isfinite

import numpy as np
from numba import njit

from protocols.errors import InputError

GAINS = (1.0, 10.0, 100.0)  # of the power unit; x10 and x100 are used in sec. C.3


@njit(inline="always")
def voltage(load, leaked, sensitivity, offset, limit):
    """Return the output of the power unit [V] under `load` [N], of which `leaked` [N] is lost.

    The sensitivity includes the gain [V/N].
    """
    return min(max(sensitivity * (load - leaked) + offset, -limit), limit)  # Janssens 2010, sec. C.2


@njit(inline="always")
def leak(leaked, load, share):
    """Return the leaked load q [N] after a step of constant `load` [N]; `share` = 1 - exp(-step/tau)."""
    return leaked + share * (load - leaked)  # Janssens 2010, sec. C.2: F_H = tau s/(tau s + 1)


@njit(cache=True)
def _measure_samples(load, leaked, share, sensitivity, offset, limit):
    output = np.empty_like(load)
    for k in range(load.size):
        output[k] = voltage(load[k], leaked, sensitivity, offset, limit)
        leaked = leak(leaked, load[k], share)
    return output, leaked


@dataclass(frozen=True)
class IcpSensor:
    """Sensor and power unit.

    sensitivity S [V/N]; time_constant tau [s]; gain 1, 10 or 100; offset V_0 [V] at the output; warming_load k_T [N/K];
    limit V_max [V]. Raises InputError. Source: Janssens 2010, appendix C; it gives none of the values but the gains.
    """

    sensitivity: float = 2.25e-3  # V/N, 10 mV/lb: loads of 0.5 and 2 kg then give the axes of figs C.3, C.5 and C.8
    time_constant: float = 2.5  # s, chosen: fig C.3 decays within its 20 s
    gain: float = 100.0
    offset: float = 0.0  # V
    warming_load: float = 0.0  # N/K
    limit: float = 10.0  # V, chosen: the swing of a power unit made for +-10 V data acquisition

    def __post_init__(self) -> None:
        """Raise InputError naming the value that is not possible."""
        for name in ("sensitivity", "time_constant", "limit"):
            if not 0.0 < getattr(self, name) < float("inf"):
                raise InputError(f"ICP sensor: {name} is {getattr(self, name):g}; it must be above 0 and finite")
        for name in ("offset", "warming_load"):
            if not isfinite(getattr(self, name)):
                raise InputError(f"ICP sensor: {name} is {getattr(self, name):g}; it must be finite")
        if self.gain not in GAINS:
            raise InputError(f"ICP sensor: gain is {self.gain:g}; allowed are 1, 10 and 100")

    @property
    def decay_rate(self) -> float:
        """Rate a = 1/tau [1/s] of the decay exp(-a t)."""
        return 1.0 / self.time_constant  # Janssens 2010, sec. C.2

    @property
    def scale(self) -> float:
        """Volts at the output per newton."""
        return self.gain * self.sensitivity

    def measure(
        self, force: np.ndarray, step: float, warming: np.ndarray | float = 0.0, leaked: float = 0.0
    ) -> tuple[np.ndarray, float]:
        """Return the output voltages (n,) [V] and the leaked load at the end [N].

        force (n,) [N], held for `step` [s] after each sample; warming, scalar or (n,) [K], above the temperature at rest;
        `leaked` [N] at the start. Raises InputError.
        """
        if not 0.0 < step < float("inf"):
            raise InputError(f"ICP sensor: step is {step:g} s; it must be above 0 and finite")
        pressed, warm = np.asarray(force, dtype=float), np.asarray(warming, dtype=float)
        if pressed.ndim != 1 or warm.shape not in ((), pressed.shape):
            raise InputError(
                f"ICP sensor: force has the shape {pressed.shape} and warming {warm.shape};"
                " force must be a vector, warming a number or as long"
            )
        load = pressed + self.warming_load * warm
        if not np.isfinite(load).all():
            raise InputError("ICP sensor: force and warming must be finite")
        if not isfinite(leaked):
            raise InputError(f"ICP sensor: leaked is {leaked:g} N; it must be finite")
        share = -expm1(-step / self.time_constant)
        return _measure_samples(load, leaked, share, self.scale, self.offset, self.limit)
