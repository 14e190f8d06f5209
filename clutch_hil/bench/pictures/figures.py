"""Figures of a run and of a sweep, for matplotlib: show them in a notebook, change them, or save them by `savefig`."""

from collections.abc import Sequence

import numpy as np
import pyarrow as pa
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.cm import ScalarMappable
from matplotlib.figure import Figure

from clutch_hil.bench.arguments import take_list, take_run
from clutch_hil.bench.metadata import list_injection_times
from clutch_hil.bench.pictures import palette
from clutch_hil.bench.rig import find_rig_of_run
from protocols.errors import InputError, suggest_closest
from protocols.files.run import Run

_SIZE = 7.0, 4.5  # inch
_COLOURS = "viridis"  # of a map: perceptually uniform, also for the colour-blind
_TICKS = 8  # on an axis of a map
_DOT = 30.0  # pt^2, size of the dot of a run


def draw_run(run: Run, title: str = "") -> Figure:
    """Draw a run over time as its rig defines it: torques, pressures, speeds, phases, faults and times of injections.

    Raises InputError for a run that lacks a column to draw.
    """
    run = take_run("run", run)
    rig = find_rig_of_run(run)
    if len(run.columns.get("time_s", ())) == 1:
        raise InputError("the run has 1 sample; 2 or more are needed to draw it")
    columns = {name: np.where(np.isinf(values), np.nan, values) for name, values in run.columns.items()}
    figure: Figure = rig.make_sheet(columns, title, list_injection_times(run.metadata)).finish()
    return figure


def draw_sweep(table: pa.Table, x: str | Sequence[str], y: str) -> Figure:
    """Draw a measure over one or two parameters of a sweep.

    `table` is the result of `sweep`, `x` a parameter in it or a pair of them, `y` a measure. With one parameter every run is a
    point. If only that parameter was varied, a line joins the means over the seeds. With two parameters the colour is the mean
    over all runs at a point, as a map where the points form a grid, and as dots elsewhere. Runs whose measure is NaN are not
    drawn; the title gives their number. Raises InputError.
    """
    if not isinstance(table, pa.Table):
        raise InputError(f"the table is of the type {type(table).__name__}; the result of sweep is needed")
    names = tuple(take_list("x", x))
    parameters = table.column_names[: table.column_names.index("seed")] if "seed" in table.column_names else []
    for name in names:
        if name not in parameters:
            raise InputError(f"the sweep has no parameter {name!r}; {suggest_closest(name, parameters)}")
    if not 1 <= len(names) <= 2 or len(set(names)) < len(names):
        raise InputError(
            f"a sweep cannot be drawn over {', '.join(names) or 'nothing'}; allowed are one or two parameters"
        )
    numbers = [name for name in table.column_names if pa.types.is_floating(table.schema.field(name).type)]
    measures = [name for name in numbers if name not in parameters]
    if y not in measures:
        raise InputError(f"the sweep has no numeric measure {y!r}; {suggest_closest(y, measures)}")
    values = np.array(table[y], dtype=float)
    known = np.isfinite(values)
    points = np.array([np.array(table[name], dtype=float) for name in names])[:, known]
    figure = Figure(figsize=_SIZE, layout="constrained")
    FigureCanvasAgg(figure)
    axes = figure.subplots()
    axes.spines[["top", "right"]].set_visible(False)
    axes.set_xlabel(_format_label(table, names[0]))
    if len(names) == 1:
        _draw_line(axes, points[0], values[known], alone=len(parameters) == 1)
        axes.set_ylabel(_format_label(table, y))
        axes.grid(alpha=0.3)
    else:
        _draw_map(figure, axes, points, values[known], _format_label(table, y))
        axes.set_ylabel(_format_label(table, names[1]))
    missing = len(values) - int(known.sum())
    left_out = f", of which {missing} cannot be measured" if missing else ""
    figure.suptitle(f"{len(values)} runs{left_out}", x=0.01, ha="left", fontsize=11)
    return figure


def _draw_line(axes: Axes, x: np.ndarray, y: np.ndarray, alone: bool) -> None:
    """Draw runs as points, x and y (n,), and the line of their means if only x was varied (`alone`)."""
    axes.scatter(x, y, s=_DOT, color=palette.CYCLE[1], label="run", alpha=0.6, lw=0)
    if alone and len(x):
        places, means = _average(x[np.newaxis], y)
        axes.plot(places[0], means, color=palette.CYCLE[0], lw=1.4, label="mean over the seeds")
        axes.legend(frameon=False)


def _draw_map(figure: Figure, axes: Axes, points: np.ndarray, y: np.ndarray, label: str) -> None:
    """Draw the means of y (n,) at `points` (2, n) as colours."""
    places, means = _average(points, y)
    across, up = (np.unique(one) for one in places)
    if len(means) == len(across) * len(up) and min(len(across), len(up)) > 1:
        grid = means.reshape(len(across), len(up)).T  # points are sorted; the second parameter varies fastest
        colours: ScalarMappable = axes.pcolormesh(across, up, grid, shading="nearest", cmap=_COLOURS)
        axes.set_xticks(_choose_ticks(across))
        axes.set_yticks(_choose_ticks(up))
    else:
        colours = axes.scatter(places[0], places[1], s=2.0 * _DOT, c=means, cmap=_COLOURS)
        axes.grid(alpha=0.3)
    figure.colorbar(colours, ax=axes, label=label)


def _choose_ticks(values: np.ndarray) -> np.ndarray:
    """Return those of `values` that label an axis, at most _TICKS."""
    return values[:: -(-len(values) // _TICKS)]


def _average(points: np.ndarray, y: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return the distinct `points` (k, n), sorted, shape (k, m), and the mean of y (n,) at each, (m,)."""
    places, which = np.unique(points, axis=1, return_inverse=True)
    which = np.ravel(which)
    return places, np.bincount(which, y) / np.bincount(which)


def _format_label(table: pa.Table, name: str) -> str:
    """Return a column's name and unit, for an axis."""
    unit = (table.schema.field(name).metadata or {}).get(b"unit", b"1").decode()
    return name if unit == "1" else f"{name} [{unit}]"
