"""Report of an identification as one HTML page that needs no network."""

from collections.abc import Sequence
from datetime import datetime
from importlib.metadata import version
from platform import python_version

import numpy as np

from clutch_hil.bench.rig import find_rig
from clutch_hil.identify.calibration import Calibration, Identified
from clutch_hil.identify.identification import Identification
from clutch_hil.identify.joint_fit import GOOD_FIT
from clutch_hil.identify.misfit import LOGGED
from clutch_hil.identify.report.quantity_pictures import MAPS_HEIGHT, RESPONSE_HEIGHT, plot_maps, plot_response
from clutch_hil.identify.report.report_pictures import FAR, draw_correlation, draw_fit, draw_parameters
from clutch_hil.identify.two_clutches.hand_over import HAND_OVER
from clutch_hil.identify.two_clutches.power_shift import ShiftIdentification
from clutch_hil.page.document import compose_document
from clutch_hil.page.figures import page_figure, render_png
from clutch_hil.page.markup import (
    Html,
    fold,
    join,
    make_element,
    make_figure,
    make_interval_cells,
    make_table,
    make_value,
)
from clutch_hil.page.wording import format_column, format_number, format_unit, format_with_unit
from protocols.errors import format_count

_PACKAGES = ("clutch-hil", "numpy", "scipy", "numba", "matplotlib")
_MOST_PAIRS = 8  # number of correlated pairs in the visible table
_CORRELATED = 0.95  # correlation of a pair above which the two intervals must not be used independently

Section = tuple[str, list[Html]]


def compose_report(identification: Identification, files: Sequence[str], command: str) -> str:
    """Return the report as HTML text. files: names of the files in the same folder. command: the command line as typed."""
    calibration = identification.calibration
    title = f"Identification report: {calibration.rig.replace('_', ' ')}"
    sections = [
        _make_parameter_section(calibration), _make_warnings(identification), *_make_hand_overs(identification),
        _make_fit(identification), _make_quantities(identification),
        *([_make_correlation_section(calibration)] if len(calibration.parameters) > 1 else []),
        _make_run_section(identification),
        _make_provenance_section(identification, files, command),
    ]  # fmt: skip
    return compose_document(title, _make_header(identification, title), sections)


def make_verdict_sentence(identification: Identification) -> str:
    """Return a summary in one sentence: what was identified, how well it fits, and the number of warnings."""
    calibration = identification.calibration
    column = max(identification.misfit, key=lambda name: identification.misfit[name])
    misfit = format_number(identification.misfit[column])
    fit = f"{format_column(column, identification.units[column])} at {misfit} times its noise"
    count = len(calibration.parameters)
    what = f"{format_count(count, 'parameter')} identified"
    if identification.misfit[column] > GOOD_FIT:
        logged = any(finding.check == "logged" for finding in identification.findings)
        rows = f" {LOGGED}" if logged else ""
        return (
            f"{what}, but the model does not explain the runs: {fit}.{rows} Look for missing physics with clutch-hil"
            " discrepancy."
        )
    warned = f"; {format_count(len(calibration.warnings), 'warning')} below" if calibration.warnings else ""
    return f"{what}. The model explains the runs down to their noise; the worst output is {fit}{warned}."


def _make_header(identification: Identification, title: str) -> Html:
    calibration = identification.calibration
    count, when = len(identification.measured), datetime.fromisoformat(calibration.date).astimezone()
    meta = f"rig {calibration.rig} · {format_count(count, 'run')} · {when.strftime('%Y-%m-%d %H:%M %Z')}"
    good = max(identification.misfit.values()) <= GOOD_FIT
    mark = "none_of_these" if not good else "one_of" if calibration.warnings else "nothing_missing"
    moved = sum(
        abs(p.value - p.declared) > max(2.0 * _list_uncertainties(calibration)[p.name], p.half)
        for p in calibration.parameters
    )
    facts = [
        f"{format_count(len(calibration.parameters), 'parameter')} identified",
        f"{moved} of them beyond twice the uncertainty stated before",
        f"{len(calibration.held)} not identified",
        format_count(len(calibration.warnings), "warning"),
    ]
    parts = [
        make_element("h1", title),
        make_element("p", meta, class_="meta"),
        make_element("p", make_verdict_sentence(identification), class_=f"verdict {mark}"),
        make_element(
            "ul",
            join(
                [
                    make_element("li", join([make_element("b", number), what], ""))
                    for number, what in (fact.split(" ", 1) for fact in facts)
                ]
            ),
            class_="facts",
        ),
    ]
    return make_element("header", join(parts))


