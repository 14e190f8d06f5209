"""Experiment design: find the experiment that a bench can play whose outcome separates the alternatives best.

Equation        T = min over pairs (a, b) of  min over (theta, phi_b) of |r_a - r_b(theta, phi_b)|^2/n + chi^2 of theta
                r: outputs in floors; n: `Evidence.redundancy`; theta: baseline; phi_b: effects of alternative b
                T is the difference that remains after each alternative is re-fitted to the prediction of the other. The
                experiment of the library with the largest T is proposed (T-optimality)
Assumptions     the sensitivities of the baseline are those beside the first alternative; the inputs are those that the bench's
                controller gives for it; white noise
Valid range     the baseline is re-fitted for a short list of experiments only. Re-fits are linear while experiments are
                compared, and nonlinear for those that may be proposed
Not modelled    the runs already recorded limit a re-fit as well, so the true difference is larger
References      Hunter and Reiner 1965, Technometrics 7; Atkinson and Fedorov 1975, Biometrika 62
"""

from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, replace
from functools import cache, cached_property
from itertools import permutations
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any, Protocol, runtime_checkable

import numpy as np

from clutch_hil.bench.experiments import EXPERIMENTS
from clutch_hil.bench.judgement.calibration_check import CONTACT
from clutch_hil.fitting.evidence import Evidence
from clutch_hil.fitting.fit import FreeParameter, LinearModel, free_baseline, free_effect, linearise, refit
from clutch_hil.fitting.model import Columns, Model, Values, find_calibration
from plant_sim.profiles.profile import Profile, load_profile
from protocols.errors import InputError
from protocols.node import load_node
from protocols.renamed_methods import refuse_old_methods

# Least T of a separating experiment: 3 standard deviations, three times TIE_COST (decision.py). T is twice the log odds.
LEAST_SEPARATION = 9.0
# bar: up to this shift an experiment is played unchanged; its lowest pressure in contact is 0.25 bar above contact
_LEAST_SHIFT = 0.1
_SHIFT_STEP = 0.05  # bar, of a shift: a slightly better estimate of the contact pressure gives the same experiment
_SHORTLIST = 6  # experiments with the largest T, for which the baseline is re-fitted too, with thirty simulations each
_REFIT_ROUNDS = 2  # linearisations of a nonlinear re-fit
_REFITTED_EXPERIMENTS = 3  # experiments re-fitted nonlinearly before the answer is that none separates the alternatives


@dataclass(frozen=True)
class Experiment:
    """A profile, played from an oil temperature [degC] at `rate` [Hz].

    shift [bar]: added to each pressure of the profile, for a clutch whose contact pressure differs from the shipped one.
    """

    profile: str
    temperature: float
    rate: int = 1000
    shift: float = 0.0

    @property
    def name(self) -> str:
        """Return profile and temperature, for people and file names."""
        return f"{self.profile}-{self.temperature:g}"

    @property
    def title(self) -> str:
        """Return a one-sentence description of the experiment."""
        make = EXPERIMENTS.get(self.profile)
        title = ((make and make.__doc__) or self.profile).rstrip(".")
        return (
            title if not self.shift else f"{title}; here each pressure is shifted by {self.shift:+.2f} bar from these"
        )

    @property
    def seconds(self) -> float:
        """Return the length of the experiment [s]."""
        return self.load().duration

    def load(self) -> Profile:
        """Return the profile. Raises InputError where the shift leads outside the limits of the bench."""
        profile = load_profile(self.profile)
        if not self.shift:
            return profile
        try:
            return profile.shift_pressures(self.shift)
        except InputError as error:
            raise InputError(
                f"experiment {self.name} would be played {self.shift:+.2f} bar from its own pressures, to fit the contact"
                f" pressure of the controller: {error}; `clutch-hil frames --pressure` makes a bench for higher pressures"
            ) from None

    @contextmanager
    def open_profile(self) -> Iterator[str]:
        """Yield the name of the profile, or the path of a temporary file with it. Raises InputError as `load` does."""
        if not self.shift:
            yield self.profile
            return
        profile = self.load()
        with TemporaryDirectory() as folder:
            path = Path(folder) / f"{profile.name}.csv"
            path.write_text(profile.format_csv(), encoding="utf-8")
            yield str(path)

    def fit_to_contact(self, contact: float) -> "Experiment":
        """Return this experiment with its pressures shifted for a clutch with contact pressure `contact` [bar]."""
        above = contact - _load_shipped_contact()
        shift = _SHIFT_STEP * round(above / _SHIFT_STEP) if abs(above) >= _LEAST_SHIFT else 0.0
        return replace(self, shift=round(shift, 2))

    def with_rate(self, rate: int | None) -> "Experiment":
        """Return this experiment at another rate [Hz]; None keeps the rate."""
        return self if rate is None else replace(self, rate=rate)

    def list_course(self) -> dict[str, list[float]]:
        """Return the demands over time: breakpoints of the profile, by column."""
        profile = self.load()
        return {
            "time_s": list(profile.time),
            "pressure_demand_bar": list(profile.pressure),
            "motor_speed_demand_rad_s": list(profile.speed),
        }

    @property
    def command(self) -> str:
        """Return the command line that plays this experiment. A shift comes from the controller, which must be calibrated."""
        if self.shift:
            return f"clutch-hil experiment {self.name} --rate {self.rate}"
        return f"clutch-hil up --profile {self.profile} --temperature {self.temperature:g} --rate {self.rate}"


