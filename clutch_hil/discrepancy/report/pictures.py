"""Pictures of a `Result`: those of the page, each a PNG, and two posters, `atlas.png` (where) and `gap.png` (before, after)."""

from collections.abc import Mapping, Sequence
from typing import Any

from matplotlib.figure import Figure

from clutch_hil.discrepancy.report import panels
from clutch_hil.discrepancy.report.residuals import ANGLE, Residuals
from clutch_hil.discrepancy.report.wording import format_regime, make_verdict_sentence
from clutch_hil.discrepancy.result import Estimate, Rival
from clutch_hil.fitting.model import Columns
from clutch_hil.page.figures import name_file, page_figure, render_png
from clutch_hil.page.wording import format_column

_MOST_OUTPUTS = 2  # outputs that are drawn separately
_MOST_MAPS = 3  # residual maps next to a loop
_LOOPS = {  # output -> column over which it is usually drawn
    "clutch_torque_nm": "cylinder_pressure_bar",
    "cylinder_pressure_bar": "valve_voltage_v",
}
_POSITIONS = ("position", "displacement")  # prefixes of a column over which a force is drawn


class Pictures:
    """Draw `residuals`. Every method returns a PNG, or None where there is nothing to draw."""

    def __init__(self, residuals: Residuals) -> None:
        self.residuals = residuals
        self.result = residuals.result

    @property
    def examined_outputs(self) -> list[str]:
        """Return the outputs that are drawn separately."""
        return self.residuals.outputs_to_examine[:_MOST_OUTPUTS]

    def draw_stretch(self, column: str, held_out: bool = False) -> bytes | None:
        """Draw the run with the largest error of an output, and its worst stretch; with the model after if `held_out`."""
        stretch = self.residuals.find_worst(column, held_out)
        if stretch is None:
            return None
        with page_figure(5.6) as figure:
            whole, signals, residual = figure.subplots(3, 1, height_ratios=(1.0, 2.4, 1.5))
            panels.draw_overview(whole, self.residuals, stretch)
            panels.draw_signals(signals, self.residuals, stretch, held_out)
            panels.draw_residual(residual, self.residuals, stretch, held_out)
            whole.set_title(f"{name_file(stretch.trace.name)}: the whole run, and its shaded part enlarged", loc="left")
            if stretch.inside is not None:
                signals.set_title(f"shaded: {format_regime(stretch.regime)}", loc="left")
            residual.sharex(signals)
            signals.tick_params(labelbottom=False)
            return render_png(figure)

    def draw_shapes(self) -> bytes | None:
        """Draw loop and residual maps of each examined output."""
        columns = [column for column in self.examined_outputs if self.residuals.list_variables(column)]
        if not columns:
            return None
        with page_figure(2.7 * len(columns)) as figure:
            for row, column in zip(_make_rows(figure, len(columns)), columns, strict=True):
                self._draw_shapes(row, column, after=False)
            return render_png(figure)

    def draw_size_map(self) -> bytes | None:
        """Draw the heat map by output and regime."""
        outputs = len(self.result.floors)
        with page_figure(1.5 + 0.36 * max(outputs, 2)) as figure:
            panels.draw_heat_map(figure.subplots(), self.result)
            return render_png(figure)

    def draw_orders(self) -> bytes | None:
        """Draw the order spectrum of the output with the largest error; None where no order stands out."""
        column = self._choose_order_output()
        if column is None or not self.residuals.has_order(column):
            return None
        with page_figure(2.5) as figure:
            panels.draw_order_spectrum(figure.subplots(), self.residuals, column, after=False)
            return render_png(figure)

    def draw_rivals(self, rivals: Sequence[Rival], alike: Sequence[str]) -> bytes | None:
        """Draw the share of the gap that each candidate closes."""
        if not rivals:
            return None
        with page_figure(0.9 + 0.27 * len(rivals)) as figure:
            panels.draw_rival_bars(figure.subplots(), rivals, alike)
            return render_png(figure)

    def draw_gap(self) -> bytes | None:
        """Draw before and after by output: `gap.png`."""
        if not self.result.gap:
            return None
        with page_figure(1.3 + 0.42 * len(self.result.gap)) as figure:
            axes = figure.subplots()
            panels.draw_gap_bars(axes, self.result, self.residuals.has_changed)
            _draw_legend(axes)
            return render_png(figure)

    def draw_gap_by_regime(self) -> bytes | None:
        """Draw before and after by regime, for the examined outputs."""
        columns = [column for column in self.examined_outputs if self.result.gap_by_regime.get(column)]
        if not columns:
            return None
        rows = [min(len(self.result.gap_by_regime[column]), panels.REGIMES) for column in columns]
        with page_figure(sum(0.9 + 0.3 * count for count in rows) + 0.3) as figure:
            plots = figure.subplots(len(columns), 1, height_ratios=[1.5 + count for count in rows], squeeze=False)[:, 0]
            for axes, column in zip(plots, columns, strict=True):
                panels.draw_gap_by_regime(axes, self.result, column, self.residuals.has_changed)
                if axes is not plots[-1]:
                    axes.set_xlabel("")
            _draw_legend(plots[0])
            return render_png(figure)

    def draw_baseline(self, known: Sequence[Estimate]) -> bytes | None:
        """Draw shifts of re-fitted parameters whose uncertainty is known."""
        if not known:
            return None
        with page_figure(0.9 + 0.25 * len(known)) as figure:
            panels.draw_baseline_shifts(figure.subplots(), known)
            return render_png(figure)

    def draw_remaining_residuals(self) -> bytes | None:
        """Draw residual over time, autocorrelation and spectrum of every output."""
        columns = self.residuals.outputs
        if not columns:
            return None
        after = self.residuals.has_changed
        with page_figure(0.5 + 1.45 * len(columns)) as figure:
            rows = figure.subplots(len(columns), 3, width_ratios=(2.0, 1.0, 1.0), squeeze=False)
            for i, (column, (time, correlation, spectrum)) in enumerate(zip(columns, rows, strict=True)):
                stretch = self.residuals.find_worst(column, held_out=True)
                if stretch is None:
                    continue
                panels.draw_residual_overview(time, self.residuals, stretch, after)
                panels.draw_autocorrelation(correlation, self.residuals, column, after)
                panels.draw_spectrum(spectrum, self.residuals, column, after)
                unit = self.result.units.get(column)
                time.set_title(f"{format_column(column, unit)}, {name_file(stretch.trace.name)}", loc="left")
                if i == 0:
                    correlation.set_title("autocorrelation", loc="left")
                    spectrum.set_title("amplitude density [unit/√Hz]", loc="left")
                if column == columns[-1]:
                    time.set_xlabel("time [s]")
                else:
                    correlation.set_xlabel("")
                    spectrum.set_xlabel("")
            return render_png(figure)

    def draw_course(self, time: Sequence[float], columns: Mapping[str, Sequence[float]]) -> bytes:
        """Draw the proposed experiment."""
        with page_figure(0.6 + 1.3 * len(columns)) as figure:
            plots = figure.subplots(len(columns), 1, sharex=True, squeeze=False)[:, 0]
            for axes, (name, values) in zip(plots, columns.items(), strict=True):
                panels.draw_course(axes, time, values, name)
            plots[-1].set_xlabel("time [s]")
            return render_png(figure)

    def draw_atlas(self) -> bytes:
        """Draw all disagreements on one sheet: `atlas.png`."""
        residuals = self.residuals
        outputs = residuals.outputs
        columns = [column for column in self.examined_outputs[:2] if residuals.list_variables(column)]
        ordered = self._choose_order_output()
        heights = [
            0.35 + 1.0 * max(len(outputs), 1),
            1.6 + 0.32 * len(self.result.floors),
            *[2.7] * len(columns),
            *([2.3] if ordered else []),
        ]
        with page_figure(sum(heights) + 0.7) as figure:
            figure.suptitle(
                _wrap(make_verdict_sentence(self.result)), x=0.01, ha="left", fontsize=10, fontweight="bold"
            )
            parts = iter(_make_rows(figure, len(heights), heights))
            self._draw_over_time(next(parts), outputs)
            heat = next(parts)
            _write_heading(
                heat, "size beyond noise in multiples of the floor; ● claimed: p < 0.05 for all claims together"
            )
            panels.draw_heat_map(heat.subplots(), self.result)
            for column in columns:
                self._draw_shapes(next(parts), column, after=False)
            if ordered:
                part = next(parts)
                unit = self.result.units.get(ordered)
                _write_heading(part, f"{format_column(ordered, unit)}: residual by order of the shaft's angle")
                panels.draw_order_spectrum(part.subplots(), residuals, ordered, after=False)
            return render_png(figure)

    def _draw_over_time(self, figure: Any, outputs: Sequence[str]) -> None:
        _write_heading(figure, "residual of the model before, in the run where it is largest; grey: twice the floor")
        if not outputs:
            return
        for axes, column in zip(figure.subplots(len(outputs), 1, squeeze=False)[:, 0], outputs, strict=True):
            stretch = self.residuals.find_worst(column)
            if stretch is not None:
                panels.draw_residual_overview(axes, self.residuals, stretch)
                unit = self.result.units.get(column)
                axes.set_title(
                    f"{format_column(column, unit)}, {name_file(stretch.trace.name)}", loc="left", fontsize=8, pad=2
                )
            if column == outputs[-1]:
                axes.set_xlabel("time [s]")

    def _draw_shapes(self, figure: Any, column: str, after: bool) -> None:
        """Draw loop and maps of an output in a row."""
        variables = self.residuals.list_variables(column)
        stretch = self.residuals.find_worst(column)
        unit = self.result.units.get(column)
        _write_heading(
            figure, f"{format_column(column, unit)}: loop in the worst stretch, and mean residual of all runs"
        )
        first, *others = figure.subplots(1, 1 + min(_MOST_MAPS, len(variables)), squeeze=False)[0]
        if stretch is not None:
            over = _choose_loop_variable(column, variables, stretch.trace.columns)
            panels.draw_loop(first, self.residuals, self.residuals.widen(stretch), over, after)
        for axes, variable in zip(others, variables, strict=False):
            panels.draw_residual_map(axes, self.residuals, column, variable, after)
            if axes is others[0]:
                panels.draw_legend_above(axes)
            else:
                axes.set_ylabel("")

    def _choose_order_output(self) -> str | None:
        """Return the output for an order spectrum: the one with the largest error, where a shaft turns."""
        columns = self.examined_outputs[:1]
        if not columns or not any(ANGLE in trace.columns for trace in self.result.traces):
            return None
        return columns[0] if self.residuals.compute_orders(columns[0], "before") is not None else None


def _choose_loop_variable(column: str, variables: Sequence[str], columns: Columns) -> str:
    """Return the column over which an output is drawn: the usual one, a position, or the one that explains most residual."""
    if _LOOPS.get(column) in columns:
        return _LOOPS[column]
    positions = [name for name in columns if name != column and name.startswith(_POSITIONS)]
    others = [name for name in variables if name not in (column, ANGLE)]
    return (positions or others or list(variables))[0]


def _make_rows(figure: Figure, count: int, heights: Sequence[float] | None = None) -> list[Any]:
    return list(figure.subfigures(count, 1, squeeze=False, height_ratios=heights)[:, 0])


def _write_heading(figure: Any, text: str) -> None:
    figure.suptitle(text, x=0.01, ha="left", fontsize=9)


def _draw_legend(axes: Any) -> None:
    if axes.get_legend_handles_labels()[0]:
        axes.legend(loc="lower right", bbox_to_anchor=(1.0, 1.0), ncols=3, borderaxespad=0.2)


def _wrap(text: str) -> str:
    from textwrap import fill

    return fill(text, 105)
