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
from clutch_hil.discrepancy.report.wording import format_closed, format_regime, make_verdict_sentence
from clutch_hil.discrepancy.result import Result
from clutch_hil.page.document import compose_document
from clutch_hil.page.markup import Html, join, make_element
from clutch_hil.page.wording import format_column, format_number, format_with_unit
from protocols.errors import format_count

_SECTIONS = (disagreement, missing_physics, gap, baseline, remaining_residual, proposed_experiment)


def compose_page(pictures: Pictures, files: list[str], command: str) -> str:
    """Return the HTML text. files: names of the other report files. command: the command line that made the result."""
    title = f"Discrepancy report: {pictures.result.rig.replace('_', ' ')}"
    sections = [section.make_section(pictures) for section in _SECTIONS]
    sections.append(provenance.make_section(pictures, files, command))
    return compose_document(title, _make_header(pictures, title), sections)


def _make_header(pictures: Pictures, title: str) -> Html:
    result = pictures.result
    count = len(result.hashes) or len(result.traces)
    when = datetime.now().astimezone().strftime("%Y-%m-%d %H:%M %Z")
    meta = f"rig {result.rig} · {format_count(count, 'run')}{_split(result)} · {when}"
    parts = [
        make_element("h1", title),
        make_element("p", meta, class_="meta"),
        make_element("p", make_verdict_sentence(result), class_=f"verdict {result.verdict}"),
        _make_facts(pictures),
    ]
    return make_element("header", join(parts))


def _split(result: Result) -> str:
    if result.held_out == "in turn":
        return ", each left out in turn"
    out = sum(trace.held_out for trace in result.traces)
    return f", {len(result.traces) - out} fitted and {out} held out" if out else ""


def _make_facts(pictures: Pictures) -> Html:
    """Return the numbers that support the verdict."""
    result, facts = pictures.result, []
    claim = max(result.where, key=lambda claim: claim.times_floor, default=None)
    if claim is not None:
        place = f"{format_column(claim.output, claim.unit)}, {format_regime(claim.regime)}"
        facts.append((f"{format_number(claim.times_floor, 2)} × floor", f"largest disagreement: {place}"))
    column = result.main_output
    if column is not None:
        main_gap, unit = result.gap[column], result.units.get(column, "")
        name = format_column(column, unit)
        error = f"error of {name} on runs that were not fitted"
        if pictures.residuals.has_changed:
            facts.append((f"{format_number(main_gap.before, 2)} → {format_with_unit(main_gap.after, unit, 2)}", error))
            facts.append((format_closed(main_gap), "of the gap to the floor is closed there"))
        else:
            facts.append((format_with_unit(main_gap.before, unit, 2), error))
        facts.append((format_with_unit(main_gap.floor, unit, 2), f"noise floor of {name}"))
    return make_element(
        "ul",
        join([make_element("li", join([make_element("b", big), small], "")) for big, small in facts]),
        class_="facts",
    )
