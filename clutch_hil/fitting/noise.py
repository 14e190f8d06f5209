"""Noise floor of measured outputs.

Equation        sigma = rms(d)/sqrt(20) of those third differences d of the samples (weights 1, 3, 3, 1) with |d| < 4 s,
                s = 1.4826 median |d|. A signal that is a parabola over four samples adds nothing
                sigma is at least the rounding, spacing of the values/sqrt(12)
                floor of an output: median over the runs. A run whose sigma is clearly larger has its own noise
Assumptions     white noise; fast events are rare
Not modelled    coloured noise: differences do not contain its low frequencies
References      von Neumann et al. 1941, Ann. Math. Stat. 12 (mean square successive difference); Rousseeuw and Croux 1993 (MAD)
"""

from collections.abc import Sequence

import numpy as np

from clutch_hil.fitting.model import Columns, Output

_MAD_TO_SIGMA = 1.4826  # standard deviation over median absolute deviation
_EVENT_LIMIT = 4.0  # standard deviations: larger differences are events; noise exceeds it once in 16000
_THIRD_DIFFERENCE_VARIANCE = 20.0  # variance of third differences of unit white noise: 1 + 9 + 9 + 1
# Ratio of noises. Ten profiles at 1 kHz differ by 3 %, their slip by 13 %, because its rounding depends on the speed. A run
# with a ratio of 1.1 in all outputs, not known to be noisier, has an excess of 0.21. A quieter run may only be coarse
_LOUDER = 1.1
_MOST_LEVELS = 4000  # largest number of different values of a coarse channel
_ONE_STEP = 1.75  # in smallest steps: a shorter gap is one step of the converter, a longer one may be two
_LEVEL_TOLERANCE = 0.15  # largest deviation of a level, in steps: differential non-linearity of a coarse converter


def estimate_noise(values: np.ndarray) -> float:
    """Estimate the standard deviation of the white noise in `values` (n,), in their unit; 0 for fewer than 8 values."""
    if len(values) < 8:
        return 0.0
    d = np.diff(values, 3)
    near = np.abs(d) <= max(_EVENT_LIMIT * _MAD_TO_SIGMA * float(np.median(np.abs(d))), 0.0)
    sigma = float(
        np.sqrt(np.mean(d[near] ** 2) / _THIRD_DIFFERENCE_VARIANCE)
    )  # not from the median itself, which is coarse for coarse values
    steps = np.diff(np.unique(values))
    rounding = float(steps.min()) / np.sqrt(12.0) if len(steps) else 0.0
    return max(sigma, rounding if rounding > 1e-9 * float(np.ptp(values) or 1.0) else 0.0)


def find_lattice(values: np.ndarray) -> tuple[float, float]:
    """Find the lattice of levels that `values` (n,) lie on: its step, and its offset from 0 in steps, -0.5..0.5.

    Both are 0 where there is no lattice, or too few or too many levels.
    """
    levels = np.unique(np.round(values, 9))
    if len(levels) < 3 or len(levels) > _MOST_LEVELS:
        return 0.0, 0.0
    gaps = np.diff(levels)
    typical = float(np.mean(gaps[gaps < _ONE_STEP * np.quantile(gaps, 0.1)]))
    number = np.concatenate([[0.0], np.cumsum(np.round(gaps / typical))])
    step, first = np.polyfit(number, levels, 1)
    off_lattice = np.abs(levels - first - step * number)
    if np.quantile(off_lattice, 0.99) > _LEVEL_TOLERANCE * step:
        return 0.0, 0.0
    return float(step), float(first / step - np.round(first / step))


def estimate_floors(runs: Sequence[Columns], outputs: Sequence[Output]) -> dict[str, float]:
    """Estimate the noise floor of each output by column, in its unit: at least its resolution, and above 0."""
    floors = {}
    for output in outputs:
        sigma = max(float(np.median([estimate_noise(run[output.column]) for run in runs])), output.resolution)
        spread = max(float(np.ptp(run[output.column])) for run in runs)
        floors[output.column] = max(sigma, 1e-6 * spread, 1e-12)
    return floors


def estimate_own_noise(values: np.ndarray, floor: float) -> float:
    """Return the noise of one run's output `values` (n,): its `floor`, or the run's own noise if that is clearly larger."""
    own = estimate_noise(values)
    return own if own > _LOUDER * floor else floor


def pool_noise(runs: Sequence[np.ndarray], floor: float) -> float:
    """Return the root mean square noise of an output over several `runs` (n,) of it."""
    own = [estimate_own_noise(values, floor) for values in runs]
    if max(own) == floor:
        return floor
    return float(np.sqrt(np.average(np.square(own), weights=[len(values) for values in runs])))
