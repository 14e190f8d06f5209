"""ColumnFormula: a column that is not in a file, computed from others of the same run.

    slip_speed_rad_s         = { formula = "input_speed_rad_s - 2.5 * output_speed_rad_s" }
    motor_speed_demand_rad_s = { formula = "low_pass(slip_speed_rad_s, 50)" }

Equation        low_pass(x, f): Butterworth of order 4 at f [Hz], forwards and backwards (rasters.py)
                derivative(x): (x(k+1) - x(k-1))/(2 T), at an end (x(1) - x(0))/T
                integral(x): trapezoidal rule, from 0; running_sum(x): x(0) T + .. + x(k) T, the integral of means over a sample
                shift(x, s): x(t - s), delayed by s [s], with linear interpolation; the end values are held
"""

from collections.abc import Callable, Mapping
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from clutch_hil.recordings.rasters import filter_low_pass
from protocols.errors import InputError, suggest_closest
from protocols.files.formula import Formula

# Functions of whole columns -> number of arguments
_OF_ROWS = {"low_pass": 2, "derivative": 1, "integral": 1, "running_sum": 1, "shift": 2}


class ColumnFormula:
    """The formula `text` of the run's column `name`, over other columns in their units. Raises InputError."""

    def __init__(self, name: str, text: str) -> None:
        self._name, self.text = name, text
        try:
            self._formula = Formula(text, _OF_ROWS)
        except ValueError as error:
            raise InputError(f"{name}: {error}") from None
        if not self._formula.names:
            raise InputError(f"the formula {text!r} of {name} uses no column; use `constant` for one value")

    def check_names(self, above: set[str], below: set[str]) -> None:
        """Raise InputError for a name that is neither a column of the file nor of a formula `above`. below: of this and later
        formulas."""
        for name in self._formula.names:
            if name in below:
                raise InputError(
                    f"{self._name}: its formula needs {name}, which is also computed; put the line of {name} above it"
                )
            if name not in above:
                raise InputError(
                    f"{self._name}: its formula needs {name!r}, which is not a column of the map;"
                    f" {suggest_closest(name, above)}"
                )

    def compute(self, file: Path, columns: Mapping[str, np.ndarray]) -> np.ndarray:
        """Compute the values (n,) from `columns` (n,) with one sample period; some may be NaN or infinite. Raises
        InputError."""
        time = columns["time_s"]
        if len(time) < 2:
            raise InputError(f"recording {file}: {self._name} is computed over {len(time)} row; 2 or more are needed")
        period = float(time[-1] - time[0]) / (len(time) - 1)
        functions: dict[str, Callable[..., Any]] = {
            "low_pass": partial(self._low_pass, file, 1.0 / period),
            "derivative": lambda values: np.gradient(self._take_column(file, "derivative", values), period),
            "integral": lambda values: _integrate(self._take_column(file, "integral", values), period),
            "running_sum": lambda values: period * np.cumsum(self._take_column(file, "running_sum", values)),
            "shift": partial(self._shift, file, time),
        }
        return np.asarray(self._formula.compute(columns, functions), float)

    def check_values(self, file: Path, values: np.ndarray) -> None:
        """Raise InputError if one of the values (n,) is not a finite number."""
        if len(bad := np.flatnonzero(~np.isfinite(values))):
            raise InputError(
                f"recording {file}: {self._name} = {self.text} is {values[bad[0]]:g} in row {bad[0]}, one of {len(bad)} such"
                " rows; allowed are numbers"
            )

    def _shift(self, file: Path, time: np.ndarray, values: Any, by: Any) -> np.ndarray:
        if np.ndim(by) or not abs(by) < time[-1] - time[0]:
            given = "a column" if np.ndim(by) else f"{by:g} s"
            raise InputError(
                f"{self._name}: shift is by {given}; allowed is less than the run's {time[-1] - time[0]:g} s"
            )
        return np.interp(time - by, time, self._take_column(file, "shift", values))

    def _low_pass(self, file: Path, rate: float, values: Any, limit: Any) -> np.ndarray:
        if np.ndim(limit) or not limit > 0.0:
            given = "a column" if np.ndim(limit) else f"{limit:g}"
            raise InputError(f"{self._name}: the limit of low_pass is {given}; allowed is a number of Hz above 0")
        column = self._take_column(file, "low_pass", values)
        return filter_low_pass(file, self._name, column, float(limit), rate, f"low_pass of {self._name}")

    def _take_column(self, file: Path, function: str, values: Any) -> np.ndarray:
        """Return the argument of a column function as an array. Raises InputError for a single number and for non-finite
        values."""
        if not np.ndim(values):
            raise InputError(f"{self._name}: {function} has as its argument the number {values:g}; a column is needed")
        if len(bad := np.flatnonzero(~np.isfinite(values))):
            raise InputError(
                f"recording {file}: {function} in the formula of {self._name} is applied to a value that is not a"
                f" number in row {bad[0]}, one of {len(bad)} such rows"
            )
        return np.asarray(values, float)


def _integrate(values: np.ndarray, period: float) -> np.ndarray:
    """Return the integral (n,) of `values` (n,) over time by the trapezoidal rule, from 0."""
    from scipy.integrate import cumulative_trapezoid  # loading takes 0.3 s of CPU; few formulas need it

    return np.asarray(cumulative_trapezoid(values, dx=period, initial=0.0))
