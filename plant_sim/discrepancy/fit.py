"""Fit: parameters by simulation error, damped Gauss-Newton, with what is known of the baseline as prior.

Equation        minimise |r(x)|^2 + sum over the baseline's parameters of ((x - x_0)/s)^2,  s = PRIOR times stated uncertainty
                near a point r(x + S d) = r + J d, so d = -(J'J + L)^-1 (J'r + L a),  L = 1 where a prior is, a = (x - x_0)/S
Assumptions     white noise of unit variance
References      Ljung 1999, System identification, ch. 10; Kennedy and O'Hagan 2001, J. R. Statist. Soc. B 63 (a discrepancy is
                judged beside the uncertainty of the model's own parameters)
"""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from scipy.linalg import cho_factor, cho_solve

from plant_sim.discrepancy.evidence import Evidence, Point
from plant_sim.discrepancy.model import Candidate, Values
from plant_sim.effects.effect import Strength
from protocols.parameters import ParameterSet

PRIOR = (
    0.5  # standard deviation of a baseline parameter as a share of its stated uncertainty; set on the development split
)
LIMIT = 2.0  # stated uncertainties that a parameter may move
_STEP = 0.2  # stated uncertainties: step of the baseline's finite differences
_EFFECT_STEP = 0.05  # of an effect's parameter, or of a fifth of its typical size, whichever is more
_PHASE_STEP = 0.05  # rad
_ROUNDS = 4
_CONVERGED = 1e-4  # of the number of residuals: a smaller gain ends the iteration
_WORTHWHILE = 2e-3  # of the cost: a fit that gained less needs no other sensitivities
_SHARES = (1.0, 0.4, 0.1)  # of a Gauss-Newton step that are tried
_LOOSE = 1e-9  # prior weight of an effect's parameter, beside 1 of the baseline's: none, but the matrix stays regular


@dataclass(frozen=True)
class Free:
    """A parameter that is fitted: its finite-difference `step`, unit of moves `scale`, bounds, known `centre` or None."""

    name: str
    step: float
    scale: float
    low: float
    high: float
    centre: float | None = None


def baseline_free(declared: ParameterSet) -> list[Free]:
    """The uncertain parameters of a baseline."""
    return [
        Free(
            n, _STEP * p.uncertainty, PRIOR * p.uncertainty,
            max(p.bounds[0], p.value - LIMIT * p.uncertainty), min(p.bounds[1], p.value + LIMIT * p.uncertainty), p.value,
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
            found.append(Free(name, step, step, *p.bounds))
    return found


@dataclass(frozen=True)
class Linear:
    """A model linearised at `point`: residuals r (size,), J (size, p) per `scale` of each of `free`."""

    point: Point
    free: tuple[Free, ...]
    residual: np.ndarray
    jacobian: np.ndarray

    @cached_property
    def offset(self) -> np.ndarray:
        """a: distance (p,) from what was known, in scales; 0 where nothing was."""
        known = [(self.value(f) - f.centre) / f.scale if f.centre is not None else 0.0 for f in self.free]
        return np.array(known)

    @cached_property
    def prior(self) -> np.ndarray:
        """Diagonal of L, (p,)."""
        return np.array([_LOOSE if f.centre is None else 1.0 for f in self.free])

    @cached_property
    def gram(self) -> np.ndarray:
        """J'J (p, p)."""
        return self.jacobian.T @ self.jacobian

    @cached_property
    def _factor(self) -> tuple[np.ndarray, bool]:
        ridge = 1e-10 * np.diag(self.gram)
        return cho_factor(self.gram + np.diag(self.prior + ridge))

    @property
    def cost(self) -> float:
        """What is minimised, here."""
        cost = float(self.residual @ self.residual + self.prior @ self.offset**2)
        return cost if np.isfinite(cost) else np.inf

    def value(self, free: Free) -> float:
        """A parameter, here."""
        return float(self.point[0][free.name] if free.name in self.point[0] else self.point[1][free.name])

    def best(self, residual: np.ndarray) -> tuple[np.ndarray, float]:
        """Move (p,) in scales that suits `residual` best, and the cost that is left."""
        a = self.prior * self.offset
        g = self.jacobian.T @ residual + a
        move = -cho_solve(self._factor, g)
        return move, float(residual @ residual + a @ self.offset + g @ move)

    def project(self, columns: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """J'C (p, k), and C'C less what the free parameters explain (k, k): variable projection (Golub and Pereyra 1973)."""
        b = self.jacobian.T @ columns
        return b, columns.T @ columns - b.T @ cho_solve(self._factor, b)

    def right(self, residual: np.ndarray, columns: np.ndarray, b: np.ndarray) -> np.ndarray:
        """Right side (k,) of the least squares for `columns` (size, k) with `b` of `project`."""
        g = self.jacobian.T @ residual + self.prior * self.offset
        return b.T @ cho_solve(self._factor, g) - columns.T @ residual

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
        inverse = cho_solve(self._factor, np.eye(len(self.free)))
        scores = np.array([self.jacobian[c].T @ self.residual[c] for c in clusters])
        middle = scores.T @ scores + np.diag(self.prior)
        return inverse @ middle @ inverse


def linearised(evidence: Evidence, point: Point, free: Sequence[Free]) -> Linear:
    """The model of `evidence` linearised at `point` in the parameters `free`."""
    parameters, effects = point
    steps = []
    points: list[Point] = [point]
    for f in free:
        ours = f.name in parameters
        value = (parameters if ours else effects)[f.name]
        step = f.step if value + f.step <= f.high else -f.step
        steps.append(step)
        changed = {f.name: value + step}
        points.append(({**parameters, **changed}, effects) if ours else (parameters, {**effects, **changed}))
    first, *others = evidence.residuals(points)
    jacobian = np.empty((evidence.size, len(free)))
    for i, (r, f, step) in enumerate(zip(others, free, steps, strict=True)):
        jacobian[:, i] = (r - first) * (f.scale / step) if np.isfinite(r).all() else 0.0
    return Linear(point, tuple(free), first, jacobian)


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
        if gained < 0.1 * (at.cost + gained - expected):  # these sensitivities no longer say where to go
            break
    return at
