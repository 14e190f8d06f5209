"""Starts of the fit of a ripple: the strongest periods of the residual over the path.

Equation        r = c A cos(2 pi x/period + phase),  c the quantity to which the ripple is proportional (1 N for none)
                line(w) = 2 sum(c r exp(-2 pi i w x))/sum(c^2), over places first, then about its peaks over all samples
                places have equal distances: one chirp transform gives all lines of the spectrum, for any travel
Memory          proportional to the travel over the shortest period, for at most _MOST_BINS places: of a longer travel only the
                part about its median is used
References      Rabiner, Schafer and Rader 1969, Bell Syst. Tech. J. 48 (chirp z-transform)
Assumptions     places are visited in both directions, or c keeps its sign
"""

import numpy as np
from scipy.signal import czt

from clutch_hil.discrepancy.models.linear_motion import PERIOD
from clutch_hil.fitting.model import Candidate
from clutch_hil.recordings.measured_motion import Motion

_LEAST_SPEED = 0.1  # of the greatest speed: slower samples show the reversal, not the position
_BINS = 8  # places along the shortest period
_STARTS = 3  # number of returned periods
_COARSE_LINES = 4  # lines of the coarse spectrum for each line that the path can resolve
_MOST_BINS = 1 << 20  # places: 130 000 shortest periods, some 100 MB while the spectrum is computed
_CHUNK = 1 << 16  # samples whose phases are in memory at once: 42 MB for the lines near a peak
_FINE_LINES = 40  # lines near a peak: the phase is then right to 1/80 of a period at the ends of the path


def find_ripple_starts(
    candidate: Candidate, moved: Motion, residual: np.ndarray, carrier: np.ndarray
) -> list[dict[str, float]]:
    """Return period, amplitude and phase by dotted name of the strongest ripples; [] where nothing moves.

    residual [N], carrier c [N]: (n,). The part of the residual that is linear in acceleration, speed and direction is removed
    first, because the baseline may not be fitted yet.
    """
    limits = {p.name: p.bounds for p in candidate.parameters}
    shortest, longest = (1e-3 * bound for bound in limits[PERIOD])  # m
    moving = np.abs(moved.speed) > _LEAST_SPEED * np.abs(moved.speed).max(initial=0.0)
    x, c, speed = moved.position[moving], carrier[moving], moved.speed[moving]
    if x.size < _BINS or np.ptp(x) < shortest or not c.any():
        return []
    if np.ptp(x) > (longest_path := _MOST_BINS / _BINS * shortest):
        near_median = np.abs(x - np.median(x)) < 0.5 * longest_path
        x, c, speed = x[near_median], c[near_median], speed[near_median]
        moving = np.flatnonzero(moving)[near_median]
    linear = np.column_stack([np.ones(x.size), np.sign(speed), speed, np.abs(speed), moved.acceleration[moving]])
    r = residual[moving] - linear @ np.linalg.lstsq(linear, residual[moving], rcond=None)[0]
    bins = int(np.ptp(x) / shortest * _BINS) + 1
    edges = np.linspace(x.min(), x.max(), bins + 1)
    at = np.clip(np.digitize(x, edges) - 1, 0, bins - 1)
    resolved = 1.0 / np.ptp(x)
    waves = np.arange(1.0 / longest, 1.0 / shortest, resolved / _COARSE_LINES)
    width = edges[1] - edges[0]
    first, step = np.exp(2j * np.pi * waves[0] * width), np.exp(-2j * np.pi * resolved / _COARSE_LINES * width)
    strength = np.abs(czt(np.bincount(at, c * r, minlength=bins), len(waves), step, first))
    starts: list[dict[str, float]] = []
    while len(starts) < _STARTS and strength.any():
        k = int(np.argmax(strength))
        near = waves[k] + resolved * np.arange(-0.5, 0.5, 1.0 / _FINE_LINES)
        lines = _compute_lines(x, c * r, near) / np.sum(c * c)
        best = int(np.argmax(np.abs(lines)))
        values = {
            PERIOD: 1e3 / near[best], "phase": float(np.angle(lines[best])), "amplitude": float(np.abs(lines[best])),
        }  # fmt: skip
        starts.append({f"{candidate.name}.{n}": float(np.clip(v, *limits[n])) for n, v in values.items()})
        strength[max(k - 2 * _COARSE_LINES, 0) : k + 2 * _COARSE_LINES + 1] = 0.0
    return starts


def _compute_lines(x: np.ndarray, weighted: np.ndarray, waves: np.ndarray) -> np.ndarray:
    """Return 2 sum(weighted exp(-2 pi i w x)) for each wave number w [1/m] of `waves` (k,)."""
    total = np.zeros(len(waves), complex)
    for begin in range(0, len(x), _CHUNK):
        part = slice(begin, begin + _CHUNK)
        total += np.exp(-2j * np.pi * np.outer(waves, x[part])) @ weighted[part]
    return 2.0 * total
