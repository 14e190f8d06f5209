"""Starts: the parameters at which the fit of each candidate starts."""

from collections.abc import Sequence

import numpy as np

from clutch_hil.fitting.evidence import Evidence, Point
from clutch_hil.fitting.model import Candidate, Hinting, Model

_START_RUNS = 2  # runs with the largest residual, from which starts are read; set by hand: more runs take longer
_SHAPE_FACTOR = 4.0  # between starts of a shape parameter; chosen: three starts then cover a factor of 16


def collect_starts(
    model: Model, evidence: Evidence, candidates: Sequence[Candidate], point: Point, residual: np.ndarray
) -> dict[str, list[dict[str, float]]]:
    """Return starting parameters by dotted name, by candidate.

    These are the typical values, and the typical values with each shape larger and smaller. Where the model can read starts
    from runs, they are read from the runs that disagree most. point: of the re-fitted baseline. residual: (size,) in floors; it
    ranks the runs.
    """
    starts = {c.name: [c.list_typical_values(), *_vary_shapes(c)] for c in candidates}
    if not isinstance(model, Hinting):
        return starts
    power = [float(np.sum(residual[p] ** 2)) for p in evidence.pieces]
    hints: dict[str, list[dict[str, float]]] = {}
    for k in np.argsort(power)[::-1][:_START_RUNS]:
        run, predicted = evidence.runs[k], evidence.predict(point, int(k))
        residuals = {c: run[c] - predicted[c] for c in evidence.columns}
        for c in candidates:
            hints.setdefault(c.name, []).extend(model.suggest_starts(c, run, residuals))
    return starts | {name: read for name, read in hints.items() if read}


def _vary_shapes(candidate: Candidate) -> list[dict[str, float]]:
    """Return typical values with one shape changed by a factor: the direction of an effect depends on its time constants."""
    varied = []
    for shape in candidate.shapes:
        for factor in (_SHAPE_FACTOR, 1.0 / _SHAPE_FACTOR):
            value = float(np.clip(shape.typical * factor, *shape.bounds))
            if shape.typical > 0.0 and shape.unit != "rad" and value != shape.typical:
                varied.append(candidate.list_typical_values() | {f"{candidate.name}.{shape.name}": value})
    return varied
