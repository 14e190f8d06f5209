"""Panels: each draws one part of a `Result` into one axes. Measured is black, before red, after blue, the noise floor grey."""

from collections.abc import Sequence
from textwrap import shorten
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.colors import LogNorm
from matplotlib.ticker import FixedLocator, FuncFormatter, NullLocator

from clutch_hil.discrepancy.report.residuals import ANGLE, Residuals, Stretch, list_times
from clutch_hil.discrepancy.report.wording import SIGNIFICANT, compute_excess, format_effect, format_regime
from clutch_hil.discrepancy.result import Estimate, Gap, Result, Rival
from clutch_hil.page.figures import compute_envelope
from clutch_hil.page.wording import format_axis_label, format_column, format_number, format_percent, format_unit

MEASURED, BEFORE, AFTER, FLOOR = "#1c1c1c", "#c8402f", "#1f6fb4", "#b9bec6"
_REGIME, _WINDOW, _OTHER, _ALIKE = "#fbe9b7", "#dfe8f2", "#c4c8ce", "#8fb8de"
_BAND = 2.0  # multiples of the floor that contain 95 % of a white residual
_LABEL = 30  # letters of a name beside an axis
_TICKS = (0.5, 1, 2, 5, 10, 20, 50, 100, 200, 500, 1000, 2000, 5000)
_FAINTEST = 0.3  # floors: smaller values have the same colour in the heat map
REGIMES = 10  # of an output in a picture: those with the largest error before
_CUT_SHARE = -0.5  # share of gap below which a bar is cut


def draw_overview(axes: Axes, residuals: Residuals, stretch: Stretch) -> None:
    """Draw the whole run, measured and before, with the enlarged stretch marked."""
    trace, column = stretch.trace, stretch.column
    time = list_times(trace)
    axes.axvspan(time[stretch.begin], time[stretch.end - 1], color=_WINDOW, lw=0)
    for values, colour, width in ((trace.before[column], BEFORE, 1.0), (trace.measured[column], MEASURED, 0.6)):
        axes.plot(*compute_envelope(time, values), color=colour, lw=width)
    axes.set_ylabel(_find_unit(residuals.result, column))
    axes.margins(x=0.0, y=0.1)


def draw_residual_overview(axes: Axes, residuals: Residuals, stretch: Stretch, after: bool = False) -> None:
    """Draw the residual of the whole run with the band of the floor."""
    trace, column = stretch.trace, stretch.column
    _draw_band(axes, residuals.result, column)
    for when, colour in _list_versions(after):
        axes.plot(
            *compute_envelope(list_times(trace), residuals.compute_error(trace, column, when)), color=colour, lw=0.6
        )
    axes.set_ylabel(_find_unit(residuals.result, column))
    axes.margins(x=0.0, y=0.1)


def draw_signals(axes: Axes, residuals: Residuals, stretch: Stretch, after: bool) -> None:
    """Draw measured and model output in the stretch."""
    trace, column = stretch.trace, stretch.column
    part = slice(stretch.begin, stretch.end)
    time = list_times(trace)[part]
    _mark_regime(axes, stretch, stretch.begin, stretch.end)
    for when, colour in _list_versions(after):
        width = 2.6 if when == "after" else 1.5  # visible on both sides of the measured line
        axes.plot(time, getattr(trace, when)[column][part], color=colour, lw=width, label=_name_model(residuals, when))
    axes.plot(time, trace.measured[column][part], color=MEASURED, lw=0.8, label="measured")
    axes.set_ylabel(format_axis_label(column, residuals.result.units.get(column)))
    axes.margins(x=0.0, y=0.08)
    axes.legend(loc="lower right", bbox_to_anchor=(1.0, 0.99), ncols=4, borderaxespad=0.0)


