"""Score: the measures of docs/battery.md, each with numerator, denominator and 95 % Wilson interval.

top-1           the first name reported (that of `named`, or the first of `one_of`) is the effect hidden; single effects
alias           it is that, or one of its alias group by the specification
in the set      the effect is among all names reported
false name      `named` or `one_of` where nothing is hidden
localisation    of `where`: a claim is right if its block is that of a hidden effect and its regime is the truth's: the
                difference (with - without, free of noise) of the claimed output is at least TOLD floors there and is
                concentrated there, which is: atlas.concentrated, given the difference itself, names the regime ("all" where
                it names none), or it is DENSE times denser there than over all samples. Precision: right claims of all
                claims. Recall: hidden effects with a right claim of all hidden effects. F1 of both, over all single, pair,
                triple and null cases together
closed          (before^2 - after^2)/(before^2 - floor^2), squares over floors^2 summed over the analog outputs, held out
resolves        of cases with `one_of` that holds the truth: the truth is named once the proposed experiment has been played;
                where none was proposed it is not
at the floor    no analog output is left above AT_FLOOR of its floor, held out
worse           that sum is larger after than before by more than CHANCE
parameter       |estimate - truth|/|truth - off| where law and catalogue share the parameter (shared.py) and the name is right
coverage        truth inside `ci95`, the same parameters
Shares are of cases with a gap of at least 2 (severity) where the measure is of hidden effects, by noise and all together.
References      Wilson 1927, J. Am. Stat. Assoc. 22
"""

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from math import isnan, nan, sqrt
from typing import Any

import numpy as np

from benchmarks.battery.cases import FAMILIES, NOISES
from benchmarks.battery.shared import SHARED
from clutch_hil.discrepancy.result import NAMED, NONE_OF_THESE, NOTHING, ONE_OF

Told = dict[str, Any]
TOLD = 0.3  # floors: less is of no practical interest (atlas.LEAST_DISAGREEMENT)
DENSE = 1.6  # atlas._DENSER
AT_FLOOR = 1.1
CHANCE = 1e-3  # of the sum of squares
LEFT = 0.03  # of the number of residuals: with less the re-fitted baseline has taken the effect up (decision.CLOSED_EXCESS)
ANALOG = ("cylinder_pressure_bar", "clutch_torque_nm", "motor_torque_nm", "oil_temperature_degc")
ALIASES = (  # of the specification
    {"torque_sensor_gain", "friction_level"},
    {"valve_delay", "slower_valve", "pressure_time_offset"},
    {"piston_seal_friction", "valve_hysteresis", "friction_lag"},
    {"torque_sensor_leakage", "friction_fade", "coulomb_temperature"},
    {"clearance_change", "entrapped_air", "squeeze_film", "supply_sag"},
    {"torque_sensor_offset", "drag_torque"},
)
_NORMAL = 1.959964


def wilson(good: int, count: int) -> tuple[float, float]:
    """95 % interval of a share."""
    if count == 0:
        return nan, nan
    share, z2 = good / count, _NORMAL**2
    middle = share + z2 / (2 * count)
    half = _NORMAL * sqrt(share * (1.0 - share) / count + z2 / (4 * count**2))
    return max(0.0, (middle - half) / (1.0 + z2 / count)), min(1.0, (middle + half) / (1.0 + z2 / count))


