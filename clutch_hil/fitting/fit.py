"""Fit: parameters by simulation error, damped Gauss-Newton, with the uncertainty of the baseline as prior.

Equation        minimise |r(x)|^2 + n chi^2,  chi^2 = sum over the p parameters of the baseline of ((x - x_0)/s)^2
                s: a third of the allowed change of x.  n: `Evidence.redundancy`
                chi^2 <= its 99.9 % quantile for p degrees of freedom: each parameter may be off by its stated uncertainty, but
                  not all of them at once
                linear near a point: r(x + S d) = r + J d,  d = -(J'J + L)^-1 (J'r + L a)
                  S: unit of moves, L: n where there is a prior, a = (x - x_0)/S
Assumptions     white noise of unit variance, and errors of the laws (evidence.py)
References      Ljung 1999, System identification, ch. 10; Stark and Parker 1995, Comput. Stat. 10 (bounded least squares);
                Kennedy and O'Hagan 2001, J. R. Statist. Soc. B 63 (a discrepancy is judged together with the uncertainty of
                the model's own parameters)
"""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from scipy.linalg import cho_factor, cho_solve, cholesky, solve_triangular
from scipy.optimize import lsq_linear
from scipy.stats import chi2

from clutch_hil.fitting.evidence import Evidence, Point
from clutch_hil.fitting.model import Candidate, Values
from plant_sim.effects.effect import Strength
from protocols.files.parameters import ParameterSet

PRIOR_DEVIATION = 1.0 / 3.0  # standard deviation of a baseline parameter over its allowed change: 3 sigma
CHI2_QUANTILE = 0.999  # share of rigs whose chi^2 is below the limit
_STEP = 0.2  # step of the baseline's finite differences, in stated uncertainties
# Step of an effect's parameter, relative to it or to a fifth of its typical size, if that is larger
_EFFECT_STEP = 0.05
_PHASE_STEP = 0.05  # rad
# Largest share of an effect's contribution by which the finite difference of a shape may change the residuals
_LINEAR_SHARE = 0.3
_MOST_SHORTENINGS = 3  # how often a step is shortened for this
_MOST_STEPS = 4  # Gauss-Newton steps with the same sensitivities
_CONVERGED = 1e-4  # share of the number of residuals: a smaller gain ends the iteration
_LEAST_GAIN = 2e-3  # share of the cost: after a smaller gain the sensitivities are not updated
_STEP_SHARES = (1.0, 0.4, 0.1)  # shares of a Gauss-Newton step that are tried
_TRUSTED_SHARE = 0.1  # share of the predicted gain: after a smaller gain the sensitivities are no longer used
_MOST_PRIOR_WEIGHT = 1e8  # largest factor on the prior, to keep chi^2 within its limit
_NEAR_LIMIT = 0.9  # share of the limit above which chi^2 is close enough to it
_EFFECT_PRIOR = 1e-9  # prior weight of an effect's parameter: practically 0, but the matrix stays regular


@dataclass(frozen=True)
class FreeParameter:
    """A parameter that is fitted.

    step: of its finite difference. scale: unit of its moves. low, high: bounds. centre: its prior mean, None without a prior.
    off: value of an effect's strength while the effect is off, None for any other parameter.
    """

    name: str
    step: float
    scale: float
    low: float
    high: float
    centre: float | None = None
    off: float | None = None


def free_baseline(declared: ParameterSet, calibration: float) -> list[FreeParameter]:
    """Return the uncertain parameters of a baseline, free within `calibration` times their stated uncertainty."""
    return [
        FreeParameter(
            n, _STEP * p.uncertainty, PRIOR_DEVIATION * calibration * p.uncertainty,
            max(p.bounds[0], p.value - calibration * p.uncertainty),
            min(p.bounds[1], p.value + calibration * p.uncertainty), p.value,
        )
        for n, p in declared.items()
        if p.uncertainty > 0.0
    ]  # fmt: skip


