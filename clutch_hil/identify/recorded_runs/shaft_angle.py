"""Slip from a shaft's angle; angle of a rig without an encoder as the integral of its slip, with the other shaft at rest."""

import numpy as np
from scipy.integrate import cumulative_trapezoid
from scipy.ndimage import gaussian_filter1d

from clutch_hil.fitting.model import Columns

_TIME, _SLIP, _ANGLE = "time_s", "slip_speed_rad_s", "shaft_angle_rad"
# s, width of the Gaussian filter that differentiates the angle: the encoder's counts are then 2 mrad/s at 1 kHz
_SMOOTH = 2e-3
_CUT = 6.0  # widths at which the filter is truncated: at 4, the default, the speed is 0.06 % too low


def integrate_slip(columns: Columns, begin: float = 0.0) -> np.ndarray:
    """Integrate the slip to the angle (n,) [rad], from `begin` [rad] on."""
    return np.asarray(begin + cumulative_trapezoid(columns[_SLIP], columns[_TIME], initial=0.0))


def complete_angle(columns: Columns) -> Columns:
    """Return `columns` with the angle integrated from the slip, where a run has a slip and no angle."""
    if _ANGLE in columns or not {_TIME, _SLIP} <= set(columns) or len(columns[_TIME]) != len(columns[_SLIP]):
        return columns
    return {**columns, _ANGLE: integrate_slip(columns)}


def is_integrated(columns: Columns) -> bool:
    """Return whether the angle of a run is the integral of its slip, and so no separate measurement."""
    angle = columns[_ANGLE]
    return bool(np.ptp(angle) > 0.0 and np.allclose(angle, integrate_slip(columns, angle[0]), rtol=1e-12, atol=1e-12))


def differentiate_angle(time: np.ndarray, angle: np.ndarray) -> np.ndarray:
    """Differentiate an encoder's angle (n,) [rad] at times (n,) [s] to the speed [rad/s] at each row."""
    period = float(time[1] - time[0])
    width = _SMOOTH / period
    if width < 1.0:  # such a narrow Gaussian gives too low a speed: 0.85 of it at 250 Hz, a half at 200 Hz
        return np.gradient(angle, period)
    beside = np.arange(1, int(_CUT * width) + 2)
    first, last = angle[1] - angle[0], angle[-1] - angle[-2]
    longer = np.concatenate([angle[0] - first * beside[::-1], angle, angle[-1] + last * beside])
    slope = gaussian_filter1d(longer, width, order=1, truncate=_CUT)
    return np.asarray(slope[len(beside) : -len(beside)] / period)