@cache
def _load_shipped_contact() -> float:
    """Return the contact pressure that the shipped controller expects [bar]: the experiments are designed for it."""
    return float(load_node("controller")().parameters[CONTACT].value)


class Bench(Protocol):
    """Interface of a rig's bench: the `experiments` it can play, and their inputs."""

    experiments: tuple[Experiment, ...]

    def plan_inputs(self, experiment: Experiment, parameters: Values, effects: Values) -> Columns | None:
        """Return columns (n,) with the inputs of an experiment; None where the experiment comes near a limit of the rig."""
        ...


@runtime_checkable
class Experimenting(Protocol):
    """A model whose rig has a bench."""

    def make_bench(self) -> Bench:
        """Return the bench of the rig."""
        ...


def check_bench(bench: Bench, rig: str) -> Bench:
    """Return the `bench` of a rig if it is complete. Raises InputError, which gives the new name of a renamed method."""
    refuse_old_methods(bench, f"the bench of the rig {rig}", {"planned": "plan_inputs"})
    if not hasattr(bench, "plan_inputs"):
        raise InputError(f"the bench of the rig {rig} lacks plan_inputs")
    return bench


class PredictedRuns(Evidence):
    """Predicted runs. They have no noise from which to estimate a floor of block means, so the noise is taken as white."""

    def _compute_block_noise(self, column: str) -> list[float]:
        return [float(self.floors[column] / np.sqrt(block)) for block in self.blocks]


@dataclass(frozen=True)
class _Comparison:
    """An experiment with each alternative linearised in it. `separation` of two: T, the smaller of both directions."""

    experiment: Experiment
    evidence: Evidence
    fits: list[LinearModel]

    @cached_property
    def separation(self) -> dict[tuple[int, int], float]:
        """Return T by pair of alternatives (i, j), i < j."""
        costs: dict[tuple[int, int], float] = {}
        for i, j in permutations(range(len(self.fits)), 2):
            pair = min(i, j), max(i, j)
            cost = self.fits[j].find_best(self.fits[j].residual - self.fits[i].residual)[1] / self.evidence.redundancy
            costs[pair] = min(cost, costs.get(pair, np.inf))
        return costs

    def score(self) -> tuple[float, float]:
        """Return T of the worst separated pair, then the sum over all pairs: the sort key of experiments."""
        return min(self.separation.values()), sum(self.separation.values())

    def with_baseline(self, free: Sequence[FreeParameter]) -> "_Comparison":
        """Return this comparison with the parameters `free` of the baseline re-fitted as well."""
        baseline = linearise(self.evidence, self.fits[0].point, free)
        fits = [
            replace(own, free=(*baseline.free, *own.free), jacobian=np.hstack([baseline.jacobian, own.jacobian]))
            for own in self.fits
        ]
        return replace(self, fits=fits)


