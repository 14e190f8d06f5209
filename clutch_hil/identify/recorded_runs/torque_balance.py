"""Torque balance: check that clutch torque and motor torque are equal where the speed is steady.

Equation        M_m = J alpha + M, plus M_drag and offsets                               docs/rig.md, 8
What            slope of M_m over M in stretches without acceleration: 1 for any clutch, whatever its friction; drag and
                offsets shift the line, and do not change its slope
"""

from collections.abc import Mapping

import numpy as np

from clutch_hil.fitting.model import Columns
from clutch_hil.recordings.checks.finding import Finding

_BLOCK = 0.05  # s, averaging time: it removes the noise, and is shorter than any step at constant speed
_STEADY = 0.02  # rad/s from one mean to the next: 0.4 rad/s^2, for which even 0.3 kg m^2 need 0.12 Nm only
# Least number of means, and least span of clutch torque [Nm]: the slope is then known to some percent
_LEAST_BLOCKS, _LEAST_SPAN = 20, 3.0
_TOLERANCE = 0.02  # of the slope: on 25 rigs within 40 %, with offsets and drag, it was 0.9998 to 1.0002
_ANOTHER = (
    "one of them is another channel, or in another unit (1 Nm is 0.738 lbf ft, 8.85 lbf in, 10.2 kgf cm); set its unit in the"
    " import map"
)
# Slopes that the gain of a sensor can cause. Pound-feet beside Nm are 0.738 or 1.356; sensor gains of the battery's largest
# size are 0.75 to 1.25
_SLOPES = 0.77, 1.3


def find_other_torque(runs: Mapping[str, Columns]) -> list[Finding]:
    """Return a finding where motor and clutch torque of all runs together are not equal; hard if no sensor has such an
    error."""
    means = [_average_steady(run) for run in runs.values()]
    clutch, motor = (np.concatenate([pair[k] for pair in means]) for k in (0, 1))
    if len(clutch) < _LEAST_BLOCKS or np.ptp(clutch) < _LEAST_SPAN:
        return []
    slope = float(np.polyfit(clutch, motor, 1)[0])
    if abs(slope - 1.0) < _TOLERANCE:
        return []
    hard = not _SLOPES[0] < slope < _SLOPES[1]
    if abs(slope) < _TOLERANCE:  # such as a column of zeros that an exporter writes for a missing channel
        text = (
            f"moves by {np.ptp(clutch):.3g} Nm at steady speeds, but motor_torque_nm, the same torque, does not: one of them"
            " is dead, or another channel"
        )
    else:
        text = (
            f"moves {1.0 / slope:.3g} times as much as motor_torque_nm at steady speeds, where both are the same torque:"
            f" {_ANOTHER if hard else 'the gain of one of the sensors is off'}"
        )
    return [Finding("scale", "clutch_torque_nm", (0, len(next(iter(runs.values()))["time_s"]) - 1), text, hard)]


def _average_steady(run: Columns) -> tuple[np.ndarray, np.ndarray]:
    """Return block means (n,) of clutch and motor torque [Nm] whose speed equals that of both neighbours."""
    time = run["time_s"]
    rows = max(1, round(_BLOCK / float(time[1] - time[0])))
    count = len(time) // rows
    slip, clutch, motor = (
        np.asarray(run[name][: count * rows], float).reshape(count, rows).mean(axis=1)
        for name in ("slip_speed_rad_s", "clutch_torque_nm", "motor_torque_nm")
    )
    same = np.abs(np.diff(slip)) < _STEADY
    steady = np.zeros(count, bool)
    steady[1:-1] = same[1:] & same[:-1]
    return clutch[steady], motor[steady]
