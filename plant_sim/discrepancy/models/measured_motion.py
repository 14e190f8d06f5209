"""Speed and acceleration of a measured position, without delay.

Method          least squares of a cubic over a sliding window (Savitzky and Golay 1964): zero phase, and no transient at the
                ends of a run, which the usual Butterworth filter forwards and backwards leaves there
Play            holds the position while it flickers by less than the sensor's last digit: no reversals are made of noise
References      Savitzky and Golay 1964, Anal. Chem. 36(8), 1627-1639; zero-phase central differences for inverse dynamics:
                Gautier 1997, Dynamic identification of robots with power model, ICRA, 1922-1927
"""

from typing import NamedTuple

import numpy as np
from numba import njit
from scipy.signal import savgol_filter

_DEGREE = 3  # of the polynomial: its second derivative is still unbiased where the acceleration changes linearly
_LEAST = 5  # samples in the window: a cubic leaves one over


class Motion(NamedTuple):
    """Position [m], speed [m/s] and acceleration [m/s^2], each (n,)."""

    position: np.ndarray
    speed: np.ndarray
    acceleration: np.ndarray


def motion(position: np.ndarray, period: float, window: float, flicker: float) -> Motion:
    """Motion of the measured `position` [m] (n,), sampled every `period` [s], over a `window` [s], played by `flicker` [m]."""
    played = _played(np.ascontiguousarray(position, float), flicker)
    length = min(max(2 * round(0.5 * window / period) + 1, _LEAST), 2 * ((position.size - 1) // 2) + 1)
    if length <= _DEGREE:
        return Motion(played, *2 * (np.zeros(position.size),))
    smooth = [savgol_filter(played, length, _DEGREE, deriv=order, delta=period) for order in range(3)]
    return Motion(*map(np.ascontiguousarray, smooth))


@njit(cache=True, nogil=True)
def _played(position, flicker):
    """The position with a play of +-`flicker`."""
    played = position.copy()
    for i in range(1, played.size):
        played[i] = min(max(played[i - 1], position[i] - flicker), position[i] + flicker)
    return played
