"""The discrepancy report as one HTML page that needs no network."""

from datetime import datetime

from clutch_hil.discrepancy.report import (
    baseline,
    disagreement,
    gap,
    missing_physics,
    proposed_experiment,
    provenance,
    remaining_residual,
)
from clutch_hil.discrepancy.report.pictures import Pictures
from clutch_hil.discrepancy.report.wording import closed_text, regime_text, verdict_sentence
from clutch_hil.discrepancy.result import Result
from clutch_hil.page.document import compose_document
from clutch_hil.page.markup import Html, join, tag
from clutch_hil.page.wording import column_text, number, number_with_unit

_SECTIONS = (disagreement, missing_physics, gap, baseline, remaining_residual, proposed_experiment)


def compose_page(pictures: Pictures, files: list[str], command: str) -> str:
    """The HTML text; files: names of the files beside it. command: the command line that made the result."""
    title = f"Discrepancy report: {pictures.result.rig.replace('_', ' ')}"
    sections = [section.section(pictures) for section in _SECTIONS]
    sections.append(provenance.section(pictures, files, command))
    return compose_document(title, _header(pictures, title), sections)


def _header(pictures: Pictures, title: str) -> Html:
    result = pictures.result
    count = len(result.hashes) or len(result.traces)
    when = datetime.now().astimezone().strftime("%Y-%m-%d %H:%M %Z")
    meta = f"rig {result.rig} · {count} {'run' if count == 1 else 'runs'}{_split(result)} · {when}"
    parts = [
        tag("h1", title),
        tag("p", meta, class_="meta"),
        tag("p", verdict_sentence(result), class_=f"verdict {result.verdict}"),
        _facts(pictures),
    ]
    return tag("header", join(parts))


def _split(result: Result) -> str:
    if result.held_out == "in turn":
        return ", each left out in turn"
    out = sum(trace.held_out for trace in result.traces)
    return f", {len(result.traces) - out} fitted and {out} held out" if out else ""


def _facts(pictures: Pictures) -> Html:
    """The numbers that support the verdict."""
    result, facts = pictures.result, []
    claim = max(result.where, key=lambda claim: claim.times_floor, default=None)
    if claim is not None:
        place = f"{column_text(claim.output, claim.unit)}, {regime_text(claim.regime)}"
        facts.append((f"{number(claim.times_floor, 2)} × floor", f"largest disagreement: {place}"))
    column = result.main_output
    if column is not None:
        main_gap, unit = result.gap[column], result.units.get(column, "")
        name = column_text(column, unit)
        error = f"error of {name} on runs that were not fitted"
        if pictures.residuals.has_changed:
            facts.append((f"{number(main_gap.before, 2)} → {number_with_unit(main_gap.after, unit, 2)}", error))
            facts.append((closed_text(main_gap), "of the gap to the floor is closed there"))
        else:
            facts.append((number_with_unit(main_gap.before, unit, 2), error))
        facts.append((number_with_unit(main_gap.floor, unit, 2), f"noise floor of {name}"))
    return tag("ul", join([tag("li", join([tag("b", big), small], "")) for big, small in facts]), class_="facts")
