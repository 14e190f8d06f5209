"""Recording for the rerun viewer: every output and run, measured, before and after, as `evidence.rrd` (rerun 0.41)."""

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
import rerun as rr
import rerun.blueprint as rrb

from clutch_hil.bench.pictures import palette
from clutch_hil.discrepancy.report.residuals import Residuals, list_times
from clutch_hil.discrepancy.report.wording import format_regime, make_verdict_sentence
from clutch_hil.discrepancy.result import Trace
from clutch_hil.live.viewer.canvas import make_scalar_columns
from clutch_hil.live.viewer.rrd_writer import check_space
from clutch_hil.live.viewer.stream import make_recording
from clutch_hil.page.wording import format_axis_label, format_column, format_number, format_unit
from protocols.errors import InputError
from protocols.files.output_file import whole_file

TIMELINE = "rig_time"
NAMES = ("before", "after", "measured")  # lines of an output, the last on top; those of a residual are the first two
_COLOURS = tuple(
    map(palette.make_rgba, (palette.LIMIT, palette.TRUE, palette.MEASURED))
)  # the page has red, blue, black on white
_WIDTHS = (1.5, 2.5, 1.0)  # ui points: after is visible on both sides of measured
_VERDICT = "verdict"
_LINES = len(NAMES) + 2  # lines of an output, including those of its residual
_ROWS = 4  # outputs on a screen


def write_evidence(residuals: Residuals, path: Path) -> None:
    """Write the recording to `path`. Raises InputError where it cannot be written.

    Entities: /RUN/OUTPUT with the lines NAMES, and /RUN/OUTPUT/residual of the outputs to examine.
    """
    with whole_file(path) as part:
        name = f"discrepancy: {residuals.result.rig}"
        recording = make_recording(name)
        try:
            check_space(path, 0)
            recording.save(part, default_blueprint=_make_blueprint(residuals))
            recording.send_recording_name(name)
            document = rr.TextDocument(_format_verdict(residuals), media_type=rr.MediaType.MARKDOWN)
            recording.log(_VERDICT, document, static=True)
            for trace in residuals.result.traces:
                check_space(path, _LINES * sum(values.nbytes for values in trace.measured.values()))
                _log_run(recording, residuals, trace)
                recording.flush()
        except RuntimeError as error:
            raise InputError(f"file {path} cannot be written: {error}") from None
        finally:
            recording.disconnect()


def _log_run(recording: rr.RecordingStream, residuals: Residuals, trace: Trace) -> None:
    nanoseconds = np.rint(list_times(trace) * 1e9).astype("timedelta64[ns]")
    indexes = [rr.TimeColumn(TIMELINE, duration=nanoseconds)]
    for column in trace.measured:
        floor = residuals.result.floors.get(column, 0.0)
        values = [trace.before[column], trace.after[column], trace.measured[column]]
        _log_lines(recording, _make_path(trace, column), NAMES, _COLOURS, indexes, values)
        if column in residuals.outputs_to_examine:
            errors = [residuals.compute_error(trace, column, when) for when in NAMES[:2]]
            _log_lines(recording, _make_path(trace, column, "residual"), NAMES[:2], _COLOURS[:2], indexes, errors)
            ends = [rr.TimeColumn(TIMELINE, duration=nanoseconds[[0, -1]])]
            band = [np.full(2, 2.0 * floor), np.full(2, -2.0 * floor)]
            path = _make_path(trace, column, "residual", "floor")
            _log_lines(recording, path, ("2 x floor", "-2 x floor"), (palette.make_rgba(palette.GRID),) * 2, ends, band)


def _log_lines(
    recording: rr.RecordingStream,
    path: str,
    names: Sequence[str],
    colours: Sequence[int],
    indexes: Sequence[rr.TimeColumn],
    values: Sequence[np.ndarray],
) -> None:
    lines = rr.SeriesLines(names=list(names), colors=np.array(colours, np.uint32), widths=_WIDTHS[: len(names)])
    recording.log(path, lines, static=True)
    recording.send_columns(path, indexes=indexes, columns=make_scalar_columns(np.column_stack(values)))