def draw_residual(axes: Axes, residuals: Residuals, stretch: Stretch, after: bool) -> None:
    """Draw measured minus model output in the stretch, with the band of the floor."""
    trace, column = stretch.trace, stretch.column
    part = slice(stretch.begin, stretch.end)
    _mark_regime(axes, stretch, stretch.begin, stretch.end)
    _draw_band(axes, residuals.result, column)
    for when, colour in _list_versions(after):
        axes.plot(list_times(trace)[part], residuals.compute_error(trace, column, when)[part], color=colour, lw=0.9)
    axes.set_ylabel(f"residual [{_find_unit(residuals.result, column)}]")
    axes.set_xlabel("time [s]")
    axes.margins(x=0.0, y=0.1)


def draw_heat_map(axes: Axes, result: Result) -> None:
    """Draw the size of the disagreement above noise by output and regime, in multiples of the floor; a dot marks a claim."""
    claims = {(claim.output, claim.regime): claim for claim in result.where}
    outputs = list(dict.fromkeys([*result.floors, *result.gap_by_regime, *(claim.output for claim in result.where)]))
    of_gaps = [regime for gaps in result.gap_by_regime.values() for regime in gaps]
    regimes = list(
        dict.fromkeys([*(["all"] if result.gap else []), *of_gaps, *(claim.regime for claim in result.where)])
    )
    regimes.sort(key=lambda regime: (regime != "all", regime.partition("=")[0]))
    cells = np.full((len(outputs), len(regimes)), np.nan)
    for i, output in enumerate(outputs):
        for k, regime in enumerate(regimes):
            cells[i, k] = _draw_cell(result, claims, output, regime)
    if not cells.size or not np.any(np.isfinite(cells)):
        _write_instead(axes, "no regimes are known")
        return
    most = max(4.0, float(np.nanmax(cells[np.isfinite(cells)])))
    shown = np.clip(cells, _FAINTEST, most)
    axes.imshow(shown, cmap="YlOrRd", norm=LogNorm(_FAINTEST, 1.6 * most), aspect="auto")
    size = 8.0 if len(regimes) <= 12 else 6.5
    for (i, k), value in np.ndenumerate(cells):
        if np.isfinite(value):
            claim = claims.get((outputs[i], regimes[k]))
            marked = claim is not None and claim.p_value < SIGNIFICANT
            dark = np.log(max(value, _FAINTEST) / _FAINTEST) > 0.75 * np.log(1.6 * most / _FAINTEST)
            axes.text(
                k, i, f"{_format_tenths(value)}{' ●' if marked else ''}", ha="center", va="center", fontsize=size,
                color="white" if dark else MEASURED, fontweight="bold" if marked else "normal",
            )  # fmt: skip
    axes.set_xticks(range(len(regimes)), [_shorten(format_regime(r), 22) for r in regimes], rotation=30, ha="right")
    axes.set_yticks(range(len(outputs)), [_shorten(format_column(o, result.units.get(o))) for o in outputs])
    axes.set_xticks(np.arange(len(regimes) + 1) - 0.5, minor=True)
    axes.set_yticks(np.arange(len(outputs) + 1) - 0.5, minor=True)
    axes.grid(False)
    axes.grid(which="minor", color="white", lw=2.0, alpha=1.0)
    axes.tick_params(which="both", length=0)
    axes.spines[:].set_visible(False)


def draw_loop(axes: Axes, residuals: Residuals, stretch: Stretch, over: str, after: bool) -> None:
    """Draw the output over `over` in the stretch."""
    trace, column = stretch.trace, stretch.column
    part = slice(stretch.begin, stretch.end)
    abscissa = trace.columns[over][part]
    axes.plot(abscissa, trace.measured[column][part], ".", color=MEASURED, ms=1.5, alpha=0.5, label="measured")
    for when, colour in _list_versions(after):
        model = getattr(trace, when)
        abscissa = model.get(over, trace.columns[over])[part]  # the prediction, where the model predicts this column
        axes.plot(abscissa, model[column][part], color=colour, lw=1.0, label=_name_model(residuals, when))
    axes.set_xlabel(format_axis_label(over, residuals.result.units.get(over)))
    axes.set_ylabel(format_axis_label(column, residuals.result.units.get(column)))
    draw_legend_above(axes)


