"""Least squares of a model's one output on runs, without the workflow: what its numbers are checked with."""

from collections.abc import Mapping, Sequence

import numpy as np
from scipy.optimize import least_squares

from clutch_hil.fitting.model import Columns, Model

STEP = 1e-4  # relative, of finite differences: far above rounding, far below any curvature here


def fit_least_squares(
    model: Model, runs: Sequence[Columns], effects: Mapping[str, float] | None = None
) -> tuple[dict[str, float], dict[str, float]]:
    """Baseline, with its uncertain parameters fitted to `runs`, and parameters of `effects` fitted from the values given."""
    start = dict(effects or {})
    base = {name: p.value for name, p in model.parameters.items()}
    declared = {n: p for c in model.candidates for n, p in c.declare_parameters().items()}
    free = [name for name, p in model.parameters.items() if p.uncertainty > 0.0]
    names = [*free, *start]
    low, high = np.array([(model.parameters[n] if n in base else declared[n]).bounds for n in names]).T
    begin = np.clip([*(base[n] for n in free), *start.values()], low, high)
    unit = np.where(begin != 0.0, np.abs(begin), 1e-3 * (high - low))

    def split(x: np.ndarray) -> tuple[dict[str, float], dict[str, float]]:
        values = dict(zip(names, x * unit, strict=True))
        return base | {n: values[n] for n in free}, {n: values[n] for n in start}

    def residuals(x: np.ndarray) -> np.ndarray:
        return np.concatenate([compute_residual(model, run, *split(x)) for run in runs])

    result = least_squares(residuals, begin / unit, bounds=(low / unit, high / unit), diff_step=STEP)
    return split(result.x)


def compute_residual(
    model: Model, run: Columns, parameters: Mapping[str, float], effects: Mapping[str, float]
) -> np.ndarray:
    """Measured less predicted (n,)."""
    column = model.outputs[0].column
    return run[column] - model.simulate(run, parameters, effects)[column]


def compute_error(
    model: Model, runs: Sequence[Columns], parameters: Mapping[str, float], effects: Mapping[str, float]
) -> float:
    """Root mean square of the residuals of all `runs`."""
    return float(
        np.sqrt(np.mean(np.concatenate([compute_residual(model, run, parameters, effects) for run in runs]) ** 2))
    )
