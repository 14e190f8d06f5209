"""Baseline: the section on the parameters that were re-fitted before anything was called missing."""

from clutch_hil.discrepancy.report.markup import Html, figure, interval_cells, more, table, tag, value
from clutch_hil.discrepancy.report.pictures import Pictures
from clutch_hil.discrepancy.report.wording import listed, number, unit_text
from clutch_hil.discrepancy.result import Estimate

_FAR = 2.0  # multiples of the uncertainty
_DRAWN = 10  # parameters in the picture and in the table that is open


def section(pictures: Pictures) -> tuple[str, list[Html]]:
    """Heading and contents."""
    heading = "Re-fitted parameters of the baseline"
    estimates = pictures.result.baseline
    if not estimates:
        return heading, [tag("p", "No parameter of the baseline was re-fitted.")]
    known = sorted((e for e in estimates if e.uncertainty > 0.0), key=lambda e: -abs(_shift(e)))
    far = [e.name for e in known if abs(_shift(e)) > _FAR]
    told = "None moved by more than twice its stated uncertainty."
    if far:
        told = f"{listed(far)} moved by more than twice the stated uncertainty: look there."
    said = f"A rig that is only calibrated otherwise must not be taken for missing physics, so these were fitted too. {told}"
    most = f" The {_DRAWN} of {len(known)} that moved most." if len(known) > _DRAWN else ""
    picture = figure(
        pictures.baseline(known[:_DRAWN]),
        "shifts of the baseline's parameters",
        "Shift of each parameter with its 95 % interval, in multiples of the uncertainty it is known to; shaded: 1 and 2."
        f"{most}",
    )
    order = known + [e for e in estimates if not e.uncertainty > 0.0]
    rows = [
        (
            e.name, value(e.nominal, number(e.nominal, 4)), number(e.uncertainty, 2) if e.uncertainty > 0.0 else "",
            *interval_cells(e), unit_text(e.unit), _sigmas(_shift(e)) if e.uncertainty > 0.0 else "",
        )
        for e in order
    ]  # fmt: skip
    header = ("parameter", "nominal", "±", "fitted", "95 % interval", "unit", "shift")
    rest = table(header, rows[_DRAWN:], " nnnn n")
    first = table(header, rows[:_DRAWN], " nnnn n")
    return heading, [tag("p", said), picture, first, more(f"{len(rows) - _DRAWN} further parameters", rest)]


def _shift(estimate: Estimate) -> float:
    return (estimate.value - estimate.nominal) / estimate.uncertainty


def _sigmas(shift: float) -> str:
    shown = round(shift, 1)
    return f"{shown:+.1f} σ".replace("-", "−") if shown else "0.0 σ"
