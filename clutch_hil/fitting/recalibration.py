"""Recalibration: the baseline fitted beyond its stated uncertainty, within its declared bounds.

Equation        minimise |r(x)|^2 + n sum ((x - x_0)/(_WIDE s))^2,  s: stated uncertainty (fit.py).  The second term only keeps
                parameters in place that the runs do not show
Assumptions     no effect is missing
"""

from collections.abc import Sequence
from typing import Protocol, runtime_checkable

import numpy as np

from clutch_hil.fitting.evidence import Evidence, Point
from clutch_hil.fitting.fit import FreeParameter, LinearModel, linearise, refit
from clutch_hil.fitting.model import Values

FLOOR = 0.03  # of the number of residuals: power above the noise floor that counts as none (decision.CLOSED_EXCESS)
_WIDE = 30.0  # stated uncertainties: a parameter that is wrong by 10 then costs 0.1 n, as good as nothing
_STEP = 0.2  # stated uncertainties: step of differences, as in fit.py
_MOST_ROUNDS = 12  # linearisations; 2 to 8 are usual
LEAST_GAIN = 0.2  # of the power above the floor: a round that gains less goes nowhere; usual where an effect is missing


@runtime_checkable
class Identifiable(Protocol):
    """A model whose rig a command identifies from recordings.

    identification: that command, as it is typed, with RUN... for the runs.
    """

    identification: str

    def recalibrate(self, evidence: Evidence, near: Values) -> Values:
        """Parameters of the baseline that fit `evidence` best without any effect, within declared bounds, beginning `near`."""
        ...


def recalibrate(evidence: Evidence, near: Point) -> tuple[Values, float]:
    """Parameters that fit best without any effect, beginning `near` a point, and the power that they leave above the floor.

    The power is a share of the number of residuals. Identifiable models do it themselves.
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
    """Fit the parameters `free` from `start` until little of the power above the floor is gained.

    Its cost is infinite where `start` cannot be simulated.
    """
    at = linearise(evidence, start, free)
    for _ in range(_MOST_ROUNDS):
        if not np.isfinite(at.cost):
            break
        before, at = evidence.compute_excess(at.residual), refit(evidence, at, 0)
        after = evidence.compute_excess(at.residual)
        if not before - after > LEAST_GAIN * after:
            break
        at = linearise(evidence, at.point, free)
    return at
