"""Proposed experiment: the section on what to measure next."""

from collections.abc import Mapping
from typing import Any

from clutch_hil.bench.rig import list_rigs_with_model
from clutch_hil.discrepancy.report.pictures import Pictures
from clutch_hil.discrepancy.report.wording import has_proposal
from clutch_hil.discrepancy.result import IDENTIFY_FIRST, NAMED, NOTHING
from clutch_hil.page.markup import Html, describe, is_numbers, join, make_element, make_figure

_LEAD = ("title", "sentence", "what", "why", "reason")  # keys of an experiment that are shown as text, in this order


def make_section(pictures: Pictures) -> tuple[str, list[Html]]:
    """Return heading and contents of the section."""
    heading, experiment = "What to measure next", pictures.result.experiment
    before = []
    if pictures.result.equal_calibration:
        before.append(
            make_element("p", "Identify the rig first, if it never was: another calibration explains as much.")
        )
    if experiment is None and before:
        return heading, before
    if experiment is None:
        text = {
            NOTHING: "Nothing: these runs leave no question open that an experiment could answer.",
            IDENTIFY_FIRST: "No experiment is proposed: identify the rig first.",
            NAMED: "Nothing: the verdict needs no further experiment.",
        }.get(pictures.result.verdict, "No experiment is proposed.")
        return heading, [make_element("p", text)]
    lead = [key for key in _LEAD if isinstance(experiment.get(key), str) and experiment[key]]
    parts = [*before, *(make_element("p", _make_sentence(experiment[key])) for key in lead)]
    rest = {key: v for key, v in experiment.items() if key not in lead and v not in (None, {}, [], 0.0)}
    for key, part in {"": rest, **rest}.items():
        course = _read_course(part)
        if course is not None:
            time, columns = course
            parts.append(
                make_figure(
                    pictures.draw_course(time, columns), "the experiment over time", "The experiment over time."
                )
            )
            drawn = (key,) if key else ("time_s", *columns)
            rest = {k: v for k, v in rest.items() if k not in drawn}
    if rest:
        parts.append(describe(rest))
    if pictures.result.rig in list_rigs_with_model() and has_proposal(pictures.result):
        command = make_element("code", "clutch-hil experiment --for report.json")
        parts.append(make_element("p", join(["To run it on the live plant and decide again: ", command], "")))
    return heading, parts


def _make_sentence(text: str) -> str:
    """Return `text` with an initial capital and a final full stop."""
    return f"{text[:1].upper()}{text[1:]}{'' if text.endswith(('.', '!', '?')) else '.'}"


def _read_course(part: Any) -> tuple[list[float], dict[str, list[float]]] | None:
    """Return time and columns of a part of an experiment if it is a time course; else None."""
    time = part.get("time_s") if isinstance(part, Mapping) else None
    if not is_numbers(time):
        return None
    same = {k: v for k, v in part.items() if k != "time_s" and is_numbers(v) and len(v) == len(time)}
    return (list(time), same) if same else None
