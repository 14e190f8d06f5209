"""Unlike runs: a few of the fitted runs that hold most of a disagreement, and held-out runs that the model does not predict.

Equation        p = max((|r|^2 - N)/N - 3 sqrt(2/N), 0):  power of a run above the floor and chance, N its residuals
                a run disagrees:  p > DISAGREEMENT
Assumptions     an effect that acts in all runs, but is excited in a few, looks the same as one that acts in these alone
"""

from collections.abc import Mapping, Sequence
from math import sqrt

import numpy as np

from clutch_hil.discrepancy.decision import DISAGREEMENT
from clutch_hil.fitting.evidence import Evidence, Point
from clutch_hil.fitting.model import Columns, Model, Output, Values
from protocols.errors import join_names
from protocols.files.units import space_unit

_STANDARD_DEVIATIONS = 3.0  # of the mean square of white noise
_MOST = 0.8  # of the power: where half of the runs or fewer hold as much, they are noted


def compute_powers(model: Model, runs: Sequence[Columns], point: Point, floors: Values, rounding: Values) -> np.ndarray:
    """Return the power p (k,) of each of `runs` at `point`; floors and rounding as of `Evidence`."""
    powers = []
    for run in runs:
        alone = Evidence(model, [run], floors, rounding)
        excess = alone.compute_excess(alone.compute_residuals([point])[0])
        powers.append(max(excess - _STANDARD_DEVIATIONS * sqrt(2.0 / alone.count), 0.0))
    return np.array(powers)


def note_unlike(names: Sequence[str], powers: np.ndarray) -> list[str]:
    """Return a note if a few of the runs `names` hold most of the power `powers` (k,)."""
    order = np.argsort(-powers, kind="stable")
    shares = np.cumsum(powers[order]) / max(float(powers.sum()), 1e-12)
    count = int(np.argmax(shares >= _MOST)) + 1
    if shares[-1] < _MOST or 2 * count > len(names):
        return []
    which = _list_runs([names[k] for k in order[:count]])
    return [
        f"{shares[count - 1]:.0%} of what disagrees in {len(names)} runs is in {which}: something acts or is excited there"
        " alone. Search in such runs alone, and compare how they were recorded"
    ]


def describe_held_out(
    model: Model, held: Mapping[str, Columns], powers: np.ndarray, point: Point, floors: Values
) -> str:
    """Return which `held` runs of the power `powers` (k,) disagree at `point`, and in which output; "" if none does."""
    unseen = {name: run for (name, run), power in zip(held.items(), powers, strict=True) if power > DISAGREEMENT}
    if not unseen:
        return ""
    errors: dict[Output, float] = {}
    for run in unseen.values():
        predicted = model.simulate(run, *point)
        for output in model.outputs:
            error = float(np.sqrt(np.mean((run[output.column] - predicted[output.column]) ** 2)))
            errors[output] = max(errors.get(output, 0.0), error)
    worst = max(errors, key=lambda output: errors[output] / floors[output.column])
    size, unit = errors[worst], space_unit(worst.unit)
    return (
        f"{_list_runs(list(unseen))}, not fitted, cannot be predicted: {worst.column} is off by {size:.2g}{unit},"
        f" {size / floors[worst.column]:.2g} times its floor. The fitted runs do not show what acts there: fit such a run too"
    )


def _list_runs(names: Sequence[str]) -> str:
    return f"run{'s' if len(names) > 1 else ''} {join_names(names)}"
