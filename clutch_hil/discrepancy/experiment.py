"""Experiment: of those that a bench can do, the one whose outcome the alternatives predict most differently.

Equation        T = min over pairs (a, b) of  min over (theta, phi_b) of |r_a - r_b(theta, phi_b)|^2/n + chi^2 of theta,
                r in floors (evidence.py): what is left of the difference after each is re-fitted to the other's prediction;
                n neighbouring residuals tell as much as one (evidence.py)
                T-optimality; from the library the experiment with the largest T
Assumptions     sensitivities of the baseline are those beside the first alternative, inputs those that it would get under the
                bench's own controller; white noise
Valid range     the baseline is re-fitted too where the effects' own re-fit leaves most; re-fits are linear while experiments
                are compared, and in earnest for the one that is proposed
Not modelled    what the runs at hand say against a re-fit: the true difference is larger
References      Hunter and Reiner 1965, Technometrics 7; Atkinson and Fedorov 1975, Biometrika 62
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import permutations
from typing import Any, Protocol, runtime_checkable

import numpy as np

from clutch_hil.bench.experiments import EXPERIMENTS
from clutch_hil.discrepancy.evidence import Evidence
from clutch_hil.discrepancy.fit import Free, Linear, baseline_free, effect_free, linearised, refitted
from clutch_hil.discrepancy.model import Columns, Model, Values, calibration
from plant_sim.profiles.profile import load_profile

# T, twice the log of the odds by which the outcome would tell: 3 standard deviations, thrice what ties (decide.py)
SEPARATES = 9.0
_SHORT = 6  # experiments for which the baseline is re-fitted too, thirty simulations each: those that promise most
_ROUNDS = 2  # of the re-fit in earnest
_TRIED = 3  # experiments whose re-fit is done in earnest before none is said to separate


@dataclass(frozen=True)
class Experiment:
    """A profile, played from an oil temperature [degC] on at `rate` [Hz]."""

    profile: str
    temperature: float
    rate: int = 1000

    @property
    def name(self) -> str:
        """For people and files."""
        return f"{self.profile}-{self.temperature:g}"

    @property
    def title(self) -> str:
        """What it is, one sentence."""
        make = EXPERIMENTS.get(self.profile)
        return ((make and make.__doc__) or self.profile).rstrip(".")

    @property
    def seconds(self) -> float:
        """Its length [s]."""
        return load_profile(self.profile).duration

    def at_rate(self, rate: int | None) -> "Experiment":
        """The same at another rate [Hz]; None keeps it."""
        return self if rate is None else replace(self, rate=rate)

    def course(self) -> dict[str, list[float]]:
        """What is asked for over time: breakpoints of its profile."""
        profile = load_profile(self.profile)
        return {
            "time_s": list(profile.time),
            "pressure_demand_bar": list(profile.pressure),
            "motor_speed_demand_rad_s": list(profile.speed),
        }

    @property
    def command(self) -> str:
        """What plays it."""
        return f"clutch-hil up --profile {self.profile} --temperature {self.temperature:g} --rate {self.rate}"


class Bench(Protocol):
    """What a rig's bench can do: `experiments`, and their inputs."""

    experiments: tuple[Experiment, ...]

    def planned(self, experiment: Experiment, parameters: Values, effects: Values) -> Columns | None:
        """Columns (n,) with the inputs that an experiment would have; None where it would come near a limit of the rig."""
        ...


@runtime_checkable
class Experimenting(Protocol):
    """A model whose rig has a bench."""

    def bench(self) -> Bench:
        """The bench."""
        ...


class Predicted(Evidence):
    """Runs that are predicted: without noise to be estimated from, they are judged as if it were white, of one floor."""

    def _spread(self, column: str) -> float:
        return float(self.floors[column] / np.sqrt(np.median(self.blocks)))


@dataclass(frozen=True)
class _Compared:
    """An experiment, and each alternative linearised in it; `left` between each two: T, the smaller of both directions."""

    experiment: Experiment
    evidence: Evidence
    fits: list[Linear]

    @cached_property
    def left(self) -> dict[tuple[int, int], float]:
        """By pair, i < j."""
        costs: dict[tuple[int, int], float] = {}
        for i, j in permutations(range(len(self.fits)), 2):
            pair = min(i, j), max(i, j)
            cost = self.fits[j].best(self.fits[j].residual - self.fits[i].residual)[1] / self.evidence.alike
            costs[pair] = min(cost, costs.get(pair, np.inf))
        return costs

    def score(self) -> tuple[float, float]:
        """The pair told apart worst, then all of them."""
        return min(self.left.values()), sum(self.left.values())

    def beside_baseline(self, free: Sequence[Free]) -> "_Compared":
        """The same with the baseline re-fitted too."""
        baseline = linearised(self.evidence, self.fits[0].point, free)
        fits = [
            replace(own, free=(*baseline.free, *own.free), jacobian=np.hstack([baseline.jacobian, own.jacobian]))
            for own in self.fits
        ]
        return replace(self, fits=fits)


