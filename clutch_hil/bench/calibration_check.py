"""Calibration check: whether a controller's estimate of the torque is that of another clutch than the one that it runs.

Equation        d = mean of sign(slip) (M_m - estimate) in slip control; a torque that only turns the inertia averages out
                told: |d| > max(0.1 mean |M_m|, 0.5 Nm). A controller that knows its rig was within 0.043 mean |M_m| on 50 of
                  50 rigs drawn within 30 %; with the shipped calibration 28 of the 31 without a fault had more than 0.1
Assumptions     the motor's torque is measured well
"""

from collections.abc import Mapping

import numpy as np

from clutch_hil.bench.measures import is_in_phase
from protocols.can.two_clutches import CLUTCHES, CONTROLLERS

_SHARE, _LEAST = 0.1, 0.5  # of the mean torque of the motor, and Nm: see Equation
_LEAST_SAMPLES = 100  # in slip control: fewer are a touch
_OR = "or the clutch has changed; see clutch-hil identify"


def describe_mismatch(columns: Mapping[str, np.ndarray]) -> str | None:
    """A sentence where motor and estimate differ as with another clutch; None where they do not, or it cannot be known."""
    off = _compare(columns, is_in_phase(columns, "slip control"), "controller", "slip_speed_rad_s")
    if off is None:
        return None
    return f"{off} than the controller estimated: its calibration is of another clutch, {_OR}"


def describe_shift_mismatch(columns: Mapping[str, np.ndarray]) -> str | None:
    """As `describe_mismatch`, of a rig of two clutches: of each, in the time in which it alone is in slip control."""
    sliding = [is_in_phase(columns, "slip control", name) for name in CONTROLLERS]
    for clutch, name, own, other in zip(CLUTCHES, CONTROLLERS, sliding, reversed(sliding), strict=True):
        if off := _compare(columns, own & ~other, name, f"slip_speed_{clutch}_rad_s"):
            return f"on clutch {clutch} alone {off} than its controller estimated: its calibration is of another clutch, {_OR}"
    return None


def _compare(columns: Mapping[str, np.ndarray], sliding: np.ndarray, controller: str, slip: str) -> str | None:
    """How far motor and estimate differ where the clutch slides, in words; None where they do not, or it cannot be known."""
    if np.count_nonzero(sliding) < _LEAST_SAMPLES:
        return None
    motor, estimate = (columns[name][sliding] for name in ("motor_torque_nm", f"{controller}_torque_estimate_nm"))
    off = float(np.mean(np.sign(columns[slip][sliding]) * (motor - estimate)))
    mean = float(np.mean(np.abs(motor)))
    if not abs(off) > max(_SHARE * mean, _LEAST):
        return None
    return f"the motor gave {mean:.1f} Nm on average, {abs(off):.1f} Nm {'more' if off > 0.0 else 'less'}"
