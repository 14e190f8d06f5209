"""Decision: which of the four verdicts a search supports, and with what confidence.

Equation        gain = (S_0 - S)/N:  S_0 cost of the re-fitted baseline, S cost with the effects, N number of residuals
                closed = gain/(gain + rest):  share of the excess over the noise floor that the effects explain
                a gain counts where the better fit exceeds chance, or where it leads to a more probable calibration (fit.py)
                two effects are distinguished where the worse one leaves more than the misfit of the better one can explain
Assumptions     the thresholds hold for rigs like those of the battery (benchmarks/battery). They were set on its development
                split, a part of the cases that is used for no published score
References      Hansen, Lunde and Nason 2011, Econometrica 79 (model confidence set); White 2000, Econometrica 68
"""

from collections.abc import Mapping
from dataclasses import dataclass
from math import sqrt

import numpy as np

# Least gain, as a share of the number of residuals. Twelve cases without a hidden effect gained 0.0006 at most, by a ripple.
LEAST_GAIN = 0.002
# Least gain of |r|^2. The best of 45 candidates with four parameters gains 28 by chance once in a thousand cases.
CHANCE_GAIN = 30.0
# Least gain of cost/redundancy by a more probable calibration. Development: wrong effects at most 8, right ones at least 39.
PRIOR_GAIN = 15.0
CLOSED_EXCESS = 0.03  # of the number of residuals: a smaller rest counts as explained
DISAGREEMENT = 0.10  # of the number of residuals: a larger excess is a disagreement
LEAST_CLOSED = (0.75, 0.85, 0.90)  # share of the excess that one, two, three effects must explain to be named
MOST_EFFECTS = len(LEAST_CLOSED)  # largest number of effects named together
# A further effect is named if it closes this share of what the others leave. Development: wrong effects closed 0.52 at most.
CLOSED_BY_FURTHER = 0.7
# Or if it closes this share and LARGE_SHARE of the excess. Development: wrong effects beside a right one closed 0.026 of it.
CLOSED_BY_LARGE, LARGE_SHARE = 0.5, 0.03
# Or if it closes LARGE_SHARE of the excess, and no other effect gains this share of its gain.
RUNNER_UP_SHARE = 0.5
# Two effects are indistinguishable if the worse one's cost is higher by less than this share of what the better one leaves ...
ALIAS_SHARE = 0.75
TIE_COST = 3.0  # ... plus this times redundancy: odds of e^1.5. Development: neither value loses a right effect
# chi^2 of an improbable calibration. Development: where a single effect explained nearly all, it was 30 at most.
RARE_CHI2 = 35.0
# One run distinguishes two effects if the worse one leaves more in it by this share of what the better one leaves, ...
DECISIVE_SHARE = 1.5  # ... plus DISAGREEMENT
NOTHING_CONFIDENCE, NONE_CONFIDENCE = 0.9, 0.8  # of the verdicts without a gain: set by hand
CALIBRATION_CONFIDENCE = 0.9  # that no effect is missing where a re-calibration explains the disagreement: set by hand


