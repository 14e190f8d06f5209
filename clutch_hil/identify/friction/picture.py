"""Picture of an identified friction law: the force over time and over speed, the loops, and what is left."""

from collections.abc import Sequence
from typing import Any

import numpy as np

from clutch_hil.bench.pictures import palette
from clutch_hil.identify.friction.motion_model import MotionModel, select_judged
from clutch_hil.identify.friction.result import IdentifiedFriction
from clutch_hil.identify.friction.slide_record import SlideRecord

_SIZE = 11.0, 7.5  # inch
_MOST_POINTS = 6000  # of a line: more are not seen, and make the file large


def draw_friction(friction: IdentifiedFriction, records: Sequence[SlideRecord]) -> Any:
    """Draw `friction` and the force of `records`, those it was identified from or others of the rig; a matplotlib Figure."""
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    length, unit = friction.units[:2]
    forces = MotionModel(friction.structure, records).compute_forces(friction.values)
    figure = Figure(figsize=_SIZE, layout="constrained")
    FigureCanvasAgg(figure)
    figure.suptitle(friction.verdict, x=0.01, ha="left", fontsize=10)
    over_time, left, over_speed, loops = figure.subplots(2, 2).flat
    begin = 0.0
    for record, force in zip(records, forces, strict=True):
        part = select_judged(record)
        every = slice(part.start, part.stop, max((part.stop - part.start) // _MOST_POINTS, 1))
        time = (begin + record.period * np.arange(record.size))[every]
        begin += record.period * record.size
        rigid = friction["mass"] * record.acceleration + friction["offset"] + friction["load_gain"] * record.load
        for what, colour, shown, width in (
            ("measured", palette.MEASURED, record.force, 1.6),
            ("model", palette.ESTIMATE, force, 0.8),
        ):
            named = what if record is records[0] else None
            over_time.plot(time, shown[every], color=colour, lw=width, label=named)
            over_speed.plot(record.speed[every], (shown - rigid)[every], ".", color=colour, ms=width + 0.4, label=named)
            loops.plot(record.position[every], (shown - rigid)[every], color=colour, lw=width, label=named)
        left.plot(time, (record.force - force)[every], color=palette.LIMIT, lw=0.7)
    fitted = f"{friction.errors['fitted']:.3g} {unit} RMS where fitted"
    left.axhline(0.0, color=palette.INK, lw=0.7)
    for axes, across, up, title in (
        (over_time, "time [s]", f"force [{unit}]", "Force"),
        (left, "time [s]", f"measured minus model [{unit}]", f"Residual, {fitted}"),
        (over_speed, f"speed [{length}/s]", f"friction [{unit}]", "Friction over speed"),
        (loops, f"position [{length}]", f"friction [{unit}]", "Friction over position"),
    ):  # fmt: skip
        axes.set_xlabel(across, fontsize=9)
        axes.set_ylabel(up, fontsize=9)
        axes.set_title(title, loc="left", fontsize=9)
        axes.grid(alpha=0.3)
        axes.spines[["top", "right"]].set_visible(False)
    over_time.legend(loc="lower right", bbox_to_anchor=(1.0, 0.98), ncols=2, fontsize=8, frameon=False)
    return figure
