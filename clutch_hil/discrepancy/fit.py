"""Fit: parameters by simulation error, damped Gauss-Newton, with what is known of the baseline as prior.

Equation        minimise |r(x)|^2 + n chi^2,  chi^2 = sum over the baseline's p parameters of ((x - x_0)/s)^2,  s = PRIOR times
                how far x may move,  n residuals that tell as much as one (Evidence.alike),  with chi^2 <= its 99.9 % point for
                p degrees of freedom: each parameter may be off as far as is stated, but not all of them at once
                near a point r(x + S d) = r + J d, so d = -(J'J + L)^-1 (J'r + L a),  L = n where a prior is, a = (x - x_0)/S
Assumptions     white noise of unit variance, and beside it what the laws of a rig do otherwise than ours (evidence.py)
References      Ljung 1999, System identification, ch. 10; Stark and Parker 1995, Comput. Stat. 10 (bounded least squares);
                Kennedy and O'Hagan 2001, J. R. Statist. Soc. B 63 (a discrepancy is judged beside the uncertainty of the
                model's own parameters)
"""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from scipy.linalg import cho_factor, cho_solve, cholesky, solve_triangular
from scipy.optimize import lsq_linear
from scipy.stats import chi2

from clutch_hil.discrepancy.evidence import Evidence, Point
from clutch_hil.discrepancy.model import Candidate, Values
from plant_sim.effects.effect import Strength
from protocols.files.parameters import ParameterSet

PRIOR = 1.0 / 3.0  # standard deviation of a baseline parameter as a share of how far it may move
LIKELY = 0.999  # of rigs have a chi^2 below the limit
LIMIT = 2.0  # stated uncertainties that a parameter may move
_STEP = 0.2  # stated uncertainties: step of the baseline's finite differences
_EFFECT_STEP = 0.05  # of an effect's parameter, or of a fifth of its typical size, whichever is more
_PHASE_STEP = 0.05  # rad
_LINEAR, _SHORTER = 0.3, 3  # share of an effect's contribution that a step of its shape may change, and tries
_ROUNDS = 4
_CONVERGED = 1e-4  # of the number of residuals: a smaller gain ends the iteration
_WORTHWHILE = 2e-3  # of the cost: a fit that gained less needs no other sensitivities
_SHARES = (1.0, 0.4, 0.1)  # of a Gauss-Newton step that are tried
_TRUSTED = 0.1  # of the gain that sensitivities promise: with less they are given up
_WEIGHTS = 1e8  # most that the prior is raised by to keep chi^2 within its limit
_NEAR = 0.9  # share of the limit that is near enough to it
_LOOSE = 1e-9  # prior weight of an effect's parameter, beside 1 of the baseline's: none, but the matrix stays regular


@dataclass(frozen=True)
class Free:
    """A parameter that is fitted: its finite-difference `step`, unit of moves `scale`, bounds, known `centre` or None.

    off: of an effect's strength, where it is off; None of what only shapes.
    """

    name: str
    step: float
    scale: float
    low: float
    high: float
    centre: float | None = None
    off: float | None = None


def baseline_free(declared: ParameterSet, calibration: float) -> list[Free]:
    """The uncertain parameters of a baseline, each within `calibration` times its stated uncertainty."""
    return [
        Free(
            n, _STEP * p.uncertainty, PRIOR * calibration * p.uncertainty,
            max(p.bounds[0], p.value - calibration * p.uncertainty),
            min(p.bounds[1], p.value + calibration * p.uncertainty), p.value,
        )
        for n, p in declared.items()
        if p.uncertainty > 0.0
    ]  # fmt: skip


def effect_free(candidate: Candidate, values: Values, shapes: bool = True) -> list[Free]:
    """Parameters of a candidate with `values`: strengths and, if asked, shapes. A second strength at `off` is free too."""
    found = []
    for p in candidate.parameters:
        if isinstance(p, Strength) or shapes:
            name = f"{candidate.name}.{p.name}"
            size = abs(values[name] - p.off) if isinstance(p, Strength) else abs(values[name])
            step = _EFFECT_STEP * max(size, 0.2 * abs((p.typical - p.off) or p.typical or 1.0))
            if p.unit == "rad" and not isinstance(p, Strength):
                step = _PHASE_STEP
            found.append(Free(name, step, step, *p.bounds, off=p.off if isinstance(p, Strength) else None))
    return found


