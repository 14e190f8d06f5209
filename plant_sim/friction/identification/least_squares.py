"""Bounded least squares, with covariance, 95 % intervals, correlation and identifiability of the result.

What            parameters theta in their bounds with the smallest sum of squared residuals
Equation        covariance = s^2 (J^T J)^-1,  s^2 = sum r^2 / (n - m),  interval = theta -+ t_975(n - m) sigma
Assumptions     residuals independent, of one size, the model nearly linear over an interval. A residual that lasts over many
                samples (the model is not the plant) makes the intervals too narrow
Valid range     more samples than parameters
Not modelled    bounds in the intervals: a parameter at a bound is reported instead
References      scipy.optimize.least_squares (trust region reflective: Branch, Coleman, Li 1999); Seber and Wild 2003, ch. 5
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from scipy import optimize, stats

from plant_sim.friction.model import Array
from protocols.errors import InputError

CONFIDENCE = 0.95
DIFFERENCE_STEP = 1e-6  # of a parameter, for Jacobians: well above rounding, well below any curvature of these models
MOST_ITERATIONS = 200  # of the search; those that settle took 7 to 93 on smooth and on measured traces
JUMP_RATIO = 0.1  # of a slope: a larger difference of both sides is a jump or a kink; by curvature it is about 1e-6
SINGULAR = 1e-7  # of the largest singular value: smaller ones are rounding of the finite differences
LEAST_COMPONENT = 0.1  # of a unit direction: a parameter with less of it is not named
BOUND_DISTANCE = 1e-6  # of the width between the bounds
WIDE_INTERVAL = 1.0  # half an interval, of the value: the data do not say even the sign


@dataclass(frozen=True)
class Estimate:
    """Estimated parameters, in the order of `names`.

    `values` (m,); `intervals` (m, 2) at 95 %; `covariance`, `correlation` (m, m); `jacobian` of the residual (n, m); `rmse` in
    the unit of the data; `evaluations` of the model; `frozen` parameters and their values; `doubts`, one sentence for each
    parameter that the data do not determine.
    """

    names: tuple[str, ...]
    values: Array
    intervals: Array
    covariance: Array
    correlation: Array
    jacobian: Array
    rmse: float
    evaluations: int
    frozen: Mapping[str, float] = field(default_factory=dict)
    doubts: tuple[str, ...] = ()

    def __getitem__(self, name: str) -> float:
        """Return the value of a parameter, estimated or frozen."""
        return float(self.values[self.names.index(name)]) if name in self.names else self.frozen[name]

    def contains(self, truth: Mapping[str, float]) -> Array:
        """Return whether each interval holds the value in `truth`, bool (m,)."""
        true_values = np.array([truth[name] for name in self.names])
        return (self.intervals[:, 0] <= true_values) & (true_values <= self.intervals[:, 1])


def minimise(
    residual: Callable[[Array], Array],
    names: Sequence[str],
    starts: Array,
    bounds: Array,
    frozen: Mapping[str, float] | None = None,
    progress: Callable[[int, int], None] = lambda done, total: None,
) -> Estimate:
    """Return the best estimate from each of `starts` (k, m) within `bounds` (m, 2) for `residual`: (m,) -> (n,).

    `progress(done, total)` is called after each start. Raises InputError.
    """
    starts, bounds = np.atleast_2d(np.asarray(starts, float)), np.asarray(bounds, float)
    _check(names, starts, bounds)
    scale = np.where(starts[0] != 0.0, np.abs(starts[0]), np.abs(bounds[:, 1] - bounds[:, 0]))
    scale = np.where(np.isfinite(scale), scale, 1.0)
    count = 0

    def scale_residual(theta: Array) -> Array:
        nonlocal count
        count += 1
        return residual(theta * scale)

    limits = bounds / scale[:, None]
    best = None
    for i, start in enumerate(starts):
        minimum = _search(scale_residual, start / scale, limits)
        best = minimum if best is None or minimum.cost < best.cost else best
        progress(i + 1, len(starts))
    assert best is not None
    values = np.clip(best.theta * scale, bounds[:, 0], bounds[:, 1])
    rows = compute_jacobian(scale_residual, values / scale, limits) / scale
    estimate = _estimate(tuple(names), values, bounds, rows, scale_residual(values / scale), count, dict(frozen or {}))
    if best.settled:
        return estimate
    return replace(estimate, doubts=(f"the search has not settled after {MOST_ITERATIONS} rounds", *estimate.doubts))


@dataclass(frozen=True)
class _Minimum:
    theta: Array
    cost: float
    settled: bool


def _search(residual: Callable[[Array], Array], start: Array, bounds: Array) -> _Minimum:
    """Return the minimum from `start`.

    A parameter without influence at the current point is left out, because it slows the search, and joins once it has some.
    """
    theta, joined = start.copy(), np.zeros(start.size, bool)
    minimum = _Minimum(start, np.inf, True)
    while True:
        alive = joined | (np.linalg.norm(compute_jacobian(residual, theta, bounds), axis=0) > 0.0)
        if (alive == joined).all():
            return minimum
        joined = alive

        def select_part(free: Array, fixed: Array = theta, alive: Array = alive) -> Array:
            whole = fixed.copy()
            whole[alive] = free
            return residual(whole)

        result = optimize.least_squares(
            select_part,
            theta[alive],
            bounds=bounds[alive].T,
            x_scale="jac",
            diff_step=DIFFERENCE_STEP,
            max_nfev=MOST_ITERATIONS,
        )
        theta = theta.copy()
        theta[alive] = result.x
        minimum = _Minimum(theta, result.cost, result.status > 0)
        if alive.all():
            return minimum


def compute_jacobian(residual: Callable[[Array], Array], values: Array, bounds: Array) -> Array:
    """Return the derivative of `residual` at `values` (m,) inside `bounds` (m, 2): (n, m), by central differences.

    The output of a sampled model jumps where an event moves by a sample, and a search often ends at such a jump. A difference
    across a jump is no slope and would make the intervals far too narrow. So the side without the jump is taken there.
    """
    here, columns = residual(values), []
    for j, value in enumerate(values):
        width = bounds[j, 1] - bounds[j, 0]
        size = min(DIFFERENCE_STEP * max(abs(value), 0.01 * min(1.0, width)), 0.5 * width)  # also for a value near 0
        sides = []
        for step in (size, -size):
            beside = values.copy()
            beside[j] += step
            if bounds[j, 0] <= beside[j] <= bounds[j, 1]:
                sides.append((residual(beside) - here) / (beside[j] - value))
        smallest, largest = min(sides, key=np.linalg.norm), max(sides, key=np.linalg.norm)
        jumps = np.linalg.norm(largest - smallest) > JUMP_RATIO * np.linalg.norm(largest)
        columns.append(smallest if jumps else np.mean(sides, axis=0))
    return np.stack(columns, axis=1)


def _estimate(
    names: tuple[str, ...],
    values: Array,
    bounds: Array,
    rows: Array,
    residual: Array,
    count: int,
    frozen: dict[str, float],
) -> Estimate:
    freedom = residual.size - values.size
    variance = float(residual @ residual) / freedom
    size = np.linalg.norm(rows, axis=0)
    unit = rows / np.where(size > 0.0, size, 1.0)
    _, singular, directions = np.linalg.svd(unit, full_matrices=False)
    dead = singular <= SINGULAR * singular[0]
    inverse = np.where(dead, 0.0, 1.0 / np.where(dead, 1.0, singular))
    covariance = (
        variance * (directions.T * inverse**2) @ directions / np.outer(*(2 * [np.where(size > 0.0, size, 1.0)]))
    )
    lost = (np.abs(directions[dead]) > LEAST_COMPONENT).any(axis=0) | (size == 0.0)
    covariance[lost, lost] = np.inf
    sigma = np.sqrt(np.diag(covariance))
    half = stats.t.ppf(0.5 + CONFIDENCE / 2.0, freedom) * sigma
    with np.errstate(divide="ignore", invalid="ignore"):
        correlation = np.where(np.eye(values.size) > 0.0, 1.0, covariance / np.outer(sigma, sigma))
    return Estimate(
        names,
        values,
        np.stack([values - half, values + half], axis=1),
        covariance,
        correlation,
        rows,
        float(np.sqrt(np.mean(residual**2))),
        count,
        frozen,
        _list_doubts(names, values, bounds, half, size, directions[dead]),
    )


def _list_doubts(
    names: tuple[str, ...], values: Array, bounds: Array, half: Array, size: Array, lost: Array
) -> tuple[str, ...]:
    """Return one sentence for each parameter, or each group of them, that the data do not determine."""
    doubts = [f"{names[j]} is not identifiable: it has no influence on these data" for j in np.flatnonzero(size == 0.0)]
    for direction in lost:
        group = [names[j] for j in np.flatnonzero(np.abs(direction) > LEAST_COMPONENT) if size[j] > 0.0]
        if len(group) > 1:
            doubts.append(
                f"{' and '.join(group)} are not identifiable separately: these data determine only a combination of them"
            )
    for j, name in enumerate(names):
        width = bounds[j, 1] - bounds[j, 0]
        gap = min(values[j] - bounds[j, 0], bounds[j, 1] - values[j])
        if gap <= BOUND_DISTANCE * (width if np.isfinite(width) else abs(values[j])):
            doubts.append(f"{name} rests at its bound {values[j]:g}; its interval is not valid")
        elif np.isfinite(half[j]) and half[j] > WIDE_INTERVAL * abs(values[j]):
            doubts.append(f"{name} is poorly identifiable: its interval is {values[j]:g} -+ {half[j]:.2g}")
    return tuple(doubts)


def _check(names: Sequence[str], starts: Array, bounds: Array) -> None:
    if not names:
        raise InputError("there is no parameter to fit; one or more are needed")
    if starts.shape[1] != len(names) or bounds.shape != (len(names), 2):
        raise InputError(f"start and bounds are {starts.shape[1:]} and {bounds.shape} for {len(names)} parameters")
    for j, name in enumerate(names):
        low, high = bounds[j]
        if not low < high:
            raise InputError(f"bounds of {name} are {low:g} and {high:g}; the first must be the smaller")
        for start in starts[:, j]:
            if not low <= start <= high or not np.isfinite(start):
                raise InputError(f"start of {name} is {start:g}; allowed is {low:g} to {high:g}")
