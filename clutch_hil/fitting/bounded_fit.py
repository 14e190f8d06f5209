"""Bounded fit: parameters by simulation error within bounds, without prior, by SciPy's trust-region reflective least squares.

Equation        minimise |r(x)|^2, low <= x <= high; r: whitened residuals (evidence.py), J by finite differences
Assumptions     the start is in the valley of the minimum: `clutch_hil/identify` finds it step by step
References      Branch, Coleman and Li 1999, SIAM J. Sci. Comput. 21 (the method of scipy.optimize.least_squares)
"""

from collections.abc import Callable, Sequence

import numpy as np
from scipy.optimize import least_squares

from clutch_hil.fitting.evidence import Evidence, Point
from clutch_hil.fitting.fit import FreeParameter, LinearModel, linearise

_IMPOSSIBLE = 1e3  # residual, in floors, of a run that cannot be simulated at a point: the step is refused
_INSIDE = 1e-6  # of the width between bounds: SciPy wants a start strictly within them
_TOLERANCE = 1e-8  # of the cost: of 1e5 residuals, a thousandth of what is within an interval


def fit_within_bounds(
    evidence: Evidence,
    start: Point,
    free: Sequence[FreeParameter],
    most_steps: int = 30,
    progress: Callable[[float], None] = lambda share: None,
) -> LinearModel:
    """Fit the parameters `free` from `start`, and linearise the model there.

    most_steps: linearisations at most. progress: called with the share of them that is done.
    """
    free = list(free)
    scales = np.array([f.scale for f in free])
    widths = np.array([f.high - f.low for f in free])
    low = np.array([f.low for f in free]) / scales
    high = np.array([f.high for f in free]) / scales
    begin = np.array([value_at(start, f.name) for f in free]) / scales
    begin = np.clip(begin, low + _INSIDE * widths / scales, high - _INSIDE * widths / scales)
    steps = 0

    def residual(x: np.ndarray) -> np.ndarray:
        return np.nan_to_num(evidence.residuals([move_point(start, free, x * scales)])[0], nan=_IMPOSSIBLE)

    def jacobian(x: np.ndarray) -> np.ndarray:
        nonlocal steps
        steps += 1
        progress(min(steps / most_steps, 1.0))
        return linearise(evidence, move_point(start, free, x * scales), free).jacobian

    solved = least_squares(
        residual, begin, jacobian, (low, high), method="trf", ftol=_TOLERANCE, xtol=_TOLERANCE, gtol=None, x_scale="jac",
        max_nfev=most_steps,
    )  # fmt: skip
    return linearise(evidence, move_point(start, free, solved.x * scales), free)


def value_at(point: Point, name: str) -> float:
    """Value of a parameter at a point, of the baseline or of an effect."""
    return float(point[0][name] if name in point[0] else point[1][name])


def move_point(point: Point, free: Sequence[FreeParameter], values: np.ndarray) -> Point:
    """The point with the parameters `free` at `values` (p,), within bounds."""
    parameters, effects = dict(point[0]), dict(point[1])
    for f, value in zip(free, values, strict=True):
        (parameters if f.name in parameters else effects)[f.name] = float(np.clip(value, f.low, f.high))
    return parameters, effects
