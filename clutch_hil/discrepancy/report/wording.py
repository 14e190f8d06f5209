"""Wording: regimes, gaps and the verdict of a `Result` as text, for the page and the pictures."""

import math

from clutch_hil.discrepancy.result import IDENTIFY_FIRST, NAMED, NOTHING, ONE_OF, Gap, Result
from clutch_hil.page.wording import format_column, format_number, format_percent, format_with_unit, list_words

SIGNIFICANT = 0.05  # level of p-values that are corrected for all claims together
AT_FLOOR = 1.1  # error over floor that counts as closed: the held-out measure of docs/battery.md
_MOST_MOVED = 3  # parameters in the verdict: those that moved most
_SURE = 0.9995  # confidence that would be rounded to 100 %


def format_confidence(share: float) -> str:
    """Return a confidence in percent."""
    return "more than 99.9 %" if share >= _SURE else format_percent(share, 1 if share > 0.985 else 0)


def format_closed(gap: Gap) -> str:
    """Return the share of a gap that is closed, in percent; empty where there was no gap."""
    return format_percent(gap.closed) if gap.before > AT_FLOOR * gap.floor else "no gap"


def format_p_value(p_value: float) -> str:
    """Return a p-value as text."""
    return format_number(p_value, 1 if p_value < 0.1 else 2)


def compute_excess(gap: Gap) -> float:
    """Return the error before in excess of the floor, in floors: 0 where noise explains all of it."""
    return math.sqrt(max(gap.before**2 / gap.floor**2 - 1.0, 0.0)) if gap.floor > 0.0 else math.nan


def format_effect(name: str) -> str:
    """Return the identifier of an effect as text for people."""
    return name.replace("_", " ")


def format_regime(regime: str) -> str:
    """Return a regime as text for people."""
    return "all samples" if regime == "all" else regime.replace("=", " = ").replace("_", " ")


def compute_ratio(gap: Gap, after: bool = False) -> float:
    """Return the error before, or after, divided by the floor."""
    return (gap.after if after else gap.before) / gap.floor if gap.floor > 0.0 else math.inf


def count_candidates(result: Result) -> int:
    """Return the number of candidates that were judged."""
    return len({rival.name for rival in result.rivals})


def group_alternatives(result: Result) -> list[list[str]]:
    """Return sets of effects, one of which is missing. Sets of a single effect each are merged into one set."""
    sets = [each for each in result.alternatives if each]
    if all(len(each) == 1 for each in sets):
        return [[name for each in sets for name in each]] if sets else []
    return sets


def list_indistinguishable_effects(result: Result) -> list[str]:
    """Return the effects that cannot be distinguished from another."""
    return [name for each in group_alternatives(result) for name in each] if result.verdict == ONE_OF else []


def has_proposal(result: Result) -> bool:
    """Return whether there is an experiment that separates the alternatives; one without a profile states why there is none."""
    return result.experiment is not None and result.experiment.get("profile", "") is not None


def make_verdict_sentence(result: Result) -> str:
    """Return the verdict in one sentence, with its confidence, and another one where a calibration explains as much."""
    also = " Another calibration explains as much: see below." if result.equal_calibration else ""
    return f"{_describe_verdict(result)}{also}"


def _describe_verdict(result: Result) -> str:
    sure = format_confidence(result.confidence)
    column = result.main_output
    unit = result.units.get(column or "", "")
    if result.verdict == NAMED:
        named = list_words([format_effect(name) for name in result.effects])
        return f"The model lacks {named} (confidence {sure}){_describe_closed(result, column, unit)}."
    if result.verdict == NOTHING:
        within = f": {_describe_within(result)}" if column else ""
        count = count_candidates(result)
        tried = f"; none of the {count} candidates explains more than chance" if count else ""
        return f"Nothing is missing from the model (confidence {sure}){within}{tried}."
    if result.verdict == ONE_OF:
        lacking = [format_effect(name) for name in result.effects]
        lacking += [
            f"one of {list_words([format_effect(n) for n in each], 'or')}" for each in group_alternatives(result)
        ]
        which = list_words(lacking)
        end = "; the experiment below separates them" if has_proposal(result) else ""
        return f"The model lacks {which}, but these runs cannot decide which (confidence {sure} that it is among them){end}."
    if result.verdict == IDENTIFY_FIRST and result.recalibration:
        shown = result.recalibration.moved[:_MOST_MOVED]
        moved = list_words([one.name for one in shown])
        how = "beyond their stated uncertainties" if all(one.sigmas > 1.0 for one in shown) else "most"
        return (
            f"Identify the rig first (confidence {sure}): another calibration explains"
            f" {format_percent(result.recalibration.closed, 1)} of the disagreement; {moved} move {how}."
        )
    count = count_candidates(result)
    what = f"none of the {count} candidates explains" if count > 1 else "no candidate explains"
    return f"Something is missing that {what} (confidence {sure}){_describe_location(result)}."


def _describe_closed(result: Result, column: str | None, unit: str) -> str:
    if column is None:
        return ""
    gap = result.gap[column]
    falls = "falls" if gap.after < gap.before else "goes"
    return (
        f": with {'it' if len(result.effects) == 1 else 'them'} the error of {format_column(column, unit)} on runs that"
        " were not"
        f" fitted {falls} from {format_with_unit(gap.before, unit, 2)} to {format_with_unit(gap.after, unit, 2)},"
        f" where noise alone gives {format_with_unit(gap.floor, unit, 2)}"
    )


def _describe_within(result: Result) -> str:
    largest = math.ceil(100.0 * max(compute_ratio(gap) for gap in result.gap.values())) / 100.0
    logged = any(finding.check == "logged" for finding in result.checks) and largest > AT_FLOOR
    rows = ", which the low rate of a logger alone can explain" if logged else ""
    return f"on runs that were not fitted every output is within {largest:g} times its noise floor{rows}"


def _describe_location(result: Result) -> str:
    claim = max(result.where, key=lambda claim: claim.times_floor, default=None)
    if claim is None:
        return ""
    place = "" if claim.regime == "all" else f" at {format_regime(claim.regime)}"
    return (
        f": {format_column(claim.output, claim.unit)}{place} is off by {format_with_unit(claim.size, claim.unit, 2)},"
        f" {format_number(claim.times_floor, 2)} times its noise floor"
    )
