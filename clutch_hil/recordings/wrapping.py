"""Wrapping: numbers that begin anew after their range, as counters do, and as numbers below 0 do that are read without sign."""

import numpy as np

_BITS = (8, 16, 24, 32)  # of counters and of raw numbers of sensors
_FEW = 8  # numbers; fewer have no course
_NEAR_END = 1 / 8  # of the range: a number is so near to an end where it begins anew, and other steps are smaller
_UNEVEN = (
    3.0  # by which a step where it begins anew may be larger than the largest other one: a placeholder is far away
)


def unwrap(values: np.ndarray, period: float) -> tuple[np.ndarray, int]:
    """Return the values (n,) with steps of `period` removed, and the number of steps. Missing values stay missing."""
    known = np.isfinite(values)
    whole = values.astype(float)
    whole[known] = np.unwrap(whole[known], period=period)
    moved = np.diff(whole[known] - values[known])
    return whole, int(np.count_nonzero(np.abs(moved) > 0.5 * period))


def find_range(values: np.ndarray) -> tuple[int, int]:
    """Return the range after which whole numbers (n,) begin anew, and the first row after that; 0 and 0 if they do not.

    Their course is then even without the steps of this range. A signal that only switches between two ends has no course.
    """
    known = np.flatnonzero(np.isfinite(values))
    numbers = values[known]
    if len(numbers) < _FEW or np.any(numbers != np.rint(numbers)) or len(np.unique(numbers)) < _FEW:
        return 0, 0
    low, high = float(numbers.min()), float(numbers.max())
    for period in (1 << bits for bits in _BITS):
        begin = 0.0 if low >= 0.0 else -0.5 * period
        if not begin <= low <= high < begin + period or high - low < (1.0 - 2.0 * _NEAR_END) * period:
            continue
        steps = np.diff(numbers)
        jumps = np.abs(steps) > (1.0 - 2.0 * _NEAR_END) * period
        course = np.abs(steps - np.sign(steps) * period * jumps)
        usual = course[~jumps].max(initial=0.0)
        if jumps.any() and 0.0 < usual < _NEAR_END * period and course[jumps].max() <= _UNEVEN * usual:
            return period, int(known[np.flatnonzero(jumps)[0] + 1])
    return 0, 0
