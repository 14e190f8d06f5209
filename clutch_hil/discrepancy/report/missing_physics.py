"""Missing physics: the section with the effects that are missing, their equations and values, and the rejected rivals."""

from collections.abc import Sequence
from itertools import groupby

from clutch_hil.discrepancy.recalibration import Recalibration
from clutch_hil.discrepancy.report.pictures import Pictures
from clutch_hil.discrepancy.report.wording import format_effect, group_alternatives, list_indistinguishable_effects
from clutch_hil.discrepancy.result import IDENTIFY_FIRST, NAMED, NONE_OF_THESE, NOTHING, ONE_OF, Estimate, Result, Rival
from clutch_hil.page.markup import (
    Html,
    describe,
    fold,
    join,
    make_element,
    make_figure,
    make_interval_cells,
    make_table,
    make_value,
)
from clutch_hil.page.wording import format_number, format_percent, format_unit, list_words, trim_zeros

_MOST_DRAWN = 12  # rivals in a picture
_OPEN_ROWS = 8  # rivals in the open table
_TITLES = {
    NOTHING: "Missing physics: none, and what was tried",
    NAMED: "Missing physics, and why not the other candidates",
    ONE_OF: "Missing physics: one of a few effects, and why not the others",
    NONE_OF_THESE: "Missing physics: none of the candidates",
    IDENTIFY_FIRST: "Missing: a calibration",
}


def make_section(pictures: Pictures) -> tuple[str, list[Html]]:
    """Return heading and contents of the section."""
    result = pictures.result
    heading = _TITLES.get(result.verdict, _TITLES[NAMED])
    parts = _describe_effects(result)
    if result.verdict == IDENTIFY_FIRST and result.recalibration:
        parts += _describe_recalibration(result.recalibration)
    if result.equal_calibration:
        parts += _describe_equal_calibration(result.equal_calibration)
    if result.verdict == NONE_OF_THESE:
        parts += _describe_surrogate(result)
    judged = [(count, list(g)) for count, g in groupby(sorted(result.rivals, key=lambda r: r.round), lambda r: r.round)]
    for count, rivals in judged:
        if len(judged) > 1:
            added = [format_effect(r.name) for c, others in judged if c < count for r in others if not r.reason]
            known = f", with {list_words(added)} added" if added else ""
            parts.append(make_element("h3", f"Search {count}{known}"))
        parts += _describe_rivals(pictures, rivals)
    if judged:
        text = "Gain: reduction of twice the negative log-likelihood by the candidate."
        parts.append(make_element("p", text, class_="soft"))
    return heading, parts


def _describe_effects(result: Result) -> list[Html]:
    """Return equation and values of each effect that is named or is an alternative."""
    parts: list[Html] = []
    names = result.effects
    if result.verdict == ONE_OF:
        names = list(dict.fromkeys([*names, *list_indistinguishable_effects(result)]))
        same = list_words([format_effect(name) for name in list_indistinguishable_effects(result)])
        text = (
            f"Each of {same} explains the measurement as well as the others do: these runs do not excite the difference between"
            " them. Equation and fitted values of each, as if it were the missing one:"
        )
        parts.append(make_element("p", text))
    shown: list[Estimate] = []
    for name in names:
        own = [estimate for estimate in result.parameters if estimate.name.startswith(f"{name}.")]
        shown += own
        parts.append(make_element("h3", format_effect(name)))
        if name in result.equations:
            parts.append(make_element("pre", result.equations[name]))
        rival = next((rival for rival in result.rivals if rival.name == name), None)
        parts.append(_describe_estimates(own, f"{name}.") if own or not rival else _describe_fitted_values(rival))
    parts.append(_describe_estimates([estimate for estimate in result.parameters if estimate not in shown], ""))
    if result.verdict == NAMED and result.alternatives:
        near = [format_effect(name) for each in group_alternatives(result) for name in each]
        parts.append(make_element("p", f"The closest alternative: {list_words(near, 'or')}."))
    return parts


def _describe_recalibration(recalibration: Recalibration) -> list[Html]:
    before, after, effects = (
        format_number(power, 2) for power in (recalibration.before, recalibration.after, recalibration.effects)
    )
    text = (
        f"Above the floor the baseline within its stated uncertainty leaves {before} times the floor's power. Fitted"
        f" further, it leaves {after} times. The effects that explain most leave {effects} times. So no"
        f" effect is named: after an identification of the rig, a search shows whether one is missing. Next,"
        f" {recalibration.advice}. Moved parameters:"
    )
    return [make_element("p", text), _make_table_of_moved(recalibration)]


def _describe_equal_calibration(recalibration: Recalibration) -> list[Html]:
    text = (
        "These parameters, beyond their stated uncertainties, explain the measurement as well as what is named above. The runs"
        f" cannot tell which is right. If this rig was never identified, {recalibration.advice}."
    )
    return [make_element("h3", "Or another calibration"), make_element("p", text), _make_table_of_moved(recalibration)]


