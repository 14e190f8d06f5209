"""Motion from a measured position, without delay: `compute_path` for the sign of the speed, `smooth` for the acceleration.

Equation        path: v = dx/dt from sample to sample, x at the middle between them
                smooth: least squares of a quartic over a sliding window (Savitzky and Golay 1964). It has zero phase and no
                transient at the ends of a run, unlike a Butterworth filter forwards and backwards
Flicker         the position is held where it returns by no more than the sensor's last digit, so that noise is no reversal.
                A true reversal stays at its sample: a backlash filter would delay it, by an amount that looks like pre-sliding
References      Savitzky and Golay 1964, Anal. Chem. 36(8), 1627-1639; zero-phase central differences for inverse dynamics:
                Gautier 1997, Dynamic identification of robots with power model, ICRA, 1922-1927
"""

from typing import NamedTuple

import numpy as np
from numba import njit

from protocols.errors import InputError

_POLYNOMIAL_DEGREE = 4  # degree of the polynomial
# Least samples in the window: a quartic through 5 samples is the central difference of order 4, without smoothing
_LEAST_SAMPLES = 5


class Motion(NamedTuple):
    """Position [m], speed [m/s] and acceleration [m/s^2], (n,) each, at the samples (`smooth`) or half a sample before
    (`compute_path`)."""

    position: np.ndarray
    speed: np.ndarray
    acceleration: np.ndarray


def compute_path(position: np.ndarray, period: float, flicker: float) -> Motion:
    """Return the motion between samples of `position` [m] (n,) with `period` [s], without `flicker` [m]; acceleration is 0."""
    played = _hold_flicker(np.ascontiguousarray(position, float), flicker)
    step = np.diff(played, prepend=played[0])
    return Motion(played - 0.5 * step, step / period, np.zeros(played.size))


def smooth(position: np.ndarray, period: float, window: float) -> Motion:
    """Return the motion at samples of `position` [m] (n,) with `period` [s], smoothed over a `window` [s]. Raises
    InputError."""
    from scipy.signal import savgol_filter  # loading takes half a second of CPU

    length = max(2 * round(0.5 * window / period) + 1, _LEAST_SAMPLES)
    if position.size < length:
        raise InputError(f"position has {position.size} samples; the window of its derivative needs {length}")
    return Motion(
        *(savgol_filter(position, length, _POLYNOMIAL_DEGREE, deriv=order, delta=period) for order in range(3))
    )


@njit(cache=True, nogil=True)
def _hold_flicker(position, flicker):
    """Return the position, held where it returns by 2 `flicker` or less; a true reversal stays at its sample."""
    held = position.copy()
    way, turned = 0, 0  # direction, 0 before the first motion; sample of the last reversal
    low, high = 0, 0  # samples of the least and the greatest position since then
    for i in range(1, position.size):
        if position[i] < position[low]:
            low = i
        if position[i] > position[high]:
            high = i
        ahead = high if way > 0 else low
        if way == 0 and position[high] - position[low] > 2.0 * flicker:
            way, turned = (1, low) if high > low else (-1, high)
            held[: turned + 1] = position[turned]
        elif way != 0 and i != ahead and way * (position[ahead] - position[i]) > 2.0 * flicker:
            way, turned = -way, ahead
        else:
            held[i] = held[0] if way == 0 else position[ahead]
            continue
        for k in range(turned + 1, i + 1):
            held[k] = max(held[k - 1], position[k]) if way > 0 else min(held[k - 1], position[k])
        low, high = (turned, i) if way > 0 else (i, turned)
    return held
