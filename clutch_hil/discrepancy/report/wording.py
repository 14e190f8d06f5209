"""Wording: numbers, columns, regimes and the verdict of a `Result` as text, for the page and the pictures."""

import math
from collections.abc import Sequence

from clutch_hil.discrepancy.result import IDENTIFY_FIRST, NAMED, NOTHING, ONE_OF, Estimate, Gap, Result

NO_NUMBER = "–"
SIGNIFICANT = 0.05  # of p-values that hold for all claims together
AT_FLOOR = 1.1  # error over floor that counts as closed: the held-out measure of docs/battery.md
_MOST_MOVED = 3  # parameters in the verdict: those that moved most
_SURE = 0.9995  # confidence that would be rounded to 100 %
_SUPERSCRIPT = str.maketrans("-0123456789", "⁻⁰¹²³⁴⁵⁶⁷⁸⁹")
_UNITS = {
    "_rad_s": "rad/s", "_m_s": "m/s", "_degc": "degC", "_bar": "bar", "_rpm": "rpm", "_rad": "rad", "_nm": "Nm",
    "_mm": "mm", "_um": "um", "_hz": "Hz", "_pa": "Pa", "_v": "V", "_a": "A", "_n": "N", "_m": "m", "_k": "K", "_s": "s",
}  # fmt: skip  # by the end of a column's name (docs/rig.md), the longest first


def number(value: float, digits: int = 3) -> str:
    """`value` with `digits` significant digits."""
    if not math.isfinite(value):
        return NO_NUMBER if math.isnan(value) else ("∞" if value > 0.0 else "−∞")
    if value == 0.0:
        return "0"
    power = math.floor(math.log10(abs(float(f"{value:.{digits - 1}e}"))))
    return format_fixed(value, digits - 1 - power, power)


def trim_zeros(value: float, digits: int = 3) -> str:
    """`value` with at most `digits` significant digits, without zeros at the end: for settings, not for measurements."""
    text, times, power = number(value, digits).partition(" · ")
    return (text.rstrip("0").rstrip(".") if "." in text else text) + times + power


def format_fixed(value: float, decimals: int, power: int | None = None) -> str:
    """`value` rounded to `decimals` places, which may be negative; very large or small values with a power of ten.

    power: exponent of the leading digit, computed where it is not given.
    """
    power = math.floor(math.log10(abs(value))) if power is None and value else power or 0
    if -3 <= power < 6:
        return f"{round(value, decimals):.{max(decimals, 0)}f}".replace("-", "−")
    mantissa = f"{value / 10.0**power:.{max(decimals + power, 0)}f}".replace("-", "−")
    return f"{mantissa} · 10{str(power).translate(_SUPERSCRIPT)}"


def interval(estimate: Estimate) -> tuple[str, str, str]:
    """Value and ends of the 95 % interval, rounded to two digits of the interval's half-width."""
    low, high = estimate.ci95
    half = 0.5 * (high - low)
    if not (math.isfinite(half) and half > 0.0):
        return number(estimate.value, 4), number(low, 4), number(high, 4)
    decimals = 1 - math.floor(math.log10(half))
    largest = max(abs(estimate.value), abs(low), abs(high))
    power = math.floor(math.log10(largest)) if largest > 0.0 else 0
    value, below, above = (format_fixed(v, decimals, power) for v in (estimate.value, low, high))
    return value, below, above


def percent(share: float, decimals: int = 0) -> str:
    """`share` of 1 in percent."""
    return f"{100.0 * share:.{decimals}f} %".replace("-", "−") if math.isfinite(share) else NO_NUMBER


def confidence(share: float) -> str:
    """A confidence in percent."""
    return "more than 99.9 %" if share >= _SURE else percent(share, 1 if share > 0.985 else 0)


def closed_text(gap: Gap) -> str:
    """Share of a gap that is closed, in percent; nothing where there was none to close."""
    return percent(gap.closed) if gap.before > AT_FLOOR * gap.floor else "no gap"


def p_value_text(p_value: float) -> str:
    """A p-value."""
    return number(p_value, 1 if p_value < 0.1 else 2)


def unit_text(unit: str) -> str:
    """A unit as people write it; nothing for a pure number."""
    return {"1": "", "degC": "°C"}.get(unit, unit).replace("^2", "²").replace("^3", "³")


def number_with_unit(value: float, unit: str, digits: int = 3) -> str:
    """A number and its unit."""
    return f"{number(value, digits)} {unit_text(unit)}".rstrip()


def column_text(column: str, unit: str | None = None) -> str:
    """Name of a column without its unit, for people."""
    endings = [f"_{unit.lower().replace('/', '_').replace('^', '')}"] if unit else []
    ending = next((e for e in (*endings, *_UNITS) if column.endswith(e) and len(e) < len(column)), "")
    return column.removesuffix(ending).replace("_", " ")


