"""Remaining residual: the section on the residual of the model with the added effects."""

from clutch_hil.discrepancy.report.pictures import Pictures
from clutch_hil.discrepancy.report.wording import AT_FLOOR, compute_ratio
from clutch_hil.page.markup import Html, make_element, make_figure, make_table
from clutch_hil.page.wording import format_column, format_number, format_with_unit, list_words

_UNCORRELATED = 0.2  # autocorrelation below which a residual counts as uncorrelated


def make_section(pictures: Pictures) -> tuple[str, list[Html]]:
    """Return heading and contents of the section."""
    rows = [
        _make_row(pictures, column)
        for column in pictures.residuals.outputs
        if pictures.residuals.list_held_out_traces(column)
    ]
    if not rows:
        return "What remains", [make_element("p", "No trace of a run was kept.")]
    result, changed = pictures.result, pictures.residuals.has_changed
    left = [
        f"{format_column(c, result.units.get(c))} ({format_number(compute_ratio(gap, after=True), 2)} times)"
        for c, gap in result.gap.items()
        if compute_ratio(gap, after=True) > AT_FLOOR
    ]
    text = f"No output stays above {AT_FLOOR:g} times its floor on runs that were not fitted."
    if left:
        text = f"On runs that were not fitted, {list_words(left)} stay above {AT_FLOOR:g} times the floor: more is missing."
    caption = (
        "Left: residual, with twice the floor in grey. Middle: autocorrelation, with the 95 % band of white noise. Right:"
        " amplitude density; dashed: a white residual as large as the floor."
        f"{' Red: before; blue: after.' if changed else ''}"
    )
    header = (
        "output",
        "rms, worst run",
        "floor",
        "times floor",
        "correlation at one sample",
        f"below {_UNCORRELATED:g} after",
    )
    picture = make_figure(pictures.draw_remaining_residuals(), "residuals that remain", caption)
    return "What remains", [make_element("p", text), picture, make_table(header, rows, " nnnnn")]


def _make_row(pictures: Pictures, column: str) -> tuple[str, ...]:
    residuals, unit = pictures.residuals, pictures.result.units.get(column, "")
    when = "after" if residuals.has_changed else "before"
    rms = max(residuals.compute_rms(trace, column, when) for trace in residuals.list_held_out_traces(column))
    floor = pictures.result.floors.get(column, 0.0)
    lags, correlation, _ = residuals.compute_autocorrelation(column, when)
    end = next((lag for lag, c in zip(lags, correlation, strict=True) if abs(c) < _UNCORRELATED), None)
    memory = (
        f"{format_number(1e3 * end, 2)} ms" if end is not None else f"over {format_number(1e3 * float(lags[-1]), 2)} ms"
    )
    times_floor = format_number(rms / floor) if floor > 0.0 else ""
    next_one = f"{round(float(correlation[1]), 2) + 0.0:.2f}".replace("-", "−")
    return (
        format_column(column, unit),
        format_with_unit(rms, unit),
        format_with_unit(floor, unit),
        times_floor,
        next_one,
        memory,
    )
