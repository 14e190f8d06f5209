"""Ranking of effects that another method gives for one case, computed in a worker process."""

from pathlib import Path

from benchmarks.battery.cases import Case
from benchmarks.battery.rivals import gaussian_process, sindy
from benchmarks.battery.rivals.features import compute_features
from benchmarks.battery.rivals.residuals import load_residuals, simulate_effects
from benchmarks.battery.score import Answer


def rank_case(method: str, folder: Path, name: str) -> Answer:
    """Rank the effects of a case by a method; for the classifier only its features are computed."""
    data = load_residuals(name, folder)
    answer: Answer = {"case": name, "truth": _describe_truth(name), "excess": data.excess, "ranking": []}
    if method == "sindy":
        return answer | {"ranking": sindy.rank_effects(data)}
    if method == "gaussian_process":
        return answer | {"ranking": gaussian_process.rank_effects(data, simulate_effects(name))}
    return answer | {"features": compute_features(data).tolist()}


def _describe_truth(name: str) -> Answer:
    """Return the fields of the truth that score.py needs. The methods do not see them."""
    case = Case.of(name)
    return {
        "effects": [{"name": n} for n in case.effects], "severity": case.severity, "noise": case.noise, "split": case.split,
    }  # fmt: skip