def draw_residual_map(axes: Axes, residuals: Residuals, column: str, over: str, after: bool = False) -> None:
    """Draw the mean residual over a variable while it rises and while it falls, for all runs together."""
    _draw_band(axes, residuals.result, column, 1.0)
    for when, colour in _list_versions(after):
        means = residuals.compute_map(column, over, when)
        name = f"{when}, " if after else ""
        axes.plot(means.centres, means.rising, "^-", color=colour, lw=1.3, ms=3, label=f"{name}rising")
        axes.plot(means.centres, means.falling, "v--", color=colour, lw=1.3, ms=3, label=f"{name}falling")
    label = format_axis_label(over, residuals.result.units.get(over))
    axes.set_xlabel("angle within the turn [rad]" if over == ANGLE else label)
    axes.set_ylabel(f"mean residual [{_find_unit(residuals.result, column)}]")
    axes.margins(y=0.12)


def draw_order_spectrum(axes: Axes, residuals: Residuals, column: str, after: bool) -> bool:
    """Draw the amplitude of the residual by periods per turn of the shaft; return False where no run turns enough."""
    drawn = False
    for when, colour in _list_versions(after):
        amplitudes = residuals.compute_orders(column, when)
        if amplitudes is not None:
            axes.plot(*amplitudes, color=colour, lw=1.0, label=when)
            drawn = True
    if not drawn:
        _write_instead(axes, "no run turns the shaft often enough")
        return False
    axes.set_xlabel("order [periods a turn]")
    axes.set_ylabel(f"residual's amplitude [{_find_unit(residuals.result, column)}]")
    axes.set_yscale("log")
    axes.yaxis.set_major_formatter(FuncFormatter(lambda value, _: format_number(value, 1)))
    axes.yaxis.set_minor_locator(NullLocator())
    axes.margins(x=0.0)
    if after:
        axes.legend(loc="upper right")
    return True


def draw_gap_bars(axes: Axes, result: Result, changed: bool) -> None:
    """Draw the error on held-out runs by output, before and after, in multiples of the floor."""
    rows = [
        (_shorten(format_column(c, result.units.get(c))), gap, result.units.get(c, "")) for c, gap in result.gap.items()
    ]
    _draw_dumbbells(axes, rows, changed)


def draw_gap_by_regime(axes: Axes, result: Result, column: str, changed: bool) -> None:
    """Draw the error on held-out runs of one output by regime, before and after, in multiples of the floor."""
    unit = result.units.get(column, "")
    gaps = sorted(result.gap_by_regime.get(column, {}).items(), key=lambda item: -item[1].before)[:REGIMES]
    rows = [(_shorten(format_regime(regime)), gap, unit) for regime, gap in gaps]
    _draw_dumbbells(axes, rows, changed)
    axes.set_title(format_column(column, unit), loc="left")


def draw_rival_bars(axes: Axes, rivals: Sequence[Rival], alike: Sequence[str]) -> None:
    """Draw the share of the gap that each candidate closes; the chosen one is blue, indistinguishable ones are light blue."""
    place = np.arange(len(rivals))
    for y, rival in zip(place, rivals, strict=True):
        closed = rival.closed if np.isfinite(rival.closed) else 0.0
        colour = _ALIKE if rival.name in alike else _OTHER if rival.reason else AFTER
        axes.barh(y, max(closed, _CUT_SHARE), color=colour, height=0.7)
        text = format_percent(rival.closed, 1) + ("" if closed >= _CUT_SHARE else " (worse than without)")
        axes.annotate(text, (max(closed, 0.0), y), (4, 0), textcoords="offset points", va="center", fontsize=8)
    axes.axvline(0.0, color=MEASURED, lw=0.8)
    axes.axvline(1.0, color=FLOOR, lw=1.0, ls="--")
    axes.set_yticks(place, [_shorten(format_effect(rival.name)) for rival in rivals])
    axes.set_ylim(len(rivals) - 0.4, -0.6)
    axes.set_xlim(right=1.15)
    axes.xaxis.set_major_formatter(FuncFormatter(lambda value, _: format_percent(value)))
    axes.set_xlabel("share of the gap to the floor that is closed on the fitted runs")
    axes.grid(axis="y", visible=False)


