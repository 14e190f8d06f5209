"""Candidates: fit every effect together with a linearised baseline, first by one step, then by several for the best ones.

Equation        linear least squares eliminates the parameters of the baseline and of effects already named (variable
                projection). A candidate is fitted only to what these parameters cannot explain
Assumptions     sensitivities of the baseline do not depend on the candidate
References      Golub and Pereyra 1973, SIAM J. Numer. Anal. 10; Rao 1948, Math. Proc. Camb. Phil. Soc. 44 (score test)
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import combinations

import numpy as np

from clutch_hil.fitting.evidence import Evidence, Point
from clutch_hil.fitting.fit import FreeParameter, LinearModel, free_effect
from clutch_hil.fitting.model import Candidate, Values

_SECOND_SIMULATION = 0.02  # of the best predicted gain: a candidate with a smaller gain is not simulated a second time
_LONGEST_STEP = 30.0  # finite-difference steps: limit of a parameter's change in one round
_CONVERGED = 1e-3  # of a candidate's gain: a smaller improvement ends its rounds
_STEP_SHARES = (1.0, 0.3)  # shares of a Gauss-Newton step that are tried
_FIRST_STEP_SHARES = (1.0, 0.4, 0.15)  # shares of the first step from off that are tried; ...
_KEPT_PROMISE = 0.3  # ... a shorter step is tried where the gain is below this share of the predicted gain
_GROWING_GAIN = 0.1  # of the best gain: strengths of a candidate above it are doubled while the gain grows, ...
_MOST_DOUBLINGS = 4  # ... at most this many times


@dataclass(frozen=True)
class Fit:
    """A fitted candidate with the `values` of its parameters by dotted name.

    cost: with the baseline at its linear optimum. residual: (size,) with the baseline unchanged.
    """

    candidate: Candidate
    values: dict[str, float]
    cost: float
    residual: np.ndarray

    @property
    def name(self) -> str:
        """Return the name of the candidate."""
        return self.candidate.name


@dataclass(frozen=True)
class Direction:
    """Change of the residuals by a candidate. `columns` (size, k): by each strength alone, at its value in `strengths`.

    off: values by dotted name with the candidate off.
    """

    candidate: Candidate
    off: dict[str, float]
    strengths: dict[str, float]
    columns: np.ndarray


_Trial = tuple[float, Direction, dict[str, float]]  # predicted gain, and the values that give it


class CandidateSearch:
    """Fit candidates together with the linearised model `at`; `cost` is the cost without candidates.

    least: least predicted gain for which a candidate is simulated. directions: taken from another search, instead of `screen`.
    """

    def __init__(
        self, evidence: Evidence, at: LinearModel, least: float = 0.0, directions: Sequence[Direction] = ()
    ) -> None:
        self._evidence, self.at, self._least = evidence, at, least
        self._spans: dict[int, slice] = {}  # columns of each direction, by its id
        self._matrix, self._right, self._usable = np.empty((0, 0)), np.empty(0), np.empty(0, bool)
        self.directions: list[Direction] = []
        self._base = at.eliminate(at.residual)
        self.cost = self._base.cost
        if directions:
            self._set_directions(directions)

    def screen(self, candidates: Sequence[Candidate], starts: Mapping[str, list[dict[str, float]]]) -> list[Fit]:
        """Fit each candidate by one step from off, in the direction of its starting values; best first.

        starts: starting parameters by dotted name, by candidate. A candidate without an entry starts at its typical values.
        """
        jobs: list[tuple[Candidate, dict[str, float], dict[str, float]]] = []  # candidate, off, strengths
        for c in candidates:
            for start in starts.get(c.name) or [c.list_typical_values()]:
                full = c.list_off_values() | start
                strengths = {f"{c.name}.{s.name}": full[f"{c.name}.{s.name}"] for s in c.strengths}
                jobs.append((c, full | {n: c.list_off_values()[n] for n in strengths}, strengths))
        points = [self._make_point(off | {n: v}) for _, off, strengths in jobs for n, v in strengths.items()]
        residuals = iter(self._evidence.compute_residuals(points))
        self._set_directions(
            [
                Direction(c, off, strengths, np.column_stack([next(residuals) - self.at.residual for _ in strengths]))
                for c, off, strengths in jobs
            ]
        )
        trials = [(gain, d, values) for d in self.directions for gain, values in [self.predict_gain([d])]]
        worth = max(self._least, _SECOND_SIMULATION * max((gain for gain, _, _ in trials), default=0.0))
        best = self._take_first_steps([trial for trial in trials if trial[0] > worth])
        for _, d, _ in trials:  # candidates without a gain stay off
            best.setdefault(
                d.candidate.name, Fit(d.candidate, d.candidate.list_off_values(), self.cost, self.at.residual)
            )
        return sorted(best.values(), key=lambda fit: fit.cost)

    def predict_gain(self, together: Sequence[Direction]) -> tuple[float, dict[str, float]]:
        """Return predicted gain and parameters of several candidates after one linear step along directions, within bounds."""
        names = [n for d in together for n in d.strengths]
        off = {n: v for d in together for n, v in d.off.items()}
        towards = {n: v for d in together for n, v in d.strengths.items()}
        bounds = {n: b for d in together for n, b in _list_bounds(d.candidate).items()}
        index = np.concatenate([np.arange(self._spans[id(d)].start, self._spans[id(d)].stop) for d in together])
        matrix, right, usable = self._matrix[np.ix_(index, index)], self._right[index], self._usable[index]
        values = dict(off)
        while usable.any():
            kept = np.flatnonzero(usable)
            share = np.linalg.lstsq(matrix[np.ix_(kept, kept)], right[kept], rcond=1e-10)[0]
            outside = False
            for by, k in zip(share, kept, strict=True):
                (low, high), n = bounds[names[k]], names[k]
                value = off[n] + by * (towards[n] - off[n])
                if (value <= low and off[n] <= low) or (value >= high and off[n] >= high):
                    usable[k], outside, values[n] = False, True, off[n]
                else:
                    values[n] = float(np.clip(value, low, high))
            if not outside:
                return float(share @ right[kept]), values
        return 0.0, values

    def improve(self, fits: Sequence[Fit], rounds: int) -> list[Fit]:
        """Improve each fit by `rounds` of damped Gauss-Newton steps in its strengths; best first."""
        fits = list(fits)
        active = list(range(len(fits)))
        for _ in range(rounds):
            steps = dict(zip(active, self._find_newton_steps([fits[i] for i in active]), strict=True))
            old = {i: fits[i].cost for i in active}
            waiting = active
            for share in _STEP_SHARES:
                tried = self._evaluate([(fits[i].candidate, steps[i](share)) for i in waiting])
                better = {i: new for i, new in zip(waiting, tried, strict=True) if new.cost < fits[i].cost}
                for i, new in better.items():
                    fits[i] = new
                waiting = [i for i in waiting if i not in better]
            active = [i for i in active if old[i] - fits[i].cost > _CONVERGED * max(self.cost - fits[i].cost, 0.0)]
            if not active:
                break
        return sorted(fits, key=lambda fit: fit.cost)

    def extend(self, taken: Sequence[str], count: int) -> list[Fit]:
        """Fit by one step the `count` candidates with the largest predicted gain beside the effects `taken`; best first."""
        trials: dict[str, _Trial] = {}
        for d in self.directions:
            name = d.candidate.name
            if name in taken or set(d.candidate.excludes) & set(taken):
                continue
            gain, values = self.predict_gain([d])
            if gain > max(self._least, trials[name][0] if name in trials else 0.0):
                trials[name] = gain, d, values
        best = self._take_first_steps(sorted(trials.values(), key=lambda one: -one[0])[:count])
        return sorted(best.values(), key=lambda fit: fit.cost)

    def rank_pairs(self, count: int) -> list[tuple[float, tuple[Direction, Direction], dict[str, float]]]:
        """Return the `count` pairs of candidates with the largest predicted gain: gain, directions and parameters."""
        single = {id(d): self.predict_gain([d])[0] for d in self.directions}
        useful: dict[str, Direction] = {}
        for d in sorted(self.directions, key=lambda d: -single[id(d)]):
            useful.setdefault(d.candidate.name, d)
        pairs = []
        for one, other in combinations(list(useful.values()), 2):
            if other.candidate.name in one.candidate.excludes or one.candidate.name in other.candidate.excludes:
                continue
            gain, values = self.predict_gain([one, other])
            pairs.append((gain, (one, other), values))
        return sorted(pairs, key=lambda pair: -pair[0])[:count]

    def _take_first_steps(self, waiting: Sequence[_Trial]) -> dict[str, Fit]:
        """Return each candidate's fit after its first step, by name: at its start, or at the best share of the predicted step.

        The strengths of good candidates are doubled while the gain grows, because an effect with a threshold does little while
        it is small.
        """
        best: dict[str, Fit] = {}

        def evaluate(trials: list[tuple[Candidate, dict[str, float]]]) -> list[Fit]:
            fits = self._evaluate(trials)
            for fit in fits:
                best[fit.name] = min(best.get(fit.name, fit), fit, key=lambda one: one.cost)
            return fits

        evaluate([(d.candidate, d.off | d.strengths) for _, d, _ in waiting])
        for share in _FIRST_STEP_SHARES:
            refits = evaluate([(d.candidate, _interpolate(d.off, values, share)) for _, d, values in waiting])
            waiting = [
                one
                for one, fit in zip(waiting, refits, strict=True)
                if self.cost - fit.cost < share * _KEPT_PROMISE * one[0]
            ]
        most = self.cost - min((fit.cost for fit in best.values()), default=self.cost)
        growing = [fit for fit in best.values() if self.cost - fit.cost > _GROWING_GAIN * most]
        for _ in range(_MOST_DOUBLINGS):
            longer = evaluate([(fit.candidate, _double_strengths(fit)) for fit in growing])
            growing = [new for fit, new in zip(growing, longer, strict=True) if new.cost < fit.cost]
        return best

    def _set_directions(self, directions: Sequence[Direction]) -> None:
        """Set `directions` and the normal equations of all of them together."""
        self.directions = list(directions)
        columns = np.hstack([d.columns for d in directions])
        finite = np.isfinite(columns).all(axis=0)
        columns[:, ~finite] = 0.0
        self._usable = finite & columns.any(axis=0)
        self._matrix, self._right = self._base.make_normal_equations(columns)
        ends = np.cumsum([d.columns.shape[1] for d in directions]).tolist()
        self._spans = {id(d): slice(e - d.columns.shape[1], e) for d, e in zip(directions, ends, strict=True)}

    def _make_point(self, effects: Values) -> Point:
        return self.at.point[0], {**self.at.point[1], **effects}

    def _evaluate(self, trials: Sequence[tuple[Candidate, dict[str, float]]]) -> list[Fit]:
        residuals = self._evidence.compute_residuals([self._make_point(values) for _, values in trials])
        return [
            Fit(c, values, self.at.find_best(r)[1] if np.isfinite(r).all() else np.inf, r)
            for (c, values), r in zip(trials, residuals, strict=True)
        ]

    def _find_newton_steps(self, fits: Sequence[Fit]) -> list[Callable[[float], dict[str, float]]]:
        """Return the Gauss-Newton step of each fit, as a function from a share of the step to the parameters there."""
        frees = [
            [replace(f, step=f.step if fit.values[f.name] + f.step <= f.high else -f.step) for f in free]
            for fit in fits
            for free in [free_effect(fit.candidate, fit.values, shapes=False)]
        ]
        points = [
            self._make_point(fit.values | {f.name: fit.values[f.name] + f.step})
            for fit, free in zip(fits, frees, strict=True)
            for f in free
        ]
        residuals = iter(self._evidence.compute_residuals(points))
        return [
            self._find_newton_step(fit, free, [next(residuals) for _ in free])
            for fit, free in zip(fits, frees, strict=True)
        ]

    def _find_newton_step(
        self, fit: Fit, free: Sequence[FreeParameter], residuals: Sequence[np.ndarray]
    ) -> Callable[[float], dict[str, float]]:
        columns = [(r - fit.residual, f) for r, f in zip(residuals, free, strict=True) if np.isfinite(r).all()]
        columns = [(d, f) for d, f in columns if d.any()]
        if not columns:
            return lambda share: fit.values
        directions = np.column_stack([d for d, _ in columns])
        matrix, right = self.at.eliminate(fit.residual).make_normal_equations(directions)
        matrix = matrix + np.diag(1e-6 * np.diag(matrix) + 1e-12)
        by = np.clip(np.linalg.solve(matrix, right), -_LONGEST_STEP, _LONGEST_STEP)
        moves = {f.name: (step * f.step, f) for step, (_, f) in zip(by, columns, strict=True)}

        def move(share: float) -> dict[str, float]:
            moved = {n: float(np.clip(fit.values[n] + share * m, f.low, f.high)) for n, (m, f) in moves.items()}
            return fit.values | moved

        return move


def _interpolate(off: Values, values: Values, share: float) -> dict[str, float]:
    """Return the parameters at a `share` of the way from `off` to `values`."""
    return {n: off[n] + share * (v - off[n]) for n, v in values.items()}


def _double_strengths(fit: Fit) -> dict[str, float]:
    """Return the parameters of a fit with its strengths twice as far from off, within bounds."""
    bounds, off = _list_bounds(fit.candidate), fit.candidate.list_off_values()
    strengths = {f"{fit.name}.{s.name}" for s in fit.candidate.strengths}
    return {n: float(np.clip(2.0 * v - off[n], *bounds[n])) if n in strengths else v for n, v in fit.values.items()}


def _list_bounds(c: Candidate) -> dict[str, tuple[float, float]]:
    return {f"{c.name}.{p.name}": p.bounds for p in c.parameters}
