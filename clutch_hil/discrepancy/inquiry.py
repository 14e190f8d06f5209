"""Inquiry: the fits of one search - the baseline, every effect beside it, the best in earnest, two and three together."""

from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np

from clutch_hil.discrepancy.candidates import Fit, Search
from clutch_hil.discrepancy.decide import (
    CLOSED,
    GAIN,
    NONE_SURE,
    NOTHING_SURE,
    UNEXPLAINED,
    Weighed,
    aliases,
    confidence,
    worthwhile,
)
from clutch_hil.discrepancy.evidence import Evidence, Point
from clutch_hil.discrepancy.fit import Linear, effect_free, linearised, refitted
from clutch_hil.discrepancy.held_out import left_out
from clutch_hil.discrepancy.intervals import half_widths
from clutch_hil.discrepancy.model import Candidate, Hinting, Model, readings
from clutch_hil.discrepancy.reading import best_reading
from clutch_hil.discrepancy.result import NAMED, NONE_OF_THESE, NOTHING, ONE_OF, Estimate, Rival

Progress = Callable[[str, float], None]  # what is being done, share of the whole
_IN_EARNEST = 8  # candidates that are fitted in more than one step
_JOINT = 4  # of these, fitted with their shapes and with the baseline's own parameters beside
_RESHAPED = 4.0  # factor between starts of a shape
_TAKEN_UP = 0.3  # share of the nominal model's excess below which what is left is looked at from the re-fitted baseline
_RENEWALS = 3  # of an effect's own sensitivities, and of a set of effects'
_CONVERGED = 0.01  # of the gain over the baseline
_CLOSE = 0.2  # regret within which a rival is fitted as fully as the best
_PAIRS = 4  # pairs that are fitted
_PARTNERS = 3  # candidates that are fitted beside what is named
_RUNNERS_UP = 2  # single effects beside which they are, too: of two that are missing neither may be the best alone
_TELLING = 2  # runs that starts are read from
_CONTRADICTED = 2.0  # weight of an output's power that a candidate adds: true ones of the development split add none
_Joint = tuple[Linear, tuple[Candidate, ...]]
_Set = tuple[tuple[Candidate, ...], Point]  # candidates, and where their fit begins