@dataclass(frozen=True)
class Linear:
    """A model linearised at `point`: residuals r (size,), `alike` of which tell as much as one, J (size, p) per `scale` of each
    of `free`."""

    point: Point
    free: tuple[Free, ...]
    residual: np.ndarray
    jacobian: np.ndarray
    alike: float

    @cached_property
    def offset(self) -> np.ndarray:
        """a: distance (p,) from what was known, in scales; 0 where nothing was."""
        known = [(self.value(f) - f.centre) / f.scale if f.centre is not None else 0.0 for f in self.free]
        return np.array(known)

    @cached_property
    def prior(self) -> np.ndarray:
        """Diagonal of L, (p,)."""
        return np.array([_LOOSE if f.centre is None else self.alike for f in self.free])

    @cached_property
    def gram(self) -> np.ndarray:
        """J'J (p, p)."""
        return self.jacobian.T @ self.jacobian

    @property
    def strain(self) -> float:
        """chi^2, here."""
        return self._strain(np.zeros(len(self.free)))

    @property
    def cost(self) -> float:
        """What is minimised, here."""
        cost = float(self.residual @ self.residual + self.prior @ self.offset**2)
        return cost if np.isfinite(cost) else np.inf

    def value(self, free: Free) -> float:
        """A parameter, here."""
        return float(self.point[0][free.name] if free.name in self.point[0] else self.point[1][free.name])

    @cached_property
    def _box(self) -> tuple[np.ndarray, np.ndarray]:
        """Least and most move (p,) in scales, within bounds."""
        values = np.array([self.value(f) for f in self.free])
        scales = np.array([f.scale for f in self.free])
        low, high = np.array([f.low for f in self.free]), np.array([f.high for f in self.free])
        return np.minimum((low - values) / scales, 0.0), np.maximum((high - values) / scales, 0.0)

    def best(self, residual: np.ndarray) -> tuple[np.ndarray, float]:
        """Move (p,) in scales within bounds that suits `residual` best, and the cost that is left."""
        left = self.eliminated(residual)
        return left.move, left.cost

    def eliminated(self, residual: np.ndarray) -> "Eliminated":
        """The free parameters at their best for `residual` within bounds and the limit of chi^2.

        Bounded least squares (Stark and Parker 1995), with the prior raised until the limit is kept.
        """
        gradient = self.jacobian.T @ residual
        move, inner, weight = *self._bounded(gradient, 1.0), 1.0
        low, high, tried = 1.0, _WEIGHTS, 10.0
        while self._strain(move) > self._limit or (weight > 1.0 and self._strain(move) < _NEAR * self._limit):
            if high / low < 1.02:
                break
            move, inner, weight = *self._bounded(gradient, tried), tried
            low, high = (tried, high) if self._strain(move) > self._limit else (low, tried)
            tried = min(10.0 * tried, np.sqrt(low * high)) if high == _WEIGHTS else np.sqrt(low * high)
        change = self.jacobian @ move + residual
        cost = float(change @ change + self.prior @ (self.offset + move) ** 2)
        return Eliminated(self, residual, move, cost, inner, weight)

    @cached_property
    def _limit(self) -> float:
        """Of chi^2."""
        return float(chi2.ppf(LIKELY, sum(f.centre is not None for f in self.free) or 1))

    def _strain(self, move: np.ndarray) -> float:
        """chi^2 after a move."""
        known = [f.centre is not None for f in self.free]
        return float(np.sum((self.offset + move)[known] ** 2))

    def _bounded(self, gradient: np.ndarray, weight: float) -> tuple[np.ndarray, np.ndarray]:
        """Best move (p,) within bounds where J'r is `gradient` and the prior raised by `weight`; what is not at a bound."""
        prior = weight * self.prior
        hessian = self.gram + np.diag(prior + 1e-10 * np.diag(self.gram))
        low, high = self._box
        inner = np.flatnonzero(low < high)
        move = np.zeros(len(self.free))
        if len(inner):
            lower = cholesky(hessian[np.ix_(inner, inner)], lower=True)
            right = -solve_triangular(lower, (gradient + prior * self.offset)[inner], lower=True)
            found = lsq_linear(lower.T, right, (low[inner], high[inner]), method="bvls")
            move[inner] = found.x
            inner = inner[found.active_mask == 0]
        return move, inner

    def moved(self, move: np.ndarray, share: float = 1.0) -> Point:
        """Parameters after a move, within bounds."""
        parameters, effects = dict(self.point[0]), dict(self.point[1])
        for f, by in zip(self.free, move, strict=True):
            new = float(np.clip(self.value(f) + share * by * f.scale, f.low, f.high))
            (parameters if f.name in parameters else effects)[f.name] = new
        return parameters, effects

    def covariance(self, clusters: Iterable[np.ndarray]) -> np.ndarray:
        """Covariance (p, p) of the parameters in scales, robust to what the model lacks: sandwich with `clusters` of residuals
        that are independent of each other (White 1980, Econometrica 48; Liang and Zeger 1986, Biometrika 73)."""
        inverse = np.linalg.inv(self.gram + np.diag(self.prior + 1e-10 * np.diag(self.gram)))
        scores = np.array([self.jacobian[c].T @ self.residual[c] for c in clusters])
        middle = scores.T @ scores + np.diag(self.prior**2)
        return inverse @ middle @ inverse


