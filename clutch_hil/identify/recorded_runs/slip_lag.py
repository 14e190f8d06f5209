"""Lag of a recorded slip behind the shaft's angle, as of a tachometer, a filter or a bus.

Equation        s = f(v - zero):  v speed from the angle, the mean over a sample of T; s recorded slip; both smoothed
                  f = exp(-d p)/(1 + a p + b p^2), p = d/dt: a delay d alone, or a filter of first order, a alone, as leaves the
                  smaller residual; all three if they leave clearly less: a filter of second order, or one behind a bus
                  d or a, and zero, by least squares, d s/d later = -ds/dt, from 0 on (Gauss-Newton); d, a, b from there on
                without an encoder: the mean over a sample, or the value at its end (d = -T/2), as agrees better with
                  ds/dt = (M_m - M)/J at a constant speed demand, by least squares in 1/J and a zero    docs/rig.md, 8
                a simulated slip, a mean over T (docs/rig.md, 9), gets the same f. The recorded one stays: between its rows its
                  noise would not be white
Assumptions     the encoder is right, and the lag is the same in the whole run
Not modelled    rows of a logger, 1.5 ms and more apart (logged_rows.py); filters of third and higher order
"""

from typing import NamedTuple

import numpy as np
from scipy.ndimage import gaussian_filter1d
from scipy.optimize import least_squares
from scipy.signal import bilinear, lfilter

from clutch_hil.fitting.model import Columns
from clutch_hil.identify.recorded_runs.logged_rows import LOOP
from clutch_hil.identify.recorded_runs.shaft_angle import is_integrated

# Columns (n,) of a complete run whose slip is no mean over a sample: d and a [s], b [s^2]
SLIP_LAG = ("slip_delay_s", "slip_filter_s", "slip_filter_s2")
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
# Ratio of mean squares: noise alone makes the third and fourth parameter of 12 s gain 0.3 %
_SECOND_ORDER = 0.9
# Damping of a filter of second order: Butterworth 0.71, two equal RC stages 1; at 2 it is nearly of first order
_DAMPING = 0.3, 2.0
_SAME = 1e-7  # rad, tolerance: the slip of the bench is the difference of two angles, which takes no fit to see


class _Lag(NamedTuple):
    """Coefficients of f: `delay` and `first` [s], `second` [s^2]."""

    delay: float
    first: float = 0.0
    second: float = 0.0

    @property
    def later(self) -> float:
        """Time [s] by which a slow signal is behind."""
        return self.delay + self.first


class _Fit(NamedTuple):
    """A lag, its standard deviation [s], and the mean square that it leaves [rad^2/s^2]."""

    lag: _Lag
    unsure: float
    left: float


def add_slip_lag(columns: Columns) -> Columns:
    """Return a run with the columns SLIP_LAG if its slip is no mean over a sample, and the angle shows it."""
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
        lag = _Lag(-0.5 * period) if _is_instantaneous(columns, period) else None
    else:
        lag = _find_lag(turned / period, slip[1:], period)
    if lag is None:
        return columns
    return {**columns, **{name: np.full(len(time), value) for name, value in zip(SLIP_LAG, lag, strict=True)}}


def delay_slip(mean: np.ndarray, columns: Columns) -> np.ndarray:
    """Return a simulated slip (n,), `mean` over a sample, with the lag of the recorded one in `columns`."""
    lag = _read_lag(columns)
    return _follow(mean, lag, float(columns[_TIME][1] - columns[_TIME][0])) if lag else mean


def advance_slip(columns: Columns) -> np.ndarray:
    """Return the recorded slip (n,) as if it were the mean over a sample, to drive a model with."""
    lag = _read_lag(columns)
    return np.interp(columns[_TIME] + lag.later, columns[_TIME], columns[_SLIP]) if lag else columns[_SLIP]


def describe_slip_lag(columns: Columns) -> str:
    """Return a sentence on the slip of a complete run that is no mean over a sample; "" for one that is."""
    lag = _read_lag(columns)
    if lag is None:
        return ""
    what = "a filter of first order" if lag.first else "a delay"
    if lag.second:
        corner = 0.5 / np.pi / np.sqrt(lag.second)
        what = f"a filter of second order with {corner:.3g} Hz and a delay of {1e3 * lag.delay:.2f} ms"
    side = f"{1e3 * lag.later:.2f} ms behind" if lag.later > 0.0 else f"{-1e3 * lag.later:.2f} ms before"
    return f"is {side} the mean speed of a sample, and is simulated like this, as {what}"


