"""Gap: the section with the errors before and after on held-out runs, and the noise floor."""

from clutch_hil.discrepancy.report.pictures import Pictures
from clutch_hil.discrepancy.report.wording import AT_FLOOR, closed_text, effect_text, ratio, regime_text
from clutch_hil.discrepancy.result import NAMED, NONE_OF_THESE, ONE_OF, Gap, Result
from clutch_hil.page.markup import Html, figure, fold, table, tag, value
from clutch_hil.page.wording import column_text, list_words, number, unit_text

_HOW = {
    "in turn": "Each run was left out in turn; the errors are those of each run by the model that had not seen it.",
    "given": "The errors are those of the runs that were held out.",
}
_HEADER = {True: ("before", "after", "floor", "closed", "unit"), False: ("error", "floor", "unit")}
_NUMERIC = {True: "nnnn ", False: "nn "}


def section(pictures: Pictures) -> tuple[str, list[Html]]:
    """Heading and contents of the section."""
    result, units, changed = pictures.result, pictures.result.units, pictures.residuals.has_changed
    title = (
        "The gap before and after, on runs that were not fitted"
        if changed
        else "The error on runs that were not fitted"
    )
    if not result.gap:
        return title, [tag("p", "No run was left out, so nothing can be said here.")]
    caption = "From before (red) to after (blue); 1 is the noise floor." if changed else "1 is the noise floor."
    rows = [
        (column_text(c, units.get(c)), *_cells(result, c, gap, changed), _reach_text(gap))
        for c, gap in result.gap.items()
    ]
    parts = [
        tag("p", _meaning(result, changed)),
        figure(pictures.draw_gap(), "error by output", caption),
        table(("output", *_HEADER[changed], ""), rows, f" {_NUMERIC[changed]}"),
    ]
    for column in pictures.shown[:1] if changed else ():
        name = column_text(column, units.get(column))
        caption = (
            f"{name.capitalize()} where before is worst in what was not fitted: measured black, before red, after blue."
        )
        parts.append(
            figure(pictures.draw_stretch(column, held_out=True), f"{name} measured, before and after", caption)
        )
    by_regime = [
        (column_text(c, units.get(c)), regime_text(regime), *_cells(result, c, gap, changed))
        for c, gaps in result.gap_by_regime.items()
        for regime, gap in gaps.items()
    ]
    if by_regime:
        parts.append(
            figure(pictures.draw_gap_by_regime(), "error by regime", "The same by regime, for what disagrees most.")
        )
        whole = table(("output", "regime", *_HEADER[changed]), by_regime, f"  {_NUMERIC[changed]}")
        parts.append(fold("every output and regime", whole))
    return title, parts


def _meaning(result: Result, changed: bool) -> str:
    """The paragraph that explains the numbers."""
    how = f"{_HOW.get(result.held_out, result.held_out)} The floor is the noise of the measurement, found in the runs."
    if not changed:
        return f"{how} Nothing was added to the model."
    added = {
        NAMED: f"with {list_words([effect_text(name) for name in result.effects])}",
        ONE_OF: "with one of the alternatives, which fit alike",
        NONE_OF_THESE: "with the nameless term that model.toml carries",
    }.get(result.verdict, "re-fitted")
    closing = "Closed: (before² − after²)/(before² − floor²)."
    return f"{how} Before: the baseline with its own parameters re-fitted; after: {added}. {closing}"


def _cells(result: Result, column: str, gap: Gap, changed: bool) -> tuple[Html | str, ...]:
    before, after, floor = (value(v, number(v)) for v in (gap.before, gap.after, gap.floor))
    unit = unit_text(result.units.get(column, ""))
    return (before, after, floor, closed_text(gap), unit) if changed else (before, floor, unit)


def _reach_text(gap: Gap) -> str:
    if ratio(gap, after=True) <= AT_FLOOR:
        return "at the floor"
    return f"{number(ratio(gap, after=True), 2)} × floor"