def _make_blueprint(residuals: Residuals) -> rrb.Blueprint:
    """Return the layout of the viewer: a tab for each run; runs and outputs with the largest disagreement first."""
    first = residuals.find_worst_run(residuals.outputs[0]) if residuals.outputs else None
    traces = sorted(residuals.result.traces, key=lambda trace: trace is not first)
    tabs = [_run_view(residuals, trace, _make_order_columns(residuals, trace)[:_ROWS], trace.name) for trace in traces]
    rest = [_run_view(residuals, t, _make_order_columns(residuals, t)[_ROWS:], f"{t.name}: more") for t in traces]
    views = [tab for tab in (*tabs, *rest) if tab is not None]
    verdict_view = rrb.TextDocumentView(origin=f"/{_VERDICT}", name="verdict")
    if views:
        views[0] = rrb.Horizontal(views[0], verdict_view, column_shares=[4.0, 1.0], name=views[0].name)
    return rrb.Blueprint(
        rrb.Tabs(*views, *([] if views else [verdict_view]), active_tab=0),
        rrb.TopPanel(state="expanded"),
        rrb.BlueprintPanel(state="collapsed"),
        rrb.SelectionPanel(state="collapsed"),
        rrb.TimePanel(state="collapsed", timeline=TIMELINE, play_state="paused"),
        auto_layout=False,
        auto_views=False,
    )


def _make_order_columns(residuals: Residuals, trace: Trace) -> list[str]:
    return [column for column in residuals.outputs if column in trace.measured]


def _run_view(residuals: Residuals, trace: Trace, columns: Sequence[str], name: str) -> Any:
    if not columns:
        return None
    rows: list[Any] = []
    for column in columns:
        unit = residuals.result.units.get(column, "")
        path = _make_path(trace, column)
        value = _plot_view(path, f"{trace.name}: {format_axis_label(column, unit)}", [f"+ {path}"])
        if column not in residuals.outputs_to_examine:
            rows.append(value)
            continue
        inside = f"{path}/residual"
        residual = _plot_view(inside, f"measured minus model [{format_unit(unit)}]", [f"+ {inside}/**"])
        rows.append(rrb.Horizontal(value, residual, column_shares=[1.3, 1.0]))
    return rrb.Vertical(*rows, name=name)


def _plot_view(origin: str, name: str, contents: Sequence[str]) -> rrb.TimeSeriesView:
    whole = rrb.VisibleTimeRange(TIMELINE, start=rrb.TimeRangeBoundary.infinite(), end=rrb.TimeRangeBoundary.infinite())
    return rrb.TimeSeriesView(
        origin=origin,
        contents=list(contents),
        name=name,
        plot_legend=rrb.PlotLegend(visible=True, corner=rrb.Corner2D.RightTop),
        axis_x=rrb.archetypes.TimeAxis(link="LinkToGlobal"),
        time_ranges=whole,
    )


def _make_path(trace: Trace, *parts: str) -> str:
    return str(rr.new_entity_path([trace.name, *parts]))


def _format_verdict(residuals: Residuals) -> str:
    """Return the verdict, the largest disagreements and the gap, in Markdown."""
    result = residuals.result
    lines = [f"## {_escape(make_verdict_sentence(result))}", ""]
    for claim in sorted(result.where, key=lambda claim: -claim.times_floor)[:5]:
        where = f"{format_column(claim.output, claim.unit)}, {format_regime(claim.regime)}"
        lines.append(f"- {_escape(where)}: {format_number(claim.times_floor, 2)} x floor")
    lines += ["", "Error on runs that were not fitted:", ""]
    for column, gap in result.gap.items():
        unit = format_unit(result.units.get(column, ""))
        gap_text = (
            f"{format_number(gap.before)} to {format_number(gap.after)} {unit} (floor {format_number(gap.floor)})"
        )
        lines.append(f"- {_escape(format_column(column, unit))}: {gap_text}")
    return "\n".join(lines)


def _escape(text: str) -> str:
    """Return `text` with the special characters of Markdown escaped."""
    return "".join(f"\\{letter}" if letter in "\\`*_{}[]<>#|!" else letter for letter in text)