def _read_lag(columns: Columns) -> _Lag | None:
    return _Lag(*(float(columns[name][0]) for name in SLIP_LAG)) if SLIP_LAG[0] in columns else None


def _find_lag(speed: np.ndarray, slip: np.ndarray, period: float) -> _Lag | None:
    """Return the lag of `slip` (n,) behind `speed` (n,), the mean over each sample; None if there is none, or one too large."""
    simple = min((_fit(speed, slip, period, filtered) for filtered in (False, True)), key=lambda fit: fit.left)
    later = simple.lag.later
    if not abs(later) > _SURE * simple.unsure + _LEAST * period or not _EARLIEST < later < _LATEST:
        return None
    best = _fit_second_order(speed, slip, period, simple.lag)
    return best.lag if best.left < _SECOND_ORDER * simple.left else simple.lag


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
        terms = np.column_stack([_follow(torque, _Lag(later), period)[rests], np.ones(len(rise))])
        left.append(float(np.mean((rise - terms @ np.linalg.lstsq(terms, rise)[0]) ** 2)))
    return left[1] < _CLEARLY * left[0]


def _follow(speed: np.ndarray, lag: _Lag, period: float) -> np.ndarray:
    """Return `speed` (n,) with a lag; from its first value on."""
    if lag.delay:
        rows = np.arange(len(speed))
        speed = np.interp(rows - lag.delay / period, rows, speed)
    if not lag.first:
        return speed
    polynomial = [lag.second, lag.first, 1.0] if lag.second else [lag.first, 1.0]
    return speed[0] + lfilter(*bilinear([1.0], polynomial, 1.0 / period), speed - speed[0])


def _smooth(values: np.ndarray, period: float) -> tuple[np.ndarray, slice]:
    """Return `values` (n,) smoothed, and the rows that its ends do not reach."""
    width = _SMOOTH / period
    cut = int(_CUT * width) + 1
    return gaussian_filter1d(values, width), slice(cut, -cut)


def _fit(speed: np.ndarray, slip: np.ndarray, period: float, filtered: bool) -> _Fit:
    """Fit a delay, or a filter of first order."""
    mean = float(speed.mean())
    smooth, inside = _smooth(speed - mean, period)
    shown, _ = _smooth(slip - mean, period)
    later = 0.0 if not filtered else period
    for _ in range(_ROUNDS):
        lag = _Lag(0.0, later) if filtered else _Lag(later)
        simulated = _follow(smooth, lag, period)
        rise = np.gradient(simulated, period)[inside]
        power = float(np.var(rise))
        if not power > 0.0:
            return _Fit(lag, np.inf, np.inf)
        terms = np.column_stack([rise, np.ones(len(rise))])
        behind = (simulated - shown)[inside]
        (beyond, zero), *_ = np.linalg.lstsq(terms, behind)
        later = float(np.clip(later + beyond, 2.0 * _EARLIEST, 2.0 * _LATEST))
        if filtered and later <= 0.0:
            return _Fit(lag, np.inf, np.inf)
    left = float(np.mean((behind - terms @ [beyond, zero]) ** 2))
    unsure = float(np.sqrt(left / power * _WIDTH_OF_ONE * _SMOOTH / period / len(rise)))
    return _Fit(_Lag(0.0, later) if filtered else _Lag(later), unsure, left)


def _fit_second_order(speed: np.ndarray, slip: np.ndarray, period: float, near: _Lag) -> _Fit:
    """Fit a delay and a filter of second order, beginning at the lag `near`."""
    mean = float(speed.mean())
    smooth, inside = _smooth(speed - mean, period)
    shown, _ = _smooth(slip - mean, period)

    def make_lag(x: np.ndarray) -> _Lag:
        delay, time, damping = x[0] * period, x[1] * period, x[2]
        return _Lag(delay, 2.0 * damping * time, time**2)

    def compute_residual(x: np.ndarray) -> np.ndarray:
        left = (_follow(smooth, make_lag(x), period) - shown)[inside]
        return left - left.mean()

    later = max(near.later, period) / period
    bounds = ([_EARLIEST / period, 0.1, _DAMPING[0]], [_LATEST / period, _LATEST / period, _DAMPING[1]])
    found = least_squares(compute_residual, [0.0, 0.5 * later, 1.0], bounds=bounds, x_scale=[1.0, 1.0, 0.3])
    return _Fit(make_lag(found.x), 0.0, float(np.mean(found.fun**2)))