def free_effect(candidate: Candidate, values: Values, shapes: bool = True) -> list[FreeParameter]:
    """Return the strengths of a candidate as free parameters, also those that are off, and with `shapes` its shape
    parameters."""
    parameters = []
    for p in candidate.parameters:
        if isinstance(p, Strength) or shapes:
            name = f"{candidate.name}.{p.name}"
            size = abs(values[name] - p.off) if isinstance(p, Strength) else abs(values[name])
            step = _EFFECT_STEP * max(size, 0.2 * abs((p.typical - p.off) or p.typical or 1.0))
            if p.unit == "rad" and not isinstance(p, Strength):
                step = _PHASE_STEP
            parameters.append(
                FreeParameter(name, step, step, *p.bounds, off=p.off if isinstance(p, Strength) else None)
            )
    return parameters


@dataclass(frozen=True)
class LinearModel:
    """A model linearised at `point` in the parameters `free`: residual r (size,), jacobian J (size, p) per `scale` of each.

    redundancy: number of neighbouring residuals that have the information of one (evidence.py).
    """

    point: Point
    free: tuple[FreeParameter, ...]
    residual: np.ndarray
    jacobian: np.ndarray
    redundancy: float

    @cached_property
    def offset(self) -> np.ndarray:
        """a: distance (p,) from the prior mean in scales; 0 without a prior."""
        known = [(self.find_value(f) - f.centre) / f.scale if f.centre is not None else 0.0 for f in self.free]
        return np.array(known)

    @cached_property
    def prior(self) -> np.ndarray:
        """Diagonal of L, (p,)."""
        return np.array([_EFFECT_PRIOR if f.centre is None else self.redundancy for f in self.free])

    @cached_property
    def gram(self) -> np.ndarray:
        """J'J (p, p)."""
        return self.jacobian.T @ self.jacobian

    @property
    def prior_chi2(self) -> float:
        """chi^2 of the baseline parameters at `point`."""
        return self._compute_prior_chi2(np.zeros(len(self.free)))

    @property
    def cost(self) -> float:
        """Minimised cost at `point`; infinite where the model cannot be simulated."""
        cost = float(self.residual @ self.residual + self.prior @ self.offset**2)
        return cost if np.isfinite(cost) else np.inf

    def find_value(self, free: FreeParameter) -> float:
        """Return the value of a parameter at `point`."""
        return float(self.point[0][free.name] if free.name in self.point[0] else self.point[1][free.name])

    @cached_property
    def _move_bounds(self) -> tuple[np.ndarray, np.ndarray]:
        """Smallest and largest move (p,) within bounds, in scales."""
        values = np.array([self.find_value(f) for f in self.free])
        scales = np.array([f.scale for f in self.free])
        low, high = np.array([f.low for f in self.free]), np.array([f.high for f in self.free])
        return np.minimum((low - values) / scales, 0.0), np.maximum((high - values) / scales, 0.0)

    def move_to(self, point: Point, residual: np.ndarray) -> "LinearModel":
        """Return the model at another `point` with the residual `residual` (size,), and the sensitivities of this one."""
        moved = replace(self, point=point, residual=residual)
        vars(moved)["gram"] = self.gram  # J'J is unchanged; computing it takes as long as a simulation
        return moved

    def find_best(self, residual: np.ndarray, damping: float = 0.0) -> tuple[np.ndarray, float]:
        """Return the move (p,) in scales within bounds that minimises the cost of `residual` (size,), and this cost.

        damping: weight of the squared move in the minimised cost (Levenberg 1944, Q. Appl. Math. 2).
        """
        left = self.eliminate(residual, damping)
        return left.move, left.cost

    def eliminate(self, residual: np.ndarray, damping: float = 0.0) -> "Elimination":
        """Minimise the cost of `residual` (size,) over the free parameters, within bounds and the limit of chi^2.

        Bounded least squares (Stark and Parker 1995). The weight of the prior is raised until chi^2 is within its limit.
        damping: see `find_best`.
        """
        gradient = self.jacobian.T @ residual
        move, inner, weight = *self._solve_bounded(gradient, 1.0, damping), 1.0
        low, high, tried = 1.0, _MOST_PRIOR_WEIGHT, 10.0
        while self._compute_prior_chi2(move) > self._chi2_limit or (
            weight > 1.0 and self._compute_prior_chi2(move) < _NEAR_LIMIT * self._chi2_limit
        ):
            if high / low < 1.02:
                break
            move, inner, weight = *self._solve_bounded(gradient, tried, damping), tried
            low, high = (tried, high) if self._compute_prior_chi2(move) > self._chi2_limit else (low, tried)
            tried = min(10.0 * tried, np.sqrt(low * high)) if high == _MOST_PRIOR_WEIGHT else np.sqrt(low * high)
        change = self.jacobian @ move + residual
        cost = float(change @ change + self.prior @ (self.offset + move) ** 2)
        return Elimination(self, residual, move, cost, inner, weight)

    @cached_property
    def _chi2_limit(self) -> float:
        """Limit of chi^2: its quantile, with the number of priors as degrees of freedom."""
        return float(chi2.ppf(CHI2_QUANTILE, sum(f.centre is not None for f in self.free) or 1))

    def _compute_prior_chi2(self, move: np.ndarray) -> float:
        """Compute chi^2 after a move."""
        known = [f.centre is not None for f in self.free]
        return float(np.sum((self.offset + move)[known] ** 2))

    def _solve_bounded(self, gradient: np.ndarray, weight: float, damping: float) -> tuple[np.ndarray, np.ndarray]:
        """Return the best move (p,) within bounds for J'r `gradient` and the prior times `weight`, and the indices (q,) not at
        a bound."""
        prior = weight * self.prior
        hessian = self.gram + np.diag(prior + 1e-10 * np.diag(self.gram) + damping)
        low, high = self._move_bounds
        inner = np.flatnonzero(low < high)
        move = np.zeros(len(self.free))
        if len(inner):
            lower = cholesky(hessian[np.ix_(inner, inner)], lower=True)
            right = -solve_triangular(lower, (gradient + prior * self.offset)[inner], lower=True)
            best = solve_triangular(lower.T, right)
            if np.all((low[inner] <= best) & (best <= high[inner])):  # 2 to 8 times as fast as the search, for 9 to 33
                move[inner] = best
            else:
                bounded = lsq_linear(lower.T, right, (low[inner], high[inner]), method="bvls")
                move[inner] = bounded.x
                inner = inner[bounded.active_mask == 0]
        return move, inner

    def move_by(self, move: np.ndarray, share: float = 1.0) -> Point:
        """Return the point after `share` of a move (p,) in scales, within bounds."""
        parameters, effects = dict(self.point[0]), dict(self.point[1])
        for f, by in zip(self.free, move, strict=True):
            new = float(np.clip(self.find_value(f) + share * by * f.scale, f.low, f.high))
            (parameters if f.name in parameters else effects)[f.name] = new
        return parameters, effects

    def compute_covariance(self, clusters: Iterable[np.ndarray]) -> np.ndarray:
        """Compute the covariance (p, p) of the parameters in scales, robust to model error.

        clusters: indices of residuals, each cluster independent of the others. Sandwich estimator: White 1980, Econometrica 48;
        Liang and Zeger 1986, Biometrika 73.
        """
        inverse = np.linalg.inv(self.gram + np.diag(self.prior + 1e-10 * np.diag(self.gram)))
        scores = np.array([self.jacobian[c].T @ self.residual[c] for c in clusters])
        middle = scores.T @ scores + np.diag(self.prior**2)
        return inverse @ middle @ inverse


