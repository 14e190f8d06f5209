"""Thresholds: find constants of clutch_hil/discrepancy/decision.py that suit the development split best, from its answers.

Nothing is simulated. Each decision is repeated from the costs that the search stored. Fits that the search skipped because of a
threshold stay excluded, and the number of accepted effects stays unchanged.

    python -m benchmarks.battery.thresholds [OUT/ENGINE/cases]
"""

from dataclasses import asdict, dataclass, replace
from itertools import product
from pathlib import Path

import numpy as np
import typer
from scipy.optimize import minimize

from benchmarks.battery.run import Cache
from benchmarks.battery.score import Answer, are_aliases, find_family, is_strong, list_hidden_names, names_an_effect
from benchmarks.battery.validity import format_engine_name
from clutch_hil.command import end_with_verdict, run_command
from clutch_hil.discrepancy import decision
from clutch_hil.discrepancy.result import NAMED, NONE_OF_THESE, NOTHING, ONE_OF
from protocols.errors import InputError

_ANSWERS = Path("runs/battery") / format_engine_name() / "cases"  # where `python -m benchmarks.battery` writes them
_GRID = {  # values tried of each constant; chosen: around those in use
    "gain": np.geomspace(0.001, 0.05, 18),
    "excess": (0.005, 0.01, 0.02, 0.03, 0.05, 0.08),
    "closed": (0.5, 0.6, 0.65, 0.7, 0.75, 0.8, 0.85, 0.9, 0.93),
    "closed_two": (0.8, 0.85, 0.9, 0.93, 0.95, 0.97),
    "alias": (0.0, 0.05, 0.1, 0.2, 0.3, 0.5, 0.7, 1.0, 1.5),
    "tie": (0.0, 1.0, 2.0, 3.0, 5.0, 8.0, 12.0),
    "relief": (4.0, 6.0, 8.0, 10.0, 15.0, 20.0, 30.0),
}
_GRID_SWEEPS = 4  # times that every constant is varied; chosen by judgement: constants depend on each other
# goal of each measure (score.py), and weight of a point below it; chosen: a name where nothing is hidden is the worst error
_WEIGHTS = {"top1": 3.0, "alias": 1.0, "set": 1.5, "null": 8.0, "unknown": 2.0, "unknown_named": 3.0, "pairs": 1.0}
_GOALS = {"top1": 0.90, "alias": 0.97, "set": 0.95, "null": 0.0, "unknown": 0.85, "unknown_named": 0.05, "pairs": 0.75}
_UPPER_LIMITS = ("null", "unknown_named")  # goals that are upper limits
# weight of a point beyond a goal, relative to one missing; chosen: a goal comes before any surplus
_SURPLUS_WORTH = 0.2
_EXCESS_WITHOUT_GAIN = 0.10  # excess above which an answer without gain is `none_of_these`: decision.DISAGREEMENT
_ONE_OF_PENALTY = 0.3  # for a right name in a `one_of` verdict; chosen: it needs one more experiment


@dataclass(frozen=True)
class Constants:
    """Constants of decision.py. `closed` is that of one effect, `closed_two` that of two effects."""

    gain: float = decision.LEAST_GAIN
    excess: float = decision.CLOSED_EXCESS
    closed: float = decision.LEAST_CLOSED[0]
    closed_two: float = decision.LEAST_CLOSED[1]
    alias: float = decision.ALIAS_SHARE
    tie: float = decision.TIE_COST
    relief: float = decision.PRIOR_GAIN


def decide_again(answer: Answer, c: Constants) -> tuple[str, list[str]]:
    """Decide verdict and names, the best first, as the engine does with these constants."""
    w = answer["weighed"]
    gain, rest, named = w["gain"], w["rest"], w["named"]
    if not named or not _has_gained(w, c):
        return (NONE_OF_THESE if w["excess"] > _EXCESS_WITHOUT_GAIN else NOTHING), []
    least = (c.closed, c.closed_two, decision.LEAST_CLOSED[2])[len(named) - 1]
    if gain / max(gain + rest, 1e-12) < least and rest >= c.excess:
        return NONE_OF_THESE, []
    near = _list_near_names(w, rest, c) if len(named) == 1 else []
    return (ONE_OF, near) if len(near) > 1 else (NAMED, list(named))


def _has_gained(w: Answer, c: Constants) -> bool:
    better = w["gain"] - w["alike"] * w["relief"] / w["size"]
    return bool(min(w["gain"], better) > c.gain or w["gain"] > max(c.gain, w["alike"] * c.relief / w["size"]))


def _list_near_names(w: Answer, rest: float, c: Constants) -> list[str]:
    lowest = min(w["costs"].values(), default=0.0)
    near = [n for n, cost in w["costs"].items() if cost - lowest <= c.alias * rest * w["size"] + c.tie * w["alike"]]
    return sorted(near, key=w["costs"].__getitem__)