@dataclass(frozen=True)
class Explanation:
    """How much of the disagreement a set of effects explains.

    base, best: cost of the re-fitted baseline, and with the effects. size: number of residuals. count: number of effects.
    excess, rest: power above the floor of the baseline, and of the best fit, as a share of the number of residuals.
    prior_gain: reduction of chi^2 of the calibration (fit.py) by the best fit. prior_chi2: chi^2 of the calibration in the best
    fit. redundancy: number of neighbouring residuals that carry the information of one independent residual (evidence.py).
    """

    base: float
    best: float
    size: int
    count: int
    excess: float
    rest: float
    prior_gain: float = 0.0
    prior_chi2: float = 0.0
    redundancy: float = 1.0

    @property
    def gain(self) -> float:
        """Return the gain over the baseline as a share of the number of residuals."""
        return (self.base - self.best) / self.size

    @property
    def closed(self) -> float:
        """Return the share of the excess that is explained; 1 where nothing is left."""
        return self.gain / max(self.gain + self.rest, 1e-12)

    @property
    def is_significant(self) -> bool:
        """Return whether the gain exceeds chance."""
        return is_worthwhile(self.gain, self.prior_gain, self.size, self.redundancy)

    @property
    def is_negligible(self) -> bool:
        """Return whether the excess is too small to be a disagreement in the presence of a coarse converter.

        The recorded values show a coarse converter without any fit. Its levels are uneven by up to 0.15 of a step (noise.py).
        That shifts its readings by half its rounding error, which is a quarter of the power in that output.
        """
        return self.excess <= DISAGREEMENT and self.prior_gain < PRIOR_GAIN

    @property
    def is_incomplete(self) -> bool:
        """Return whether to search for a further effect.

        This is so if the rest exceeds a disagreement by more than three standard deviations of a mean square, or if the
        calibration is so improbable that it may hide an effect.
        """
        left = self.rest > DISAGREEMENT + 3.0 * sqrt(2.0 / self.size)
        return self.is_significant and self.count < MOST_EFFECTS and (left or self.prior_chi2 > RARE_CHI2)

    def justifies_further(self, gain: float, second: float) -> bool:
        """Return whether a further effect with this `gain` may be named; `second` is the gain of the best other effect.

        The thresholds are high because many effects can compensate part of the misfit of the first one.
        """
        much = gain > LARGE_SHARE * self.excess
        return gain > CLOSED_BY_FURTHER * self.rest or (
            much and (gain > CLOSED_BY_LARGE * self.rest or second < RUNNER_UP_SHARE * gain)
        )

    @property
    def is_sufficient(self) -> bool:
        """Return whether the effects explain enough of the excess to be named."""
        return self.is_significant and (self.closed >= LEAST_CLOSED[self.count - 1] or self.rest < CLOSED_EXCESS)


def is_worthwhile(gain: float, prior_gain: float, size: int, redundancy: float) -> bool:
    """Return whether a gain, as a share of `size` residuals, exceeds both chance and the usual model error.

    prior_gain: reduction of chi^2 of the calibration. The gain without this part comes from the better fit.
    redundancy: number of neighbouring residuals that carry the information of one independent residual.
    """
    better = gain - redundancy * prior_gain / size
    least = max(LEAST_GAIN, CHANCE_GAIN / size)
    return min(gain, better) > least or gain > max(least, redundancy * PRIOR_GAIN / size)


def find_aliases(costs: dict[str, float], w: Explanation, by_run: Mapping[str, np.ndarray]) -> list[str]:
    """Return the effects of `costs` that cannot be distinguished from the best one, the best first.

    The best one leaves `w.rest` above the floor. by_run: mean square above the floor in each run (k,), in floors^2, by effect.
    Effects without an entry are compared by cost only. One run that distinguishes two effects is enough.
    """
    best = min(costs, key=lambda name: costs[name])
    near = [
        n for n, cost in costs.items() if cost - costs[best] <= ALIAS_SHARE * w.rest * w.size + TIE_COST * w.redundancy
    ]
    return sorted((n for n in near if not _is_distinguished(best, n, by_run)), key=lambda name: costs[name])


def _is_distinguished(best: str, other: str, by_run: Mapping[str, np.ndarray]) -> bool:
    if best == other or best not in by_run or other not in by_run:
        return False
    more = by_run[other] - by_run[best]
    return bool(np.any(more > DECISIVE_SHARE * np.maximum(by_run[best], 0.0) + DISAGREEMENT))


def compute_confidence(explanation: Explanation) -> float:
    """Return the probability that the named effects are all that is missing: a logistic function of the share they explain.

    Slope and level were fitted to the development split of the battery (docs/battery.md). The distance to the next rival, the
    excess and the number of effects do not improve the prediction. Most wrong answers there miss a second effect that the
    calibration of the baseline hides and that no run shows.
    """
    score = 1.62 + 2.16 * (explanation.closed - 0.8)
    return float(1.0 / (1.0 + np.exp(-score)))
