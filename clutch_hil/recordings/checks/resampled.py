"""Resampled: columns with fewer samples than rows, as a signal of a bus at 100 Hz in a table at 1 kHz.

Equation        held: the column changes in every k-th row alone; joined: it bends in every k-th row alone, k > 1
                nine of ten distances from one such row to the next are the median of them to a tenth, or twice it and so on
                  where two samples are alike; and the changes differ
Assumptions     noise or motion in every sample of its own: a column that rests, or counts steps one by one, is neither
Not modelled    other ways to fill in, as splines; a column that was smoothed
"""

import numpy as np

from clutch_hil.recordings.checks.finding import Finding
from clutch_hil.recordings.checks.knowledge import Recorded

_LEAST_CHANGES = 50  # of the column: fewer may be regular by chance
_REGULAR, _ALIKE = 0.9, 0.1  # share of the distances that are alike, and what they differ by at most, as a share
_LEAST_SIZES = 0.2  # spread of the changes over their mean: a ramp on the steps of a converter has equal ones
_STRAIGHT = 1.5  # of the least change of the column: a line that was rounded to its decimals bends by one of them
_ROUNDING = 1e-9  # of the whole movement: sums in floating point


def find_resampled(run: Recorded) -> list[Finding]:
    """Measured columns that the baseline predicts, with fewer samples than rows."""
    findings, span = [], 1e3 * run.period  # ms
    for name, known in run.known.items():
        if known.predicted is None or known.slow:
            continue
        changes = np.abs(np.diff(run.columns[name]))
        bends = np.abs(np.diff(run.columns[name], 2))
        rounding = _ROUNDING * np.ptp(run.columns[name])
        least = np.min(changes, where=changes > rounding, initial=np.inf)
        if rows := _find_distance(changes, 0.0):
            seen = f"changes only every {rows * span:.3g} ms: it was held between samples, and is late by half of that"
        elif rows := _find_distance(bends, max(_STRAIGHT * least, rounding)):
            seen = f"is a straight line from each {rows}th row to the next: what is faster than {rows * span:.3g} ms is lost"
        else:
            continue
        text = f"{seen}. A fit takes that for the rig's; record this channel at {1.0 / run.period:.4g} Hz if you can"
        findings.append(Finding("resampled", name, run.rows, text, False))
    return findings


def _find_distance(sizes: np.ndarray, limit: float) -> int:
    """Rows from one of the `sizes` (n,) above `limit` to the next, where that is regular and more than one; else 0."""
    at = np.flatnonzero(sizes > limit)
    if len(at) < _LEAST_CHANGES:
        return 0
    distances = np.diff(at)
    usual = int(np.median(distances))
    alike = np.mean(np.abs(distances - usual * np.maximum(np.round(distances / usual), 1.0)) <= _ALIKE * usual)
    if usual < 2 or alike < _REGULAR or np.std(sizes[at]) < _LEAST_SIZES * np.mean(sizes[at]):
        return 0
    return usual
