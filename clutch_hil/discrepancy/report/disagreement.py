"""Disagreement: the section with the outputs and regimes in which measurement and model disagree."""

from clutch_hil.discrepancy.report.pictures import Pictures
from clutch_hil.discrepancy.report.wording import SIGNIFICANT, p_value_text, regime_text
from clutch_hil.page.markup import Html, figure, fold, table, tag, value
from clutch_hil.page.wording import column_text, list_words, number, number_with_unit

_OPEN_ROWS = 8  # claims in the open table


def section(pictures: Pictures) -> tuple[str, list[Html]]:
    """Heading and contents of the section."""
    parts = [_introduction(pictures)]
    model = "the model before" if pictures.residuals.has_changed else "the model"
    for column in pictures.shown:
        name = column_text(column, pictures.result.units.get(column))
        caption = (
            f"{name.capitalize()}: measured (black) and {model} (red). Below, the residual: measured less model;"
            " grey: twice the noise floor, where 95 % of it lie if the model is right."
        )
        parts.append(figure(pictures.draw_stretch(column), f"{name} measured and modelled", caption))
    parts += [
        figure(
            pictures.draw_shapes(),
            "loops and residual maps",
            "Left: the output over what it follows, about the worst stretch. Right: mean residual of all runs over variables"
            " that explain most of it, while they rise (solid) and fall (dashed). Curves apart from each other mean"
            " hysteresis or delay; a slope means a gain; a level means an offset. Grey: the noise floor of one sample.",
        ),
        figure(
            pictures.draw_size_map(),
            "size of the disagreement by output and regime",
            "Size of the disagreement beyond noise by output and regime, in multiples of the noise floor; 0 is noise alone."
            f" ● is claimed: p < {SIGNIFICANT:g} for all claims together, valid for autocorrelated residuals.",
        ),
        figure(
            pictures.draw_orders(),
            "order spectrum",
            "Amplitude of the residual by periods a turn of the shaft: what stands out is bound to the turn.",
        ),
    ]
    return "Where measurement and model disagree", [*parts, *_claims(pictures)]


def _introduction(pictures: Pictures) -> Html:
    units = pictures.result.units
    sure = [claim for claim in pictures.result.where if claim.p_value < SIGNIFICANT]
    first = max(sure, key=lambda claim: claim.times_floor, default=None)
    if first is None:
        return tag(
            "p",
            "No output disagrees beyond what noise explains, in any regime. The pictures show where the residual is largest.",
        )
    others = [column_text(c, units.get(c)) for c in pictures.residuals.disagreeing_outputs if c != first.output]
    also = f" They disagree in {list_words(others)} too." if others else ""
    place = "" if first.regime == "all" else f", at {regime_text(first.regime)}"
    return tag(
        "p",
        f"Most of all in {column_text(first.output, first.unit)}{place} (block: {first.block}): off by"
        f" {number_with_unit(first.size, first.unit)} root mean square, {number(first.times_floor, 2)} times the noise floor"
        f" (p\u00a0=\u00a0{p_value_text(first.p_value)}).{also}",
    )


def _claims(pictures: Pictures) -> list[Html]:
    rows = [
        (
            claim.block, column_text(claim.output, claim.unit), regime_text(claim.regime),
            value(claim.size, number_with_unit(claim.size, claim.unit)),
            value(claim.times_floor, number(claim.times_floor, 2)),
            value(claim.p_value, p_value_text(claim.p_value)),
        )
        for claim in sorted(pictures.result.where, key=lambda claim: -claim.times_floor)
    ]  # fmt: skip
    header = ("block", "output", "regime", "size (rms)", "times floor", "p")
    rest = table(header, rows[_OPEN_ROWS:], "   nnn")
    return [table(header, rows[:_OPEN_ROWS], "   nnn"), fold(f"{len(rows) - _OPEN_ROWS} smaller ones", rest)]
