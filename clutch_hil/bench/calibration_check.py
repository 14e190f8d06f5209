"""Calibration check: whether a controller's estimate of the torque is that of another clutch than the one that it runs.

Equation        d = mean of sign(slip) (M_m - estimate) in slip control; a torque that only turns the inertia averages out
                told: |d| > max(0.1 mean |M_m|, 0.5 Nm). A controller that knows its rig was within 0.043 mean |M_m| on 50 of
                  50 rigs drawn within 30 %; with the shipped calibration 28 of the 31 without a fault had more than 0.1
Assumptions     the motor's torque is measured well
"""

from collections.abc import Mapping

import numpy as np

from clutch_hil.bench.measures import is_in_phase

_SHARE, _LEAST = 0.1, 0.5  # of the mean torque of the motor, and Nm: see Equation
_LEAST_SAMPLES = 100  # in slip control: fewer are a touch


def describe_mismatch(columns: Mapping[str, np.ndarray]) -> str | None:
    """A sentence where motor and estimate differ as with another clutch; None where they do not, or it cannot be known."""
    sliding = is_in_phase(columns, "slip control")
    if np.count_nonzero(sliding) < _LEAST_SAMPLES:
        return None
    motor, estimate = (columns[name][sliding] for name in ("motor_torque_nm", "controller_torque_estimate_nm"))
    off = float(np.mean(np.sign(columns["slip_speed_rad_s"][sliding]) * (motor - estimate)))
    mean = float(np.mean(np.abs(motor)))
    if not abs(off) > max(_SHARE * mean, _LEAST):
        return None
    return (
        f"the motor gave {mean:.1f} Nm on average, {abs(off):.1f} Nm {'more' if off > 0.0 else 'less'} than the controller"
        " estimated: its calibration is of another clutch, or the clutch has changed; see clutch-hil identify"
    )