@dataclass(frozen=True)
class Measure:
    """A number: its `value`, of `good` of `count` where it is a share (else good is None), its goal.

    `below`: smaller is better. `upper`: the goal's other end, of a range.
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
        """95 % interval of a share."""
        return wilson(self.good, self.count) if self.good is not None else (nan, nan)

    @property
    def reached(self) -> bool | None:
        """Whether the goal is reached; None where there is none or nothing was measured."""
        if self.goal is None or isnan(self.value):
            return None
        if self.upper is not None:
            return self.goal <= self.value <= self.upper
        return self.value <= self.goal if self.below else self.value >= self.goal


def hidden(told: Told) -> list[str]:
    """Names that a case hides."""
    return [effect["name"] for effect in told["truth"]["effects"]]


def family(told: Told) -> str:
    """Family of a case."""
    return str(told["case"]).partition("/")[0]


def reported(told: Told) -> list[str]:
    """All names reported, the best first."""
    flat = [n for group in told["alternatives"] for n in ([group] if isinstance(group, str) else group)]
    return list(dict.fromkeys([*told["effects"], *flat]))


def first(told: Told) -> str:
    """The first name reported, or the verdict where there is none."""
    names = reported(told) if told["verdict"] in (NAMED, ONE_OF) else []
    return names[0] if names else str(told["verdict"])


def aliased(one: str, other: str) -> bool:
    """Whether two names are one or of one alias group."""
    return one == other or any({one, other} <= group for group in ALIASES)


def strong(told: Told) -> bool:
    """Whether its gap was to be at least twice the floor."""
    return float(told["truth"]["severity"]) >= 2.0


def _share(
    name: str, answers: Iterable[Told], good: Callable[[Told], bool], goal: float | None = None, below: bool = False
) -> Measure:
    judged = [good(told) for told in answers]
    value = sum(judged) / len(judged) if judged else nan
    return Measure(name, value, len(judged), goal, sum(judged), below)


def _median(name: str, values: Sequence[float], goal: float, below: bool = False, unit: str = "%") -> Measure:
    value = float(np.median(values)) if values else nan
    return Measure(name, value, len(values), goal, None, below, unit=unit)


def names_something(told: Told) -> bool:
    """Whether an effect is named, or one of several."""
    return told["verdict"] in (NAMED, ONE_OF)


def claimed(told: Told) -> list[bool]:
    """Whether each claim of a case is right."""
    blocks = {effect["block"] for effect in told["truth"]["effects"]}
    return [c["block"] in blocks and _there(c) for c in told["claims"]]


def _there(claim: Told) -> bool:
    dense = claim["regime"] != "all" and claim["density"] >= DENSE
    return claim["times_floor"] >= TOLD and (claim["concentrated"] or dense)


def localisation(answers: Sequence[Told], block_alone: bool = False) -> float:
    """F1 of block and regime, or of the block alone."""
    right = claims = found = effects = 0
    for told in answers:
        blocks = {effect["block"] for effect in told["truth"]["effects"]}
        good = [c["block"] in blocks for c in told["claims"]] if block_alone else claimed(told)
        right, claims = right + sum(good), claims + len(good)
        seen = {c["block"] for c, ok in zip(told["claims"], good, strict=True) if ok}
        found += sum(effect["block"] in seen for effect in told["truth"]["effects"])
        effects += len(told["truth"]["effects"])
    if not claims and not effects:
        return nan
    precision, recall = right / max(claims, 1), found / max(effects, 1)
    return 2.0 * precision * recall / (precision + recall) if right else 0.0


def _powers(told: Told) -> tuple[float, float, float]:
    """Sums of squares over floors^2 of the analog outputs: before, after, floor."""
    gaps = [told["gap"][column] for column in ANALOG]
    return (
        sum((gap["before"] / gap["floor"]) ** 2 for gap in gaps),
        sum((gap["after"] / gap["floor"]) ** 2 for gap in gaps),
        float(len(gaps)),
    )


def closed(told: Told) -> float:
    """Share of the held-out gap that is closed; not-a-number where the baseline has no gap there."""
    before, after, floor = _powers(told)
    return (before - after) / (before - floor) if before > 1.01 * floor else nan


def at_floor(told: Told) -> bool:
    """Whether all analog outputs are at the floor, held out."""
    return all(told["gap"][c]["after"] <= AT_FLOOR * told["gap"][c]["floor"] for c in ANALOG)


def worse(told: Told) -> bool:
    """Whether the model is worse on held-out runs than the re-fitted baseline."""
    before, after, _ = _powers(told)
    return after > before * (1.0 + CHANCE)


def parameters(told: Told) -> list[tuple[float, bool]]:
    """Relative error, and whether the interval holds the truth, of each parameter shared with an effect named rightly."""
    found = []
    estimates = {one["name"]: one for one in told["parameters"]}
    for effect in told["truth"]["effects"]:
        shared = SHARED.get(effect["name"])
        if shared is None or effect["law"] not in shared.laws or effect["name"] not in told["effects"]:
            continue
        estimate = estimates[f"{effect['name']}.{shared.parameter}"]
        truth = shared.truth(effect, told["truth"]["celsius"])
        low, high = estimate["ci95"]
        found.append((abs(estimate["value"] - truth) / abs(truth - shared.off), low <= truth <= high))
    return found


def naming(answers: Sequence[Told]) -> list[Measure]:
    """The measures that need names alone, which other methods give too."""
    single = [t for t in answers if family(t) == "single" and strong(t)]
    noisy = [t for t in single if t["truth"]["noise"] >= NOISES[-1]]
    unknown = [t for t in answers if family(t) == "unknown"]
    null = [t for t in answers if not t["truth"]["effects"]]
    return [
        _share("top-1 name", single, _named_right, 0.90),
        _share("alias group right", single, lambda t: aliased(first(t), hidden(t)[0]), 0.97),
        _share("top-1 name at 5 % noise", noisy, _named_right, 0.85),
        _share("a name where nothing is hidden", null, names_something, 0.01, True),
        _share("anything but nothing_missing there", null, lambda t: t["verdict"] != NOTHING),
        _share("unknown effect: none_of_these", unknown, lambda t: t["verdict"] == NONE_OF_THESE, 0.85),
        _share("unknown effect: a name", unknown, names_something, 0.05, True),
    ]


def _named_right(told: Told) -> bool:
    return first(told) == hidden(told)[0]


def _resolved(told: Told) -> bool:
    again = told["resolved"]
    return again is not None and again["verdict"] == NAMED and again["effects"] == hidden(told)


def _both_named(told: Told) -> bool:
    return set(hidden(told)) <= set(told["effects"])


def scores(answers: Sequence[Told]) -> list[Measure]:
    """Every measure beside its goal. Cases that broke the engine (`error`) are counted first, and left out of the others."""
    done = [told for told in answers if "error" not in told]
    families: dict[str, list[Told]] = {name: [t for t in done if family(t) == name] for name in FAMILIES}
    single = [t for t in families["single"] if strong(t)]
    located = single + families["null"] + [t for name in ("pair", "triple") for t in families[name]]
    errors = [one for t in done for one in parameters(t)]
    shares = [closed(t) for t in single]
    f1, block = (localisation(located, alone) if located else nan for alone in (False, True))
    return [
        _share("cases that broke the engine", answers, lambda t: "error" in t, 0.0, True),
        *naming(done),
        _share(
            "top-1 where the re-fit leaves a gap", [t for t in single if t["weighed"]["excess"] > LEFT], _named_right
        ),
        _share("truth in the reported set", single, lambda t: hidden(t)[0] in reported(t), 0.95),
        _share("one_of, of single effects", single, lambda t: t["verdict"] == ONE_OF),
        _share(
            "one named beside it that is not hidden", single, lambda t: set(hidden(t)) < set(t["effects"]), below=True
        ),
        _share("the proposed experiment resolves it", [t for t in single if "resolved" in t], _resolved, 0.90),
        Measure("localisation F1, block and regime", f1, len(located), 0.90, unit=""),
        Measure("localisation F1, block alone", block, len(located), unit=""),
        _median("held-out gap closed, median", [s for s in shares if np.isfinite(s)], 0.95),
        _share("held-out error at most 1.1 floor", single, at_floor, 0.80),
        _share("worse on held-out runs", done, worse, 0.005, True),
        _median("parameter error, median", [error for error, _ in errors], 0.10, True),
        _covered(errors),
        _share("pairs: both named", families["pair"], _both_named, 0.75),
        _share("triples: all named", families["triple"], _both_named),
        _share("warm: top-1", [t for t in families["warm"] if hidden(t)], _named_right),
        _share("closed loop: top-1", [t for t in families["closed"] if hidden(t)], _named_right),
        _median("CPU time a case", [t["cpu_seconds"] for t in done], 120.0, True, "s"),
    ]


def _covered(errors: Sequence[tuple[float, bool]]) -> Measure:
    inside = sum(covered for _, covered in errors)
    value = inside / len(errors) if errors else nan
    return Measure("intervals that hold the truth", value, len(errors), 0.90, inside, upper=0.98)


def by_noise(answers: Sequence[Told]) -> dict[float, list[Measure]]:
    """The measures of each noise alone."""
    return {noise: scores([t for t in answers if t["truth"]["noise"] == noise]) for noise in NOISES}


def by_severity(answers: Sequence[Told]) -> dict[float, Measure]:
    """Top-1 of single effects by severity."""
    done = [t for t in answers if "error" not in t and family(t) == "single"]
    found = {}
    for severity in sorted({float(t["truth"]["severity"]) for t in done}):
        ones = [t for t in done if t["truth"]["severity"] == severity]
        found[severity] = _share(f"severity {severity}", ones, lambda t: first(t) == hidden(t)[0])
    return found