def draw_baseline_shifts(axes: Axes, baseline: Sequence[Estimate]) -> None:
    """Draw re-fitted parameters in multiples of their stated uncertainty, with their 95 % intervals."""
    place = np.arange(len(baseline))
    axes.axvspan(-2.0, 2.0, color="#eef1f5", lw=0)
    axes.axvspan(-1.0, 1.0, color="#dde3ea", lw=0)
    for y, estimate in zip(place, baseline, strict=True):
        low, value, high = (
            (v - estimate.nominal) / estimate.uncertainty for v in (estimate.ci95[0], estimate.value, estimate.ci95[1])
        )
        colour = BEFORE if abs(value) > 2.0 else MEASURED
        axes.plot([low, high], [y, y], color=colour, lw=1.6, solid_capstyle="butt")
        axes.plot(value, y, "o", color=colour, ms=5)
    axes.axvline(0.0, color=MEASURED, lw=0.8)
    axes.set_yticks(place, [_shorten(estimate.name, 40) for estimate in baseline])
    axes.set_ylim(len(baseline) - 0.4, -0.6)
    left, right = axes.get_xlim()
    axes.set_xlim(min(left, -2.4), max(right, 2.4))
    axes.set_xlabel("shift from the nominal value in multiples of its uncertainty (1 sigma)")


def draw_autocorrelation(axes: Axes, residuals: Residuals, column: str, after: bool) -> None:
    """Draw the autocorrelation of the residual, with the band of white noise."""
    for when, colour in _list_versions(after):
        lags, values, band = residuals.compute_autocorrelation(column, when)
        axes.plot(lags, values, color=colour, lw=1.1)
    axes.axhspan(-band, band, color=FLOOR, alpha=0.6, lw=0)
    axes.set_ylim(-0.5, 1.05)
    axes.margins(x=0.0)
    axes.set_xlabel("lag [s]")


def draw_spectrum(axes: Axes, residuals: Residuals, column: str, after: bool) -> None:
    """Draw the amplitude density of the residual, and of a white residual as large as the floor."""
    for when, colour in _list_versions(after):
        frequency, density = residuals.compute_spectrum(column, when)
        axes.plot(frequency, density, color=colour, lw=0.9)
    floor = residuals.result.floors.get(column, 0.0)
    if floor > 0.0:
        axes.axhline(floor / np.sqrt(frequency[-1]), color="#7d838c", lw=1.0, ls="--")
    axes.set_xscale("log")
    axes.set_yscale("log")
    _set_plain_ticks(axes.xaxis, (0.1, 1, 10, 100, 1000), frequency[0], frequency[-1])
    low, high = axes.get_ylim()
    if high / low < 20.0:
        low, high = 0.3 * low, 3.0 * high
        axes.set_ylim(low, high)
    steps = (1.0, 2.0, 5.0) if high / low < 100.0 else (1.0,)
    _set_plain_ticks(axes.yaxis, [m * 10.0**k for k in range(-12, 13) for m in steps], low, high)
    axes.margins(x=0.0)
    axes.set_xlabel("frequency [Hz]")


def draw_course(axes: Axes, time: Sequence[float], values: Sequence[float], name: str) -> None:
    """Draw a column of the proposed experiment over time."""
    axes.plot(time, values, color=AFTER, lw=1.3)
    axes.set_ylabel(format_axis_label(name))
    axes.margins(x=0.0, y=0.1)


def _name_model(residuals: Residuals, when: str) -> str:
    """Return the name of a line of the model; where nothing was added there is only one model."""
    return f"model {when}" if residuals.has_changed else "model"


def _list_versions(after: bool) -> list[tuple[str, str]]:
    return [("before", BEFORE), ("after", AFTER)] if after else [("before", BEFORE)]


def _draw_cell(result: Result, claims: dict[tuple[str, str], Any], output: str, regime: str) -> float:
    if (output, regime) in claims:
        return float(claims[output, regime].times_floor)
    gap = result.gap_by_regime.get(output, {}).get(regime) or (result.gap.get(output) if regime == "all" else None)
    return compute_excess(gap) if gap else float("nan")