def propose(model: Model, parameters: Values, options: Sequence[Values], floors: Values) -> dict[str, Any]:
    """Propose the experiment that separates two or more alternatives best.

    parameters: the re-fitted baseline. options: fitted parameters of the effects of each alternative, by dotted name. floors:
    by output.

    Return the entry `experiment` of report.json: profile, seconds, settings and command to play it, the reason in one sentence,
    and the predicted difference by output in floors. Where no experiment separates them, `profile` is None and `why` says so.
    """
    names = [sorted({name.partition(".")[0] for name in option}) for option in options]
    proposal: dict[str, Any] = {
        "alternatives": names,
        "profile": None,
        "seconds": 0.0,
        "settings": {},
        "predicted_difference": {},
    }
    if not isinstance(model, Experimenting):
        return proposal | {"why": f"the rig {model.name} has no bench that can play an experiment"}
    bench = check_bench(model.make_bench(), model.name)
    comparisons = [c for e in bench.experiments if (c := _compare(model, bench, e, parameters, options, floors))]
    comparisons.sort(
        key=_Comparison.score, reverse=True
    )  # without a re-fit of the baseline T is larger: an upper bound
    best = sorted(
        (c.with_baseline(_free_baseline(model, parameters)) for c in comparisons[:_SHORTLIST]),
        key=_Comparison.score,
        reverse=True,
    )
    pair = f"the closest two of {_join_names(names)}" if len(names) > 2 else _join_names(names)
    closest = 0.0
    for candidate in best[:_REFITTED_EXPERIMENTS]:
        least, by_output = _refit_closest(candidate)
        if least >= LEAST_SEPARATION:
            e = candidate.experiment
            column, times = max(by_output.items(), key=lambda item: item[1])
            why = (
                f"re-fitted to each other, {pair} still differ by {times:.2g} times the floor in {column} and by"
                f" {np.sqrt(least):.0f} standard deviations in all, more than in {len(comparisons) - 1} other experiments"
            )
            settings = {"temperature": e.temperature, "rate": e.rate, **({"shift": e.shift} if e.shift else {})}
            return proposal | {
                "title": e.title, "why": why, "profile": e.profile, "seconds": e.seconds, "settings": settings,
                "command": e.command, "predicted_difference": by_output, "standard_deviations": float(np.sqrt(least)),
                "course": e.list_course(),
            }  # fmt: skip
        closest = max(closest, least)
    return proposal | {
        "why": f"none of {len(comparisons)} experiments separates {pair}: re-fitted to each other they differ by at most"
        f" {np.sqrt(closest):.1f} standard deviations, {np.sqrt(LEAST_SEPARATION):.0f} are needed",
        "standard_deviations": float(np.sqrt(closest)),
    }


def _compare(
    model: Model, bench: Bench, experiment: Experiment, parameters: Values, options: Sequence[Values], floors: Values
) -> _Comparison | None:
    """Return the comparison of the options in an experiment; None where the experiment is not safe for one of them."""
    planned = [bench.plan_inputs(experiment, parameters, option) for option in options]
    if any(inputs is None for inputs in planned):
        return None
    inputs = planned[0]
    assert inputs is not None
    evidence = PredictedRuns(model, [{**inputs, **model.simulate(inputs, parameters, options[0])}], floors)
    fits = [linearise(evidence, (parameters, option), _free_effects(model, option)) for option in options]
    return _Comparison(experiment, evidence, fits)


def _refit_closest(compared: _Comparison) -> tuple[float, dict[str, float]]:
    """Return T of the closest alternatives after nonlinear re-fits to each other, and their difference in floors by output."""
    (i, j) = min(compared.separation, key=lambda pair: compared.separation[pair])
    given = compared.evidence
    ends = []
    for a, b in ((i, j), (j, i)):
        run = given.runs[0]
        predicted = given.model.simulate(run, *compared.fits[a].point)
        evidence = PredictedRuns(given.model, [{**run, **predicted}], given.floors)
        start = replace(compared.fits[b], residual=compared.fits[b].residual - compared.fits[a].residual)
        end = refit(evidence, start, _REFIT_ROUNDS)
        ends.append(
            (
                end.cost / evidence.redundancy,
                {
                    c: _measure_in_floors(end.residual[evidence.find_part(0, c)], evidence.blocks[0])
                    for c in evidence.columns
                },
            )
        )
    return min(ends, key=lambda end: end[0])


def _join_names(names: Sequence[Sequence[str]]) -> str:
    *first, last = ("+".join(one) for one in names)
    return f"{', '.join(first)} and {last}"


def _measure_in_floors(residual: np.ndarray, block: int) -> float:
    return float(np.sqrt(np.mean(residual**2) / block))


def _free_baseline(model: Model, parameters: Values) -> list[FreeParameter]:
    """Return the parameters of the baseline, with the prior centred at the re-fitted values."""
    return [
        replace(f, centre=float(parameters[f.name])) for f in free_baseline(model.parameters, find_calibration(model))
    ]


def _free_effects(model: Model, option: Values) -> list[FreeParameter]:
    on = {name.partition(".")[0] for name in option}
    return [
        f
        for c in model.candidates
        if c.name in on
        for f in free_effect(c, {**c.list_off_values(), **option})
        if f.name in option
    ]
