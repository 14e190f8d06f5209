"""Lag of a recorded slip behind the shaft's angle, as of a tachometer, a filter or a bus.

Equation        s = f(v - zero, later):  v speed from the angle, the mean over a sample of T; s recorded slip; both smoothed
                  f a delay by `later`, or a filter of first order with that time constant: what leaves the smaller residual
                  later and zero by least squares, d s/d later = -ds/dt, from 0 on (Gauss-Newton)
                without an encoder: the mean over a sample, or the value at its end (f a delay by -T/2), as agrees better with
                  ds/dt = (M_m - M)/J at a constant speed demand, by least squares in 1/J and a zero    docs/rig.md, 8
                a simulated slip, a mean over T (docs/rig.md, 9), gets the same f. The recorded one stays: between its rows its
                  noise would not be white
Assumptions     the encoder is right, and the lag is the same in the whole run
Not modelled    rows of a logger, 1.5 ms and more apart (logged_rows.py); filters of higher order
"""

from typing import NamedTuple

import numpy as np
from scipy.ndimage import gaussian_filter1d
from scipy.signal import lfilter

from clutch_hil.fitting.model import Columns
from clutch_hil.identify.recorded_runs.logged_rows import LOOP
from clutch_hil.identify.recorded_runs.shaft_angle import is_integrated

# Columns (n,) of a complete run whose slip is no mean over a sample: by what it is delayed, and the filter's time constant [s]
SLIP_DELAY, SLIP_FILTER = "slip_delay_s", "slip_filter_s"
_TIME, _SLIP, _ANGLE = "time_s", "slip_speed_rad_s", "shaft_angle_rad"
_TORQUES, _DEMAND = ("motor_torque_nm", "clutch_torque_nm"), "motor_speed_demand_rad_s"
_SMOOTH = 5e-3  # s, width of the Gaussian filter: with 0.1 rad/s of noise a lag is then found to 0.2 ms
_CUT = 4.0  # widths at both ends that are not used
_WIDTH_OF_ONE = 3.5  # sqrt(4 pi): widths of smoothed white noise in which it has one independent value
_ROUNDS = 4  # of Gauss-Newton: 20 ms are found to 1 % in three
# A lag other than that of a mean over T counts if it differs by so many standard deviations, and by so large a share of T
_SURE, _LEAST = 4.0, 0.1
_EARLIEST, _LATEST = -0.02, 0.05  # s: beyond them the checks refuse the column
_LEAST_REST = 1.0  # s: the motion of one engagement
_CLEARLY = 0.8  # ratio of mean squares: with noise that hides half a sample it is 1
_SAME = 1e-7  # rad, tolerance: the slip of the bench is the difference of two angles, which takes no fit to see


class _Fit(NamedTuple):
    """A lag: `later` [s] than the mean over a sample, its standard deviation, and the mean square it leaves [rad^2/s^2]."""

    later: float
    unsure: float
    left: float


def add_slip_lag(columns: Columns) -> Columns:
    """Return a run with the column SLIP_DELAY or SLIP_FILTER if its slip is no mean over a sample, and the angle shows it."""
    if not {_TIME, _SLIP, _ANGLE} <= set(columns):
        return columns
    time, slip, angle = (np.asarray(columns[name], float) for name in (_TIME, _SLIP, _ANGLE))
    if not len(time) == len(slip) == len(angle) > 1 or not all(np.isfinite(c).all() for c in (time, slip, angle)):
        return columns
    period = float(time[1] - time[0])
    if not 0.0 < period < 1.5 * LOOP or len(time) * period < 4.0 * _CUT * _SMOOTH:
        return columns
    turned = np.diff(angle)
    if np.allclose(turned, slip[1:] * period, rtol=0.0, atol=_SAME):
        return columns
    if is_integrated(columns):
        instant = _is_instantaneous(columns, period)
        return {**columns, SLIP_DELAY: np.full(len(time), -0.5 * period)} if instant else columns
    fits = {
        column: _fit(turned / period, slip[1:], period, column == SLIP_FILTER) for column in (SLIP_DELAY, SLIP_FILTER)
    }
    column, best = min(fits.items(), key=lambda item: item[1].left)
    if not abs(best.later) > _SURE * best.unsure + _LEAST * period or not _EARLIEST < best.later < _LATEST:
        return columns
    return {**columns, column: np.full(len(time), best.later)}


