"""Candidates: every effect fitted beside a linearised baseline, first by one step for all, then in earnest for the best.

Equation        the baseline's (and named effects') parameters are eliminated by their linear least squares
                (variable projection); a candidate sees what they cannot explain
Assumptions     sensitivities of the baseline do not depend on the candidate
References      Golub and Pereyra 1973, SIAM J. Numer. Anal. 10; Rao 1948, Math. Proc. Camb. Phil. Soc. 44 (score test)
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import combinations

import numpy as np

from clutch_hil.discrepancy.evidence import Evidence, Point
from clutch_hil.discrepancy.fit import Free, Linear, effect_free
from clutch_hil.discrepancy.model import Candidate, Values

_WORTH = 0.02  # of the best predicted gain: what promises less is not simulated a second time
_FURTHEST = 30.0  # steps of a parameter in one round
_CONVERGED = 1e-3  # of a candidate's gain: a smaller one ends its rounds
_SHARES = (1.0, 0.3)  # of a Gauss-Newton step that are tried
_SHORTENED = (1.0, 0.4, 0.15)  # shares of the first step from off, shorter where it gains less than
_KEPT = 0.3  # this much of what it promised
_LONGER = 0.1  # of the best gain: what gains more is made twice as strong while that pays,
_DOUBLED = 4  # so many times at most


@dataclass(frozen=True)
class Fit:
    """A candidate with `values` of its parameters, the `cost` with the baseline at its linear best, `residual` (size,) with the
    baseline unmoved."""

    candidate: Candidate
    values: dict[str, float]
    cost: float
    residual: np.ndarray

    @property
    def name(self) -> str:
        """Its name."""
        return self.candidate.name


@dataclass(frozen=True)
class Direction:
    """What a candidate's strengths, each alone at its value in `strengths`, change in the residuals: `columns` (size, k).

    off: its values while it is off.
    """

    candidate: Candidate
    off: dict[str, float]
    strengths: dict[str, float]
    columns: np.ndarray


_Trial = tuple[float, Direction, dict[str, float]]  # predicted gain, and the values that give it


class Search:
    """Fits candidates beside the linearised model `at`; `cost` is that without any.

    least: a gain that is not worth a simulation. directions: those that `screened` found, or of another search.
    """

    def __init__(
        self, evidence: Evidence, at: Linear, least: float = 0.0, directions: Sequence[Direction] = ()
    ) -> None:
        self._evidence, self.at, self._least = evidence, at, least
        self._spans: dict[int, slice] = {}  # of each direction's columns, by id
        self._matrix, self._right, self._usable = np.empty((0, 0)), np.empty(0), np.empty(0, bool)
        self.directions: list[Direction] = []
        self._base = at.eliminated(at.residual)
        self.cost = self._base.cost
        if directions:
            self._direct(directions)

    def screened(self, candidates: Sequence[Candidate], starts: Mapping[str, list[dict[str, float]]]) -> list[Fit]:
        """Each candidate after one step from where it is off, in the direction of its starts."""
        jobs: list[tuple[Candidate, dict[str, float], dict[str, float]]] = []  # candidate, off, strengths
        for c in candidates:
            for start in starts.get(c.name) or [c.typical()]:
                full = c.off() | start
                strengths = {f"{c.name}.{s.name}": full[f"{c.name}.{s.name}"] for s in c.strengths}
                jobs.append((c, full | {n: c.off()[n] for n in strengths}, strengths))
        points = [self._point(off | {n: v}) for _, off, strengths in jobs for n, v in strengths.items()]
        residuals = iter(self._evidence.residuals(points))
        self._direct(
            [
                Direction(c, off, strengths, np.column_stack([next(residuals) - self.at.residual for _ in strengths]))
                for c, off, strengths in jobs
            ]
        )
        trials = [(gain, d, values) for d in self.directions for gain, values in [self.predicted([d])]]
        worth = max(self._least, _WORTH * max((gain for gain, _, _ in trials), default=0.0))
        best = self._stepped([trial for trial in trials if trial[0] > worth])
        for _, d, _ in trials:  # what promises nothing stays off
            best.setdefault(d.candidate.name, Fit(d.candidate, d.candidate.off(), self.cost, self.at.residual))
        return sorted(best.values(), key=lambda fit: fit.cost)

    def predicted(self, together: Sequence[Direction]) -> tuple[float, dict[str, float]]:
        """Gain and strengths of several candidates by one linear step along their directions, within bounds."""
        names = [n for d in together for n in d.strengths]
        off = {n: v for d in together for n, v in d.off.items()}
        towards = {n: v for d in together for n, v in d.strengths.items()}
        bounds = {n: b for d in together for n, b in _bounds(d.candidate).items()}
        index = np.concatenate([np.arange(self._spans[id(d)].start, self._spans[id(d)].stop) for d in together])
        matrix, right, usable = self._matrix[np.ix_(index, index)], self._right[index], self._usable[index]
        found = dict(off)
        while usable.any():
            kept = np.flatnonzero(usable)
            share = np.linalg.lstsq(matrix[np.ix_(kept, kept)], right[kept], rcond=1e-10)[0]
            outside = False
            for by, k in zip(share, kept, strict=True):
                (low, high), n = bounds[names[k]], names[k]
                value = off[n] + by * (towards[n] - off[n])
                if (value <= low and off[n] <= low) or (value >= high and off[n] >= high):
                    usable[k], outside, found[n] = False, True, off[n]
                else:
                    found[n] = float(np.clip(value, low, high))
            if not outside:
                return float(share @ right[kept]), found
        return 0.0, found

    def improved(self, fits: Sequence[Fit], rounds: int) -> list[Fit]:
        """The fits after `rounds` of damped Gauss-Newton, side by side, over strengths; best first."""
        fits = list(fits)
        active = list(range(len(fits)))
        for _ in range(rounds):
            steps = dict(zip(active, self._steps([fits[i] for i in active]), strict=True))
            old = {i: fits[i].cost for i in active}
            waiting = active
            for share in _SHARES:
                tried = self._evaluated([(fits[i].candidate, steps[i](share)) for i in waiting])
                better = {i: new for i, new in zip(waiting, tried, strict=True) if new.cost < fits[i].cost}
                for i, new in better.items():
                    fits[i] = new
                waiting = [i for i in waiting if i not in better]
            active = [i for i in active if old[i] - fits[i].cost > _CONVERGED * max(self.cost - fits[i].cost, 0.0)]
            if not active:
                break
        return sorted(fits, key=lambda fit: fit.cost)

    def beside(self, taken: Sequence[str], count: int) -> list[Fit]:
        """The `count` candidates that promise most beside the effects `taken`, each after one step; best first."""
        found: dict[str, _Trial] = {}
        for d in self.directions:
            name = d.candidate.name
            if name in taken or set(d.candidate.excludes) & set(taken):
                continue
            gain, values = self.predicted([d])
            if gain > max(self._least, found[name][0] if name in found else 0.0):
                found[name] = gain, d, values
        best = self._stepped(sorted(found.values(), key=lambda one: -one[0])[:count])
        return sorted(best.values(), key=lambda fit: fit.cost)

    def pairs(self, count: int) -> list[tuple[float, tuple[Direction, Direction], dict[str, float]]]:
        """The `count` pairs of candidates that promise most together, with their predicted gain and strengths."""
        single = {id(d): self.predicted([d])[0] for d in self.directions}
        useful: dict[str, Direction] = {}
        for d in sorted(self.directions, key=lambda d: -single[id(d)]):
            useful.setdefault(d.candidate.name, d)
        found = []
        for one, other in combinations(list(useful.values()), 2):
            if other.candidate.name in one.candidate.excludes or one.candidate.name in other.candidate.excludes:
                continue
            gain, values = self.predicted([one, other])
            found.append((gain, (one, other), values))
        return sorted(found, key=lambda pair: -pair[0])[:count]

    def _stepped(self, waiting: Sequence[_Trial]) -> dict[str, Fit]:
        """The best by name of: where directions start from, and the predicted steps, shortened where they gain much less.

        What is promising is made stronger while that pays: an effect with a threshold does little while it is small.
        """
        best: dict[str, Fit] = {}

        def evaluated(trials: list[tuple[Candidate, dict[str, float]]]) -> list[Fit]:
            found = self._evaluated(trials)
            for fit in found:
                best[fit.name] = min(best.get(fit.name, fit), fit, key=lambda one: one.cost)
            return found

        evaluated([(d.candidate, d.off | d.strengths) for _, d, _ in waiting])
        for share in _SHORTENED:
            found = evaluated([(d.candidate, _between(d.off, values, share)) for _, d, values in waiting])
            waiting = [
                one for one, fit in zip(waiting, found, strict=True) if self.cost - fit.cost < share * _KEPT * one[0]
            ]
        most = self.cost - min((fit.cost for fit in best.values()), default=self.cost)
        growing = [fit for fit in best.values() if self.cost - fit.cost > _LONGER * most]
        for _ in range(_DOUBLED):
            longer = evaluated([(fit.candidate, _doubled(fit)) for fit in growing])
            growing = [new for fit, new in zip(growing, longer, strict=True) if new.cost < fit.cost]
        return best

    def _direct(self, directions: Sequence[Direction]) -> None:
        """Take `directions` and the normal equations of all of them."""
        self.directions = list(directions)
        columns = np.hstack([d.columns for d in directions])
        finite = np.isfinite(columns).all(axis=0)
        columns[:, ~finite] = 0.0
        self._usable = finite & columns.any(axis=0)
        self._matrix, self._right = self._base.normal(columns)
        ends = np.cumsum([d.columns.shape[1] for d in directions]).tolist()
        self._spans = {id(d): slice(e - d.columns.shape[1], e) for d, e in zip(directions, ends, strict=True)}

    def _point(self, effects: Values) -> Point:
        return self.at.point[0], {**self.at.point[1], **effects}

    def _evaluated(self, trials: Sequence[tuple[Candidate, dict[str, float]]]) -> list[Fit]:
        residuals = self._evidence.residuals([self._point(values) for _, values in trials])
        return [
            Fit(c, values, self.at.best(r)[1] if np.isfinite(r).all() else np.inf, r)
            for (c, values), r in zip(trials, residuals, strict=True)
        ]

    def _steps(self, fits: Sequence[Fit]) -> list[Callable[[float], dict[str, float]]]:
        """For each fit a function from the share of a Gauss-Newton step to the values there."""
        frees = [
            [replace(f, step=f.step if fit.values[f.name] + f.step <= f.high else -f.step) for f in free]
            for fit in fits
            for free in [effect_free(fit.candidate, fit.values, shapes=False)]
        ]
        points = [
            self._point(fit.values | {f.name: fit.values[f.name] + f.step})
            for fit, free in zip(fits, frees, strict=True)
            for f in free
        ]
        residuals = iter(self._evidence.residuals(points))
        return [self._step(fit, free, [next(residuals) for _ in free]) for fit, free in zip(fits, frees, strict=True)]

    def _step(
        self, fit: Fit, free: Sequence[Free], residuals: Sequence[np.ndarray]
    ) -> Callable[[float], dict[str, float]]:
        columns = [(r - fit.residual, f) for r, f in zip(residuals, free, strict=True) if np.isfinite(r).all()]
        columns = [(d, f) for d, f in columns if d.any()]
        if not columns:
            return lambda share: fit.values
        directions = np.column_stack([d for d, _ in columns])
        matrix, right = self.at.eliminated(fit.residual).normal(directions)
        matrix = matrix + np.diag(1e-6 * np.diag(matrix) + 1e-12)
        by = np.clip(np.linalg.solve(matrix, right), -_FURTHEST, _FURTHEST)
        moves = {f.name: (step * f.step, f) for step, (_, f) in zip(by, columns, strict=True)}

        def at(share: float) -> dict[str, float]:
            moved = {n: float(np.clip(fit.values[n] + share * m, f.low, f.high)) for n, (m, f) in moves.items()}
            return fit.values | moved

        return at


def _between(off: Values, values: Values, share: float) -> dict[str, float]:
    """Strengths at a share of their way from `off`; shapes as in `values`."""
    return {n: off[n] + share * (v - off[n]) for n, v in values.items()}


def _doubled(fit: Fit) -> dict[str, float]:
    """Values with the strengths twice as far from off, within bounds."""
    bounds, off = _bounds(fit.candidate), fit.candidate.off()
    strengths = {f"{fit.name}.{s.name}" for s in fit.candidate.strengths}
    return {n: float(np.clip(2.0 * v - off[n], *bounds[n])) if n in strengths else v for n, v in fit.values.items()}


def _bounds(c: Candidate) -> dict[str, tuple[float, float]]:
    return {f"{c.name}.{p.name}": p.bounds for p in c.parameters}
