"""Disagreement: the section with the outputs and regimes in which measurement and model disagree."""

from clutch_hil.discrepancy.report.pictures import Pictures
from clutch_hil.discrepancy.report.wording import SIGNIFICANT, format_p_value, format_regime
from clutch_hil.discrepancy.result import NAMED, ONE_OF
from clutch_hil.page.markup import Html, fold, make_element, make_figure, make_table, make_value
from clutch_hil.page.wording import format_column, format_number, format_with_unit, list_words

_OPEN_ROWS = 8  # claims in the open table


def make_section(pictures: Pictures) -> tuple[str, list[Html]]:
    """Return heading and contents of the section."""
    parts = [_introduce(pictures)]
    model = "the model before" if pictures.residuals.has_changed else "the model"
    for column in pictures.examined_outputs:
        name = format_column(column, pictures.result.units.get(column))
        caption = (
            f"{name.capitalize()}: measured (black) and {model} (red). Below, the residual: measured minus model;"
            " grey: twice the noise floor, which contains 95 % of it if the model is right."
        )
        parts.append(make_figure(pictures.draw_stretch(column), f"{name} measured and modelled", caption))
    parts += [
        make_figure(
            pictures.draw_shapes(),
            "loops and residual maps",
            "Left: the output over the variable that it depends on, around the worst stretch. Right: mean residual of"
            " all runs over variables"
            " that explain most of it, while they rise (solid) and fall (dashed). Curves apart from each other mean"
            " hysteresis or delay; a slope means a gain; a level means an offset. Grey: the noise floor of one sample.",
        ),
        make_figure(
            pictures.draw_size_map(),
            "size of the disagreement by output and regime",
            "Size of the disagreement beyond noise by output and regime, in multiples of the noise floor; 0 is noise alone."
            f" ● is claimed: p < {SIGNIFICANT:g} for all claims together, valid for autocorrelated residuals.",
        ),
        make_figure(
            pictures.draw_orders(),
            "order spectrum",
            "Amplitude of the residual by periods per turn of the shaft: a peak belongs to the rotation.",
        ),
    ]
    return "Where measurement and model disagree", [*parts, *_list_claims(pictures)]


def _introduce(pictures: Pictures) -> Html:
    units = pictures.result.units
    sure = [claim for claim in pictures.result.where if claim.p_value < SIGNIFICANT]
    first = max(sure, key=lambda claim: claim.times_floor, default=None)
    if first is None:
        named = pictures.result.verdict in (NAMED, ONE_OF)  # by all runs together
        text = (
            f"All runs together show the disagreement. No single place is certain (p < {SIGNIFICANT:g})."
            if named
            else "No output disagrees beyond what noise explains, in any regime."
        )
        return make_element("p", f"{text} The pictures show where the residual is largest.")
    others = [format_column(c, units.get(c)) for c in pictures.residuals.disagreeing_outputs if c != first.output]
    also = f" They also disagree in {list_words(others)}." if others else ""
    place = "" if first.regime == "all" else f", at {format_regime(first.regime)}"
    acts = pictures.result.verdict in (NAMED, ONE_OF)  # then each size is that of the effect at its fitted strength
    return make_element(
        "p",
        f"Most of all in {format_column(first.output, first.unit)}{place} (block: {first.block}):"
        f" {'the named effects change it by' if acts else 'off by'}"
        f" {format_with_unit(first.size, first.unit)} root mean square,"
        f" {format_number(first.times_floor, 2)} times the noise floor"
        f" (p\u00a0=\u00a0{format_p_value(first.p_value)}).{also}",
    )


def _list_claims(pictures: Pictures) -> list[Html]:
    rows = [
        (
            claim.block, format_column(claim.output, claim.unit), format_regime(claim.regime),
            make_value(claim.size, format_with_unit(claim.size, claim.unit)),
            make_value(claim.times_floor, format_number(claim.times_floor, 2)),
            make_value(claim.p_value, format_p_value(claim.p_value)),
        )
        for claim in sorted(pictures.result.where, key=lambda claim: -claim.times_floor)
    ]  # fmt: skip
    header = ("block", "output", "regime", "size (rms)", "times floor", "p")
    rest = make_table(header, rows[_OPEN_ROWS:], "   nnn")
    return [make_table(header, rows[:_OPEN_ROWS], "   nnn"), fold(f"{len(rows) - _OPEN_ROWS} smaller ones", rest)]
