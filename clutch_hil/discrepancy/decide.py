"""Decide: which of the four verdicts a search supports, and with what confidence.

Equation        gain = (S_0 - S)/N:  S_0 cost of the re-fitted baseline, S with the effect(s), N residuals; it is more than
                chance by how much better it fits, or by how much likelier a calibration it leaves (fit.py)
                closed = gain/(gain + rest):  the share of the excess over the floor that is explained
                a rival is told apart when it is worse by more than the best one's own misfit would excuse
Assumptions     thresholds hold for rigs like those of the battery (benchmarks/battery): set on some development cases
References      Hansen, Lunde and Nason 2011, Econometrica 79 (model confidence set); White 2000, Econometrica 68
"""

from collections.abc import Mapping
from dataclasses import dataclass
from math import sqrt

import numpy as np

GAIN = 0.002  # of the number of residuals: the most in twelve cases with nothing hidden was 0.0006, of a ripple
CHANCE = 30.0  # |r|^2 that the best of 45 candidates with four parameters gains by chance once in a thousand cases: 28
RELIEF = 15.0  # the same of cost/alike: wrong names of the development split gained 8 at most, right ones 39 at least
EXCESS = 0.03  # of the number of residuals: an unexplained rest below it is no disagreement
UNEXPLAINED = 0.10  # of the number of residuals: an excess above it is a disagreement that is looked into
CLOSED = (0.75, 0.85, 0.90)  # least share of the excess that one, two, three effects must explain to be named
MOST = len(CLOSED)  # effects that are named together
MENDED = 0.7  # share of what others leave that names an effect beside them; development: wrong ones 0.52 at most,
HALF, NEEDED = 0.5, 0.03  # or this share of it and this of the excess: wrong ones with the one had 0.026 of the other,
DISTINCT = 0.5  # or this of the excess while no other gains this share of what it gains
ALIAS = 0.75  # a rival is not told apart when it is worse by less than this share of what the best one leaves itself,
TIE = 3.0  # and this of cost/alike: odds of e^1.5. Neither costs a right name on the development split
RARE = 35.0  # chi^2 of a calibration; where a single effect explained nearly all it was 30 at most on the development split
DECISIVE = 1.5  # a run tells a rival apart that leaves more there by this share of what the best one leaves itself
NOTHING_SURE, NONE_SURE = 0.9, 0.8  # confidence where nothing gains: set by hand


@dataclass(frozen=True)
class Weighed:
    """A search: cost `base` of the re-fitted baseline and `best`, number of residuals `size`, `count` of effects.

    excess, rest: what the baseline, and the best, leave above the floor, as a share of the number of residuals.
    relief, strain: chi^2 of the calibration (fit.py), by how much that of the best is less, and what it is.
    alike: residuals that tell as much as one (evidence.py).
    """

    base: float
    best: float
    size: int
    count: int
    excess: float
    rest: float
    relief: float = 0.0
    strain: float = 0.0
    alike: float = 1.0

    @property
    def gain(self) -> float:
        """Gain over the baseline as a share of the number of residuals."""
        return (self.base - self.best) / self.size

    @property
    def closed(self) -> float:
        """Share of the excess that is explained; 1 where nothing is left."""
        return self.gain / max(self.gain + self.rest, 1e-12)

    @property
    def gained(self) -> bool:
        """Whether the gain is more than chance."""
        return worthwhile(self.gain, self.relief, self.size, self.alike)

    @property
    def slight(self) -> bool:
        """Whether all that is left beside an effect that is evident is no disagreement: levels of a converter that are up to
        0.15 of a step uneven (noise.py) shift what it shows by half its rounding, a quarter of the power in that output."""
        return self.excess <= UNEXPLAINED and self.relief < RELIEF

    @property
    def unfinished(self) -> bool:
        """Whether what is left is worth looking for a further effect: it is a disagreement, and more than three deviations of
        a mean square, or hidden by a calibration that is rare."""
        left = self.rest > UNEXPLAINED + 3.0 * sqrt(2.0 / self.size)
        return self.gained and self.count < MOST and (left or self.strain > RARE)

    def mended(self, gain: float, second: float) -> bool:
        """Whether a further effect that gains so much, and the best of the others so much, earns its place: a misfit of the
        first can be patched in many ways."""
        much = gain > NEEDED * self.excess
        return gain > MENDED * self.rest or (much and (gain > HALF * self.rest or second < DISTINCT * gain))

    @property
    def explained(self) -> bool:
        """Whether so few effects explain enough to be named."""
        return self.gained and (self.closed >= CLOSED[self.count - 1] or self.rest < EXCESS)


def worthwhile(gain: float, relief: float, size: int, alike: float) -> bool:
    """Whether a gain, as a share of `size` residuals, is no chance and more than a model is off without any effect missing.

    relief: by how much chi^2 of the calibration is less: what is left of the gain without it is what fits better.
    alike: residuals that tell as much as one.
    """
    better = gain - alike * relief / size
    least = max(GAIN, CHANCE / size)
    return min(gain, better) > least or gain > max(least, alike * RELIEF / size)


def aliases(costs: dict[str, float], w: Weighed, by_run: Mapping[str, np.ndarray]) -> list[str]:
    """Names of `costs` that are not told apart from the best, which leaves `w.rest` above the floor; the best first.

    by_run: mean square above the floor in each run (k,), of some names, in floors^2: one run that tells is enough.
    """
    best = min(costs, key=lambda name: costs[name])
    near = [n for n, cost in costs.items() if cost - costs[best] <= ALIAS * w.rest * w.size + TIE * w.alike]
    return sorted((n for n in near if not _told_apart(best, n, by_run)), key=lambda name: costs[name])


def _told_apart(best: str, other: str, by_run: Mapping[str, np.ndarray]) -> bool:
    if best == other or best not in by_run or other not in by_run:
        return False
    more = by_run[other] - by_run[best]
    return bool(np.any(more > DECISIVE * np.maximum(by_run[best], 0.0) + UNEXPLAINED))


def confidence(weighed: Weighed) -> float:
    """Probability that what is named, one or several, is all that is missing, from the share explained.

    Logistic; slope and level from the development split of the battery (docs/battery.md). The regret of the next rival, the
    excess and the number of effects told right from wrong no better: what is wrong there is mostly that a second effect hides
    behind the baseline's own calibration, of which no run says anything.
    """
    score = 1.62 + 2.16 * (weighed.closed - 0.8)
    return float(1.0 / (1.0 + np.exp(-score)))
