"""Baseline: the section on the re-fitted parameters of the baseline."""

from clutch_hil.discrepancy.report.pictures import Pictures
from clutch_hil.discrepancy.result import Estimate
from clutch_hil.page.markup import Html, fold, make_element, make_figure, make_interval_cells, make_table, make_value
from clutch_hil.page.wording import format_number, format_unit, list_words

_FAR_SHIFT = 2.0  # multiples of the uncertainty: such a parameter is highlighted
_MOST_DRAWN = 10  # parameters in the picture and in the open table


def make_section(pictures: Pictures) -> tuple[str, list[Html]]:
    """Return heading and contents of the section."""
    heading = "Re-fitted parameters of the baseline"
    estimates = pictures.result.baseline
    if not estimates:
        return heading, [make_element("p", "No parameter of the baseline was re-fitted.")]
    known = sorted((e for e in estimates if e.uncertainty > 0.0), key=lambda e: -abs(_compute_shift(e)))
    far = [e.name for e in known if abs(_compute_shift(e)) > _FAR_SHIFT]
    summary = "None moved by more than twice its stated uncertainty."
    if far:
        summary = f"{list_words(far)} moved by more than twice the stated uncertainty: check these."
    text = f"These were fitted too, so that a different calibration of the rig does not look like missing physics. {summary}"
    most = f" The {_MOST_DRAWN} of {len(known)} that moved most." if len(known) > _MOST_DRAWN else ""
    picture = make_figure(
        pictures.draw_baseline(known[:_MOST_DRAWN]),
        "shifts of the baseline's parameters",
        "Shift of each parameter with its 95 % interval, in multiples of its stated uncertainty; shaded: 1 and 2."
        f"{most}",
    )
    order = known + [e for e in estimates if not e.uncertainty > 0.0]
    rows = [
        (
            e.name, make_value(e.nominal, format_number(e.nominal, 4)),
            format_number(e.uncertainty, 2) if e.uncertainty > 0.0 else "",
            *make_interval_cells(e.value, e.ci95), format_unit(e.unit),
            _format_shift(_compute_shift(e)) if e.uncertainty > 0.0 else "",
        )
        for e in order
    ]  # fmt: skip
    header = ("parameter", "nominal", "±", "fitted", "95 % interval", "unit", "shift")
    rest = make_table(header, rows[_MOST_DRAWN:], " nnnn n")
    first = make_table(header, rows[:_MOST_DRAWN], " nnnn n")
    return heading, [
        make_element("p", text),
        picture,
        first,
        fold(f"{len(rows) - _MOST_DRAWN} further parameters", rest),
    ]


def _compute_shift(estimate: Estimate) -> float:
    return (estimate.value - estimate.nominal) / estimate.uncertainty


def _format_shift(shift: float) -> str:
    shown = round(shift, 1)
    return f"{shown:+.1f} σ".replace("-", "−") if shown else "0.0 σ"
