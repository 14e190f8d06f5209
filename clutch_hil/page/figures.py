"""Figures: the pictures of a page, in one style and width."""

from collections.abc import Iterator
from contextlib import contextmanager
from io import BytesIO
from pathlib import Path
from typing import Any

import matplotlib
import numpy as np
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from matplotlib.ticker import AutoLocator, MaxNLocator

_DPI = 130  # 1235 pixels at the page's width
_WIDTH = 9.5  # inch, of the page
_POINTS = 900  # of a line's envelope: about one per pixel of an axis
_TICKS = 6  # largest number of intervals of an axis: ticks take most of the drawing time
_STYLE: Any = {
    "text.parse_math": False,  # a name may have a $
    "font.size": 9.0,
    "axes.titlesize": 9.0,
    "axes.labelsize": 8.5,
    "xtick.labelsize": 8.0,
    "ytick.labelsize": 8.0,
    "legend.fontsize": 8.0,
    "legend.frameon": False,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "axes.grid": True,
    "axes.axisbelow": True,
    "grid.alpha": 0.3,
    "path.simplify_threshold": 0.3,
}


def name_file(path: str, letters: int = 80) -> str:
    """Return the name of a file for a title: without folder; of a longer name only its end."""
    name = Path(path).name
    return name if len(name) <= letters else f"…{name[1 - letters :]}"


@contextmanager
def page_figure(height: float) -> Iterator[Figure]:
    """Yield a figure with the width of a page and a `height` [inch]."""
    with matplotlib.rc_context(_STYLE):
        figure = Figure(figsize=(_WIDTH, height), dpi=_DPI, layout="constrained")
        FigureCanvasAgg(figure)
        yield figure


def render_png(figure: Figure) -> bytes:
    """Return the figure as a PNG."""
    for axes in figure.axes:
        for axis in (axes.xaxis, axes.yaxis):
            if isinstance(axis.get_major_locator(), AutoLocator):
                axis.set_major_locator(MaxNLocator(_TICKS, steps=[1, 2, 2.5, 5, 10]))  # ticks take most of the time
    target = BytesIO()
    figure.canvas.print_png(target, pil_kwargs={"compress_level": 4})  # type: ignore[attr-defined]  # `savefig` draws twice
    return target.getvalue()


def compute_envelope(time: np.ndarray, values: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return time and values (k,) of the envelope of a line (n,), about two per pixel; a short line is returned unchanged."""
    step = len(values) // _POINTS
    if step < 4:
        return time, values
    count = len(values) // step
    pieces = values[: count * step].reshape(count, step)
    ends = np.column_stack([pieces.min(axis=1), pieces.max(axis=1)]).ravel()
    return np.repeat(time[: count * step : step], 2), ends
