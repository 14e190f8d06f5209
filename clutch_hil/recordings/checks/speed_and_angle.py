"""Speed and angle: a slip that is not the rate of the angle of the same shaft, but a multiple of it.

Equation        mean of the slip over a block = ratio * (change of the angle over it / its length) + zero
                least squares over all blocks; a finding if |ratio - 1| > _TOLERANCE, and the ratio explains the difference:
                  the squares left are at most _LEFT of those with a ratio of 1 and a zero of its own
Assumptions     both columns are of the shaft of docs/columns.md; a zero of a tachometer is not counted as a ratio
Not modelled    slip behind a filter or late: no ratio explains it, so it gives no finding
"""

import numpy as np
from scipy.integrate import cumulative_trapezoid

from clutch_hil.recordings.checks.finding import Finding
from clutch_hil.recordings.checks.knowledge import Recorded

SPEED, ANGLE = "slip_speed_rad_s", "shaft_angle_rad"  # docs/columns.md
_BLOCK = 0.2  # s, chosen: longer than the lag of a usual speed filter
_LEAST_BLOCKS, _LEAST_SPAN = 10, 3.0  # -, rad/s: then counts and noise of the bench's encoder change the ratio by 1e-4
_TOLERANCE = 0.01  # of the ratio, chosen: less does not change a verdict; sound runs of the bench are within 0.001
_LEFT = 0.1  # of the squares, chosen: what is left where the columns differ in anything but a ratio


def find_scaled_speed(run: Recorded) -> list[Finding]:
    """Return a finding where the slip is a multiple of the rate of the angle."""
    columns = run.columns
    if not {SPEED, ANGLE} <= columns.keys():
        return []
    rows = max(1, round(_BLOCK / run.period))
    length = np.diff(columns["time_s"][::rows])
    if len(length) < _LEAST_BLOCKS:
        return []
    speed = np.diff(cumulative_trapezoid(columns[SPEED], columns["time_s"], initial=0.0)[::rows]) / length
    rate = np.diff(columns[ANGLE][::rows]) / length
    if np.ptp(speed) < _LEAST_SPAN or np.ptp(rate) < _LEAST_SPAN:
        return []
    ratio, zero = np.polyfit(rate, speed, 1)
    left = np.sum((speed - ratio * rate - zero) ** 2)
    if abs(ratio - 1.0) <= _TOLERANCE or left > _LEFT * np.sum((speed - rate - np.mean(speed - rate)) ** 2):
        return []
    text = (
        f"is {ratio:.4g} times the rate of {ANGLE}, where both are of one shaft: sign, unit, counts of a turn or gear ratio of"
        " one of them is wrong; set scale in the import map"
    )
    return [Finding("scale", SPEED, run.rows, text, False)]
