"""DC restoration: inverse of the leak of a piezo force sensor, so that constant loads can be measured.

Equation        u = y + x,  x' = a y,  that is (s + a)/s;  a = -ln(0.02)/t_98                        (sec. C.2)
Integration     x <- x + (1 - exp(-a h)) y: exact for a load held over the step, where y fades as exp(-a t) within it.
                With the sensor's own a, sensor and restoration together are the identity.
Assumptions     y is zero without load (`with_zero_from`): a zero error V_0 becomes a ramp of slope a V_0
Valid range     as long as the converter before it does not saturate: signals cut off there are lost
Not modelled    -
References      Janssens 2010, appendix C
"""

from dataclasses import dataclass, replace
from math import expm1, isfinite, log

import numpy as np
from numba import njit

from protocols.errors import InputError

_SHARE_AFTER_T_98 = 0.02  # share of the first value that remains after t_98: Janssens 2010, fig C.2


@njit(inline="always")
def restore_voltage(voltage, integral):
    """Return the restored voltage [V]: `voltage` plus the leaked part `integral` [V]."""
    return voltage + integral  # Janssens 2010, sec. C.2: 1 + a/s


@njit(inline="always")
def integrate_leak(integral, voltage, share):
    """Return the leaked part [V] after a step that began at `voltage` [V]; `share` = 1 - exp(-a step)."""
    return integral + share * voltage  # Janssens 2010, sec. C.2: a/s of a voltage that fades as exp(-a t)


@njit(cache=True)
def _restore_samples(voltage, integral, share, zero):
    output = np.empty_like(voltage)
    for k in range(voltage.size):
        y = voltage[k] - zero
        output[k] = restore_voltage(y, integral)
        integral = integrate_leak(integral, y, share)
    return output, integral


@dataclass(frozen=True)
class DcRestoration:
    """Inverse filter: decay_rate a [1/s]; zero [V] is subtracted from the voltage first. Raises InputError.

    Source: Janssens 2010, sec. C.2.
    """

    decay_rate: float
    zero: float = 0.0

    def __post_init__(self) -> None:
        """Raise InputError naming the value that is not possible."""
        if not 0.0 < self.decay_rate < float("inf"):
            raise InputError(f"DC restoration: decay_rate is {self.decay_rate:g} 1/s; it must be above 0 and finite")
        if not isfinite(self.zero):
            raise InputError(f"DC restoration: zero is {self.zero:g} V; it must be finite")

    @classmethod
    def from_decay_time(cls, t_98: float) -> "DcRestoration":
        """Make the filter of a sensor that loses 98 % of a constant load within `t_98` [s]. Raises InputError."""
        if not 0.0 < t_98 < float("inf"):
            raise InputError(f"DC restoration: t_98 is {t_98:g} s; it must be above 0 and finite")
        return cls(-log(_SHARE_AFTER_T_98) / t_98)  # Janssens 2010, sec. C.2: -a = ln(0.02)/t_98

    def with_zero_from(self, idle: np.ndarray) -> "DcRestoration":
        """Make a filter of equal rate whose zero is the mean of the `idle` voltages (n,) [V], taken without load.

        Raises InputError for no voltages.
        """
        voltages = np.asarray(idle, dtype=float)
        if voltages.size == 0:
            raise InputError("DC restoration: zeroing needs at least one voltage of the unloaded sensor")
        return replace(self, zero=float(voltages.mean()))  # Janssens 2010, sec. C.2

    def restore(self, voltage: np.ndarray, step: float, integral: float = 0.0) -> tuple[np.ndarray, float]:
        """Return the restored voltages (n,) [V] and the leaked part at the end [V].

        voltage (n,) [V], every `step` [s]; `integral` [V] at the start. Raises InputError.
        """
        if not 0.0 < step < float("inf"):
            raise InputError(f"DC restoration: step is {step:g} s; it must be above 0 and finite")
        samples = np.asarray(voltage, dtype=float)
        if samples.ndim != 1 or not np.isfinite(samples).all():
            raise InputError("DC restoration: the voltage must be a vector of finite numbers")
        if not isfinite(integral):
            raise InputError(f"DC restoration: integral is {integral:g} V; it must be finite")
        return _restore_samples(samples, integral, -expm1(-self.decay_rate * step), self.zero)