def _list_uncertainties(calibration: Calibration) -> dict[str, float]:
    """Return the stated uncertainty of each parameter, one standard deviation in its unit; 0 where none is stated."""
    declared = find_rig(calibration.rig).plant.load_parameters()
    return {p.name: declared[p.name].uncertainty if p.name in declared else 0.0 for p in calibration.parameters}


def _make_parameter_section(calibration: Calibration) -> Section:
    stated = _list_uncertainties(calibration)
    rows = [
        (
            p.name, *make_interval_cells(p.value, p.interval), format_unit(p.unit),
            make_value(p.declared, format_number(p.declared, 4)),
            format_number(stated[p.name], 2) if stated[p.name] else "", _format_shift(p),
        )
        for p in calibration.parameters
    ]  # fmt: skip
    header = ("parameter", "identified", "95 % interval", "unit", "stated before", "±", "shift")
    picture = make_figure(
        draw_parameters(calibration.parameters),
        "identified parameters over the values stated before",
        "Each parameter with its 95 % interval (thick), over the value that was stated before. An arrow marks an interval that"
        " goes on.",
    )
    text = (
        "Values stated before are those of the rig's parameter file, with one standard deviation (±) where it has one."
    )
    return "Parameters, stated and identified", [make_element("p", text), make_table(header, rows, " nn nnn"), picture]


def _format_shift(p: Identified) -> str:
    """Format the change from the stated value: in percent, as a factor where it is large, in K for a temperature."""
    if p.unit == "degC":
        return f"{_format_change(p.value - p.declared)} K"
    if p.declared == 0.0:
        return ""
    ratio = p.value / p.declared
    return f"× {format_number(ratio, 3)}" if ratio > FAR else f"{_format_change(100.0 * (ratio - 1.0))} %"


def _format_change(change: float) -> str:
    """Return a change with its sign and one decimal; what rounds to 0 has no sign."""
    text = f"{change:+.1f}".replace("-", "−")
    return "0.0" if text[1:] == "0.0" else text


def _make_warnings(identification: Identification) -> Section:
    calibration = identification.calibration
    heading = "What these runs do not show"
    contents = (
        [make_element("ul", join([make_element("li", text) for text in calibration.warnings]))]
        if calibration.warnings
        else []
    )
    if not calibration.warnings:
        contents.append(make_element("p", "No warning: the runs excite everything that was fitted."))
    if calibration.held:
        held = make_table(("not identified", "why"), list(calibration.held.items()))
        known = (
            "Held parameters keep their values. Parameters that the runs do not excite are known roughly: the fit may change"
            " them, but their values are not results."
        )
        contents += [make_element("p", known), held]
    return heading, contents


def _make_hand_overs(identification: Identification) -> list[Section]:
    """Return the hand-over section of a power shift: its hand-overs, and the pressures at which each clutch carries half the
    torque."""
    if not isinstance(identification, ShiftIdentification) or not identification.hand_overs:
        return []
    rows = [
        (one.run, make_value(one.time, format_number(one.time, 4)), make_value(one.half, format_number(1e3 * one.half, 2)),
         format_number(one.begin, 4), format_number(one.end, 4), format_number(one.torque, 3))
        for one in identification.hand_overs
    ]  # fmt: skip
    header = ("run", "hand-over at [s]", "± [ms]", "begins [s]", "ends [s]", "output torque [Nm]")
    at = [q for q in identification.quantities if q.where == HAND_OVER]
    pressures = [
        (q.name, *make_interval_cells(q.value, (q.value - q.half, q.value + q.half)), q.unit, q.at) for q in at
    ]
    text = (
        "The hand-over is the time at which clutch b begins to carry more of the output torque than clutch a. The identified"
        " clutches carry half of it each at the pressures below."
    )
    tables = [
        make_table(header, rows, " nnnnn"),
        make_table(("pressure", "identified", "95 % interval", "unit", "at"), pressures, " nn  "),
    ]
    return [("Hand-over", [make_element("p", text), *tables])]


def _make_fit(identification: Identification) -> Section:
    rows = [
        (
            format_column(column, identification.units[column]),
            make_value(share, format_number(share)),
            "noise" if share <= GOOD_FIT else "more",
        )
        for column, share in identification.misfit.items()
    ]
    text = (
        "The runs as measured and as the identified model simulates them from their inputs alone. Shaded in the residual:"
        " twice the noise, which contains 95 % of pure noise."
    )
    header = ("output", "residual over noise", "residual")
    pictures = [
        make_figure(
            draw_fit(identification, column),
            f"fit of {column}",
            f"{format_column(column, identification.units[column])}, and its residual.",
        )
        for column in identification.misfit
    ]
    return "Fit and residual", [make_element("p", text), make_table(header, rows, " n "), *pictures]


