"""Score: the measures of docs/battery.md, each with its numerator, denominator and 95 % Wilson interval.

top-1           the first name of the answer (of `named`, or of `one_of`) is the hidden effect; single effects
alias           the first name is the hidden effect, or of the same group of ALIAS_GROUPS
in the set      the effect is among all names of the answer
false name      `named` or `one_of` where nothing is hidden
localisation    of `where`. A claim is right if its block is that of a hidden effect and its regime agrees with the truth. The
                regime agrees if the true difference (with - without, without noise) of the claimed output is there at least
                LEAST_CLAIM floors, and is concentrated there. It is concentrated if atlas.concentrated, applied to the true
                difference, names the regime ("all" where it names none), or if its power per sample there is at least
                LEAST_DENSITY times that of all samples. Precision: right claims over all claims. Recall: hidden effects
                with a right claim over all hidden effects. F1 of both, for all single, pair, triple and null cases together
closed          (before^2 - after^2)/(before^2 - floor^2); sums of squares over floors^2 of the analog outputs, held-out runs
resolves        cases with `one_of` that contains the truth: the truth is named after the proposed experiment was run; a case
                without a proposal counts as not resolved
at the floor    no analog output of the held-out runs is left above FLOOR_LIMIT of its floor
worse           that sum is larger after than before by more than WORSE_TOLERANCE
parameter       |estimate - truth|/|truth - off| where law and catalogue share the parameter (shared_parameters.py) and the
                name is right
coverage        the truth lies inside `ci95`, for these parameters
Shares of hidden effects count cases with a gap (severity) of at least 2, for each noise and for all together.
References      Wilson 1927, J. Am. Stat. Assoc. 22
"""

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from math import isnan, nan, sqrt
from typing import Any

import numpy as np

from benchmarks.battery.cases import FAMILIES, NOISES
from benchmarks.battery.shared_parameters import SHARED_PARAMETERS
from clutch_hil.discrepancy.result import NAMED, NONE_OF_THESE, NOTHING, ONE_OF

Answer = dict[str, Any]  # a case, its truth and the engine's answer: a JSON object
LEAST_CLAIM = 0.3  # floors: a smaller difference is of no practical interest (atlas.LEAST_DISAGREEMENT)
LEAST_DENSITY = 1.6  # times the power of all samples (atlas._LEAST_DENSITY)
FLOOR_LIMIT = 1.1  # times the floor; chosen: a rest of 0.46 floors, of no practical interest
WORSE_TOLERANCE = 1e-3  # share of the sum of squares; chosen by judgement: a smaller share counts as chance
LEAST_EXCESS = 0.03  # over the number of residuals: below, the re-fit has absorbed the effect (decision.CLOSED_EXCESS)
ANALOG_COLUMNS = ("cylinder_pressure_bar", "clutch_torque_nm", "motor_torque_nm", "oil_temperature_degc")
ALIAS_GROUPS = (  # effects that are hard to tell apart by their physics; chosen by judgement
    {"torque_sensor_gain", "friction_level"},
    {"valve_delay", "slower_valve", "pressure_time_offset"},
    {"piston_seal_friction", "valve_hysteresis", "friction_lag"},
    {"torque_sensor_leakage", "friction_fade", "coulomb_temperature"},
    {"clearance_change", "entrapped_air", "squeeze_film", "supply_sag"},
    {"torque_sensor_offset", "drag_torque"},
)
_NORMAL_QUANTILE = 1.959964  # 97.5 % quantile of the standard normal distribution


def compute_wilson_interval(good: int, count: int) -> tuple[float, float]:
    """Compute the 95 % Wilson interval of the share `good`/`count`; not-a-numbers for no cases."""
    if count == 0:
        return nan, nan
    share, z2 = good / count, _NORMAL_QUANTILE**2
    middle = share + z2 / (2 * count)
    half = _NORMAL_QUANTILE * sqrt(share * (1.0 - share) / count + z2 / (4 * count**2))
    return max(0.0, (middle - half) / (1.0 + z2 / count)), min(1.0, (middle + half) / (1.0 + z2 / count))


