"""The shaft's angle of a rig without an encoder: the integral of its slip, as the other shaft stands."""

import numpy as np
from scipy.integrate import cumulative_trapezoid

from clutch_hil.fitting.model import Columns

_TIME, _SLIP, _ANGLE = "time_s", "slip_speed_rad_s", "shaft_angle_rad"


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
