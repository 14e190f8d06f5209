"""Sources: the power of the disagreement between model and runs that each block causes.

A `Locating` model separates the sources by what its channels have in common: the noise of two sensors is independent.
For any other model every output is its own source: r^2 minus the power of white noise, r measured minus simulated.
"""

from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass

import numpy as np

from clutch_hil.fitting.model import Columns, Locating, Model, Values
from clutch_hil.fitting.noise import estimate_noise

MEAN = 4e-3  # s: samples are averaged over about this time, a whole number of rows, as in the fit (evidence.py)
LATER = 4, 5, 6  # lags of tested products, in means: 16 to 24 ms, so that coloured noise of 10 ms has no effect
SENSORS, DRIVE, FRICTION, HYDRAULICS = "sensors", "drive", "friction", "hydraulics"
PRESSURE, SLIP, TORQUE = "cylinder_pressure_bar", "slip_speed_rad_s", "clutch_torque_nm"
MOTOR, CELSIUS, ANGLE = "motor_torque_nm", "oil_temperature_degc", "shaft_angle_rad"


@dataclass(frozen=True)
class Source:
    """The disagreement of an output that is attributed to a block: lists by run, of means over MEAN, in the output's unit.

    `power` (n,): its mean is the mean square (unit squared). `tested` (n, k): the same from products at later lags; its mean is
    0 where the block is right. `residual` (n,): the residual that shows it.
    """

    block: str
    column: str
    power: list[np.ndarray]
    tested: list[np.ndarray]
    residual: list[np.ndarray]


def find_sources(
    model: Model, runs: Sequence[Columns], floors: Values, parameters: Values, effects: Values
) -> list[Source]:
    """Return the sources of the disagreement between `model` and `runs`."""
    with ThreadPoolExecutor() as pool:
        predicted = list(pool.map(lambda run: model.simulate(run, parameters, effects), runs))
        off = [_compute_residuals(model, floors, run, shown) for run, shown in zip(runs, predicted, strict=True)]
        if isinstance(model, Locating):
            parts = list(pool.map(
                lambda k: model.locate(k, runs[k], predicted[k], off[k], floors, parameters, effects), range(len(runs))
            ))  # fmt: skip
            return [
                Source(
                    one.block,
                    one.column,
                    *(list(series) for series in zip(*(part[k][2:] for part in parts), strict=True)),
                )
                for k, one in enumerate(parts[0])
            ]
    run_sources = []
    for output in model.outputs:
        residuals = [average(r[output.column], run) for r, run in zip(off, runs, strict=True)]
        run_sources.append(
            Source(
                output.block, output.column,
                [free(r, o[output.column], run) for r, o, run in zip(residuals, off, runs, strict=True)],
                [np.column_stack([compute_products(r, lag) for lag in LATER]) for r in residuals], residuals,
            )
        )  # fmt: skip
    return run_sources


def free(x: np.ndarray, raw: np.ndarray, run: Columns) -> np.ndarray:
    """Return x^2 minus the power in the means `x` of white noise as large as in the samples `raw`."""
    return x**2 - estimate_noise(raw) ** 2 / count_rows(run)


def compute_products(x: np.ndarray, lag: int) -> np.ndarray:
    """Return x_j x_(j+lag), 0 at the end."""
    product = np.zeros_like(x)
    product[:-lag] = x[lag:] * x[:-lag]
    return product


def _compute_residuals(model: Model, floors: Values, run: Columns, shown: Columns) -> Columns:
    """Return measured minus simulated, with the offset removed as far as `Output.beginning` [floors] lets it vary by run."""
    residuals = {}
    for output in model.outputs:
        residual = run[output.column] - shown[output.column]
        spread = len(residual) * output.beginning**2
        residuals[output.column] = residual - (1.0 - 1.0 / np.sqrt(1.0 + spread)) * residual.mean()
    return residuals


def average(values: np.ndarray, run: Columns) -> np.ndarray:
    """Return means over MEAN."""
    size = count_rows(run)
    n = len(values) // size
    return np.asarray(values[: n * size].reshape(n, size).mean(axis=1))


def compute_period(run: Columns) -> float:
    """Return the sample period of a run [s]."""
    return float(run["time_s"][1] - run["time_s"][0])


def count_rows(run: Columns) -> int:
    """Return the number of rows of a mean."""
    return max(1, round(MEAN / compute_period(run)))


def compute_step(run: Columns) -> float:
    """Return the time between two means [s]: MEAN at 1 kHz, 10 ms at 100 Hz."""
    return count_rows(run) * compute_period(run)


def select_usual(steps: Sequence[float], counts: Sequence[int]) -> list[int]:
    """Return the indices of the series whose `steps` [s] most of the time has, for statistics over lags or frequencies.

    counts: number of values of each series.
    """
    alike = [round(step, 9) for step in steps]
    usual = max(alike, key=lambda step: sum(n * one for one, n in zip(alike, counts, strict=True) if one == step))
    return [k for k, step in enumerate(alike) if step == usual]