def excess(gap: Gap) -> float:
    """Error before beyond the floor, in floors: 0 where noise explains all of it."""
    return math.sqrt(max(gap.before**2 / gap.floor**2 - 1.0, 0.0)) if gap.floor > 0.0 else math.nan


def axis_label(column: str, unit: str | None = None) -> str:
    """Name of a column with its unit; the unit is read from the name where it is not given."""
    known = unit or next((u for e, u in _UNITS.items() if column.endswith(e) and len(e) < len(column)), "1")
    shown = unit_text(known)
    return f"{column_text(column, unit)} [{shown}]" if shown else column_text(column, unit)


def effect_text(name: str) -> str:
    """Identifier of an effect, for people."""
    return name.replace("_", " ")


def regime_text(regime: str) -> str:
    """A regime, for people."""
    return "all samples" if regime == "all" else regime.replace("=", " = ").replace("_", " ")


def list_words(names: Sequence[str], last: str = "and") -> str:
    """Names as text: 'a, b and c'."""
    if len(names) < 2:
        return "".join(names)
    return f"{', '.join(names[:-1])} {last} {names[-1]}"


def ratio(gap: Gap, after: bool = False) -> float:
    """Error before, or after, over floor."""
    return (gap.after if after else gap.before) / gap.floor if gap.floor > 0.0 else math.inf


def count_candidates(result: Result) -> int:
    """How many candidates were judged."""
    return len({rival.name for rival in result.rivals})


def group_alternatives(result: Result) -> list[list[str]]:
    """Sets of effects of each of which one is missing. Sets of a single effect each are merged into one set."""
    sets = [each for each in result.alternatives if each]
    if all(len(each) == 1 for each in sets):
        return [[name for each in sets for name in each]] if sets else []
    return sets


def indistinguishable_effects(result: Result) -> list[str]:
    """Effects that cannot be told apart from another."""
    return [name for each in group_alternatives(result) for name in each] if result.verdict == ONE_OF else []


def has_proposal(result: Result) -> bool:
    """Whether there is an experiment that separates the alternatives; one without a profile says why there is none."""
    return result.experiment is not None and result.experiment.get("profile", "") is not None


def verdict_sentence(result: Result) -> str:
    """The verdict in one sentence, with its confidence."""
    sure = confidence(result.confidence)
    column = result.main_output
    unit = result.units.get(column or "", "")
    if result.verdict == NAMED:
        named = list_words([effect_text(name) for name in result.effects])
        return f"The model lacks {named} (confidence {sure}){_closed_clause(result, column, unit)}."
    if result.verdict == NOTHING:
        within = f": {_within_clause(result)}" if column else ""
        count = count_candidates(result)
        tried = f"; none of the {count} candidates explains more than chance does" if count else ""
        return f"Nothing is missing from the model (confidence {sure}){within}{tried}."
    if result.verdict == ONE_OF:
        lacking = [effect_text(name) for name in result.effects]
        lacking += [f"one of {list_words([effect_text(n) for n in each], 'or')}" for each in group_alternatives(result)]
        which = list_words(lacking)
        end = "; the experiment below separates them" if has_proposal(result) else ""
        return (
            f"The model lacks {which}, but these runs cannot tell which (confidence {sure} that it is among them){end}."
        )
    if result.verdict == IDENTIFY_FIRST and result.recalibration:
        moved = list_words([one.name for one in result.recalibration.moved[:_MOST_MOVED]])
        return (
            f"Identify the rig first (confidence {sure}): another calibration explains"
            f" {percent(result.recalibration.closed, 1)} of the disagreement; {moved} move beyond what is stated."
        )
    count = count_candidates(result)
    what = f"none of the {count} candidates explains" if count > 1 else "no candidate explains"
    return f"Something is missing that {what} (confidence {sure}){_location_clause(result)}."


def _closed_clause(result: Result, column: str | None, unit: str) -> str:
    if column is None:
        return ""
    gap = result.gap[column]
    falls = "falls" if gap.after < gap.before else "goes"
    return (
        f": with {'it' if len(result.effects) == 1 else 'them'} the error of {column_text(column, unit)} on runs that were not"
        f" fitted {falls} from {number_with_unit(gap.before, unit, 2)} to {number_with_unit(gap.after, unit, 2)},"
        f" where noise alone gives {number_with_unit(gap.floor, unit, 2)}"
    )


def _within_clause(result: Result) -> str:
    largest = math.ceil(100.0 * max(ratio(gap) for gap in result.gap.values())) / 100.0
    return f"on runs that were not fitted every output is within {largest:g} times its noise floor"


def _location_clause(result: Result) -> str:
    claim = max(result.where, key=lambda claim: claim.times_floor, default=None)
    if claim is None:
        return ""
    place = "" if claim.regime == "all" else f" at {regime_text(claim.regime)}"
    return (
        f": {column_text(claim.output, claim.unit)}{place} is off by {number_with_unit(claim.size, claim.unit, 2)},"
        f" {number(claim.times_floor, 2)} times its noise floor"
    )