@dataclass(frozen=True)
class Measure:
    """A measure with its goal.

    `value` is a share, of `good` among `count` cases, or another number of `count` cases; `good` is then None. `below`:
    smaller is better. `upper`: upper end of a goal that is a range.
    """

    name: str
    value: float
    count: int
    goal: float | None = None
    good: int | None = None
    below: bool = False
    upper: float | None = None
    unit: str = "%"

    @property
    def interval(self) -> tuple[float, float]:
        """95 % interval of a share; not-a-numbers for other numbers."""
        return compute_wilson_interval(self.good, self.count) if self.good is not None else (nan, nan)

    @property
    def reached(self) -> bool | None:
        """Whether the goal is reached; None without a goal or a measured value."""
        if self.goal is None or isnan(self.value):
            return None
        if self.upper is not None:
            return self.goal <= self.value <= self.upper
        return self.value <= self.goal if self.below else self.value >= self.goal


def list_hidden_names(answer: Answer) -> list[str]:
    """List the effects that a case hides."""
    return [effect["name"] for effect in answer["truth"]["effects"]]


def find_family(answer: Answer) -> str:
    """Find the family of a case."""
    return str(answer["case"]).partition("/")[0]


def list_reported_names(answer: Answer) -> list[str]:
    """List all names of an answer, the best first."""
    flat = [n for group in answer["alternatives"] for n in ([group] if isinstance(group, str) else group)]
    return list(dict.fromkeys([*answer["effects"], *flat]))


def find_first_name(answer: Answer) -> str:
    """Find the first name of an answer; if it has no name, its verdict."""
    names = list_reported_names(answer) if answer["verdict"] in (NAMED, ONE_OF) else []
    return names[0] if names else str(answer["verdict"])


def are_aliases(one: str, other: str) -> bool:
    """Return whether two names are equal or of one alias group."""
    return one == other or any({one, other} <= group for group in ALIAS_GROUPS)


def is_strong(answer: Answer) -> bool:
    """Return whether the severity of the case is at least 2."""
    return float(answer["truth"]["severity"]) >= 2.0


def _measure_share(
    name: str, answers: Iterable[Answer], good: Callable[[Answer], bool], goal: float | None = None, below: bool = False
) -> Measure:
    verdicts = [good(answer) for answer in answers]
    value = sum(verdicts) / len(verdicts) if verdicts else nan
    return Measure(name, value, len(verdicts), goal, sum(verdicts), below)


def _measure_median(name: str, values: Sequence[float], goal: float, below: bool = False, unit: str = "%") -> Measure:
    value = float(np.median(values)) if values else nan
    return Measure(name, value, len(values), goal, None, below, unit=unit)


def names_an_effect(answer: Answer) -> bool:
    """Return whether the verdict names an effect, or one of several."""
    return answer["verdict"] in (NAMED, ONE_OF)


def check_claims(answer: Answer) -> list[bool]:
    """Check whether each claim of an answer is right, see localisation above."""
    blocks = {effect["block"] for effect in answer["truth"]["effects"]}
    return [c["block"] in blocks and _is_located(c) for c in answer["claims"]]


def _is_located(claim: Answer) -> bool:
    dense = claim["regime"] != "all" and claim["density"] >= LEAST_DENSITY
    return claim["times_floor"] >= LEAST_CLAIM and (claim["concentrated"] or dense)


