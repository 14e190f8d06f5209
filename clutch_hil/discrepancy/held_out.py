"""Held-out runs: errors of the model before and after the fit on runs that were not fitted, and the noise floor."""

from collections.abc import Sequence

import numpy as np

from clutch_hil.discrepancy.regimes import ALL, Regimes
from clutch_hil.discrepancy.result import Gap, Trace
from clutch_hil.fitting.evidence import Evidence, Point
from clutch_hil.fitting.fit import LinearModel
from clutch_hil.fitting.model import Model, Partial, Values


def fit_without_each(evidence: Evidence, before: LinearModel, after: LinearModel) -> list[tuple[Point, Point]]:
    """Return for each run the points, before and after, that fit the other runs best: one linear step from the fit to all."""
    return [
        (_refit_without(evidence, before, k), _refit_without(evidence, after, k)) for k in range(len(evidence.runs))
    ]


def _refit_without(evidence: Evidence, at: LinearModel, k: int) -> Point:
    if len(evidence.runs) < 2:
        return at.point
    others = np.ones(evidence.size, bool)
    others[evidence.pieces[k]] = False
    rest = LinearModel(at.point, at.free, at.residual[others], at.jacobian[others], at.redundancy)
    return at.move_by(rest.find_best(rest.residual)[0])


def measure_gaps(
    model: Model, traces: Sequence[Trace], floors: Values
) -> tuple[dict[str, Gap], dict[str, dict[str, Gap]]]:
    """Return root mean square errors over all `traces`: by output, and by output and regime; `floors` by output.

    Rows that the model does not predict do not count.
    """
    regimes = Regimes(model, [t.columns for t in traces], {n: p.value for n, p in model.parameters.items()})
    masks = [regimes(trace.columns) for trace in traces]
    names = list(dict.fromkeys(name for mask in masks for name in mask if name != ALL))
    whole, parts = {}, {}
    for output in model.outputs:
        c = output.column
        errors = [(t.measured[c] - t.before[c], t.measured[c] - t.after[c]) for t in traces]
        seen = [_find_seen(model, trace, c) for trace in traces]
        whole[c] = _measure_gap(errors, seen, floors[c])
        by_name = {
            name: _measure_gap(
                errors,
                [m.get(name, np.zeros(len(own), bool)) & own for m, own in zip(masks, seen, strict=True)],
                floors[c],
            )
            for name in names
        }
        parts[c] = {name: gap for name, gap in by_name.items() if np.isfinite(gap.before)}
    return whole, parts


def _find_seen(model: Model, trace: Trace, column: str) -> np.ndarray:
    """Return a mask (n,) of the rows in which the model predicts the output `column`."""
    unseen = model.find_unseen(trace.columns).get(column) if isinstance(model, Partial) else None
    return np.ones(len(trace.measured[column]), bool) if unseen is None else ~unseen


def _measure_gap(errors: Sequence[tuple[np.ndarray, np.ndarray]], masks: Sequence[np.ndarray], floor: float) -> Gap:
    before = np.concatenate([b[m] for (b, _), m in zip(errors, masks, strict=True)])
    after = np.concatenate([a[m] for (_, a), m in zip(errors, masks, strict=True)])
    if not len(before):
        return Gap(float("nan"), float("nan"), floor)
    return Gap(float(np.sqrt(np.mean(before**2))), float(np.sqrt(np.mean(after**2))), floor)
