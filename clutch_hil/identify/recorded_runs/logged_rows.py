"""Sampling of a run's rows: every cycle of the loop, or at a lower rate by a logger.

Every cycle     commands are constant between rows, and the slip is the mean over the last sample, from the encoder's angle
                (docs/rig.md, 9)
Of a logger     commands are linear between rows, and the slip is that at the time of the row, or some ms earlier
Equation        slip(k) = (theta(k+1) - theta(k-1))/(2 T) - lag a(k),  a = (theta(k+1) - 2 theta(k) + theta(k-1))/T^2:
                the mean over a sample has a lag of T/2, whatever the noise; lag by least squares
                a slip from the counts of an encoder has steps of q/T_l,  q: step of the angle, T_l: sample of the loop. So T_l
                is known, and the lag is T_l/2; least squares give more, because the same counts are in a(k)
Assumptions     the loop of a logged run is faster than its rows; the time of a command's step, and of its consequences, is
                known to T/2
"""

from math import ceil, log10, sqrt

import numpy as np

from clutch_hil.fitting.model import Columns
from clutch_hil.fitting.noise import find_lattice

_SLIP, _ANGLE = "slip_speed_rad_s", "shaft_angle_rad"
# Column of the recorded slip in a run whose slip was replaced by the derivative of the angle
RECORDED_SLIP = "recorded_slip_speed_rad_s"
LOOP = 1e-3  # s: rows closer than 1.5 of this count as every cycle; longest step of the linear commands
_MOST_PARTS = 10  # most steps between two rows: for slower rows the steps are longer, so that memory stays bounded
# Share of a sample: with less lag a slip is no mean over a sample; every second mean of a loop has a quarter
_NEARER = 0.375
# Tolerance: offset of the slip's steps from 0, in steps; distance of a sample from a multiple of the loop's, as a share
_WHOLE = 0.01
_ENOUGH = 20_000  # rows from which encoder steps are found: done in each simulation; sorting them takes 2 ms
_DIGIT = 1e-3  # tolerance of a whole logarithm, by which a step of the last digit of a text is recognised
_SURE = 0.05  # share of a sample: with a larger standard deviation of the lag the run is not conclusive


class LoggedRows:
    """Rows of a run that a logger took. period [s]: time between rows. lag [s]: of the slip."""

    def __init__(self, columns: Columns, period: float, lag: float) -> None:
        self._rows, self._lag = len(columns["time_s"]), lag
        self._parts = min(ceil(period / LOOP - 1e-9), _MOST_PARTS)
        self.period = period / self._parts  # s, time between the interpolated rows
        self._fine = np.arange((self._rows - 1) * self._parts + 1) / self._parts
        self._at = np.arange(self._rows, dtype=float)

    def refine(self, values: np.ndarray) -> np.ndarray:
        """Interpolate values (n,) linearly between the rows, to (m,)."""
        return np.interp(self._fine, self._at, values)

    def take(self, shown: np.ndarray) -> np.ndarray:
        """Return the recorded rows (n, k) of a simulation (m, k)."""
        return shown[:: self._parts]

    def take_slip(self, slip: np.ndarray, lag: float = 0.0) -> np.ndarray:
        """Return the slip (n,) at the rows with the recorded lag, from a slip (m,) that already lags by `lag` [s]."""
        behind = (self._lag - lag) / (self.period * self._parts)
        return np.interp(self._at - behind, self._fine, slip)


def find_logged_rows(columns: Columns, period: float) -> LoggedRows | None:
    """Return the logger rows of a run; None where every cycle was recorded, or the run is not conclusive."""
    if period < 1.5 * LOOP or not {_SLIP, _ANGLE} <= set(columns):
        return None
    slip, angle = columns.get(RECORDED_SLIP, columns[_SLIP]), columns[_ANGLE]
    loop = _find_loop(slip, angle, period)
    lag = _find_slip_lag(slip, angle, period) if loop is None else 0.5 * loop
    return LoggedRows(columns, period, max(lag, 0.0)) if lag is not None and lag < _NEARER * period else None


def estimate_timing(columns: Columns) -> float:
    """Return the time uncertainty of events between the rows [s]; 0 where every cycle was recorded."""
    period = float(columns["time_s"][1] - columns["time_s"][0])
    return 0.5 * period if find_logged_rows(columns, period) else 0.0


def _find_loop(slip: np.ndarray, angle: np.ndarray, period: float) -> float | None:
    """Return the sample time of the loop [s] from the encoder steps; None without steps, or for steps of different encoders."""
    (count, _), (step, first) = find_lattice(np.diff(angle[:_ENOUGH])), find_lattice(slip[:_ENOUGH])
    if not (count > 0.0 and step > 0.0 and abs(first) < _WHOLE) or _is_decimal(count) or _is_decimal(step):
        return None
    parts = period * step / count
    return period / round(parts) if abs(parts - max(round(parts), 1)) < _WHOLE * parts else None


def _is_decimal(step: float) -> bool:
    """Return whether a step is a power of ten, as of values that were rounded in a text file."""
    return abs(log10(step) - round(log10(step))) < _DIGIT


def _find_slip_lag(slip: np.ndarray, angle: np.ndarray, period: float) -> float | None:
    """Return the lag [s] of the slip behind the angle; None where the run is not conclusive."""
    if len(slip) < 3:
        return None
    speed = (angle[2:] - angle[:-2]) / (2.0 * period)
    acceleration = (angle[2:] - 2.0 * angle[1:-1] + angle[:-2]) / period**2
    power = float(acceleration @ acceleration)
    if not power > 0.0:
        return None
    lag = float((speed - slip[1:-1]) @ acceleration) / power
    left = speed - slip[1:-1] - lag * acceleration
    unsure = sqrt(float(left @ left) / len(left) / power)
    return lag if unsure < _SURE * period else None