def _make_table_of_moved(recalibration: Recalibration) -> Html:
    rows = [
        (m.name, make_value(m.nominal, format_number(m.nominal, 4)), make_value(m.value, format_number(m.value, 4)),
         format_unit(m.unit),
         format_number(m.uncertainty, 2) if m.uncertainty > 0.0 else "",
         format_number(m.sigmas, 2) if m.uncertainty > 0.0 else "")
        for m in recalibration.moved
    ]  # fmt: skip
    header = ("parameter", "stated", "re-calibrated", "unit", "±", "times ±")
    return make_table(header, rows, " nn nn")


def _describe_fitted_values(rival: Rival) -> Html:
    """Return the values of an alternative; intervals are computed for the first one only."""
    rows = [
        (
            name.removeprefix(f"{rival.name}."),
            make_value(value, format_number(value)),
            format_unit(rival.units.get(name, "")),
        )
        for name, value in rival.values.items()
    ]
    return make_table(("parameter", "fitted", "unit"), rows, " n ")


def _describe_estimates(estimates: Sequence[Estimate], prefix: str) -> Html:
    rows = [
        (
            e.name.removeprefix(prefix),
            *make_interval_cells(e.value, e.ci95),
            format_unit(e.unit),
            make_value(e.nominal, format_number(e.nominal)),
        )
        for e in estimates
    ]
    return make_table(("parameter", "fitted", "95 % interval", "unit", "value before"), rows, " nn n")


def _describe_surrogate(result: Result) -> list[Html]:
    best = max(result.rivals, key=lambda rival: rival.closed, default=None)
    parts = []
    if best is not None and best.gain > 0.0:
        text = (
            f"The best of the candidates, {format_effect(best.name)}, closes {format_percent(best.closed)} of the gap to the"
            " floor,"
            " which is not enough to name it. The residual itself shows:"
        )
        parts.append(make_element("p", text))
    if result.surrogate:
        surrogate = {key: part for key, part in result.surrogate.items() if part not in ("", [], {}, None)}
        if sentence := surrogate.pop("sentence", ""):
            parts.append(make_element("p", str(sentence)))
        carried = "values" in surrogate
        added = "model.toml contains no term for it."
        if carried:
            added = "model.toml contains it with the values below; the gap after is that of the model with this term."
        return [*parts, make_element("p", added), describe(surrogate)]
    return [*parts, make_element("p", "No structure that can be described was found in it.")]


def _describe_rivals(pictures: Pictures, rivals: list[Rival]) -> list[Html]:
    """Return picture and table of the candidates of a search."""
    result = pictures.result
    same = set(list_indistinguishable_effects(result))
    order = sorted(
        rivals, key=lambda r: (bool(r.reason), r.name not in same, -r.closed if r.closed == r.closed else 0.0)
    )
    most = f" The first {_MOST_DRAWN} of {len(order)}." if len(order) > _MOST_DRAWN else ""
    legend = {
        NAMED: "Blue: named; grey: refused.",
        ONE_OF: "Light blue: cannot be distinguished; grey: refused.",
    }.get(result.verdict, "All were refused.")
    picture = make_figure(
        pictures.draw_rivals(order[:_MOST_DRAWN], sorted(same)),
        "share of the gap that each candidate closes",
        f"Every candidate was fitted alone, together with the parameters of the baseline. {legend}{most}",
    )
    rows: list[Sequence[object]] = [
        (
            format_effect(rival.name), make_value(rival.closed, format_percent(rival.closed, 1)),
            make_value(rival.gain, format_number(rival.gain)),
            _format_values(rival), rival.reason or ("cannot be distinguished" if rival.name in same else "named"),
        )
        for rival in order
    ]  # fmt: skip
    marks = ["alike" if r.name in same else "" if r.reason else "chosen" for r in order]
    header: Sequence[str] = ("candidate", "gap closed", "gain", "fitted values", "why not")
    if not any(rival.values for rival in order):
        header, rows = (*header[:3], header[4]), [(*row[:3], row[4]) for row in rows]
    rest = make_table(header, rows[_OPEN_ROWS:], " nn", marks[_OPEN_ROWS:])
    first = make_table(header, rows[:_OPEN_ROWS], " nn", marks[:_OPEN_ROWS])
    return [picture, first, fold(f"{len(rows) - _OPEN_ROWS} further candidates", rest)]


def _format_values(rival: Rival) -> Html:
    return join(
        [
            f"{name.partition('.')[2] or name} = {trim_zeros(value)} {format_unit(rival.units.get(name, ''))}".rstrip()
            for name, value in rival.values.items()
        ],
        ", ",
    )
