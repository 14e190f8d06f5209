"""Noise floor of measured outputs.

Equation        sigma = rms(d)/sqrt(20) of those third differences d of the samples (weights 1, 3, 3, 1) with |d| < 4 s,
                s = 1.4826 median |d|; a signal that is a parabola over four samples does not enter; not below
                spacing/sqrt(12) of the values
                floor of an output: median over the runs; from repeated runs, rms of their differences / sqrt(2)
Assumptions     white noise; fast events are rare
Not modelled    coloured noise: its low-frequency part is in no difference; repeated runs show it
References      von Neumann et al. 1941, Ann. Math. Stat. 12 (mean square successive difference); Rousseeuw and Croux 1993 (MAD)
"""

from collections.abc import Sequence

import numpy as np

from clutch_hil.discrepancy.model import Columns, Output

_GAUSSIAN = 1.4826  # standard deviation over median absolute deviation
_FAST = 4.0  # standard deviations: further ones are events, 1 in 16000 of noise
_THIRD = 20.0  # variance of third differences of unit white noise: 1 + 9 + 9 + 1
_LEVELS = 4000  # most different values of a channel that is coarse
_NEXT = 1.75  # smallest steps: a gap below it is one step of a poor converter, a longer one may be two
_UNEVEN = 0.15  # steps that levels may be off: differential non-linearity of a poor converter
_QUIET = 0.02  # of the column's standard deviation: inputs of runs that differ by less are repeats of one run


def floor_of(values: np.ndarray) -> float:
    """Standard deviation of the white noise in `values` (n,), in their unit."""
    if len(values) < 8:
        return 0.0
    d = np.diff(values, 3)
    near = np.abs(d) <= max(_FAST * _GAUSSIAN * float(np.median(np.abs(d))), 0.0)
    sigma = float(np.sqrt(np.mean(d[near] ** 2) / _THIRD))  # not the median itself: it is coarse where the values are
    steps = np.diff(np.unique(values))
    rounding = float(steps.min()) / np.sqrt(12.0) if len(steps) else 0.0
    return max(sigma, rounding if rounding > 1e-9 * float(np.ptp(values) or 1.0) else 0.0)


def lattice(values: np.ndarray) -> tuple[float, float]:
    """Step of the lattice that all `values` lie on, and its offset from 0 in steps, -0.5..0.5; 0, 0 where they take too many
    different ones to tell."""
    levels = np.unique(np.round(values, 9))
    if len(levels) < 3 or len(levels) > _LEVELS:
        return 0.0, 0.0
    gaps = np.diff(levels)
    typical = float(np.mean(gaps[gaps < _NEXT * np.quantile(gaps, 0.1)]))
    number = np.concatenate([[0.0], np.cumsum(np.round(gaps / typical))])
    step, first = np.polyfit(number, levels, 1)
    off_lattice = np.abs(levels - first - step * number)
    if np.quantile(off_lattice, 0.99) > _UNEVEN * step:
        return 0.0, 0.0
    return float(step), float(first / step - np.round(first / step))


def floors(runs: Sequence[Columns], outputs: Sequence[Output]) -> dict[str, float]:
    """Floor of each output by column, in its unit: never below its resolution, never 0."""
    found = {}
    for output in outputs:
        sigma = max(float(np.median([floor_of(run[output.column]) for run in runs])), output.resolution)
        spread = max(float(np.ptp(run[output.column])) for run in runs)
        found[output.column] = max(sigma, 1e-6 * spread, 1e-12)
    return found


def repeats(runs: Sequence[Columns], inputs: Sequence[str]) -> list[tuple[int, int]]:
    """Pairs of runs with the same inputs: one experiment, done twice."""
    pairs = []
    for i, one in enumerate(runs):
        for j in range(i + 1, len(runs)):
            other = runs[j]
            if all(len(one[c]) == len(other[c]) and _alike(one[c], other[c]) for c in inputs):
                pairs.append((i, j))
    return pairs


def _alike(one: np.ndarray, other: np.ndarray) -> bool:
    return bool(np.sqrt(np.mean((one - other) ** 2)) <= _QUIET * max(float(np.std(one)), 1e-12))
