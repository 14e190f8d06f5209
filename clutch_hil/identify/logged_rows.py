"""How the rows of a run were taken: every cycle of the loop, or now and then of a faster one, as a logger does.

Every cycle     commands stay from row to row, and the slip is the mean over the last sample, from the encoder's angle
                (docs/rig.md, 9)
Of a logger     commands move in straight lines from row to row, and the slip is that of the row, or some ms before it
Equation        slip(k) = (theta(k+1) - theta(k-1))/(2 T) - lag a(k),  a = (theta(k+1) - 2 theta(k) + theta(k-1))/T^2:
                the mean over a sample has a lag of T/2, whatever the noise; lag by least squares
                a slip from the counts of an encoder has steps of q/T_l,  q: steps of the angle, T_l: sample of the loop. It
                tells T_l, and has a lag of T_l/2; least squares give more, as the same counts are in a(k)
Assumptions     the loop of a logger's run is faster than its rows; a step of a command is off by T/2 at most, and so is what
                follows from it, for as long as it lasts
"""

from math import ceil, log10, sqrt

import numpy as np

from clutch_hil.fitting.model import Columns
from clutch_hil.fitting.noise import find_lattice

_SLIP, _ANGLE = "slip_speed_rad_s", "shaft_angle_rad"
RECORDED_SLIP = "recorded_slip_speed_rad_s"  # of a run whose slip was replaced by the derivative of the angle
_LOOP = 1e-3  # s: rows nearer to each other are taken as every cycle; commands move by lines, in steps of this
_MOST_PARTS = 10  # of a sample: of slower rows commands move by lines over longer steps, and memory stays bounded
_NEARER = 0.375  # of a sample: a slip with less lag is no mean over a sample; every second mean of a loop has a quarter
_WHOLE = 0.01  # of a step that slips of counts are off 0, and of a sample that it is no multiple of the loop's
_ENOUGH = 20_000  # rows that tell an encoder's steps: each simulation asks, and they are sorted in 2 ms
_DIGIT = 1e-3  # to which the logarithm of a step is whole where it is one of the last digit
_SURE = 0.05  # of a sample, standard deviation of the lag: with more the run does not tell


class LoggedRows:
    """The rows of a run that a logger took. period [s]: of its rows; lag [s]: of its slip."""

    def __init__(self, columns: Columns, period: float, lag: float) -> None:
        self._rows, self._lag = len(columns["time_s"]), lag
        self._parts = min(ceil(period / _LOOP - 1e-9), _MOST_PARTS)
        self.period = period / self._parts  # s, of the finer rows
        self._fine = np.arange((self._rows - 1) * self._parts + 1) / self._parts
        self._at = np.arange(self._rows, dtype=float)

    def refine(self, values: np.ndarray) -> np.ndarray:
        """Values between the rows (n,), on straight lines, (m,)."""
        return np.interp(self._fine, self._at, values)

    def take(self, shown: np.ndarray) -> np.ndarray:
        """The rows of what was simulated (m, k), as (n, k)."""
        return shown[:: self._parts]

    def take_slip(self, slip: np.ndarray, lag: float = 0.0) -> np.ndarray:
        """Slip (n,) at the rows, by its lag, of a slip (m,) that is late itself by `lag` [s]."""
        behind = (self._lag - lag) / (self.period * self._parts)
        return np.interp(self._at - behind, self._fine, slip)


def find_logged_rows(columns: Columns, period: float) -> LoggedRows | None:
    """The rows of a run that a logger took; None where they are every cycle, or the run does not tell."""
    if period < 1.5 * _LOOP or not {_SLIP, _ANGLE} <= set(columns):
        return None
    slip, angle = columns.get(RECORDED_SLIP, columns[_SLIP]), columns[_ANGLE]
    loop = _find_loop(slip, angle, period)
    lag = _find_slip_lag(slip, angle, period) if loop is None else 0.5 * loop
    return LoggedRows(columns, period, max(lag, 0.0)) if lag is not None and lag < _NEARER * period else None


def estimate_timing(columns: Columns) -> float:
    """To which times of events between the rows are known [s]; 0 where rows are every cycle."""
    period = float(columns["time_s"][1] - columns["time_s"][0])
    return 0.5 * period if find_logged_rows(columns, period) else 0.0


def _find_loop(slip: np.ndarray, angle: np.ndarray, period: float) -> float | None:
    """Sample of the loop [s] by the steps of its encoder; None where slip and angle have none, or are not of one encoder."""
    (count, _), (step, first) = find_lattice(np.diff(angle[:_ENOUGH])), find_lattice(slip[:_ENOUGH])
    if not (count > 0.0 and step > 0.0 and abs(first) < _WHOLE) or _is_decimal(count) or _is_decimal(step):
        return None
    parts = period * step / count
    return period / round(parts) if abs(parts - max(round(parts), 1)) < _WHOLE * parts else None


def _is_decimal(step: float) -> bool:
    """Whether steps are those of the digits of a text."""
    return abs(log10(step) - round(log10(step))) < _DIGIT


def _find_slip_lag(slip: np.ndarray, angle: np.ndarray, period: float) -> float | None:
    """Lag [s] of a slip behind the angle; None where the run does not tell."""
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
