"""Recalibration: fit of the baseline beyond its stated uncertainty, within its declared bounds.

Equation        minimise |r(x)|^2 + n sum ((x - x_0)/(_WIDE s))^2,  s: stated uncertainty (fit.py).  The second term only keeps
                parameters in place that the runs do not excite
Assumptions     no effect is missing
"""

from collections.abc import Sequence
from typing import Protocol, runtime_checkable

import numpy as np

from clutch_hil.fitting.evidence import Evidence, Point
from clutch_hil.fitting.fit import FreeParameter, LinearModel, linearise, refit
from clutch_hil.fitting.model import Values

# Share of the number of residuals: less power above the noise floor counts as none (decision.CLOSED_EXCESS)
FLOOR = 0.03
# Prior width in stated uncertainties: a parameter that is wrong by 10 then costs 0.1 n, which is negligible
_WIDE = 30.0
_STEP = 0.2  # step of differences in stated uncertainties, as in fit.py
_MOST_ROUNDS = 12  # linearisations; 2 to 8 are usual
LEAST_GAIN = 0.2  # share of the power above the floor: a smaller gain ends the fit; usual where an effect is missing


@runtime_checkable
class Identifiable(Protocol):
    """A model whose rig can be identified from recordings by a command.

    identification: the command line, with RUN... for the runs.
    """

    identification: str

    def recalibrate(self, evidence: Evidence, near: Values) -> Values:
        """Fit the baseline to `evidence` without effects, within declared bounds, starting at `near`. Return its parameters."""
        ...


def recalibrate(evidence: Evidence, near: Point) -> tuple[Values, float]:
    """Fit the baseline without effects from the point `near`. Return its parameters and the mean square above the floor.

    Identifiable models use their own fit.
    """
    model = evidence.model
    if isinstance(model, Identifiable):
        values = model.recalibrate(evidence, near[0])
    else:
        free = [
            FreeParameter(n, _STEP * p.uncertainty, _WIDE * p.uncertainty, *p.bounds, p.value)
            for n, p in model.parameters.items()
            if p.uncertainty > 0.0 and p.bounds[0] < p.bounds[1]
        ]
        values = fit_to_end(evidence, (near[0], {}), free).point[0]
    return values, evidence.compute_excess(evidence.compute_residuals([(values, {})])[0])


def fit_to_end(evidence: Evidence, start: Point, free: Sequence[FreeParameter]) -> LinearModel:
    """Fit the parameters `free` from `start` until a round gains little of the power above the floor.

    The cost is infinite where `start` cannot be simulated.
    """
    at = linearise(evidence, start, free)
    for _ in range(_MOST_ROUNDS):
        if not np.isfinite(at.cost):
            break
        before, at = evidence.compute_excess(at.residual), refit(evidence, at, 0)
        after = evidence.compute_excess(at.residual)
        if not before - after > LEAST_GAIN * after:
            break
        at = linearise(evidence, at.point, free, at.residual)
    return at
