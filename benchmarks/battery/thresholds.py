"""Thresholds: constants of clutch_hil/discrepancy/decision.py that suit the development split best, from its cached answers.

Nothing is simulated again: a decision is taken once more from the costs that the search kept. What a search did not fit,
because a threshold said so, stays not fitted; how many effects it took stays as it was.

    python -m benchmarks.battery.thresholds [OUT/HASH/cases]
"""

import sys
from dataclasses import asdict, dataclass, replace
from itertools import product
from pathlib import Path

import numpy as np
from scipy.optimize import minimize

from benchmarks.battery.run import Cache
from benchmarks.battery.score import Told, aliased, family, hidden, names_something, strong
from benchmarks.battery.validity import engine
from clutch_hil.discrepancy import decision
from clutch_hil.discrepancy.result import NAMED, NONE_OF_THESE, NOTHING, ONE_OF

_GRID = {
    "gain": np.geomspace(0.001, 0.05, 18),
    "excess": (0.005, 0.01, 0.02, 0.03, 0.05, 0.08),
    "closed": (0.5, 0.6, 0.65, 0.7, 0.75, 0.8, 0.85, 0.9, 0.93),
    "closed_two": (0.8, 0.85, 0.9, 0.93, 0.95, 0.97),
    "alias": (0.0, 0.05, 0.1, 0.2, 0.3, 0.5, 0.7, 1.0, 1.5),
    "tie": (0.0, 1.0, 2.0, 3.0, 5.0, 8.0, 12.0),
    "relief": (4.0, 6.0, 8.0, 10.0, 15.0, 20.0, 30.0),
}
_SWEEPS = 4  # of the grid, one constant after the other
# goals of the specification and what a point missing costs; a name where nothing is hidden is what a user forgives least
_WEIGHTS = {"top1": 3.0, "alias": 1.0, "set": 1.5, "null": 8.0, "unknown": 2.0, "unknown_named": 3.0, "pairs": 1.0}
_GOALS = {"top1": 0.90, "alias": 0.97, "set": 0.95, "null": 0.0, "unknown": 0.85, "unknown_named": 0.05, "pairs": 0.75}
_BELOW = ("null", "unknown_named")
_OVER = 0.2  # what exceeding a goal by a point is worth, beside missing it by one
_LOST = 0.10  # excess without a gain: search.py
_ONE_OF_COSTS = 0.3  # of a hit: one of several is right, but less than its name


@dataclass(frozen=True)
class Constants:
    """Those of decision.py; closed: of one effect, closed_two: of two, three as decision.py has it."""

    gain: float = decision.LEAST_GAIN
    excess: float = decision.CLOSED_EXCESS
    closed: float = decision.LEAST_CLOSED[0]
    closed_two: float = decision.LEAST_CLOSED[1]
    alias: float = decision.ALIAS_SHARE
    tie: float = decision.TIE_COST
    relief: float = decision.PRIOR_GAIN


def decided(told: Told, c: Constants) -> tuple[str, list[str]]:
    """Verdict and names, the best first, with these constants: what search.py does with what it fitted."""
    w = told["weighed"]
    gain, rest, named = w["gain"], w["rest"], w["named"]
    if not named or not _gained(w, c):
        return (NONE_OF_THESE if w["excess"] > _LOST else NOTHING), []
    least = (c.closed, c.closed_two, decision.LEAST_CLOSED[2])[len(named) - 1]
    if gain / max(gain + rest, 1e-12) < least and rest >= c.excess:
        return NONE_OF_THESE, []
    near = _near(w, rest, c) if len(named) == 1 else []
    return (ONE_OF, near) if len(near) > 1 else (NAMED, list(named))


def _gained(w: Told, c: Constants) -> bool:
    better = w["gain"] - w["alike"] * w["relief"] / w["size"]
    return bool(min(w["gain"], better) > c.gain or w["gain"] > max(c.gain, w["alike"] * c.relief / w["size"]))


def _near(w: Told, rest: float, c: Constants) -> list[str]:
    lowest = min(w["costs"].values(), default=0.0)
    near = [n for n, cost in w["costs"].items() if cost - lowest <= c.alias * rest * w["size"] + c.tie * w["alike"]]
    return sorted(near, key=w["costs"].__getitem__)