def measure_goals(answers: list[Answer], c: Constants) -> dict[str, float]:
    """Compute the measures of the goals with these constants; those without cases are left out."""
    hits: dict[str, list[float]] = {name: [] for name in _GOALS}
    for answer in answers:
        verdict, names = decide_again(answer, c)
        named = bool(names)
        truth, kind = list_hidden_names(answer), find_family(answer)
        if not truth:
            hits["null"].append(named)
        elif kind == "unknown":
            hits["unknown"].append(verdict == NONE_OF_THESE)
            hits["unknown_named"].append(named)
        elif kind == "pair":
            hits["pairs"].append(set(truth) <= set(names) and verdict == NAMED)
        elif kind == "single" and is_strong(answer):
            first = names[0] if names else ""
            hits["top1"].append((first == truth[0]) * (1.0 - _ONE_OF_PENALTY * (verdict == ONE_OF)))
            hits["alias"].append(are_aliases(first, truth[0]))
            hits["set"].append(truth[0] in names)
    return {name: float(np.mean(ones)) for name, ones in hits.items() if ones}


def rate_goals(measures: dict[str, float]) -> float:
    """Rate measures against the goals: minus the weighted missing points, plus a little for points beyond a goal."""
    total = 0.0
    for name, value in measures.items():
        missing = value - _GOALS[name] if name in _UPPER_LIMITS else _GOALS[name] - value
        total -= _WEIGHTS[name] * (missing if missing > 0.0 else _SURPLUS_WORTH * missing)
    return total


def propose_constants(answers: list[Answer]) -> Constants:
    """Find constants by coordinate search over the grid; of equally good values the middle one is taken."""
    c = Constants()
    for _, (name, values) in product(range(_GRID_SWEEPS), _GRID.items()):
        rated = [(rate_goals(measure_goals(answers, replace(c, **{name: float(v)}))), float(v)) for v in values]
        top = max(value for value, _ in rated)
        good = [v for value, v in rated if value >= top - 1e-9]
        if rate_goals(measure_goals(answers, c)) < top - 1e-9:
            c = replace(c, **{name: good[len(good) // 2]})
    return c


def fit_confidence(answers: list[Answer], c: Constants) -> tuple[float, float, float]:
    """Fit the confidence of a name by logistic regression; return coefficients: constant, of log(margin/0.1), of closed - 0.8.

    A normal prior of standard deviation 3 holds them where there are few cases.
    """
    rows, right = [], []
    for answer in answers:
        verdict, names = decide_again(answer, c)
        if names and verdict in (NAMED, ONE_OF):
            w = answer["weighed"]
            margin = _compute_margin(w, c) if len(w["named"]) == 1 else 0.1
            rows.append((1.0, np.log(max(margin, 1e-4) / 0.1), w["closed"] - 0.8))
            truth = list_hidden_names(answer)
            right.append(set(truth) == set(names) if verdict == NAMED else bool(set(truth) & set(names)))
    if not rows:
        return 2.0, 0.9, 4.0
    x, y = np.array(rows), np.array(right, float)

    def compute_loss(b: np.ndarray) -> float:
        score = x @ b
        return float(np.sum(np.logaddexp(0.0, score) - y * score) + np.sum(b**2) / 18.0)

    return tuple(minimize(compute_loss, np.array([2.0, 0.9, 4.0])).x.round(3).tolist())


def _compute_margin(w: Answer, c: Constants) -> float:
    near = _list_near_names(w, w["rest"], c)
    others = [cost for n, cost in w["costs"].items() if n not in near]
    return (min(others, default=w["base"]) - w["best"]) / max(w["base"] - w["best"], 1e-9)


def _list_false_names(answers: list[Answer]) -> str:
    named = [answer["case"] for answer in answers if not list_hidden_names(answer) and names_an_effect(answer)]
    return ", ".join(named) or "none"


def main(
    folder: Path = typer.Argument(_ANSWERS, help="folder of the answers, OUT/ENGINE/cases"),
) -> None:
    """Print the constants in use and those proposed, with their measures."""
    answers = [answer for answer in Cache(folder).read_all() if answer["truth"]["split"] == "development"]
    if not answers:
        raise InputError(
            f"no answers of the development split are below {folder}; python -m benchmarks.battery gives some"
        )
    nulls = [answer["weighed"]["gain"] for answer in answers if not list_hidden_names(answer)]
    print(f"read:    {len(answers)} answers of the development split below {folder}")
    current, proposed = Constants(), propose_constants(answers)
    for title, c in (("in use", current), ("proposed", proposed)):
        measures = measure_goals(answers, c)
        print(f"{title + ':':10}", {k: round(v, 4) for k, v in asdict(c).items()}, f"worth {rate_goals(measures):.4f}")
        print(" " * 10, {k: round(v, 3) for k, v in measures.items()})
    print("confidence, constant, log margin, closed:", fit_confidence(answers, proposed))
    if nulls:
        print(
            f"gain where nothing is hidden: largest {max(nulls):.5f} of {len(nulls)}; named there: {_list_false_names(answers)}"
        )
    end_with_verdict("put them into clutch_hil/discrepancy/decision.py by hand; report on the evaluation split")


if __name__ == "__main__":
    run_command(main)