def compute_localisation_f1(answers: Sequence[Answer], block_alone: bool = False) -> float:
    """Compute F1 [-] of block and regime, or of the block alone; not-a-number without claims and effects."""
    right = claims = located = effects = 0
    for answer in answers:
        blocks = {effect["block"] for effect in answer["truth"]["effects"]}
        good = [c["block"] in blocks for c in answer["claims"]] if block_alone else check_claims(answer)
        right, claims = right + sum(good), claims + len(good)
        located_blocks = {c["block"] for c, ok in zip(answer["claims"], good, strict=True) if ok}
        located += sum(effect["block"] in located_blocks for effect in answer["truth"]["effects"])
        effects += len(answer["truth"]["effects"])
    if not claims and not effects:
        return nan
    precision, recall = right / max(claims, 1), located / max(effects, 1)
    return 2.0 * precision * recall / (precision + recall) if right else 0.0


def _sum_gap_powers(answer: Answer) -> tuple[float, float, float]:
    """Return the sum of the squares over floors^2 of the analog outputs, held-out runs: before, after, floor."""
    gaps = [answer["gap"][column] for column in ANALOG_COLUMNS]
    return (
        sum((gap["before"] / gap["floor"]) ** 2 for gap in gaps),
        sum((gap["after"] / gap["floor"]) ** 2 for gap in gaps),
        float(len(gaps)),
    )


def compute_closed_share(answer: Answer) -> float:
    """Compute the share of the gap in held-out runs that the model closes; not-a-number where the baseline has no gap."""
    before, after, floor = _sum_gap_powers(answer)
    return (before - after) / (before - floor) if before > 1.01 * floor else nan


def is_at_floor(answer: Answer) -> bool:
    """Return whether all analog outputs of the held-out runs are at the floor."""
    return all(answer["gap"][c]["after"] <= FLOOR_LIMIT * answer["gap"][c]["floor"] for c in ANALOG_COLUMNS)


def is_worse(answer: Answer) -> bool:
    """Return whether the model is worse on held-out runs than the re-fitted baseline."""
    before, after, _ = _sum_gap_powers(answer)
    return after > before * (1.0 + WORSE_TOLERANCE)


def list_parameter_errors(answer: Answer) -> list[tuple[float, bool]]:
    """List relative errors of shared parameters of rightly named effects, and whether the interval holds the truth."""
    errors = []
    estimates = {one["name"]: one for one in answer["parameters"]}
    for effect in answer["truth"]["effects"]:
        shared = SHARED_PARAMETERS.get(effect["name"])
        if shared is None or effect["law"] not in shared.laws or effect["name"] not in answer["effects"]:
            continue
        estimate = estimates[f"{effect['name']}.{shared.parameter}"]
        truth = shared.compute_truth(effect, answer["truth"]["celsius"])
        low, high = estimate["ci95"]
        errors.append((abs(estimate["value"] - truth) / abs(truth - shared.off), low <= truth <= high))
    return errors


def score_names(answers: Sequence[Answer]) -> list[Measure]:
    """Compute the measures that need only names, which other methods give as well."""
    single = [t for t in answers if find_family(t) == "single" and is_strong(t)]
    noisy = [t for t in single if t["truth"]["noise"] >= NOISES[-1]]
    unknown = [t for t in answers if find_family(t) == "unknown"]
    null = [t for t in answers if not t["truth"]["effects"]]
    return [
        _measure_share("top-1 name", single, _is_named, 0.90),
        _measure_share(
            "alias group right", single, lambda t: are_aliases(find_first_name(t), list_hidden_names(t)[0]), 0.97
        ),
        _measure_share("top-1 name at 5 % noise", noisy, _is_named, 0.85),
        _measure_share("a name where nothing is hidden", null, names_an_effect, 0.01, True),
        _measure_share("anything but nothing_missing there", null, lambda t: t["verdict"] != NOTHING),
        _measure_share("unknown effect: none_of_these", unknown, lambda t: t["verdict"] == NONE_OF_THESE, 0.85),
        _measure_share("unknown effect: a name", unknown, names_an_effect, 0.05, True),
    ]


def _is_named(answer: Answer) -> bool:
    return find_first_name(answer) == list_hidden_names(answer)[0]


