"""Pictures of effects: a measured quantity of the rig with and without one, and the difference."""

from collections.abc import Sequence
from pathlib import Path
from textwrap import wrap
from typing import Any

from clutch_hil.bench import palette
from clutch_hil.bench.demonstration import Demonstration

_WITHOUT, _WITH, _DIFFERENCE = palette.INK, *palette.CYCLE[:2]
_LETTERS = 14  # of a title, an inch
_OVER = {
    "cylinder_pressure_bar": "cylinder pressure [bar]",  # label of an abscissa
    "time_s": "time [s]",
    "valve_voltage_v": "valve voltage [V]",
    "motor_speed_demand_rad_s": "speed demand [rad/s]",
    "clutch_torque_nm": "clutch torque [Nm]",
    "shaft_angle_rad": "shaft angle [rad]",
}


def draw_effects(path: Path, shown: Sequence[tuple[str, Demonstration]], columns: int = 1) -> None:
    """Draw (title, demonstration) pairs, `columns` of them side by side, into a PNG at `path`."""
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    rows = -(-len(shown) // columns)
    size = (7.5, 5.5) if columns == 1 else (4.6 * columns, 3.9 * rows)
    figure = Figure(figsize=size, layout="constrained")
    FigureCanvasAgg(figure)
    for part, (title, demonstration) in zip(figure.subfigures(rows, columns, squeeze=False).flat, shown, strict=False):
        _draw(part, title, demonstration, round(_LETTERS * size[0] / columns))
    figure.savefig(path, dpi=110)


def _draw(figure: Any, title: str, shown: Demonstration, letters: int) -> None:
    above, below = figure.subplots(2, 1, sharex=True, height_ratios=(2.2, 1))
    lines = [*wrap(title, letters), *wrap(shown.excitation.title, letters)]
    figure.suptitle("\n".join(lines), x=0.02, ha="left", fontsize=9)
    above.plot(shown.without[shown.over], shown.without[shown.column], color=_WITHOUT, lw=1.1, label="without")
    above.plot(shown.with_it[shown.over], shown.with_it[shown.column], color=_WITH, lw=1.1, label="with")
    above.set_ylabel(f"{shown.what} [{shown.unit}]", fontsize=9)
    above.legend(loc="lower right", bbox_to_anchor=(1.0, 0.98), ncols=2, fontsize=8, frameon=False)
    below.plot(shown.without[shown.over], shown.difference, color=_DIFFERENCE, lw=1.0)
    below.axhline(0.0, color=_WITHOUT, lw=0.7, ls="--")
    below.set_ylabel(f"difference [{shown.unit}]", fontsize=9)
    below.set_xlabel(_OVER[shown.over], fontsize=9)
    for axes in (above, below):
        axes.grid(alpha=0.3)
        axes.spines[["top", "right"]].set_visible(False)
        axes.tick_params(labelsize=8)
        axes.margins(x=0.01, y=0.08)
