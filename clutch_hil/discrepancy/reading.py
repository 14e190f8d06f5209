"""Reading: of the ways in which a baseline's equations can be read, the one that suits the runs.

A reading is no effect: what it changes is open in the equations themselves, and nothing is missing in either. So the baseline
is re-fitted in each, and the cheapest fit is the baseline of the search.
"""

import numpy as np

from clutch_hil.discrepancy.evidence import Evidence, Point
from clutch_hil.discrepancy.fit import Linear, baseline_free, linearised, refitted
from clutch_hil.discrepancy.model import Model, calibration, readings

_SAME = 1e-3  # floors: readings that differ by less in every residual are one


def best_reading(model: Model, evidence: Evidence) -> tuple[str, Linear, Linear]:
    """Its name, "" for the first one or where the runs do not tell, and the baseline in it: nominal, and re-fitted."""
    names, free = list(readings(model)), baseline_free(model.parameters, calibration(model))
    nominal = {n: p.value for n, p in model.parameters.items()}
    points: list[Point] = [({**nominal, **values}, {}) for values in readings(model).values()]
    told = evidence.residuals(points)
    apart = [i for i, r in enumerate(told) if i == 0 or not np.allclose(r, told[0], rtol=0.0, atol=_SAME)]
    starts = {i: linearised(evidence, points[i], free) for i in apart}
    bases = {i: refitted(evidence, start, 0) for i, start in starts.items()}
    best = min(apart, key=lambda i: bases[i].cost)
    return names[best] if best else "", starts[best], bases[best]