def delay_slip(mean: np.ndarray, columns: Columns) -> np.ndarray:
    """Return a simulated slip (n,), `mean` over a sample, with the lag of the recorded one in `columns`."""
    period = float(columns[_TIME][1] - columns[_TIME][0])
    for column in (SLIP_DELAY, SLIP_FILTER):
        if column in columns:
            return _follow(mean, float(columns[column][0]), period, column == SLIP_FILTER)
    return mean


def advance_slip(columns: Columns) -> np.ndarray:
    """Return the recorded slip (n,) as if it were the mean over a sample, to drive a model with."""
    for column in (SLIP_DELAY, SLIP_FILTER):
        if column in columns:
            return np.interp(columns[_TIME] + columns[column], columns[_TIME], columns[_SLIP])
    return columns[_SLIP]


def describe_slip_lag(columns: Columns) -> str:
    """Return a sentence on the slip of a complete run that is no mean over a sample; "" for one that is."""
    for column, what in ((SLIP_DELAY, "a delay"), (SLIP_FILTER, "a filter of first order")):
        if column in columns:
            later = 1e3 * float(columns[column][0])
            side = f"{later:.2f} ms behind" if later > 0.0 else f"{-later:.2f} ms before"
            return f"is {side} the mean speed of a sample, and is simulated like this, as {what}"
    return ""


def _is_instantaneous(columns: Columns, period: float) -> bool:
    """Return whether both torques show that the slip of a rig without an encoder is no mean over a sample.

    Only rows count whose speed demand rests: where it moves, a sampled motor torque is not its mean between the rows either.
    """
    if not {*_TORQUES, _DEMAND} <= set(columns):
        return False
    motor, clutch, demand = (np.asarray(columns[name], float) for name in (*_TORQUES, _DEMAND))
    if not all(len(one) == len(columns[_TIME]) and np.isfinite(one).all() for one in (motor, clutch, demand)):
        return False
    width = _SMOOTH / period
    cut = int(_CUT * width) + 1
    moves = np.diff(demand, append=demand[-1]) != 0.0
    rests = np.convolve(moves, np.ones(2 * cut + 1), "same") == 0.0
    rests[:cut] = rests[-cut:] = False
    if np.count_nonzero(rests) * period < _LEAST_REST:
        return False
    torque, slip = (gaussian_filter1d(one, width) for one in (motor - clutch, np.asarray(columns[_SLIP], float)))
    rise = np.gradient(slip, period)[rests]
    left = []
    for later in (0.5 * period, 0.0):  # of a mean over a sample, and of the value at its end
        terms = np.column_stack([_follow(torque, later, period, False)[rests], np.ones(len(rise))])
        left.append(float(np.mean((rise - terms @ np.linalg.lstsq(terms, rise)[0]) ** 2)))
    return left[1] < _CLEARLY * left[0]


def _follow(speed: np.ndarray, later: float, period: float, filtered: bool) -> np.ndarray:
    """Return `speed` (n,) delayed by `later` [s], or `filtered` with this time constant [s]; from its first value on."""
    if not filtered:
        rows = np.arange(len(speed))
        return np.interp(rows - later / period, rows, speed)
    new = period / (period + 2.0 * later)  # bilinear transform of 1/(1 + later s)
    return speed[0] + lfilter([new, new], [1.0, new * (1.0 - 2.0 * later / period)], speed - speed[0])


def _fit(speed: np.ndarray, slip: np.ndarray, period: float, filtered: bool) -> _Fit:
    """Fit the lag of `slip` (n,) behind `speed` (n,), the mean over each sample."""
    width, mean = _SMOOTH / period, float(speed.mean())
    cut = int(_CUT * width) + 1
    inside = slice(cut, -cut)
    smooth, shown = (gaussian_filter1d(values - mean, width) for values in (speed, slip))
    later = 0.0 if not filtered else period
    for _ in range(_ROUNDS):
        simulated = _follow(smooth, later, period, filtered)
        terms = np.column_stack([np.gradient(simulated, period)[inside], np.ones(len(speed) - 2 * cut)])
        power = float(np.var(terms[:, 0]))
        if not power > 0.0:
            return _Fit(0.0, np.inf, np.inf)
        behind = (simulated - shown)[inside]
        (beyond, zero), *_ = np.linalg.lstsq(terms, behind)
        later = float(np.clip(later + beyond, 2.0 * _EARLIEST, 2.0 * _LATEST))
        if filtered and later <= 0.0:
            return _Fit(0.0, np.inf, np.inf)
    rest = behind - terms @ [beyond, zero]
    left = float(np.mean(rest**2))
    return _Fit(later, float(np.sqrt(left / power * _WIDTH_OF_ONE * width / len(rest))), left)
