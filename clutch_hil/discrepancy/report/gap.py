"""Gap: the section with the errors before and after on held-out runs, and the noise floor."""

from clutch_hil.discrepancy.report.pictures import Pictures
from clutch_hil.discrepancy.report.wording import AT_FLOOR, compute_ratio, format_closed, format_effect, format_regime
from clutch_hil.discrepancy.result import NAMED, NONE_OF_THESE, ONE_OF, Gap, Result
from clutch_hil.page.markup import Html, fold, make_element, make_figure, make_table, make_value
from clutch_hil.page.wording import format_column, format_number, format_unit, list_words

_HOW = {
    "in turn": "Each run was left out in turn; its errors are those of the model fitted without it.",
    "given": "The errors are those of the held-out runs.",
}
_HEADER = {True: ("before", "after", "floor", "closed", "unit"), False: ("error", "floor", "unit")}
_NUMERIC = {True: "nnnn ", False: "nn "}


def make_section(pictures: Pictures) -> tuple[str, list[Html]]:
    """Return heading and contents of the section."""
    result, units, changed = pictures.result, pictures.result.units, pictures.residuals.has_changed
    title = (
        "The gap before and after, on runs that were not fitted"
        if changed
        else "The error on runs that were not fitted"
    )
    if not result.gap:
        return title, [make_element("p", "No run was left out, so this error is unknown.")]
    caption = "From before (red) to after (blue); 1 is the noise floor." if changed else "1 is the noise floor."
    rows = [
        (format_column(c, units.get(c)), *_format_cells(result, c, gap, changed), _reach_text(gap))
        for c, gap in result.gap.items()
    ]
    parts = [
        make_element("p", _explain_numbers(result, changed)),
        make_figure(pictures.draw_gap(), "error by output", caption),
        make_table(("output", *_HEADER[changed], ""), rows, f" {_NUMERIC[changed]}"),
    ]
    for column in pictures.examined_outputs[:1] if changed else ():
        name = format_column(column, units.get(column))
        caption = (
            f"{name.capitalize()} where before is worst in what was not fitted: measured black, before red, after blue."
        )
        parts.append(
            make_figure(pictures.draw_stretch(column, held_out=True), f"{name} measured, before and after", caption)
        )
    by_regime = [
        (format_column(c, units.get(c)), format_regime(regime), *_format_cells(result, c, gap, changed))
        for c, gaps in result.gap_by_regime.items()
        for regime, gap in gaps.items()
    ]
    if by_regime:
        parts.append(
            make_figure(
                pictures.draw_gap_by_regime(),
                "error by regime",
                "The same by regime, for the output that disagrees most.",
            )
        )
        whole = make_table(("output", "regime", *_HEADER[changed]), by_regime, f"  {_NUMERIC[changed]}")
        parts.append(fold("every output and regime", whole))
    return title, parts


def _explain_numbers(result: Result, changed: bool) -> str:
    """Return the paragraph that explains the numbers."""
    how = f"{_HOW.get(result.held_out, result.held_out)} The floor is the noise of the measurement, found in the runs."
    if not changed:
        return f"{how} Nothing was added to the model."
    added = {
        NAMED: f"with {list_words([format_effect(name) for name in result.effects])}",
        ONE_OF: "with one of the alternatives, which fit equally well",
        NONE_OF_THESE: "with the unnamed term in model.toml",
    }.get(result.verdict, "re-fitted")
    closing = "Closed: (before² − after²)/(before² − floor²)."
    return f"{how} Before: the baseline with its own parameters re-fitted; after: {added}. {closing}"


def _format_cells(result: Result, column: str, gap: Gap, changed: bool) -> tuple[Html | str, ...]:
    before, after, floor = (make_value(v, format_number(v)) for v in (gap.before, gap.after, gap.floor))
    unit = format_unit(result.units.get(column, ""))
    return (before, after, floor, format_closed(gap), unit) if changed else (before, floor, unit)


def _reach_text(gap: Gap) -> str:
    if compute_ratio(gap, after=True) <= AT_FLOOR:
        return "at the floor"
    return f"{format_number(compute_ratio(gap, after=True), 2)} × floor"
