"""Pictures of effects: a measured quantity of the rig with and without the effect, and the difference."""

from collections.abc import Mapping
from pathlib import Path
from textwrap import wrap
from typing import Any

from clutch_hil.bench.effect_sheets.demonstration import Demonstration
from clutch_hil.bench.effect_sheets.excitation import INPUTS, QUANTITIES
from clutch_hil.bench.pictures import palette
from plant_sim.effects.effect import Effect

_WITHOUT, _WITH, _DIFFERENCE = palette.INK, *palette.CYCLE[:2]
_TITLE_LETTERS = 14  # characters per inch of a title, at 9 points
_LABELS = {"time_s": "time [s]"} | {c: f"{what} [{unit}]" for c, (what, unit, *_) in {**INPUTS, **QUANTITIES}.items()}


def draw_effects(path: Path, demonstrations: Mapping[Effect, Demonstration], columns: int = 1) -> None:
    """Draw demonstrations of effects, `columns` of them side by side, into a PNG at `path`."""
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    rows = -(-len(demonstrations) // columns)
    size = (7.5, 5.5) if columns == 1 else (4.6 * columns, 3.9 * rows)  # inches
    figure = Figure(figsize=size, layout="constrained")
    FigureCanvasAgg(figure)
    parts = figure.subfigures(rows, columns, squeeze=False).flat
    for part, (effect, demonstration) in zip(parts, demonstrations.items(), strict=False):
        _draw(part, f"{effect.name}: {effect.title}", demonstration, round(_TITLE_LETTERS * size[0] / columns))
    figure.savefig(path, dpi=110, format="png")


def _draw(figure: Any, title: str, demonstration: Demonstration, letters: int) -> None:
    """Draw a demonstration: the quantity above, the difference below, under a title with lines of `letters` characters."""
    above, below = figure.subplots(2, 1, sharex=True, height_ratios=(2.2, 1))
    lines = [*wrap(title, letters), *wrap(demonstration.excitation.title, letters)]
    figure.suptitle("\n".join(lines), x=0.02, ha="left", fontsize=9, parse_math=False)  # a title may have a $
    above.plot(
        demonstration.without[demonstration.over],
        demonstration.without[demonstration.column],
        color=_WITHOUT,
        lw=1.1,
        label="without",
    )
    above.plot(
        demonstration.with_it[demonstration.over],
        demonstration.with_it[demonstration.column],
        color=_WITH,
        lw=1.1,
        label="with",
    )
    above.set_ylabel(f"{demonstration.what} [{demonstration.unit}]", fontsize=9)
    above.legend(loc="lower right", bbox_to_anchor=(1.0, 0.98), ncols=2, fontsize=8, frameon=False)
    below.plot(demonstration.without[demonstration.over], demonstration.difference, color=_DIFFERENCE, lw=1.0)
    below.axhline(0.0, color=_WITHOUT, lw=0.7, ls="--")
    below.set_ylabel(f"difference [{demonstration.unit}]", fontsize=9)
    below.set_xlabel(_LABELS[demonstration.over], fontsize=9)
    for axes in (above, below):
        axes.grid(alpha=0.3)
        axes.spines[["top", "right"]].set_visible(False)
        axes.tick_params(labelsize=8)
        axes.margins(x=0.01, y=0.08)
