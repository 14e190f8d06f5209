"""Reading: find the interpretation of the baseline's equations that agrees best with the runs.

Where the source of the equations is ambiguous, a model has several readings (`Readable`). A reading is not an effect, because
nothing is missing in any of them. The baseline is re-fitted in each reading, and the search uses the one with the lowest cost.
"""

import numpy as np

from clutch_hil.fitting.evidence import Evidence, Point
from clutch_hil.fitting.fit import LinearModel, free_baseline, linearise, refit
from clutch_hil.fitting.model import Model, find_calibration, list_readings

_SAME_RESIDUAL = 1e-3  # floors: readings that differ by less in every residual count as the same


def choose_reading(model: Model, evidence: Evidence) -> tuple[str, LinearModel, LinearModel]:
    """Return the name of the reading with the lowest cost, and the baseline in it: nominal, and re-fitted.

    The name is "" for the first reading, and where the runs do not distinguish the readings.
    """
    names, free = list(list_readings(model)), free_baseline(model.parameters, find_calibration(model))
    nominal = {n: p.value for n, p in model.parameters.items()}
    points: list[Point] = [({**nominal, **values}, {}) for values in list_readings(model).values()]
    residuals_by_reading = evidence.compute_residuals(points)
    apart = [
        i
        for i, r in enumerate(residuals_by_reading)
        if i == 0 or not np.allclose(r, residuals_by_reading[0], rtol=0.0, atol=_SAME_RESIDUAL)
    ]
    starts = {i: linearise(evidence, points[i], free) for i in apart}
    bases = {i: refit(evidence, start, 0) for i, start in starts.items()}
    best = min(apart, key=lambda i: bases[i].cost)
    return names[best] if best else "", starts[best], bases[best]
