"""Ranking: what a rival says of one case, as a worker process gives it."""

from pathlib import Path

from benchmarks.battery.cases import Case
from benchmarks.battery.rivals import gaussian_process, sindy
from benchmarks.battery.rivals.features import features
from benchmarks.battery.rivals.prepared import prepared, simulated
from benchmarks.battery.score import Told


def rank(method: str, folder: Path, name: str) -> Told:
    """A method's ranking of a case; of the classifier its features."""
    made = prepared(name, folder)
    told: Told = {"case": name, "truth": _truth(name), "excess": made.excess, "ranking": []}
    if method == "sindy":
        return told | {"ranking": sindy.ranked(made)}
    if method == "gaussian_process":
        return told | {"ranking": gaussian_process.ranked(made, simulated(name))}
    return told | {"features": features(made).tolist()}


def _truth(name: str) -> Told:
    """What score.py needs of the truth; for the method's answer is not looked at."""
    case = Case.of(name)
    return {
        "effects": [{"name": n} for n in case.effects], "severity": case.severity, "noise": case.noise, "split": case.split,
    }  # fmt: skip