def measured(answers: list[Told], c: Constants) -> dict[str, float]:
    """The goals' measures with these constants; those without cases are left out."""
    hits: dict[str, list[float]] = {name: [] for name in _GOALS}
    for told in answers:
        verdict, names = decided(told, c)
        said = bool(names)
        truth, kind = hidden(told), family(told)
        if not truth:
            hits["null"].append(said)
        elif kind == "unknown":
            hits["unknown"].append(verdict == NONE_OF_THESE)
            hits["unknown_named"].append(said)
        elif kind == "pair":
            hits["pairs"].append(set(truth) <= set(names) and verdict == NAMED)
        elif kind == "single" and strong(told):
            first = names[0] if names else ""
            hits["top1"].append((first == truth[0]) * (1.0 - _ONE_OF_COSTS * (verdict == ONE_OF)))
            hits["alias"].append(aliased(first, truth[0]))
            hits["set"].append(truth[0] in names)
    return {name: float(np.mean(ones)) for name, ones in hits.items() if ones}


def worth(found: dict[str, float]) -> float:
    """How well goals are met: weighted points missing, less a little for points beyond."""
    total = 0.0
    for name, value in found.items():
        missing = value - _GOALS[name] if name in _BELOW else _GOALS[name] - value
        total -= _WEIGHTS[name] * (missing if missing > 0.0 else _OVER * missing)
    return total


def proposed(answers: list[Told]) -> Constants:
    """Constants by sweeps over the grid, one after the other; of equally good ones the middle."""
    c = Constants()
    for _, (name, values) in product(range(_SWEEPS), _GRID.items()):
        tried = [(worth(measured(answers, replace(c, **{name: float(v)}))), float(v)) for v in values]
        top = max(value for value, _ in tried)
        good = [v for value, v in tried if value >= top - 1e-9]
        if worth(measured(answers, c)) < top - 1e-9:
            c = replace(c, **{name: good[len(good) // 2]})
    return c


def logistic(answers: list[Told], c: Constants) -> tuple[float, float, float]:
    """Coefficients (constant, of log(margin/0.1), of closed - 0.8) by which confidence of a name is most likely.

    A normal prior of width 3 holds them where few cases tell.
    """
    rows, right = [], []
    for told in answers:
        verdict, names = decided(told, c)
        if names and verdict in (NAMED, ONE_OF):
            w = told["weighed"]
            margin = _margin(w, c) if len(w["named"]) == 1 else 0.1
            rows.append((1.0, np.log(max(margin, 1e-4) / 0.1), w["closed"] - 0.8))
            truth = hidden(told)
            right.append(set(truth) == set(names) if verdict == NAMED else bool(set(truth) & set(names)))
    if not rows:
        return 2.0, 0.9, 4.0
    x, y = np.array(rows), np.array(right, float)

    def loss(b: np.ndarray) -> float:
        score = x @ b
        return float(np.sum(np.logaddexp(0.0, score) - y * score) + np.sum(b**2) / 18.0)

    return tuple(minimize(loss, np.array([2.0, 0.9, 4.0])).x.round(3).tolist())


def _margin(w: Told, c: Constants) -> float:
    near = _near(w, w["rest"], c)
    others = [cost for n, cost in w["costs"].items() if n not in near]
    return (min(others, default=w["base"]) - w["best"]) / max(w["base"] - w["best"], 1e-9)


def _names_only(answers: list[Told]) -> str:
    said = [told["case"] for told in answers if not hidden(told) and names_something(told)]
    return ", ".join(said) or "none"


def main() -> None:
    """Print the constants in use and those proposed, with what each gives."""
    folder = Path(sys.argv[1]) if len(sys.argv) > 1 else Path("runs/battery") / engine() / "cases"
    answers = [told for told in Cache(folder).all() if told["truth"]["split"] == "development"]
    if not answers:
        sys.exit(f"error: no answers of the development split below {folder}")
    nulls = [told["weighed"]["gain"] for told in answers if not hidden(told)]
    print(f"read:    {len(answers)} answers of the development split below {folder}")
    now, then = Constants(), proposed(answers)
    for title, c in (("in use", now), ("proposed", then)):
        found = measured(answers, c)
        print(f"{title + ':':10}", {k: round(v, 4) for k, v in asdict(c).items()}, f"worth {worth(found):.4f}")
        print(" " * 10, {k: round(v, 3) for k, v in found.items()})
    print("confidence, constant, log margin, closed:", logistic(answers, then))
    if nulls:
        print(
            f"gain where nothing is hidden: largest {max(nulls):.5f} of {len(nulls)}; named there: {_names_only(answers)}"
        )
    print("verdict: put them into clutch_hil/discrepancy/decision.py by hand; report on the evaluation split")


if __name__ == "__main__":
    main()
