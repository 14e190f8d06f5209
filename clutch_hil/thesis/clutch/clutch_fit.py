"""Fits to the clutch experiments, with 95 % intervals, and their comparison with the plant and with the thesis."""

from collections.abc import Callable
from typing import Any

import numpy as np
from scipy.optimize import curve_fit
from scipy.stats import t as student

from clutch_hil.thesis.check_sheet import Sheet

# of the value of the thesis; chosen: the plant's return springs take 1.5 % of the pressure rise, those of the thesis none
TOLERANCE = 0.03

Fit = tuple[np.ndarray, np.ndarray]  # values, half widths of their 95 % intervals


def straight_line(x: np.ndarray, slope: float, intercept: float) -> np.ndarray:
    """The straight line slope x + intercept."""
    return slope * x + intercept


def fit(function: Callable[..., Any], x: Any, y: np.ndarray, start: Any, deviation: np.ndarray | None = None) -> Fit:
    """Fit `function` by least squares; `deviation`: standard deviations (n,) or covariance (n, n) of y if they are known."""
    values, spread = curve_fit(function, x, y, start, sigma=deviation, absolute_sigma=deviation is not None)
    freedom = np.inf if deviation is not None else y.size - values.size
    return values, compute_interval_factor(freedom) * np.sqrt(np.diag(spread))


def compute_interval_factor(freedom: float) -> float:
    """Half width of a 95 % interval in standard deviations, for `freedom` degrees of freedom (Student's t)."""
    return float(student.ppf(0.975, freedom))


def make_row(sheet: Sheet, name: str, value: float, half: float, plant: float, thesis: float) -> None:
    """Add a row to the table of the sheet, and make the checks of `check_estimate`."""
    if not sheet.table:
        sheet.table.append(("parameter", "identified", "95 %", "plant", "thesis"))
    sheet.table.append((name, f"{value:.5g}", f"+- {half:.2g}", f"{plant:.5g}", f"{thesis:.5g}"))
    check_estimate(sheet, name, value, half, plant, thesis)


def check_estimate(sheet: Sheet, name: str, value: float, half: float, plant: float, thesis: float) -> None:
    """Check that the interval `value` +- `half` contains the value of the plant, and that `value` is near the thesis's."""
    sheet.check(f"the 95 % interval of {name} contains the plant's {plant:.5g}", abs(value - plant) <= half,
                f"{value:.5g} +- {half:.2g}")  # fmt: skip
    sheet.check(
        f"{name} within {TOLERANCE:.0%} of the thesis's", abs(value - thesis) <= TOLERANCE * abs(thesis), value, thesis
    )