@dataclass(frozen=True)
class Elimination:
    """Result of eliminating the free parameters of `at`: the best `move` (p,) for `residual` (size,), and the `cost` there.

    inner: indices (q,) of parameters not at a bound. weight: factor on the prior.

    Other parameters are then fitted to the part that the inner ones cannot explain: variable projection (Golub and Pereyra
    1973).
    """

    at: LinearModel
    residual: np.ndarray
    move: np.ndarray
    cost: float
    inner: np.ndarray
    weight: float

    def make_normal_equations(self, columns: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return matrix (k, k) and right side (k,) of the normal equations for `columns` (size, k)."""
        jacobian = self.at.jacobian
        prior = self.weight * self.at.prior[self.inner]
        gram = self.at.gram[np.ix_(self.inner, self.inner)]
        b = (jacobian.T @ columns)[self.inner]
        left = self.residual + jacobian @ self.move
        solved = cho_solve(cho_factor(gram + np.diag(prior + 1e-10 * np.diag(gram))), b) if len(self.inner) else b
        # at the best move the gradient in the inner parameters is 0, so the right side needs no correction
        return columns.T @ columns - b.T @ solved, -columns.T @ left


def linearise(
    evidence: Evidence, point: Point, free: Sequence[FreeParameter], residual: np.ndarray | None = None
) -> LinearModel:
    """Linearise the model of `evidence` at `point` in the parameters `free`, by finite differences.

    residual: of `evidence` at `point`, (size,), if it is known, so that it is not simulated again.

    The step of a shape is shortened until its change is below a share of its effect's contribution. A ripple needs this: a
    small change of its order is a large change of its phase after many turns.
    """
    first = evidence.compute_residuals([point])[0] if residual is None else residual
    columns, free = _compute_differences(evidence, point, list(free), first)
    contributed: dict[str, float] = {}
    for f, column in zip(free, columns, strict=True):
        if f.off is not None:
            value = (point[0] | point[1])[f.name]  # type: ignore[operator]
            size = np.linalg.norm(column) * abs(value - f.off) / f.scale
            name = f.name.partition(".")[0]
            contributed[name] = max(contributed.get(name, 0.0), float(size))
    for _ in range(_MOST_SHORTENINGS):
        long = []
        for i, f in enumerate(free):
            allowed = _LINEAR_SHARE * contributed.get(f.name.partition(".")[0], np.inf)
            size = float(np.linalg.norm(columns[i]))
            if f.centre is None and f.off is None and size > allowed > 0.0:
                free[i] = replace(f, step=f.step * 0.7 * allowed / size, scale=f.scale * 0.7 * allowed / size)
                long.append(i)
        if not long:
            break
        again, _ = _compute_differences(evidence, point, [free[i] for i in long], first)
        for i, column in zip(long, again, strict=True):
            columns[i] = column
    jacobian = np.column_stack(columns) if columns else np.empty((evidence.size, 0))
    return LinearModel(point, tuple(free), first, jacobian, evidence.redundancy)


def _compute_differences(
    evidence: Evidence, point: Point, free: list[FreeParameter], first: np.ndarray
) -> tuple[list[np.ndarray], list[FreeParameter]]:
    """Return the change (size,) of the residuals per scale of each parameter, 0 where it cannot be simulated, and the
    parameters."""
    parameters, effects = point
    steps, points = [], []
    for f in free:
        ours = f.name in parameters
        value = (parameters if ours else effects)[f.name]
        step = f.step if value + f.step <= f.high else -f.step
        steps.append(step)
        changed = {f.name: value + step}
        points.append(({**parameters, **changed}, effects) if ours else (parameters, {**effects, **changed}))
    fits = [
        (r - first) * (f.scale / step) if np.isfinite(r).all() else np.zeros(evidence.size)
        for r, f, step in zip(evidence.compute_residuals(points), free, steps, strict=True)
    ]
    return fits, free


def refit(evidence: Evidence, start: LinearModel, renewals: int = 1) -> LinearModel:
    """Re-fit the free parameters from `start`; the sensitivities are updated at most `renewals` times.

    They are kept while steps with them gain enough (chord method).
    """
    at = start
    for renewal in range(renewals + 1):
        first = at.cost
        at = _follow(evidence, at)
        if renewal == renewals or first - at.cost < _LEAST_GAIN * max(at.cost, evidence.size):
            break
        at = linearise(evidence, at.point, at.free, at.residual)
    return at


def _follow(evidence: Evidence, at: LinearModel) -> LinearModel:
    """Take Gauss-Newton steps from `at` with constant sensitivities."""
    for _ in range(_MOST_STEPS):
        move, expected = at.find_best(at.residual)
        if at.cost - expected < _CONVERGED * evidence.size:
            break
        for share in _STEP_SHARES:
            point = at.move_by(move, share)
            tried = at.move_to(point, evidence.compute_residuals([point])[0])
            if tried.cost < at.cost:
                break
        else:
            break
        gain = at.cost - tried.cost
        at = tried
        if gain < _TRUSTED_SHARE * (at.cost + gain - expected):  # the sensitivities are no longer valid
            break
    return at
