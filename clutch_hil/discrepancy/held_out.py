"""Held out: errors before and after on runs that were not fitted, against the floor."""

from collections.abc import Sequence

import numpy as np

from clutch_hil.discrepancy.evidence import Evidence, Point
from clutch_hil.discrepancy.fit import Linear
from clutch_hil.discrepancy.model import Model, Values
from clutch_hil.discrepancy.regimes import ALL, Regimes
from clutch_hil.discrepancy.result import Gap, Trace


def left_out(evidence: Evidence, before: Linear, after: Linear) -> list[tuple[Point, Point]]:
    """For each run the parameters, before and after, that fit the other runs best, by one linear step from the whole fit."""
    return [(_without(evidence, before, k), _without(evidence, after, k)) for k in range(len(evidence.runs))]


def _without(evidence: Evidence, at: Linear, k: int) -> Point:
    if len(evidence.runs) < 2:
        return at.point
    others = np.ones(evidence.size, bool)
    others[evidence.pieces[k]] = False
    rest = Linear(at.point, at.free, at.residual[others], at.jacobian[others], at.alike)
    return at.moved(rest.best(rest.residual)[0])


def gaps(model: Model, traces: Sequence[Trace], floors: Values) -> tuple[dict[str, Gap], dict[str, dict[str, Gap]]]:
    """Root mean square errors over all `traces` by output, and by output and regime."""
    regimes = Regimes(model, [t.columns for t in traces], {n: p.value for n, p in model.parameters.items()})
    masks = [regimes(trace.columns) for trace in traces]
    names = list(dict.fromkeys(name for mask in masks for name in mask if name != ALL))
    whole, parts = {}, {}
    for output in model.outputs:
        c = output.column
        errors = [(t.measured[c] - t.before[c], t.measured[c] - t.after[c]) for t in traces]
        whole[c] = _gap(errors, [np.ones(len(b), bool) for b, _ in errors], floors[c])
        by_name = {
            name: _gap(
                errors,
                [m.get(name, np.zeros(len(b), bool)) for m, (b, _) in zip(masks, errors, strict=True)],
                floors[c],
            )
            for name in names
        }
        parts[c] = {name: gap for name, gap in by_name.items() if np.isfinite(gap.before)}
    return whole, parts


def _gap(errors: Sequence[tuple[np.ndarray, np.ndarray]], masks: Sequence[np.ndarray], floor: float) -> Gap:
    before = np.concatenate([b[m] for (b, _), m in zip(errors, masks, strict=True)])
    after = np.concatenate([a[m] for (_, a), m in zip(errors, masks, strict=True)])
    if not len(before):
        return Gap(float("nan"), float("nan"), floor)
    return Gap(float(np.sqrt(np.mean(before**2))), float(np.sqrt(np.mean(after**2))), floor)
