"""Joint fits: fit sets of effects together with the baseline's parameters, and the baseline alone."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from clutch_hil.discrepancy.candidates import Fit
from clutch_hil.discrepancy.decision import Explanation
from clutch_hil.fitting.evidence import Evidence, Point
from clutch_hil.fitting.fit import LinearModel, free_effect, linearise, refit
from clutch_hil.fitting.model import Candidate

_RELINEARISATIONS = 3  # of a set of effects
_CONVERGED = 0.01  # of the gain over the baseline: a smaller improvement ends a fit
_CLOSE_REGRET = 0.2  # share of the best gain: a rival that is worse by at most this is fitted as fully as the best
# Weight in a candidate's score of the power that it adds to an output. Development: true effects add none.
_CONTRADICTION_WEIGHT = 2.0
JointFit = tuple[LinearModel, tuple[Candidate, ...]]
Start = tuple[tuple[Candidate, ...], Point]  # candidates, and the starting point of their fit


class JointFits:
    """Fits of sets of effects to `evidence`. `base`: best fit of the baseline alone. `start`: where fits start."""

    def __init__(self, evidence: Evidence, start: LinearModel, base: LinearModel) -> None:
        self.evidence, self.start, self.base = evidence, start, base

    def weaken_outliers(self) -> Evidence:
        """Replace the evidence by one in which no output outweighs the others (`Evidence.with_tolerance`), and return it."""
        evidence = self.evidence.with_tolerance(self.base.residual)
        before = self.evidence.weights  # 0 in rows that the model does not predict
        factor = np.divide(evidence.weights, before, out=np.ones_like(before), where=before > 0.0)
        self.evidence, same = evidence, self.start is self.base
        self.start, self.base = (
            replace(at, residual=factor * at.residual, jacobian=factor[:, None] * at.jacobian)
            for at in (self.start, self.base)
        )
        self.base = refit(evidence, self.base, 0)
        if same:
            self.start = self.base
        return evidence

    def refit_baseline_alone(self, at: LinearModel) -> None:
        """Re-fit the baseline without effects, starting from `at`, a fit with effects. Keep the result if it is better.

        A gain that the baseline can reach alone is not credited to an effect.
        """
        own = [i for i, f in enumerate(at.free) if f.centre is not None]
        point: Point = at.point[0], {}
        residual, jacobian = self.evidence.compute_residuals([point])[0], at.jacobian[:, own]
        alone = LinearModel(point, tuple(at.free[i] for i in own), residual, jacobian, at.redundancy)
        again = refit(self.evidence, alone, 0)
        if again.cost < self.base.cost:
            self.base = again

    def fit(self, sets: Sequence[Start]) -> list[JointFit]:
        """Fit each set of candidates together with the baseline's parameters; the best first.

        The sensitivities of the baseline are not updated. The best set and those close to it are fitted until they converge.
        """
        fits = sorted(((self._fit_set(*one, 1), one[0]) for one in sets), key=self._rank)
        least = self._rank(fits[0])
        close = least + _CLOSE_REGRET * max(self.base.cost - least, 0.0)
        fits = [
            (self._fit_set(candidates, at.point, _RELINEARISATIONS - 1), candidates)
            if self.score(at) <= close
            else (at, candidates)
            for at, candidates in fits
        ]
        return sorted(fits, key=self._rank)

    def is_close(self, fit: Fit, best: Fit) -> bool:
        """Return whether a candidate's single fit gains nearly as much as the `best` one."""
        return fit.cost - best.cost <= _CLOSE_REGRET * max(self.base.cost - best.cost, 0.0)

    def score(self, at: LinearModel) -> float:
        """Return the score that ranks fits: cost plus a penalty on power added to outputs; infinite if the simulation fails."""
        if not np.isfinite(at.cost):
            return np.inf
        return (
            at.cost
            + _CONTRADICTION_WEIGHT
            * self.evidence.compute_contradiction(at.residual, self.base.residual)
            * self.evidence.count
        )

    def explain(self, at: LinearModel, count: int) -> Explanation:
        """Return how much `at`, a fit of `count` effects, explains beyond the baseline."""
        e = self.evidence
        left = e.compute_excess(self.base.residual), e.compute_excess(at.residual)
        return Explanation(
            self.base.cost,
            at.cost,
            e.count,
            count,
            *left,
            self.base.prior_chi2 - at.prior_chi2,
            at.prior_chi2,
            e.redundancy,
        )

    def relinearise(self, at: LinearModel, candidates: tuple[Candidate, ...]) -> LinearModel:
        """Re-fit `at`, a fit of `candidates`, after a linearisation of the baseline at that point."""
        free = [f for f in at.free if f.centre is not None]
        free += [f for c in candidates for f in free_effect(c, at.point[1])]
        return refit(self.evidence, linearise(self.evidence, at.point, free), 0)

    def _fit_set(self, candidates: tuple[Candidate, ...], point: Point, renewals: int) -> LinearModel:
        """Fit a set of candidates starting from `point`; the effects are linearised at most `renewals` times."""
        residual = None
        for _ in range(renewals):
            free = [f for c in candidates for f in free_effect(c, point[1])]
            own = linearise(self.evidence, point, free, residual)
            jacobian = np.hstack([self.start.jacobian, own.jacobian])
            before = LinearModel(point, self.start.free + own.free, own.residual, jacobian, own.redundancy)
            if not np.isfinite(before.cost):  # the model cannot be simulated there
                return before
            after = refit(self.evidence, before, 0)
            point, residual = after.point, after.residual
            if before.cost - after.cost < _CONVERGED * max(self.base.cost - after.cost, 0.0):
                break
        return after

    def _rank(self, fit: JointFit) -> float:
        return self.score(fit[0])
