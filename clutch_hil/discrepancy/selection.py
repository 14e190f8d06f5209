"""Stepwise selection of effects: fit the baseline, every single effect beside it, then two and three effects together."""

from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np

from clutch_hil.discrepancy.candidates import CandidateSearch, Fit
from clutch_hil.discrepancy.decision import (
    DISAGREEMENT,
    LEAST_CLOSED,
    LEAST_GAIN,
    NONE_CONFIDENCE,
    NOTHING_CONFIDENCE,
    compute_confidence,
    find_aliases,
    is_worthwhile,
)
from clutch_hil.discrepancy.held_out import fit_without_each
from clutch_hil.discrepancy.joint_fits import JointFit, JointFits, Start
from clutch_hil.discrepancy.reading import choose_reading
from clutch_hil.discrepancy.result import NAMED, NONE_OF_THESE, NOTHING, ONE_OF, Estimate, Rival
from clutch_hil.discrepancy.starts import collect_starts
from clutch_hil.fitting.evidence import Evidence
from clutch_hil.fitting.fit import LinearModel, linearise, refit
from clutch_hil.fitting.intervals import compute_half_widths
from clutch_hil.fitting.model import Candidate, Model, list_readings

Progress = Callable[[str, float], None]  # current step, share of the whole
# Numbers of fits, set by hand: more fits take longer
_FULL_FIT_CANDIDATES = 8  # candidates that are fitted in more than one step
_JOINT_FIT_CANDIDATES = 4  # of these, candidates fitted with their shapes and with the baseline's parameters
_PAIR_FITS = 4  # pairs that are fitted
_PARTNERS = 3  # candidates that are fitted beside the named effects
_RUNNERS_UP = 2  # further single effects used for such fits: of two missing effects, neither may be the best alone
# Share of the nominal model's excess below which the search starts from the re-fitted baseline
_CALIBRATION_SHARE = 0.3


