"""Page: the discrepancy report as one HTML file that is read from top to bottom and needs no network."""

from datetime import datetime

from clutch_hil.discrepancy.report import baseline, experiment, gap, missing, provenance, remains, where
from clutch_hil.discrepancy.report.markup import Html, joined, tag
from clutch_hil.discrepancy.report.pictures import Pictures
from clutch_hil.discrepancy.report.style import STYLE
from clutch_hil.discrepancy.report.wording import closed, number, regime_text, spoken, verdict, with_unit
from clutch_hil.discrepancy.result import Result

_POLICY = "default-src 'none'; img-src data:; style-src 'unsafe-inline'"  # nothing comes from elsewhere
_SECTIONS = (where, missing, gap, baseline, remains, experiment)


def page_text(pictures: Pictures, files: list[str], command: str) -> str:
    """The whole file; `files` lie beside it, `command` is what was typed."""
    title = f"Discrepancy report: {pictures.result.rig.replace('_', ' ')}"
    sections = [section.section(pictures) for section in _SECTIONS]
    sections.append(provenance.section(pictures, files, command))
    body = [_top(pictures, title)]
    for count, (heading, content) in enumerate(sections, 1):
        body.append(tag("section", joined([tag("h2", f"{count}. {heading}"), *content])))
    head = [
        Html('<meta charset="utf-8"><meta name="viewport" content="width=device-width">'),
        Html(f'<meta http-equiv="Content-Security-Policy" content="{_POLICY}">'),
        tag("title", title),
        tag("style", Html(STYLE)),
    ]
    whole = joined([tag("head", joined(head)), tag("body", joined(body))])
    return f'<!doctype html>\n<html lang="en">\n{whole}\n</html>\n'


def _top(pictures: Pictures, title: str) -> Html:
    result = pictures.result
    count = len(result.hashes) or len(result.traces)
    when = datetime.now().astimezone().strftime("%Y-%m-%d %H:%M %Z")
    meta = f"rig {result.rig} · {count} {'run' if count == 1 else 'runs'}{_split(result)} · {when}"
    parts = [
        tag("h1", title),
        tag("p", meta, class_="meta"),
        tag("p", verdict(result), class_=f"verdict {result.verdict}"),
        _facts(pictures),
    ]
    return tag("header", joined(parts))


def _split(result: Result) -> str:
    if result.held_out == "in turn":
        return ", each left out in turn"
    out = sum(trace.held_out for trace in result.traces)
    return f", {len(result.traces) - out} fitted and {out} held out" if out else ""


def _facts(pictures: Pictures) -> Html:
    """The few numbers that the verdict rests on."""
    result, facts = pictures.result, []
    claim = max(result.where, key=lambda claim: claim.times_floor, default=None)
    if claim is not None:
        place = f"{spoken(claim.output, claim.unit)}, {regime_text(claim.regime)}"
        facts.append((f"{number(claim.times_floor, 2)} × floor", f"largest disagreement: {place}"))
    column = result.main_output
    if column is not None:
        told, unit = result.gap[column], result.units.get(column, "")
        name = spoken(column, unit)
        error = f"error of {name} on runs that were not fitted"
        if pictures.residuals.changed:
            facts.append((f"{number(told.before, 2)} → {with_unit(told.after, unit, 2)}", error))
            facts.append((closed(told), "of the gap to the floor is closed there"))
        else:
            facts.append((with_unit(told.before, unit, 2), error))
        facts.append((with_unit(told.floor, unit, 2), f"noise floor of {name}"))
    return tag("ul", joined([tag("li", joined([tag("b", big), small], "")) for big, small in facts]), class_="facts")
