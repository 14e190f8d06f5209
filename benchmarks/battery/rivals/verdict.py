"""From a ranking to a verdict, with two limits per method, set on the development split."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from benchmarks.battery.score import Told, family, hidden
from clutch_hil.discrepancy.result import NAMED, NONE_OF_THESE, NOTHING

_GRID = 30  # values of each limit that are tried


@dataclass(frozen=True)
class Limits:
    """Least excess over the floor that is a disagreement, least score of a name."""

    excess: float = 0.02
    score: float = 0.0

    def said(self, told: Told) -> str:
        """Verdict of an answer with `excess` and `ranking`."""
        ranking = told["ranking"]
        best = ranking[0][0] if ranking else NONE_OF_THESE
        if told["excess"] < self.excess or best == NOTHING:
            return NOTHING
        return NONE_OF_THESE if not ranking or best == NONE_OF_THESE or ranking[0][1] < self.score else NAMED


def tuned(answers: Sequence[Told]) -> Limits:
    """Limits with the best mean of: names of single effects right, null cases silent, unknown effects `none_of_these`."""
    excesses = np.unique(np.quantile([a["excess"] for a in answers], np.linspace(0.0, 0.6, _GRID)))
    scores = np.unique(
        np.quantile([a["ranking"][0][1] for a in answers if a["ranking"]], np.linspace(0.0, 0.95, _GRID))
    )

    def worth(limits: Limits) -> float:
        parts: dict[str, list[bool]] = {}
        for a in answers:
            kind, verdict, truth = family(a), limits.said(a), hidden(a)
            if kind in ("null", "unknown"):
                right = verdict == (NOTHING if kind == "null" else NONE_OF_THESE)
            elif kind == "single":
                right = verdict == NAMED and a["ranking"][0][0] == truth[0]
            else:
                continue
            parts.setdefault(kind, []).append(right)
        return float(np.mean([np.mean(ones) for ones in parts.values()])) if parts else 0.0

    tried = [Limits(float(e), float(s)) for e in (0.0, *excesses) for s in (0.0, *scores)]
    return max(tried, key=worth)


def answered(told: Told, limits: Limits) -> Told:
    """An answer in the form that score.py counts, and the name that leads its ranking, whatever the limits say."""
    verdict = limits.said(told)
    names = [told["ranking"][0][0]] if verdict == NAMED else []
    leads = told["ranking"][0][0] if told["ranking"] else NONE_OF_THESE
    return told | {"verdict": verdict, "effects": names, "alternatives": [], "leads": leads}
