"""Picture of an identification: each output of each run, measured and simulated, and the residual."""

from collections.abc import Sequence
from pathlib import Path

import numpy as np
from matplotlib.figure import Figure

from clutch_hil.bench.pictures.palette import DEMAND, MEASURED, TRUE
from clutch_hil.identify.identification import Identification
from clutch_hil.page.figures import name_file
from protocols.files.output_file import whole_file

_WIDTH, _HEIGHT = 4.2, 1.25  # inches, width of a run and height of an axis
_POINTS = 3000  # most points of a line: what a page can show
_LETTERS = 48  # longest name of a run above its axes
_MOST_RUNS = 8  # most runs side by side: as many as the set of a power shift has


def draw_identification(identification: Identification, path: Path) -> None:
    """Write the picture to `path`. Raises InputError."""
    names, columns = list(identification.measured)[:_MOST_RUNS], list(identification.units)
    figure = Figure(figsize=(_WIDTH * len(names) + 1.0, 2.0 * _HEIGHT * len(columns)), layout="constrained")
    axes = figure.subplots(
        2 * len(columns), len(names), sharex="col", squeeze=False, height_ratios=[2.0, 1.0] * len(columns)
    )
    for k, name in enumerate(names):
        measured, simulated = identification.measured[name], identification.simulated[name]
        every = max(1, len(measured["time_s"]) // _POINTS)
        time = measured["time_s"][::every]
        for i, column in enumerate(columns):
            top, low = axes[2 * i, k], axes[2 * i + 1, k]
            top.plot(time, measured[column][::every], color=MEASURED, lw=2.4, alpha=0.45, label="measured")
            top.plot(time, simulated[column][::every], color=TRUE, lw=0.9, label="identified model")
            low.plot(time, (measured[column] - simulated[column])[::every], color=DEMAND, lw=0.4)
            if k == 0:
                top.set_ylabel(f"{_make_title(column)}\n[{identification.units[column]}]")
                low.set_ylabel("residual")
        axes[0, k].set_title(name_file(name, _LETTERS), fontsize=9, parse_math=False)  # a name may have a $
        axes[-1, k].set_xlabel("time [s]")
    axes[0, 0].legend(fontsize=7, loc="best")
    if len(names) < len(identification.measured):
        figure.suptitle(f"the first {len(names)} of {len(identification.measured)} runs; the report has all")
    with whole_file(path) as part:
        figure.savefig(part, format="png", dpi=110)


def _make_title(column: str) -> str:
    """Return a column's name without its unit."""
    words = column.split("_")
    return " ".join(words[:-2] if words[-2:] == ["rad", "s"] else words[:-1])


def format_table(identification: Identification) -> Sequence[str]:
    """Return the lines of a text table of the parameters, and a line on the effects that were tested and found absent."""
    width = max(len(name) for name in ("parameter", *(p.name for p in identification.calibration.parameters)))
    lines = [f"{'parameter':<{width}}  {'identified':>11}  {'+- 95 %':>9}  {'declared':>10}  unit"]
    for p in identification.calibration.parameters:
        moved = abs(p.value - p.declared) > p.half
        lines.append(
            f"{p.name:<{width}}  {p.value:>11.5g}  {p.half:>9.2g}  {p.declared:>10.5g}  {p.unit}"
            + ("" if moved else "  (as declared)")
        )
    if absent := identification.calibration.absent:
        lines.append(f"absent: {', '.join(f'{p.name} ({p.value:.2g} +- {p.half:.2g} {p.unit})' for p in absent)}")
    return [
        *lines,
        *(f"residual of {c}: {np.round(share, 2):g} times its noise" for c, share in identification.misfit.items()),
    ]
