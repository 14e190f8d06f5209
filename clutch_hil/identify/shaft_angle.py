"""Slip from a shaft's angle; and the angle of a rig without an encoder: the integral of its slip, as the other shaft stands."""

import numpy as np
from scipy.integrate import cumulative_trapezoid
from scipy.ndimage import gaussian_filter1d

from clutch_hil.fitting.model import Columns

_TIME, _SLIP, _ANGLE = "time_s", "slip_speed_rad_s", "shaft_angle_rad"
_SMOOTH = 2e-3  # s, of the Gaussian that differentiates the encoder's angle: its counts are then 2 mrad/s at 1 kHz
_CUT = 6.0  # of its widths, where it ends: cut at 4, as by default, it gives 0.06 % less than the speed


def integrate_slip(columns: Columns, begin: float = 0.0) -> np.ndarray:
    """Angle (n,) [rad] by the slip, from `begin` on."""
    return np.asarray(begin + cumulative_trapezoid(columns[_SLIP], columns[_TIME], initial=0.0))


def complete_angle(columns: Columns) -> Columns:
    """`columns`, with the angle by the slip where a run has a slip and no angle."""
    if _ANGLE in columns or not {_TIME, _SLIP} <= set(columns) or len(columns[_TIME]) != len(columns[_SLIP]):
        return columns
    return {**columns, _ANGLE: integrate_slip(columns)}


def is_integrated(columns: Columns) -> bool:
    """Whether the angle of a run is the integral of its slip, by whomever."""
    angle = columns[_ANGLE]
    return bool(np.ptp(angle) > 0.0 and np.allclose(angle, integrate_slip(columns, angle[0]), rtol=1e-12, atol=1e-12))


def differentiate_angle(time: np.ndarray, angle: np.ndarray) -> np.ndarray:
    """Speed [rad/s] at each row, of an encoder's angle (n,) [rad] at times (n,) [s]."""
    period = float(time[1] - time[0])
    width = _SMOOTH / period
    if width < 1.0:  # a Gaussian of so few values gives less than the speed: 0.85 of it at 250 Hz, a half at 200 Hz
        return np.gradient(angle, period)
    beside = np.arange(1, int(_CUT * width) + 2)
    first, last = angle[1] - angle[0], angle[-1] - angle[-2]
    longer = np.concatenate([angle[0] - first * beside[::-1], angle, angle[-1] + last * beside])
    slope = gaussian_filter1d(longer, width, order=1, truncate=_CUT)
    return np.asarray(slope[len(beside) : -len(beside)] / period)
