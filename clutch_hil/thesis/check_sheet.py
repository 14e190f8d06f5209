"""Result sheet of one reproduction: a picture, and the checks of its claim with the measured values."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure

from protocols.files.output_file import whole_file

DPI = 110  # dots per inch of a picture; chosen: sharp on a page, and small enough for the repository
_NUMBERS = (bool, int, float, np.generic, np.ndarray, list, tuple)
REFERENCE_COLOUR = "#222222"  # of reference lines: a demand, or the static curve


@dataclass(frozen=True)
class Check:
    """A statement about `measured` numbers, whether it `holds`, and the value or words of the `thesis`."""

    statement: str
    measured: Any
    thesis: Any
    holds: bool

    def make_row(self) -> tuple[str, ...]:
        """Cells of a row of a table: statement, measured, thesis, "yes" or "NO"."""
        return (
            self.statement,
            _format_measured(self.measured),
            _format_measured(self.thesis),
            "yes" if self.holds else "NO",
        )

    def make_document(self) -> dict[str, Any]:
        """The check as a JSON object, with unrounded numbers."""
        measured = np.asarray(self.measured).tolist() if isinstance(self.measured, _NUMBERS) else str(self.measured)
        return {
            "statement": self.statement,
            "measured": measured,
            "thesis": _format_measured(self.thesis),
            "holds": self.holds,
        }


class Sheet:
    """Sheet that a reproduction fills: axes to draw on, checks, notes, and optionally a table and a JSON document.

    Long work may call `progress(done, total)`.
    """

    def __init__(self, progress: Callable[[int, int], None] = lambda done, total: None) -> None:
        self.progress = progress
        self.checks: list[Check] = []
        self.notes: list[str] = []
        self.table: list[Sequence[str]] = []
        self.document: dict[str, Any] = {}
        self.figure = Figure(layout="constrained")
        FigureCanvasAgg(self.figure)

    def make_axes(
        self, rows: int = 1, columns: int = 1, width: float = 10.0, height: float = 4.5, **options: Any
    ) -> Any:
        """Make axes to draw on, as `matplotlib.figure.Figure.subplots`; `width`, `height` of the whole picture [inch]."""
        self.figure.set_size_inches(width, height)
        panels = self.figure.subplots(rows, columns, **options)
        for axes in np.atleast_1d(panels).flat:
            axes.grid(alpha=0.3)
            axes.spines[["top", "right"]].set_visible(False)
        return panels

    def check(self, statement: str, holds: bool, measured: object = "", thesis: object = "") -> None:
        """Record one check. Give numbers in `measured` unrounded, and their units in `statement`."""
        self.checks.append(Check(statement, measured, thesis, bool(holds)))

    def note(self, text: str) -> None:
        """Add a note that the reader needs to judge the result, such as parameters that the thesis does not give."""
        self.notes.append(text)

    @property
    def holds(self) -> bool:
        """Whether there is a check, and all hold."""
        return bool(self.checks) and all(check.holds for check in self.checks)

    def save(self, path: Path, title: str) -> None:
        """Write the picture with `title` above it. Raises InputError."""
        self.figure.suptitle(title, x=0.01, ha="left", fontsize=11)
        with whole_file(path) as part:
            self.figure.savefig(part, format="png", dpi=DPI)


def label_axes(axes: Axes, x: str, y: str, title: str = "") -> None:
    """Set axis labels (with units) and a title of one panel."""
    axes.set_xlabel(x)
    axes.set_ylabel(y)
    if title:
        axes.set_title(title, loc="left", fontsize=10)


def _format_measured(value: object) -> str:
    if isinstance(value, float | np.floating):
        return f"{value:.4g}"
    if isinstance(value, list | tuple | np.ndarray):
        return ", ".join(_format_measured(item) for item in value)
    return str(value)