def _make_quantities(identification: Identification) -> Section:
    """Return the section of maps and quantities of the thesis, for each clutch, with the frequency response where there is
    one."""
    text = (
        "The friction maps at the pressures of the thesis, 0.35 to 1.85 bar above contact, with 95 % bands. Values above the"
        " pressures of the runs are extrapolated along the lines of the maps."
    )
    parts = identification.parts.items() if isinstance(identification, ShiftIdentification) else [("", identification)]
    contents = [make_element("p", text)]
    for clutch, one in parts:
        with page_figure(MAPS_HEIGHT) as figure:
            plot_maps(figure, one.propagation, one.highest_pressure)
            of = f" of clutch {clutch}" if clutch else ""
            contents.append(
                make_figure(render_png(figure), f"friction maps{of}", f"M_C, C_v and β over the pressure{of}.")
            )
    if identification.response:
        with page_figure(RESPONSE_HEIGHT) as figure:
            plot_response(figure, identification.response)
            contents.append(
                make_figure(render_png(figure), "frequency response", f"Pressure loop: {identification.response}.")
            )
    rows = [
        (
            q.name,
            *make_interval_cells(q.value, (q.value - q.half, q.value + q.half)),
            format_unit(q.unit),
            q.at,
            q.where,
        )
        for q in identification.quantities
        if q.where != HAND_OVER
    ]
    header = ("quantity", "identified", "95 % interval", "unit", "at", "of the thesis")
    return "Maps and quantities of the thesis", [*contents, fold("All quantities", make_table(header, rows, " nn   "))]


def _make_correlation_section(calibration: Calibration) -> Section:
    names, matrix = [p.name for p in calibration.parameters], np.asarray(calibration.correlation)
    upper = [(abs(matrix[i, k]), i, k) for i in range(len(names)) for k in range(i + 1, len(names))]
    worst = sorted(upper, reverse=True)[:_MOST_PAIRS]
    rows = [
        (names[i], names[k], make_value(float(matrix[i, k]), f"{matrix[i, k]:+.3f}".replace("-", "−")))
        for _, i, k in worst
    ]
    strong = sum(size > _CORRELATED for size, _, _ in upper)
    text = "A strong correlation means that the runs show a combination of two parameters better than each of them."
    if strong:
        text += f" {strong} pairs are above {_CORRELATED:g}: use their values together."
    picture = make_figure(
        draw_correlation(names, matrix), "correlation of the parameters", "Correlation of all parameters."
    )
    heading = "Correlation of the parameters"
    return heading, [
        make_element("p", text),
        make_table(("parameter", "and", "correlation"), rows, "  n"),
        fold("All of them", picture),
    ]


def _make_run_section(identification: Identification) -> Section:
    cuts = {finding.run: finding.text for finding in identification.findings if finding.check == "fault"}
    rows = []
    for name, measured in identification.measured.items():
        time = measured["time_s"]
        period = float(time[1] - time[0])
        length = f"{format_number(float(time[-1] - time[0]) + period)} s"
        rate = f"{format_number(1.0 / period, 4)} Hz"
        rows.append((name, length, rate, cuts.get(name, "nothing"), identification.calibration.runs.get(name, "")))
    notes = (
        [make_element("ul", join([make_element("li", note) for note in identification.calibration.notes]))]
        if identification.calibration.notes
        else []
    )
    return "Runs", [make_table(("run", "used", "rate", "cut", "SHA-256 of the file"), rows, " nn h"), *notes]


def _make_provenance_section(identification: Identification, files: Sequence[str], command: str) -> Section:
    versions = [*(f"{name} {version(name)}" for name in _PACKAGES), f"Python {python_version()}"]
    made = {
        "rig": identification.calibration.rig,
        "command": make_element("code", command) if command else "",
        "time taken": join([make_value(identification.seconds, format_with_unit(identification.seconds, "s"))], ""),
        "versions": ", ".join(versions),
        "files with this page": ", ".join(files),
        "next": make_element("code", "clutch-hil up --calibration calibration.toml"),
    }
    items = [join([make_element("dt", key), make_element("dd", text)], "") for key, text in made.items() if text]
    return "Provenance", [make_element("dl", join(items))]