class Inquiry:
    """The fits of one search: `run` it, then ask for what it found."""

    def __init__(self, model: Model, evidence: Evidence, candidates: list[Candidate], progress: Progress) -> None:
        self.model, self.evidence, self.candidates, self.progress = model, evidence, candidates, progress
        self.named: tuple[Candidate, ...] = ()  # the effects that explain most
        self.values: dict[str, dict[str, float]] = {}  # fitted, of each single candidate
        self.costs: dict[str, float] = {}  # of the candidates in the round that decided, each beside those named before
        self.by_run: dict[str, np.ndarray] = {}  # excess (k,) that each of the best candidates leaves in each run
        self._against: dict[str, float] = {}  # how far some of them are contradicted
        self._rivals: dict[str, Rival] = {}
        self.confidence = 0.5
        self.reading = ""  # of the model's equations, where it is not the first

    def run(self) -> None:
        """Fit the baseline, then one, two, three effects."""
        evidence = self.evidence
        self.progress("baseline re-fitted", 0.02)
        self.reading, self.start, self.base = best_reading(self.model, evidence)
        if evidence.excess(self.base.residual) < _TAKEN_UP * evidence.excess(self.start.residual):
            self.base = refitted(evidence, linearised(evidence, self.base.point, self.base.free))
            self.start = self.base  # what is missing, if anything, is small beside what was calibrated
        evidence = self._tolerant()
        self.final = self.base
        self.weighed = self._weighed(self.base, 0)
        self.progress("candidates", 0.1)
        self.search = Search(evidence, self.start, 0.5 * GAIN * evidence.size)
        ranked = self.search.screened(self.candidates, self._starts(self.base.point))
        hopeful = [f for f in ranked if self.search.cost - f.cost > 0.5 * GAIN * evidence.size]
        self._judge({f.name: f.cost for f in ranked if f not in hopeful})
        if not hopeful:
            return
        self.progress("the best candidates in earnest", 0.35)
        ranked = self._first(self.search.improved(hopeful[:_IN_EARNEST], 2), hopeful)
        self.progress("the finalists with the baseline", 0.5)
        own = self.start.point[0]
        jointly = self._jointly(
            [((f.candidate,), (own, f.values)) for f in ranked[:_JOINT] if self._close(f, ranked[0])]
        )
        for i, (at, (candidate,)) in enumerate(jointly):
            if i == 0 or candidate.is_off(at.point[1]):
                self._alone(at)
        costs = {f.name: f.cost for f in ranked} | {names[0].name: self._score(at) for at, names in jointly}
        self.values = {f.name: f.values for f in ranked}
        self._singly(jointly)
        self._judge(costs)
        self._take(*jointly[0], costs)
        if self._unfinished():
            near = self._near()
            self._several([(at, names) for at, names in jointly[1:] if names[0].name in near])
        if self.weighed.gained:
            self.progress("the model with what was found", 0.8)
            self._end()
            self._without_idle(costs)

    def _tolerant(self) -> Evidence:
        """The evidence from here on: no output outweighs the others."""
        evidence = self.evidence.tolerant(self.base.residual)
        factor = evidence.weights / self.evidence.weights
        self.evidence, same = evidence, self.start is self.base
        self.start, self.base = (
            replace(at, residual=factor * at.residual, jacobian=factor[:, None] * at.jacobian)
            for at in (self.start, self.base)
        )
        self.base = refitted(evidence, self.base, 0)
        if same:
            self.start = self.base
        return evidence

    def _alone(self, at: Linear) -> None:
        """The baseline once more, from where effects left it: a gain that it can have itself is none of theirs."""
        own = [i for i, f in enumerate(at.free) if f.centre is not None]
        point: Point = at.point[0], {}
        residual, jacobian = self.evidence.residuals([point])[0], at.jacobian[:, own]
        alone = Linear(point, tuple(at.free[i] for i in own), residual, jacobian, at.alike)
        again = refitted(self.evidence, alone, 0)
        if again.cost < self.base.cost:
            self.base = again

    @staticmethod
    def _first(*groups: Sequence[Fit]) -> list[Fit]:
        """Fits of all groups, each name once, as the first group that has it; best first."""
        found: dict[str, Fit] = {}
        for group in groups:
            for fit in group:
                found.setdefault(fit.name, fit)
        return sorted(found.values(), key=lambda fit: fit.cost)

    def _close(self, fit: Fit, best: Fit) -> bool:
        return fit.cost - best.cost <= _CLOSE * max(self.base.cost - best.cost, 0.0)

    def _starts(self, point: Point) -> dict[str, list[dict[str, float]]]:
        """Where to begin: typical values, with each shape a factor up and down too, or what the runs that disagree most say."""
        starts = {c.name: [c.typical(), *_reshaped(c)] for c in self.candidates}
        if not isinstance(self.model, Hinting):
            return starts
        power = [float(np.sum(self.start.residual[p] ** 2)) for p in self.evidence.pieces]
        hints: dict[str, list[dict[str, float]]] = {}
        for k in np.argsort(power)[::-1][:_TELLING]:
            run, predicted = self.evidence.runs[k], self.evidence.predicted(point, int(k))
            residuals = {c: run[c] - predicted[c] for c in self.evidence.columns}
            for c in self.candidates:
                hints.setdefault(c.name, []).extend(self.model.starts(c, run, residuals))
        return starts | {name: found for name, found in hints.items() if found}

    def _jointly(self, sets: Sequence[_Set]) -> list[_Joint]:
        """Each set of candidates, from a point on, with the baseline's own parameters, whose sensitivities are kept.

        The best, and those that come close to it, are fitted to the end.
        """
        fits = sorted(((self._joint(*one, 1), one[0]) for one in sets), key=self._rank)
        least = self._rank(fits[0])
        close = least + _CLOSE * max(self.base.cost - least, 0.0)
        fits = [
            (self._joint(candidates, at.point, _RENEWALS - 1), candidates)
            if self._score(at) <= close
            else (at, candidates)
            for at, candidates in fits
        ]
        return sorted(fits, key=self._rank)

    def _score(self, at: Linear) -> float:
        """What fits are compared by: the cost, and what contradicts them."""
        if not np.isfinite(at.cost):
            return np.inf
        return (
            at.cost + _CONTRADICTED * self.evidence.contradicted(at.residual, self.base.residual) * self.evidence.size
        )

    def _rank(self, fit: _Joint) -> float:
        return self._score(fit[0])

    def _joint(self, candidates: tuple[Candidate, ...], point: Point, renewals: int) -> Linear:
        """A set of candidates from `point` on with the effects' own sensitivities taken at most `renewals` times."""
        for _ in range(renewals):
            free = [f for c in candidates for f in effect_free(c, point[1])]
            own = linearised(self.evidence, point, free)
            jacobian = np.hstack([self.start.jacobian, own.jacobian])
            before = Linear(point, self.start.free + own.free, own.residual, jacobian, own.alike)
            if not np.isfinite(before.cost):  # it cannot be simulated there
                return before
            after = refitted(self.evidence, before, 0)
            point = after.point
            if before.cost - after.cost < _CONVERGED * max(self.base.cost - after.cost, 0.0):
                break
        return after

    def _renewed(self, at: Linear) -> Linear:
        """The final fit with its own sensitivities."""
        free = [f for f in at.free if f.centre is not None]
        free += [f for c in self.named for f in effect_free(c, at.point[1])]
        return refitted(self.evidence, linearised(self.evidence, at.point, free), 0)

    def _end(self) -> None:
        """What is named, fitted to its end, and the baseline from there."""
        self.final = self._renewed(self.final)
        self._alone(self.final)
        self.weighed = self._weighed(self.final, self.weighed.count)

    def _take(self, at: Linear, candidates: tuple[Candidate, ...], costs: dict[str, float]) -> None:
        self.named, self.final, self.costs = candidates, at, costs
        self.weighed = self._weighed(at, len(candidates))

    def _several(self, near: Sequence[_Joint]) -> None:
        """Two effects, and a third beside them, where they explain what one does not. near: single ones nearly as good."""
        self.progress("two effects", 0.6)
        own, sets = self.start.point[0], self._beside(self.final, self.named)
        for at, candidates in near[:_RUNNERS_UP]:
            sets += self._beside(at, candidates)
        for _, (a, b), values in self.search.pairs(_PAIRS):
            if not {a.candidate, b.candidate} & set(self.named):  # else the fit beside what is named begins nearer
                sets.append(((a.candidate, b.candidate), (own, values)))
        while sets:
            best, *others = self._jointly(sets)
            if not self._earned(best, others):
                break
            at, candidates = best
            if self.weighed.explained and not self._weighed(at, len(candidates)).explained:
                break  # of two more is asked for than of one
            self._take(at, candidates, {})
            sets = []
            if self._unfinished():
                self.progress("three effects", 0.7)
                sets = self._beside(self.final, self.named)

    def _without_idle(self, costs: dict[str, float]) -> None:
        """Drop what is named beside others, may as well be off, and would not be added to them: a further effect does its
        work, or it never did any.

        costs: of single effects.
        """
        while self.weighed.explained and len(self.named) > 1 and (idle := self._idle()):
            parameters, effects = self.final.point
            sets = []
            for c in idle:
                others = {n: v for n, v in effects.items() if n not in c.declared()}
                sets.append((tuple(o for o in self.named if o is not c), (parameters, others)))
            at, kept = self._jointly(sets)[0]
            without, likelier = self._weighed(at, len(kept)), at.strain - self.final.strain
            gain = (without.best - self.weighed.best) / without.size
            earned = worthwhile(gain, likelier, without.size, without.alike) and without.mended(gain, gain)
            if earned or not without.explained:
                break
            if len(kept) == 1:
                self._singly([(at, kept)])
                self._judge(costs := costs | {kept[0].name: self._score(at)})
            self._take(at, kept, costs if len(kept) == 1 else {})
            self._end()

    def _idle(self) -> list[Candidate]:
        """Effects none of whose strengths has an interval that leaves out where it is off."""
        unsure = {e.name for e in self.estimates(effects=True) if e.ci95[0] <= e.nominal <= e.ci95[1]}
        return [c for c in self.named if all(f"{c.name}.{s.name}" in unsure for s in c.strengths)]

    def _singly(self, fits: Sequence[_Joint]) -> None:
        """Keep what fits of single effects found."""
        for at, (c,) in fits:
            self.values[c.name] = dict(at.point[1])
            self.by_run[c.name] = self.evidence.excess_by_run(at.residual)
            self._against[c.name] = self.evidence.contradicted(at.residual, self.base.residual)

    def _unfinished(self) -> bool:
        """Whether what is named, fitted to its end where it seems to, leaves enough to look for a further effect."""
        if self.weighed.unfinished:
            self.final = self._renewed(self.final)
            self.weighed = self._weighed(self.final, self.weighed.count)
        return self.weighed.unfinished

    def _beside(self, at: Linear, candidates: tuple[Candidate, ...]) -> list[_Set]:
        """`candidates`, fitted as `at`, with each of those that promise most beside them."""
        search = Search(self.evidence, at, 0.5 * GAIN * self.evidence.size, self.search.directions)
        promising = search.beside([c.name for c in candidates], _PARTNERS)
        parameters, effects = at.point
        return [((*candidates, fit.candidate), (parameters, {**effects, **fit.values})) for fit in promising]

    def _weighed(self, at: Linear, count: int) -> Weighed:
        e = self.evidence
        left = e.excess(self.base.residual), e.excess(at.residual)
        return Weighed(self.base.cost, at.cost, e.size, count, *left, self.base.strain - at.strain, at.strain, e.alike)

    def _earned(self, fit: _Joint, others: Sequence[_Joint]) -> bool:
        """Whether one more effect earns its place: it mends much of what is left, no chance, in runs left out, too."""
        w, (at, candidates) = self.weighed, fit
        new = set(candidates) - set(self.named)
        without = [self._score(other) for other, theirs in others if not new & set(theirs)]
        gain, second = (w.best - at.cost) / w.size, (w.best - min(without, default=np.inf)) / w.size
        likelier = self.final.strain - at.strain
        return worthwhile(gain, likelier, w.size, w.alike) and w.mended(gain, second) and self._holds(at)

    def _holds(self, at: Linear) -> bool:
        """Whether it predicts runs better that are left out in turn, beside what its calibration costs."""
        squares = self.evidence.alike * np.array([self.final.strain, at.strain])
        for k, points in enumerate(left_out(self.evidence, self.final, at)):
            squares += [np.sum(r[self.evidence.pieces[k]] ** 2) for r in self.evidence.residuals(points)]
        return bool(squares[1] < squares[0])

    def _judge(self, costs: dict[str, float]) -> None:
        base = self.base.cost
        for name, cost in costs.items():
            least = min(cost, base)  # switched off it is the baseline
            values = self.values.get(name, {})
            self._rivals[name] = Rival(name, 0.0, base - least, values, "", 1)

    def verdict(self) -> tuple[str, list[str], list[list[str]], list[str]]:
        """Verdict, effects named, sets of alternatives, notes."""
        w = self.weighed
        notes: list[str] = []
        if not self.named or not w.gained:
            if w.excess > UNEXPLAINED:
                self.confidence = NONE_SURE
                return NONE_OF_THESE, [], [], notes
            self.confidence = NOTHING_SURE
            return NOTHING, [], [], notes
        if not w.explained:
            self.confidence = float(np.clip(1.0 - w.closed, 0.3, 0.95))
            return NONE_OF_THESE, [], [], notes
        if w.count > 1:
            self.confidence = confidence(w)
            return NAMED, [c.name for c in self.named], [], notes
        near = self._near()
        self.confidence = confidence(w)
        if len(near) > 1:
            return ONE_OF, [], [near], notes
        return NAMED, [self.named[0].name], [], notes

    def _near(self) -> list[str]:
        """Single effects that are not told apart from the best, which is the first."""
        near = aliases(self.costs, self.weighed, self.by_run)
        return [n for n in near if self._against.get(n, 0.0) <= self._against.get(near[0], 0.0) + UNEXPLAINED]

    def drop(self) -> None:
        """Go back to the baseline."""
        self.named, self.final = (), self.base

    def rivals(self) -> list[Rival]:
        """Every candidate with why it is not the one."""
        w, size = self.weighed, self.evidence.size
        best = {c.name for c in self.named} if w.explained else set()
        whole = max(w.gain + w.rest, GAIN) * size  # of the excess
        found = []
        for r in sorted(self._rivals.values(), key=lambda r: -r.gain):
            closed = float(np.clip(r.gain / whole, 0.0, 1.0))
            reason = f"closes {closed:.1%} of the gap where {w.closed:.1%} can be closed"
            if r.gain <= GAIN * size:
                reason = "explains nothing that the baseline's own parameters do not"
            elif self._against.get(r.name, 0.0) > UNEXPLAINED:
                reason = "makes an output worse than the baseline alone does, which what is missing cannot"
            elif not best:
                reason = f"closes {closed:.0%} of the gap; to be named it takes {CLOSED[0]:.0%}"
            found.append(replace(r, closed=closed, reason="" if r.name in best else reason))
        return found

    def equations(self, alternatives: list[list[str]]) -> dict[str, str]:
        """Equations of the alternatives."""
        wanted = {n for group in alternatives for n in group}
        return {c.name: c.equation for c in self.candidates if c.name in wanted}

    def estimates(self, effects: bool) -> list[Estimate]:
        """Fitted parameters, of effects or of the baseline, with 95 % intervals."""
        at, half = self.final, half_widths(self.evidence, self.final)
        declared = dict(self.model.parameters) | {n: p for c in self.named for n, p in c.declared().items()}
        found = []
        if self.reading and not effects:
            for name in readings(self.model)[self.reading]:
                value, p = float(at.point[0][name]), declared[name]
                found.append(Estimate(name, value, p.unit, (value, value), p.value))
        for f, h in zip(at.free, half, strict=True):
            if (f.centre is None) == effects:
                value, p, reach = at.value(f), declared[f.name], float(h)
                interval = max(value - reach, p.bounds[0]), min(value + reach, p.bounds[1])
                found.append(Estimate(f.name, value, p.unit, interval, p.value, p.uncertainty))
        return found


def _reshaped(candidate: Candidate) -> list[dict[str, float]]:
    """Typical values with one shape changed: an effect with another time constant is another direction."""
    found = []
    for shape in candidate.shapes:
        for factor in (_RESHAPED, 1.0 / _RESHAPED):
            value = float(np.clip(shape.typical * factor, *shape.bounds))
            if shape.typical > 0.0 and shape.unit != "rad" and value != shape.typical:
                found.append(candidate.typical() | {f"{candidate.name}.{shape.name}": value})
    return found