def _is_resolved(answer: Answer) -> bool:
    again = answer["resolved"]
    return again is not None and again["verdict"] == NAMED and again["effects"] == list_hidden_names(answer)


def _names_all(answer: Answer) -> bool:
    return set(list_hidden_names(answer)) <= set(answer["effects"])


def score_answers(answers: Sequence[Answer]) -> list[Measure]:
    """Compute all measures with their goals. The first counts cases that broke the engine; the others leave these out."""
    done = [answer for answer in answers if "error" not in answer]
    families: dict[str, list[Answer]] = {name: [t for t in done if find_family(t) == name] for name in FAMILIES}
    single = [t for t in families["single"] if is_strong(t)]
    located = single + families["null"] + [t for name in ("pair", "triple") for t in families[name]]
    errors = [one for t in done for one in list_parameter_errors(t)]
    shares = [compute_closed_share(t) for t in single]
    f1, block = (compute_localisation_f1(located, alone) if located else nan for alone in (False, True))
    return [
        _measure_share("cases that broke the engine", answers, lambda t: "error" in t, 0.0, True),
        *score_names(done),
        _measure_share(
            "top-1 where the re-fit leaves a gap",
            [t for t in single if t["weighed"]["excess"] > LEAST_EXCESS],
            _is_named,
        ),
        _measure_share(
            "truth in the reported set", single, lambda t: list_hidden_names(t)[0] in list_reported_names(t), 0.95
        ),
        _measure_share("one_of, of single effects", single, lambda t: t["verdict"] == ONE_OF),
        _measure_share(
            "one named beside it that is not hidden",
            single,
            lambda t: set(list_hidden_names(t)) < set(t["effects"]),
            below=True,
        ),
        _measure_share(
            "the proposed experiment resolves it", [t for t in single if "resolved" in t], _is_resolved, 0.90
        ),
        Measure("localisation F1, block and regime", f1, len(located), 0.90, unit=""),
        Measure("localisation F1, block alone", block, len(located), unit=""),
        _measure_median("held-out gap closed, median", [s for s in shares if np.isfinite(s)], 0.95),
        _measure_share("held-out error at most 1.1 floor", single, is_at_floor, 0.80),
        _measure_share("worse on held-out runs", done, is_worse, 0.005, True),
        _measure_median("parameter error, median", [error for error, _ in errors], 0.10, True),
        _measure_coverage(errors),
        _measure_share("pairs: both named", families["pair"], _names_all, 0.75),
        _measure_share("triples: all named", families["triple"], _names_all),
        _measure_share("warm: top-1", [t for t in families["warm"] if list_hidden_names(t)], _is_named),
        _measure_share("closed loop: top-1", [t for t in families["closed"] if list_hidden_names(t)], _is_named),
        _measure_median("CPU time a case", [t["cpu_seconds"] for t in done], 120.0, True, "s"),
    ]


def _measure_coverage(errors: Sequence[tuple[float, bool]]) -> Measure:
    inside = sum(covered for _, covered in errors)
    value = inside / len(errors) if errors else nan
    return Measure("intervals that hold the truth", value, len(errors), 0.90, inside, upper=0.98)


def score_by_noise(answers: Sequence[Answer]) -> dict[float, list[Measure]]:
    """Compute all measures, for each noise separately."""
    return {noise: score_answers([t for t in answers if t["truth"]["noise"] == noise]) for noise in NOISES}


def score_by_severity(answers: Sequence[Answer]) -> dict[float, Measure]:
    """Compute the share of right first names of single effects, for each severity."""
    done = [t for t in answers if "error" not in t and find_family(t) == "single"]
    measures = {}
    for severity in sorted({float(t["truth"]["severity"]) for t in done}):
        cases = [t for t in done if t["truth"]["severity"] == severity]
        measures[severity] = _measure_share(
            f"severity {severity}", cases, lambda t: find_first_name(t) == list_hidden_names(t)[0]
        )
    return measures