@dataclass(frozen=True)
class Eliminated:
    """Free parameters of `at` at their best `move` for `residual`, `cost` there.

    inner: those (q,) that are not at a bound. weight: what the prior was raised by.

    What else is fitted sees residuals that the inner ones cannot explain: variable projection (Golub and Pereyra 1973).
    """

    at: Linear
    residual: np.ndarray
    move: np.ndarray
    cost: float
    inner: np.ndarray
    weight: float

    def normal(self, columns: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Matrix (k, k) and right side (k,) of the least squares for `columns` (size, k)."""
        jacobian = self.at.jacobian
        prior = self.weight * self.at.prior[self.inner]
        gram = self.at.gram[np.ix_(self.inner, self.inner)]
        b = (jacobian.T @ columns)[self.inner]
        left = self.residual + jacobian @ self.move
        solved = cho_solve(cho_factor(gram + np.diag(prior + 1e-10 * np.diag(gram))), b) if len(self.inner) else b
        # at the best move the gradient in the inner parameters is 0, so the right side needs no correction
        return columns.T @ columns - b.T @ solved, -columns.T @ left


def linearised(evidence: Evidence, point: Point, free: Sequence[Free]) -> Linear:
    """The model of `evidence` linearised at `point` in the parameters `free`.

    The step of a shape is shortened until it changes less than a share of what its effect contributes: a small change of a
    ripple's order is a large one after many turns.
    """
    first = evidence.residuals([point])[0]
    columns, free = _differences(evidence, point, list(free), first)
    contributed: dict[str, float] = {}
    for f, column in zip(free, columns, strict=True):
        if f.off is not None:
            value = (point[0] | point[1])[f.name]  # type: ignore[operator]
            size = np.linalg.norm(column) * abs(value - f.off) / f.scale
            name = f.name.partition(".")[0]
            contributed[name] = max(contributed.get(name, 0.0), float(size))
    for _ in range(_SHORTER):
        long = []
        for i, f in enumerate(free):
            allowed = _LINEAR * contributed.get(f.name.partition(".")[0], np.inf)
            size = float(np.linalg.norm(columns[i]))
            if f.centre is None and f.off is None and size > allowed > 0.0:
                free[i] = replace(f, step=f.step * 0.7 * allowed / size, scale=f.scale * 0.7 * allowed / size)
                long.append(i)
        if not long:
            break
        again, _ = _differences(evidence, point, [free[i] for i in long], first)
        for i, column in zip(long, again, strict=True):
            columns[i] = column
    jacobian = np.column_stack(columns) if columns else np.empty((evidence.size, 0))
    return Linear(point, tuple(free), first, jacobian, evidence.alike)


def _differences(
    evidence: Evidence, point: Point, free: list[Free], first: np.ndarray
) -> tuple[list[np.ndarray], list[Free]]:
    """Change of the residuals (size,) per scale of each parameter; 0 where it cannot be simulated."""
    parameters, effects = point
    steps, points = [], []
    for f in free:
        ours = f.name in parameters
        value = (parameters if ours else effects)[f.name]
        step = f.step if value + f.step <= f.high else -f.step
        steps.append(step)
        changed = {f.name: value + step}
        points.append(({**parameters, **changed}, effects) if ours else (parameters, {**effects, **changed}))
    found = [
        (r - first) * (f.scale / step) if np.isfinite(r).all() else np.zeros(evidence.size)
        for r, f, step in zip(evidence.residuals(points), free, steps, strict=True)
    ]
    return found, free


def refitted(evidence: Evidence, start: Linear, renewals: int = 1) -> Linear:
    """The model re-fitted from `start` in its free parameters, linearised where the fit ends.

    Sensitivities are kept while steps with them pay (chord method), then renewed, at most `renewals` times.
    """
    at = start
    for renewal in range(renewals + 1):
        first = at.cost
        at = _along(evidence, at)
        if renewal == renewals or first - at.cost < _WORTHWHILE * max(at.cost, evidence.size):
            break
        at = linearised(evidence, at.point, at.free)
    return at


def _along(evidence: Evidence, at: Linear) -> Linear:
    """The fit with the sensitivities of `at` kept."""
    for _ in range(_ROUNDS):
        move, expected = at.best(at.residual)
        if at.cost - expected < _CONVERGED * evidence.size:
            break
        for share in _SHARES:
            point = at.moved(move, share)
            tried = replace(at, point=point, residual=evidence.residuals([point])[0])
            if tried.cost < at.cost:
                break
        else:
            break
        gained = at.cost - tried.cost
        at = tried
        if gained < _TRUSTED * (at.cost + gained - expected):  # these sensitivities no longer say where to go
            break
    return at