class EffectSelection:
    """Select the effects of `candidates` that explain the evidence: call `run`, then `decide` and the other methods.

    progress: called with the current step, and the completed share of the search.
    """

    def __init__(self, model: Model, evidence: Evidence, candidates: list[Candidate], progress: Progress) -> None:
        self.model, self.candidates, self.progress = model, candidates, progress
        self.evidence = evidence
        self.named: tuple[Candidate, ...] = ()  # the effects that explain most
        self.values: dict[str, dict[str, float]] = {}  # fitted parameters by single candidate
        self.costs: dict[str, float] = {}  # by candidate, in the deciding round: each beside those named before
        self.by_run: dict[str, np.ndarray] = {}  # excess (k,) in each run, by single candidate
        self._contradiction: dict[str, float] = {}  # power that the candidate adds to outputs, by single candidate
        # Fits beside a linearised and beside the re-fitted baseline are each compared with their own baseline
        self._linear_costs: dict[str, float] = {}  # by candidate, beside the linearised baseline
        self._scores: dict[str, float] = {}  # by candidate that was fitted with the baseline's parameters
        self._at_bound: dict[str, str] = {}  # strength at its bound by effect, for effects dropped for this reason
        self.confidence = 0.5
        self.reading = ""  # name of the reading of the model's equations, "" for the first (reading.py)

    def run(self) -> None:
        """Fit the baseline, then one, two and three effects."""
        self._fit_baseline()
        evidence, base, start = self.evidence, self.fits.base, self.fits.start
        self.final = base
        self.explanation = self.fits.explain(base, 0)
        if not self.candidates:  # all of them are evident, or the model has none
            return
        self.progress("candidates", 0.1)
        self.search = CandidateSearch(evidence, start, 0.5 * LEAST_GAIN * evidence.count)
        ranked = self.search.screen(
            self.candidates, collect_starts(self.model, evidence, self.candidates, base.point, start.residual)
        )
        hopeful = [f for f in ranked if self.search.cost - f.cost > 0.5 * LEAST_GAIN * evidence.count]
        self._linear_costs = {f.name: f.cost for f in ranked}
        if not hopeful:
            return
        self.progress("the best candidates in full", 0.35)
        ranked = self._list_best_fits(self.search.improve(hopeful[:_FULL_FIT_CANDIDATES], 2), hopeful)
        self.progress("the finalists with the baseline", 0.5)
        own = start.point[0]
        jointly = self.fits.fit(
            [
                ((f.candidate,), (own, f.values))
                for f in ranked[:_JOINT_FIT_CANDIDATES]
                if self.fits.is_close(f, ranked[0])
            ]
        )
        for i, (at, (candidate,)) in enumerate(jointly):
            if i == 0 or candidate.is_off(at.point[1]):
                self.fits.refit_baseline_alone(at)
        self._linear_costs |= {f.name: f.cost for f in ranked}
        self.values = {f.name: f.values for f in ranked}
        self._record_single_fits(jointly)
        costs = {f.name: f.cost for f in ranked} | self._scores
        self._accept(*jointly[0], costs)
        if self._needs_more():
            near = self._find_indistinguishable()
            self._add_effects([(at, names) for at, names in jointly[1:] if names[0].name in near])
        if self.explanation.is_significant:
            self.progress("the model with the effects named", 0.8)
            self._finish()
            self._drop_idle(costs)
            self._drop_bounded(costs)

    def _fit_baseline(self) -> None:
        """Fit the baseline alone; replace the evidence by one in which no output outweighs the others."""
        evidence = self.evidence
        self.progress("baseline re-fitted", 0.02)
        self.reading, start, base = choose_reading(self.model, evidence)
        if evidence.compute_excess(base.residual) < _CALIBRATION_SHARE * evidence.compute_excess(start.residual):
            start = base = refit(evidence, linearise(evidence, base.point, base.free))  # calibration explains most
        self.fits = JointFits(evidence, start, base)
        self.evidence = self.fits.weaken_outliers()

    @staticmethod
    def _list_best_fits(*groups: Sequence[Fit]) -> list[Fit]:
        """Return the fits of all groups, best first; a candidate in several groups is taken from the first of them."""
        fits: dict[str, Fit] = {}
        for group in groups:
            for fit in group:
                fits.setdefault(fit.name, fit)
        return sorted(fits.values(), key=lambda fit: fit.cost)

    def _finish(self) -> None:
        """Fit the named effects until they converge, and the baseline alone from there."""
        self.final = self.fits.relinearise(self.final, self.named)
        self.fits.refit_baseline_alone(self.final)
        self.explanation = self.fits.explain(self.final, self.explanation.count)

    def _accept(self, at: LinearModel, candidates: tuple[Candidate, ...], costs: dict[str, float]) -> None:
        self.named, self.final, self.costs = candidates, at, costs
        self.explanation = self.fits.explain(at, len(candidates))

    def _add_effects(self, near: Sequence[JointFit]) -> None:
        """Try two effects, and a third beside them. near: fits of single effects that are nearly as good as the best."""
        self.progress("two effects", 0.6)
        own, sets = self.fits.start.point[0], self._extend_with_each(self.final, self.named)
        for at, candidates in near[:_RUNNERS_UP]:
            sets += self._extend_with_each(at, candidates)
        for _, (a, b), values in self.search.rank_pairs(_PAIR_FITS):
            if not {a.candidate, b.candidate} & set(self.named):  # else the fit beside the named effects starts closer
                sets.append(((a.candidate, b.candidate), (own, values)))
        while sets:
            best, *others = self.fits.fit(sets)
            if not self._is_justified(best, others):
                break
            at, candidates = best
            if self.explanation.is_sufficient and not self.fits.explain(at, len(candidates)).is_sufficient:
                break  # two effects must explain more than one effect to be named
            self._accept(at, candidates, {})
            sets = []
            if self._needs_more():
                self.progress("three effects", 0.7)
                sets = self._extend_with_each(self.final, self.named)

    def _drop_idle(self, costs: dict[str, float]) -> None:
        """Drop effects whose intervals include "off", unless the remaining effects would then be extended by them again.

        costs: of single effects, by name.
        """
        while self.explanation.is_sufficient and len(self.named) > 1 and (idle := self._find_idle()):
            parameters, effects = self.final.point
            sets = []
            for c in idle:
                others = {n: v for n, v in effects.items() if n not in c.declare_parameters()}
                sets.append((tuple(o for o in self.named if o is not c), (parameters, others)))
            at, kept = self.fits.fit(sets)[0]
            without, likelier = self.fits.explain(at, len(kept)), at.prior_chi2 - self.final.prior_chi2
            gain = (without.best - self.explanation.best) / without.size
            earned = is_worthwhile(gain, likelier, without.size, without.redundancy) and without.justifies_further(
                gain, gain
            )
            if earned or not without.is_sufficient:
                break
            if len(kept) == 1:
                self._record_single_fits([(at, kept)])
                costs = costs | self._scores
            self._accept(at, kept, costs if len(kept) == 1 else {})
            self._finish()

    def _drop_bounded(self, costs: dict[str, float]) -> None:
        """Drop effects at a bound, if the others explain enough without them; otherwise `decide` names none.

        costs: of single effects, by name.
        """
        effects = self.final.point[1]
        kept = tuple(c for c in self.named if not c.list_at_bounds(effects))
        if not kept or kept == self.named:
            return
        names = {n for c in kept for n in c.declare_parameters()}
        start = self.final.point[0], {n: v for n, v in effects.items() if n in names}
        at, _ = self.fits.fit([(kept, start)])[0]
        if self.fits.explain(at, len(kept)).is_sufficient:
            if len(kept) == 1:
                self._record_single_fits([(at, kept)])
                costs = costs | self._scores
            self._accept(at, kept, costs if len(kept) == 1 else {})
            self._finish()

    def list_at_bounds(self) -> list[str]:
        """Return the strengths at a bound of the effects that explain most, by dotted name; such effects are not credible."""
        return [n for c in self.named for n in c.list_at_bounds(self.final.point[1])]

    def _find_idle(self) -> list[Candidate]:
        """Return the named effects that may be off: the 95 % interval of every strength includes its off value."""
        unsure = {e.name for e in self.estimate_parameters(effects=True) if e.ci95[0] <= e.nominal <= e.ci95[1]}
        return [c for c in self.named if all(f"{c.name}.{s.name}" in unsure for s in c.strengths)]

    def _record_single_fits(self, fits: Sequence[JointFit]) -> None:
        """Store score, parameters and the excess by run of fits of single effects."""
        for at, (c,) in fits:
            self._scores[c.name] = self.fits.score(at)
            self.values[c.name] = dict(at.point[1])
            self.by_run[c.name] = self.evidence.compute_excess_by_run(at.residual)
            self._contradiction[c.name] = self.evidence.compute_contradiction(at.residual, self.fits.base.residual)

    def _needs_more(self) -> bool:
        """Return whether to search for a further effect; if so at first, re-fit the named effects and check again."""
        if self.explanation.is_incomplete:
            self.final = self.fits.relinearise(self.final, self.named)
            self.explanation = self.fits.explain(self.final, self.explanation.count)
        return self.explanation.is_incomplete

    def _extend_with_each(self, at: LinearModel, candidates: tuple[Candidate, ...]) -> list[Start]:
        """Return sets of `candidates`, fitted in `at`, with one more candidate each: those with the largest predicted gain."""
        search = CandidateSearch(self.evidence, at, 0.5 * LEAST_GAIN * self.evidence.count, self.search.directions)
        promising = search.extend([c.name for c in candidates], _PARTNERS)
        parameters, effects = at.point
        return [((*candidates, fit.candidate), (parameters, {**effects, **fit.values})) for fit in promising]

    def _is_justified(self, fit: JointFit, others: Sequence[JointFit]) -> bool:
        """Return whether one more effect may be named: it closes enough, exceeds chance, and predicts left-out runs better."""
        w, (at, candidates) = self.explanation, fit
        new = set(candidates) - set(self.named)
        without = [self.fits.score(other) for other, theirs in others if not new & set(theirs)]
        gain, second = (w.best - at.cost) / w.size, (w.best - min(without, default=np.inf)) / w.size
        likelier = self.final.prior_chi2 - at.prior_chi2
        return (
            is_worthwhile(gain, likelier, w.size, w.redundancy)
            and w.justifies_further(gain, second)
            and self._predicts_better(at)
        )

    def _predicts_better(self, at: LinearModel) -> bool:
        """Return whether `at` predicts runs left out in turn better than the fit so far; chi^2 of the calibration counts."""
        squares = self.evidence.redundancy * np.array([self.final.prior_chi2, at.prior_chi2])
        for k, points in enumerate(fit_without_each(self.evidence, self.final, at)):
            squares += [np.sum(r[self.evidence.pieces[k]] ** 2) for r in self.evidence.compute_residuals(points)]
        return bool(squares[1] < squares[0])

    def _compute_gain(self, name: str) -> float:
        """Return the gain of a candidate over the baseline; 0 for one that is off at best."""
        base = self.fits.base.cost
        if name in self._scores:
            return max(base - self._scores[name], 0.0)
        return max(min(base, self.search.cost) - self._linear_costs[name], 0.0)

    def decide(self) -> tuple[str, list[str], list[list[str]]]:
        """Return the verdict, the named effects, and the sets of alternatives."""
        w = self.explanation
        if not self.named or not w.is_significant:
            if w.excess > DISAGREEMENT:
                self.confidence = NONE_CONFIDENCE
                return NONE_OF_THESE, [], []
            self.confidence = NOTHING_CONFIDENCE
            return NOTHING, [], []
        if not w.is_sufficient:
            self.confidence = float(np.clip(1.0 - w.closed, 0.3, 0.95))
            return NONE_OF_THESE, [], []
        if self.list_at_bounds():
            self.confidence = NONE_CONFIDENCE
            return NONE_OF_THESE, [], []
        self.confidence = compute_confidence(w)
        if w.count > 1:
            return NAMED, [c.name for c in self.named], []
        candidates = {c.name: c for c in self.candidates}
        best = self.named[0].name
        near = [
            n for n in self._find_indistinguishable() if n == best or not candidates[n].list_at_bounds(self.values[n])
        ]
        if len(near) > 1:
            return ONE_OF, [], [near]
        return NAMED, [self.named[0].name], []

    def _find_indistinguishable(self) -> list[str]:
        """Return the single effects that cannot be distinguished from the best one, the best one first."""
        near = find_aliases(self.costs, self.explanation, self.by_run)
        return [
            n for n in near if self._contradiction.get(n, 0.0) <= self._contradiction.get(near[0], 0.0) + DISAGREEMENT
        ]

    def drop_effects(self) -> None:
        """Return to the baseline."""
        self._at_bound = {n.partition(".")[0]: n for n in self.list_at_bounds()}
        self.named, self.final = (), self.fits.base

    def judge_rivals(self) -> list[Rival]:
        """Return every candidate with the reason why it is not named, "" if it is named."""
        w, size = self.explanation, self.evidence.count
        best = {c.name for c in self.named} if w.is_sufficient else set()
        whole = max(w.gain + w.rest, LEAST_GAIN) * size  # whole excess
        rivals = []
        units = {c.name: {f"{c.name}.{p.name}": p.unit for p in c.parameters} for c in self.candidates}
        tried = [
            Rival(name, 0.0, self._compute_gain(name), self.values.get(name, {}), "", 1, units[name])
            for name in self._linear_costs
        ]
        for r in sorted(tried, key=lambda r: -r.gain):
            closed = float(np.clip(r.gain / whole, 0.0, 1.0))
            reason = f"closes {closed:.1%} of the gap where {w.closed:.1%} can be closed"
            if r.gain <= LEAST_GAIN * size:
                reason = "explains nothing more than the parameters of the baseline do"
            elif self._contradiction.get(r.name, 0.0) > DISAGREEMENT:
                reason = "makes an output worse than the baseline alone, which a missing effect cannot do"
            elif r.name in self._at_bound:
                reason = (
                    f"closes {closed:.0%} of the gap with {self._at_bound[r.name]} at its bound, and is not accepted"
                )
            elif not w.is_significant:
                reason = "explains no more than chance or a slightly wrong law can"
            elif not best:
                reason = f"closes {closed:.0%} of the gap; to be named it must close {LEAST_CLOSED[0]:.0%}"
            rivals.append(replace(r, closed=closed, reason="" if r.name in best else reason))
        return rivals

    def collect_equations(self, alternatives: list[list[str]]) -> dict[str, str]:
        """Return the equations of the alternatives, by name."""
        wanted = {n for group in alternatives for n in group}
        return {c.name: c.equation for c in self.candidates if c.name in wanted}

    def estimate_parameters(self, effects: bool) -> list[Estimate]:
        """Return fitted parameters of the effects, or of the baseline, with 95 % intervals."""
        at, half = self.final, compute_half_widths(self.evidence, self.final)
        declared = dict(self.model.parameters) | {n: p for c in self.named for n, p in c.declare_parameters().items()}
        estimates = []
        if self.reading and not effects:
            for name in list_readings(self.model)[self.reading]:
                value, p = float(at.point[0][name]), declared[name]
                estimates.append(Estimate(name, value, p.unit, (value, value), p.value))
        for f, h in zip(at.free, half, strict=True):
            if (f.centre is None) == effects:
                value, p, reach = at.find_value(f), declared[f.name], float(h)
                interval = max(value - reach, p.bounds[0]), min(value + reach, p.bounds[1])
                estimates.append(Estimate(f.name, value, p.unit, interval, p.value, p.uncertainty))
        return estimates
