"""Held-out runs: errors of the model before and after the fit on runs that were not fitted, and the noise floor."""

from collections.abc import Mapping, Sequence

import numpy as np

from clutch_hil.discrepancy.regimes import ALL, Regimes
from clutch_hil.discrepancy.result import Gap, Trace
from clutch_hil.fitting.evidence import Evidence, Point
from clutch_hil.fitting.fit import LinearModel
from clutch_hil.fitting.model import Model, Partial, Values
from clutch_hil.fitting.noise import pool_noise

# Of the power above the floor on runs that were not fitted: named effects that close less are doubtful. In the battery two of
# 690 verdicts with a visible gap close less, and both names are right. A hidden elastic shaft, named presliding, closed 0.15
_LEAST_CLOSED = 0.5
_STEP_SHARES = (1.0, 0.4, 0.1)  # shares of a linear step that are tried
_VISIBLE = 1.1  # floors: an error below it is no gap
DOUBTFUL_CONFIDENCE = 0.5  # largest confidence of such a verdict: set by hand


def fit_without_each(evidence: Evidence, before: LinearModel, after: LinearModel) -> list[tuple[Point, Point]]:
    """Return for each run the points, before and after, that fit the other runs best: one linear step from the fit to all.

    The step is shortened, or not taken, where it fits the other runs worse.
    """
    return [
        (_refit_without(evidence, before, k), _refit_without(evidence, after, k)) for k in range(len(evidence.runs))
    ]


def _refit_without(evidence: Evidence, at: LinearModel, k: int) -> Point:
    if len(evidence.runs) < 2:
        return at.point
    others = np.ones(evidence.size, bool)
    others[evidence.pieces[k]] = False
    rest = LinearModel(at.point, at.free, at.residual[others], at.jacobian[others], at.redundancy)
    move = rest.find_best(rest.residual)[0]
    for share in _STEP_SHARES:
        point = at.move_by(move, share)
        if rest.move_to(point, evidence.compute_residuals([point])[0][others]).cost <= rest.cost:
            return point
    return at.point


def measure_gaps(
    model: Model, traces: Sequence[Trace], floors: Values
) -> tuple[dict[str, Gap], dict[str, dict[str, Gap]]]:
    """Return root mean square errors over all `traces`: by output, and by output and regime; `floors` by output.

    Rows that the model does not predict do not count. The floor of a gap is the noise of these traces.
    """
    regimes = Regimes(model, [t.columns for t in traces], {n: p.value for n, p in model.parameters.items()})
    masks = [regimes(trace.columns) for trace in traces]
    names = list(dict.fromkeys(name for mask in masks for name in mask if name != ALL))
    whole, parts = {}, {}
    for output in model.outputs:
        c = output.column
        errors = [(t.measured[c] - t.before[c], t.measured[c] - t.after[c]) for t in traces]
        seen = [_find_seen(model, trace, c) for trace in traces]
        floor = pool_noise([trace.measured[c] for trace in traces], floors[c])
        whole[c] = _measure_gap(errors, seen, floor)
        by_name = {
            name: _measure_gap(
                errors,
                [m.get(name, np.zeros(len(own), bool)) & own for m, own in zip(masks, seen, strict=True)],
                floor,
            )
            for name in names
        }
        parts[c] = {name: gap for name, gap in by_name.items() if np.isfinite(gap.before)}
    return whole, parts


def _find_seen(model: Model, trace: Trace, column: str) -> np.ndarray:
    """Return a mask (n,) of the rows in which the model predicts the output `column`."""
    unseen = model.find_unseen(trace.columns).get(column) if isinstance(model, Partial) else None
    return np.ones(len(trace.measured[column]), bool) if unseen is None else ~unseen


def note_open_gap(gaps: Mapping[str, Gap]) -> list[str]:
    """Return a note if an effect closes too little of the visible `gaps`, by output, on runs that were not fitted."""
    seen = [gap for gap in gaps.values() if gap.before > _VISIBLE * gap.floor > 0.0]
    before, after = (
        sum(max((rms / gap.floor) ** 2 - 1.0, 0.0) for gap, rms in zip(seen, errors, strict=True))
        for errors in ([gap.before for gap in seen], [gap.after for gap in seen])
    )
    if not seen or before - after >= _LEAST_CLOSED * before:
        return []
    how = f"closes {1.0 - after / before:.0%} of the gap" if after < before else "closes nothing of the gap"
    return [f"on runs that were not fitted this {how}: it may only imitate what is missing; record more runs"]


def _measure_gap(errors: Sequence[tuple[np.ndarray, np.ndarray]], masks: Sequence[np.ndarray], floor: float) -> Gap:
    before = np.concatenate([b[m] for (b, _), m in zip(errors, masks, strict=True)])
    after = np.concatenate([a[m] for (_, a), m in zip(errors, masks, strict=True)])
    if not len(before):
        return Gap(float("nan"), float("nan"), floor)
    return Gap(float(np.sqrt(np.mean(before**2))), float(np.sqrt(np.mean(after**2))), floor)
