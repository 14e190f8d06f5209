"""Where to begin the fit of a ripple: periods that stand out in the residual over the path."""

import numpy as np

from plant_sim.discrepancy.model import Candidate
from plant_sim.discrepancy.models.measured_motion import Motion
from plant_sim.discrepancy.models.straight import PERIOD

_MOVING = 0.1  # of the greatest speed: slower samples say more of the reversal than of the place
_BINS = 8  # along the shortest period
_STARTS = 3
_APART = 2  # lines of the spectrum that belong to one peak


def ripple_starts(candidate: Candidate, moved: Motion, residual: np.ndarray) -> list[dict[str, float]]:
    """The strongest periods with amplitude and phase, by dotted name; [] where nothing moves.

    The residual [N] (n,) is averaged over all visits of a place, both directions together, less its slow change along the path.
    """
    shape = next(p for p in candidate.parameters if p.name == PERIOD)
    shortest, longest = (1e-3 * bound for bound in shape.bounds)  # m
    moving = np.abs(moved.speed) > _MOVING * np.abs(moved.speed).max(initial=0.0)
    place, force = moved.position[moving], residual[moving]
    if place.size < _BINS or np.ptp(place) < shortest:
        return []
    steps = int(np.ptp(place) / shortest * _BINS) + 1
    edges = np.linspace(place.min(), place.max(), steps + 1)
    at = np.clip(np.digitize(place, edges) - 1, 0, steps - 1)
    visits = np.bincount(at, minlength=steps)
    mean = np.bincount(at, force, minlength=steps) / np.maximum(visits, 1)
    middle, seen = 0.5 * (edges[1:] + edges[:-1]), visits > 0
    slow = np.polyfit(middle[seen], mean[seen], 3)
    mean = np.where(seen, mean - np.polyval(slow, middle), 0.0)
    travel = steps * (middle[1] - middle[0])
    waves = np.arange(travel / longest, travel / shortest, 0.25) / travel  # 1/m, four lines a resolvable one
    lines = 2.0 / steps * (np.exp(-2j * np.pi * np.outer(waves, middle)) @ mean)
    found: list[dict[str, float]] = []
    strength = np.abs(lines)
    while len(found) < _STARTS and strength.any():
        k = int(np.argmax(strength))
        values = {PERIOD: 1e3 / waves[k], "phase": float(np.angle(lines[k])), "amplitude": float(abs(lines[k]))}
        limits = {p.name: p.bounds for p in candidate.parameters}
        found.append({f"{candidate.name}.{n}": float(np.clip(v, *limits[n])) for n, v in values.items()})
        strength[max(k - 4 * _APART, 0) : k + 4 * _APART + 1] = 0.0
    return found