def propose(model: Model, parameters: Values, options: Sequence[Values], floors: Values) -> dict[str, Any]:
    """The experiment that separates `options`: fitted values of the effects of each, by dotted name, two or more, beside the
    re-fitted baseline `parameters`; `floors` by output.

    Returns what report.json has under `experiment`: profile, seconds, settings and command to play it, why in one sentence,
    predicted difference by output in floors, alternatives. Where none separates them `profile` is None and `why` says so.
    """
    names = [sorted({name.partition(".")[0] for name in option}) for option in options]
    said: dict[str, Any] = {
        "alternatives": names,
        "profile": None,
        "seconds": 0.0,
        "settings": {},
        "predicted_difference": {},
    }
    if not isinstance(model, Experimenting):
        return said | {"why": f"the rig {model.name} has no bench that could play an experiment"}
    bench = model.bench()
    found = [c for e in bench.experiments if (c := _compared(model, bench, e, parameters, options, floors))]
    found.sort(key=_Compared.score, reverse=True)  # without a re-fit of the baseline T is larger: an upper bound
    best = sorted(
        (c.beside_baseline(_baseline(model, parameters)) for c in found[:_SHORT]), key=_Compared.score, reverse=True
    )
    told = f"the closest two of {_listed(names)}" if len(names) > 2 else _listed(names)
    closest = 0.0
    for candidate in best[:_TRIED]:
        least, by_output = _in_earnest(candidate)
        if least >= SEPARATES:
            e = candidate.experiment
            column, times = max(by_output.items(), key=lambda item: item[1])
            why = (
                f"re-fitted to each other, {told} still differ by {times:.2g} times the floor in {column} and by"
                f" {np.sqrt(least):.0f} standard deviations in all, more than in {len(found) - 1} other experiments"
            )
            settings = {"temperature": e.temperature, "rate": e.rate}
            return said | {
                "title": e.title, "why": why, "profile": e.profile, "seconds": e.seconds, "settings": settings,
                "command": e.command, "predicted_difference": by_output, "standard_deviations": float(np.sqrt(least)),
                "course": e.course(),
            }  # fmt: skip
        closest = max(closest, least)
    return said | {
        "why": f"none of {len(found)} experiments separates {told}: re-fitted to each other they differ by at most"
        f" {np.sqrt(closest):.1f} standard deviations, needed are {np.sqrt(SEPARATES):.0f}",
        "standard_deviations": float(np.sqrt(closest)),
    }


def _compared(
    model: Model, bench: Bench, experiment: Experiment, parameters: Values, options: Sequence[Values], floors: Values
) -> _Compared | None:
    """An experiment with the effects of each option re-fitted; None where it is not safe with one of them."""
    planned = [bench.planned(experiment, parameters, option) for option in options]
    if any(inputs is None for inputs in planned):
        return None
    inputs = planned[0]
    assert inputs is not None
    evidence = Predicted(model, [{**inputs, **model.simulate(inputs, parameters, options[0])}], floors)
    fits = [linearised(evidence, (parameters, option), _effects(model, option)) for option in options]
    return _Compared(experiment, evidence, fits)


def _in_earnest(compared: _Compared) -> tuple[float, dict[str, float]]:
    """T between the closest two after each is re-fitted to the other in earnest, and the difference by output."""
    (i, j) = min(compared.left, key=lambda pair: compared.left[pair])
    given = compared.evidence
    ends = []
    for a, b in ((i, j), (j, i)):
        run = given.runs[0]
        predicted = given.model.simulate(run, *compared.fits[a].point)
        evidence = Predicted(given.model, [{**run, **predicted}], given.floors)
        start = replace(compared.fits[b], residual=compared.fits[b].residual - compared.fits[a].residual)
        end = refitted(evidence, start, _ROUNDS)
        ends.append(
            (
                end.cost / evidence.alike,
                {c: _times(end.residual[evidence.part(0, c)], evidence.blocks[0]) for c in evidence.columns},
            )
        )
    return min(ends, key=lambda end: end[0])


def _listed(names: Sequence[Sequence[str]]) -> str:
    *first, last = ("+".join(one) for one in names)
    return f"{', '.join(first)} and {last}"


def _times(residual: np.ndarray, block: int) -> float:
    return float(np.sqrt(np.mean(residual**2) / block))


def _baseline(model: Model, parameters: Values) -> list[Free]:
    """Within its prior about where it was re-fitted."""
    return [replace(f, centre=float(parameters[f.name])) for f in baseline_free(model.parameters, calibration(model))]


def _effects(model: Model, option: Values) -> list[Free]:
    on = {name.partition(".")[0] for name in option}
    return [
        f for c in model.candidates if c.name in on for f in effect_free(c, {**c.off(), **option}) if f.name in option
    ]
