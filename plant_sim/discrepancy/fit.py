"""Fit: baseline and effects by simulation error, damped Gauss-Newton, with what is known of the baseline as prior.

Equation        minimise |r(theta, phi)|^2 + |(theta - theta_0)/s|^2,  s = PRIOR times the stated uncertainty
                theta is eliminated by its linear least squares (variable projection): the effect's phi sees residuals that
                the baseline cannot explain
Assumptions     the baseline's sensitivities are those at its re-fitted point
References      Golub and Pereyra 1973, SIAM J. Numer. Anal. 10 (variable projection); Ljung 1999, System identification, ch. 10
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from scipy.linalg import cho_factor, cho_solve

from plant_sim.discrepancy.evidence import Evidence, Point
from plant_sim.discrepancy.model import Candidate, Values
from plant_sim.effects.effect import Strength

PRIOR = 0.5  # standard deviation of a baseline parameter as a share of its stated uncertainty: development split
LIMIT = 2.0  # uncertainties that a parameter may move
_STEP = 0.2  # uncertainties: step of the baseline's finite differences
_ROUNDS = 3


@dataclass(frozen=True)
class Linear:
    """A model linearised at a point: residuals r (size,), J (size, p) in units of the prior's s, offset a (p,) from theta_0."""

    point: Point
    names: tuple[str, ...]  # of the parameters moved
    scales: np.ndarray  # s, (p,), in the parameters' units
    offset: np.ndarray
    residual: np.ndarray
    jacobian: np.ndarray

    @cached_property
    def _factor(self) -> tuple[np.ndarray, bool]:
        return cho_factor(self.jacobian.T @ self.jacobian + np.eye(len(self.names)))

    def best(self, residual: np.ndarray) -> tuple[np.ndarray, float]:
        """Move (p,) of the baseline in units of s that suits `residual` best, and the cost that is left."""
        g = self.jacobian.T @ residual + self.offset
        move = -cho_solve(self._factor, g)
        return move, float(residual @ residual + self.offset @ self.offset + g @ move)

    def schur(self, residual: np.ndarray, directions: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Matrix (k, k) and right side (k,) of the least squares for `directions` (size, k), the baseline eliminated."""
        b = self.jacobian.T @ directions
        g = self.jacobian.T @ residual + self.offset
        solved = cho_solve(self._factor, np.column_stack([b, g]))
        return directions.T @ directions - b.T @ solved[:, :-1], b.T @ solved[:, -1] - directions.T @ residual

    def moved(self, move: np.ndarray) -> dict[str, float]:
        """Parameters of the baseline after a move, within bounds and LIMIT."""
        return dict(zip(self.names, self._values(move), strict=True))

    def _values(self, move: np.ndarray) -> list[float]:
        limit = LIMIT / PRIOR
        new = np.clip(self.offset + move, -limit, limit)
        old = np.array([self.point[0][n] for n in self.names])
        return list(old + (new - self.offset) * self.scales)


def linearised(evidence: Evidence, parameters: Values, effects: Values) -> Linear:
    """The model of `evidence` linearised in its uncertain parameters."""
    declared = evidence.model.parameters
    names = tuple(n for n, p in declared.items() if p.uncertainty > 0.0)
    steps = np.array([_STEP * declared[n].uncertainty for n in names])
    points: list[Point] = [(parameters, effects)]
    for i, (name, step) in enumerate(zip(names, steps, strict=True)):
        low, high = declared[name].bounds
        if not low <= parameters[name] + step <= high:
            steps[i] = -step
        points.append(({**parameters, name: parameters[name] + steps[i]}, effects))
    first, *others = evidence.residuals(points)
    scales = np.array([PRIOR * declared[n].uncertainty for n in names])
    jacobian = np.column_stack([(r - first) * (s / h) for r, s, h in zip(others, scales, steps, strict=True)])
    jacobian[:, ~np.isfinite(jacobian).all(axis=0)] = 0.0
    offset = np.array([(parameters[n] - declared[n].value) / s for n, s in zip(names, scales, strict=True)])
    return Linear((parameters, effects), names, scales, offset, first, jacobian)


def refitted(evidence: Evidence, parameters: Values, effects: Values, rounds: int = _ROUNDS) -> Linear:
    """The model re-fitted in its uncertain parameters with the effects held, linearised there."""
    at = linearised(evidence, parameters, effects)
    for _ in range(rounds - 1):
        move, expected = at.best(at.residual)
        present = float(at.residual @ at.residual + at.offset @ at.offset)
        if present - expected < 1e-4 * present / len(at.residual) * 100 or not len(at.names):
            break
        tried = linearised(evidence, {**at.point[0], **at.moved(move)}, effects)
        if not tried.residual @ tried.residual + tried.offset @ tried.offset < present:
            break
        at = tried
    return at


@dataclass(frozen=True)
class Fit:
    """A candidate fitted beside a linearised baseline: `values` of its parameters, `cost` at them, (size,) `residual` with the
    baseline unmoved, `directions` (size, k) of the parameters `free` at their scales."""

    candidate: Candidate
    values: dict[str, float]
    cost: float
    residual: np.ndarray
    free: tuple[str, ...] = ()
    scales: tuple[float, ...] = ()
    directions: np.ndarray | None = None


class Candidates:
    """Fits candidates beside the linearised model `at`."""

    def __init__(self, evidence: Evidence, at: Linear) -> None:
        self._evidence, self._at = evidence, at
        self.baseline_cost = at.best(at.residual)[1]

    def screened(self, candidates: Sequence[Candidate], starts: Mapping[str, list[dict[str, float]]]) -> list[Fit]:
        """Each candidate after one step from its starts, from where it is off."""
        jobs: list[tuple[Candidate, list[tuple[str, float]], dict[str, float]]] = []
        for c in candidates:
            for start in starts.get(c.name) or [c.typical()]:
                full = {**c.off(), **start}
                strengths = [(f"{c.name}.{s.name}", full[f"{c.name}.{s.name}"]) for s in c.strengths]
                jobs.append((c, strengths, full))
        points = []
        for c, strengths, full in jobs:
            off = {**full, **{n: v for n, v in c.off().items() if n in dict(strengths)}}
            points += [self._point({**off, n: v}) for n, v in strengths]
        residuals = iter(self._evidence.residuals(points))
        trials = []
        for c, strengths, full in jobs:
            columns = np.column_stack([next(residuals) - self._at.residual for _ in strengths])
            off = c.off()
            span = np.array([v - off[n] for n, v in strengths])
            trials.append({**full, **self._amplitudes(c, columns, [n for n, _ in strengths], span)})
        fits = self._evaluated([job[0] for job in jobs], trials)
        best: dict[str, Fit] = {}
        for fit in fits:
            if fit.candidate.name not in best or fit.cost < best[fit.candidate.name].cost:
                best[fit.candidate.name] = fit
        return list(best.values())

    def improved(self, fits: Sequence[Fit], shapes: bool, rounds: int) -> list[Fit]:
        """The fits after `rounds` of damped Gauss-Newton, in step with each other, over strengths and, if asked, shapes."""
        fits = list(fits)
        for _ in range(rounds):
            fits = [self._directed(*one) for one in self._differences(fits, shapes)]
            for damping in (1.0, 0.3):
                trials = [self._step(fit, damping) for fit in fits]
                tried = self._evaluated([f.candidate for f in fits], trials)
                fits = [new if new.cost < old.cost else old for old, new in zip(fits, tried, strict=True)]
                if all(f.directions is None for f in fits):
                    break
        return fits

    def with_directions(self, fits: Sequence[Fit]) -> list[Fit]:
        """The fits with the sensitivities of all their parameters."""
        return [self._directed(*one) for one in self._differences(list(fits), True)]

    def _point(self, effects: Values) -> Point:
        return self._at.point[0], {**self._at.point[1], **effects}

    def _evaluated(self, candidates: Sequence[Candidate], values: Sequence[dict[str, float]]) -> list[Fit]:
        fits = []
        for c, v, r in zip(candidates, values, self._evidence.residuals(map(self._point, values)), strict=True):
            finite = bool(np.isfinite(r).all())
            fits.append(Fit(c, dict(v), self._at.best(r)[1] if finite else np.inf, r))
        return fits

    def _amplitudes(self, c: Candidate, columns: np.ndarray, names: list[str], span: np.ndarray) -> dict[str, float]:
        """Strengths by one linear step from off, within bounds."""
        usable = np.isfinite(columns).all(axis=0) & (np.abs(columns).max(axis=0) > 0.0)
        off = c.off()
        found = {n: off[n] for n in names}
        while usable.any():
            matrix, right = self._at.schur(self._at.residual, columns[:, usable])
            share = np.linalg.lstsq(matrix, right, rcond=1e-10)[0]
            ok = True
            for i, k in enumerate(np.flatnonzero(usable)):
                low, high = _bounds(c, names[k])
                value = off[names[k]] + share[i] * span[k]
                if (value <= low and off[names[k]] <= low) or (value >= high and off[names[k]] >= high):
                    usable[k], ok = False, False
                    found[names[k]] = off[names[k]]
                else:
                    found[names[k]] = float(np.clip(value, low, high))
            if ok:
                break
        return found

    def _differences(self, fits: list[Fit], shapes: bool) -> list[tuple[Fit, list[str], list[float], list[np.ndarray]]]:
        plans = []
        points = []
        for fit in fits:
            names, steps = [], []
            for p in fit.candidate.parameters:
                if isinstance(p, Strength) or shapes:
                    name = f"{fit.candidate.name}.{p.name}"
                    high = p.bounds[1]
                    value = fit.values[name]
                    size = abs(value - p.off) if isinstance(p, Strength) else abs(value)
                    step = 0.05 * max(size, 0.2 * abs((p.typical - p.off) or p.typical))
                    if p.unit == "rad" and not isinstance(p, Strength):
                        step = 0.05
                    if value + step > high:
                        step = -step
                    names.append(name)
                    steps.append(step)
                    points.append(self._point({**fit.values, name: value + step}))
            plans.append((fit, names, steps))
        residuals = iter(self._evidence.residuals(points))
        return [(fit, names, steps, [next(residuals) for _ in names]) for fit, names, steps in plans]

    def _directed(self, fit: Fit, names: list[str], steps: list[float], residuals: list[np.ndarray]) -> Fit:
        columns = [(r - fit.residual) / (step / abs(step)) for r, step in zip(residuals, steps, strict=True)]
        ok = [bool(np.isfinite(c).all()) and bool(np.any(c)) for c in columns]
        kept = [i for i, good in enumerate(ok) if good]
        if not kept:
            return Fit(fit.candidate, fit.values, fit.cost, fit.residual)
        return Fit(
            fit.candidate, fit.values, fit.cost, fit.residual,
            tuple(names[i] for i in kept), tuple(abs(steps[i]) for i in kept),
            np.column_stack([columns[i] for i in kept]),
        )  # fmt: skip

    def _step(self, fit: Fit, damping: float) -> dict[str, float]:
        if fit.directions is None:
            return fit.values
        matrix, right = self._at.schur(fit.residual, fit.directions)
        matrix = matrix + np.diag(1e-6 * np.diag(matrix) + 1e-12)
        share = np.linalg.solve(matrix, right)
        values = dict(fit.values)
        for name, scale, by in zip(fit.free, fit.scales, share, strict=True):
            low, high = _bounds(fit.candidate, name)
            values[name] = float(np.clip(values[name] + damping * scale * np.clip(by, -30.0, 30.0), low, high))
        return values


def _bounds(c: Candidate, name: str) -> tuple[float, float]:
    return next(p.bounds for p in c.parameters if f"{c.name}.{p.name}" == name)