def _draw_dumbbells(axes: Axes, rows: Sequence[tuple[str, Gap, str]], changed: bool) -> None:
    """Draw a line from before to after for each row; only one point where nothing was added to the model."""
    rows = [row for row in rows if row[1].floor > 0.0]
    if not rows:
        _write_instead(axes, "no gap is known")
        return
    for y, (_, gap, unit) in enumerate(rows):
        before, after = (max(value / gap.floor, 0.1) for value in (gap.before, gap.after))
        axes.plot(
            before, y, "o", color=BEFORE, ms=8, label=("before" if changed else "error") if y == 0 else "_", zorder=3
        )
        label = format_number(gap.before)
        if changed:
            axes.plot([before, after], [y, y], color=_OTHER, lw=3.0, solid_capstyle="butt", zorder=1)
            axes.plot(after, y, "o", color=AFTER, ms=8, label="after" if y == 0 else "_", zorder=4)
            label += f" → {format_number(gap.after)}"
        label += f" {format_unit(unit)} (floor {format_number(gap.floor)})"
        beside = ("axes fraction", "data")
        axes.annotate(label, (1.02, y), xycoords=beside, va="center", fontsize=8, annotation_clip=False)
    axes.axvline(1.0, color="#7d838c", lw=1.2, ls="--", label="floor", zorder=2)
    axes.set_xscale("log")
    values = [value / gap.floor for _, gap, _ in rows for value in (gap.before, gap.after)]
    low, high = min(0.8, *values), max(2.2, *values)
    axes.set_xlim(max(low, 0.1) * 0.93, high * 1.12)
    _set_plain_ticks(axes.xaxis, _TICKS, *axes.get_xlim())
    axes.set_yticks(range(len(rows)), [name for name, _, _ in rows])
    axes.set_ylim(len(rows) - 0.5, -0.5)
    axes.grid(axis="y", visible=False)
    axes.set_xlabel("error on runs that were not fitted, in multiples of the floor")


def _set_plain_ticks(axis: Any, ticks: Sequence[float], low: float, high: float) -> None:
    """Label the ticks of a logarithmic axis with plain numbers."""
    axis.set_major_locator(FixedLocator([tick for tick in ticks if low <= tick <= high]))
    axis.set_major_formatter(FuncFormatter(lambda value, _: format_number(value, 1)))
    axis.set_minor_locator(NullLocator())


def _draw_band(axes: Axes, result: Result, column: str, times_floor: float = _BAND) -> None:
    floor = result.floors.get(column, 0.0)
    axes.axhspan(-times_floor * floor, times_floor * floor, color=FLOOR, alpha=0.45, lw=0)
    axes.axhline(0.0, color=MEASURED, lw=0.6)


def _mark_regime(axes: Axes, stretch: Stretch, begin: int, end: int) -> None:
    """Shade the samples of the regime, and name it."""
    if stretch.inside is None:
        return
    time, inside = list_times(stretch.trace)[begin:end], stretch.inside[begin:end]
    whole = axes.get_xaxis_transform()
    axes.fill_between(time, 0.0, 1.0, where=inside, color=_REGIME, lw=0, zorder=0, transform=whole)


def _format_tenths(value: float) -> str:
    """Return a multiple of the floor as text: with tenths below 10."""
    return f"{value:.1f}" if value < 9.95 else f"{value:.0f}"


def _find_unit(result: Result, column: str) -> str:
    return format_unit(result.units.get(column, "")) or "1"


def _shorten(text: str, width: int = _LABEL) -> str:
    return shorten(text, width, placeholder="…") if len(text) <= width or " " in text else f"{text[: width - 1]}…"


def draw_legend_above(axes: Axes) -> None:
    """Draw the legend above the axes: there it covers no curve, and matplotlib need not search for a place."""
    axes.legend(
        loc="lower left", bbox_to_anchor=(-0.05, 0.98), ncols=2, borderaxespad=0.0, handlelength=1.6, columnspacing=1.0
    )


def _write_instead(axes: Axes, text: str) -> None:
    axes.axis("off")
    axes.text(0.5, 0.5, text, ha="center", va="center", color="#777777", transform=axes.transAxes)
