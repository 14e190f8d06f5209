"""Limits of another method: they turn its ranking into a verdict, and are set on the development split."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from benchmarks.battery.score import Answer, find_family, list_hidden_names
from clutch_hil.discrepancy.result import NAMED, NONE_OF_THESE, NOTHING

_GRID = 30  # values of each limit to try; chosen by judgement


@dataclass(frozen=True)
class Limits:
    """Smallest excess over the floor that counts as a disagreement, and smallest score of a name."""

    excess: float = 0.02
    score: float = 0.0

    def decide(self, answer: Answer) -> str:
        """Decide the verdict of an answer with `excess` and `ranking`."""
        ranking = answer["ranking"]
        best = ranking[0][0] if ranking else NONE_OF_THESE
        if answer["excess"] < self.excess or best == NOTHING:
            return NOTHING
        return NONE_OF_THESE if not ranking or best == NONE_OF_THESE or ranking[0][1] < self.score else NAMED


def tune_limits(answers: Sequence[Answer]) -> Limits:
    """Find the limits with the best mean of three shares.

    They are: right names of single effects, `nothing_missing` of null cases, `none_of_these` of unknown effects.
    """
    excesses = np.unique(np.quantile([a["excess"] for a in answers], np.linspace(0.0, 0.6, _GRID)))
    scores = np.unique(
        np.quantile([a["ranking"][0][1] for a in answers if a["ranking"]], np.linspace(0.0, 0.95, _GRID))
    )

    def rate_limits(limits: Limits) -> float:
        parts: dict[str, list[bool]] = {}
        for a in answers:
            kind, verdict, truth = find_family(a), limits.decide(a), list_hidden_names(a)
            if kind in ("null", "unknown"):
                right = verdict == (NOTHING if kind == "null" else NONE_OF_THESE)
            elif kind == "single":
                right = verdict == NAMED and a["ranking"][0][0] == truth[0]
            else:
                continue
            parts.setdefault(kind, []).append(right)
        return float(np.mean([np.mean(ones) for ones in parts.values()])) if parts else 0.0

    choices = [Limits(float(e), float(s)) for e in (0.0, *excesses) for s in (0.0, *scores)]
    return max(choices, key=rate_limits)


def answer_by_limits(answer: Answer, limits: Limits) -> Answer:
    """Complete an answer by its verdict, in the form that score.py takes.

    `leads` is the first name of the ranking, whatever the verdict.
    """
    verdict = limits.decide(answer)
    names = [answer["ranking"][0][0]] if verdict == NAMED else []
    leads = answer["ranking"][0][0] if answer["ranking"] else NONE_OF_THESE
    return answer | {"verdict": verdict, "effects": names, "alternatives": [], "leads": leads}
