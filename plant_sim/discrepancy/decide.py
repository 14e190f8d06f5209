"""Decide: which of the four verdicts a search supports, and with what confidence.

Equation        gain = (S_0 - S)/N:  S_0 cost of the re-fitted baseline, S with the effect(s), N residuals
                closed = gain/(gain + rest):  the share of the excess over the floor that is explained
                a rival is told apart when it is worse by more than the best one's own misfit would excuse
Assumptions     thresholds hold for rigs like those of the battery (tests/discrepancy/battery): set on some development cases
References      Hansen, Lunde and Nason 2011, Econometrica 79 (model confidence set); White 2000, Econometrica 68
"""

from collections.abc import Mapping
from dataclasses import dataclass
from math import sqrt

import numpy as np

GAIN = 0.002  # of the number of residuals: the most in twelve cases with nothing hidden was 0.0006, of a ripple
CHANCE = 30.0  # chi^2 that the best of 45 candidates with four parameters gains by chance once in a thousand cases: 28
EXCESS = 0.03  # of the number of residuals: an unexplained rest below it is no disagreement
UNEXPLAINED = 0.10  # of the number of residuals: an excess above it is a disagreement that is looked into
CLOSED = (0.75, 0.85, 0.90)  # least share of the excess that one, two, three effects must explain to be named
MOST = len(CLOSED)  # effects that are named together
MENDED = 0.7  # share of what others leave that names an effect beside them: in cases with one effect none mended 0.4
NEEDED = 0.03  # one that mends less must explain this share of the excess,
DISTINCT = 0.5  # and no other may gain this share of what it gains
ALIAS = 0.5  # a rival is not told apart when it is worse by less than this share of what the best one leaves itself,
TIE = 0.0003  # and this share of the number of residuals
DECISIVE = 1.5  # a run tells a rival apart that leaves more there by this share of what the best one leaves itself
NOTHING_SURE, NONE_SURE = 0.9, 0.8  # confidence where nothing gains: set by hand


@dataclass(frozen=True)
class Weighed:
    """A search: cost `base` of the re-fitted baseline and `best`, number of residuals `size`, `count` of effects.

    excess, rest: what the baseline, and the best, leave above the floor, as a share of the number of residuals.
    """

    base: float
    best: float
    size: int
    count: int
    excess: float
    rest: float

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
        return self.gain > worthwhile(self.size)

    @property
    def unfinished(self) -> bool:
        """Whether what is left is worth looking for a further effect: it is a disagreement, and more than three deviations of
        a mean square."""
        return self.gained and self.count < MOST and self.rest > UNEXPLAINED + 3.0 * sqrt(2.0 / self.size)

    @property
    def explained(self) -> bool:
        """Whether so few effects explain enough to be named."""
        return self.gained and (self.closed >= CLOSED[self.count - 1] or self.rest < EXCESS)


def worthwhile(size: int) -> float:
    """Least gain, as a share of `size` residuals, that is no chance and more than a model is off without any effect missing."""
    return max(GAIN, CHANCE / size)


def aliases(costs: dict[str, float], size: int, rest: float, by_run: Mapping[str, np.ndarray]) -> list[str]:
    """Names that are not told apart from the best, which leaves `rest` above the floor; the best first.

    by_run: mean square above the floor in each run (k,), of some names, in floors^2: one run that tells is enough.
    """
    best = min(costs, key=lambda name: costs[name])
    near = [n for n, cost in costs.items() if cost - costs[best] <= (ALIAS * rest + TIE) * size]
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
