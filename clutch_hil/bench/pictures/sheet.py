"""Sheet: panels of a run over one time axis; below them a strip with phase, clutch state and fault of each controller."""

from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from clutch_hil.bench.direction import MOVING_SLIP, find_symmetric_reach
from clutch_hil.bench.pictures import palette
from clutch_hil.bench.pictures.lanes import Lane, Stretch, find_stretches, list_lanes
from protocols.files.output_file import whole_file

if TYPE_CHECKING:
    from matplotlib.figure import Figure

_WIDTH, _LEFT = 10.0, 0.8  # inches: width of the picture, and the margin left of its panels
_LANE_HEIGHT = 0.24  # inches
_RESOLUTION = 110  # dots per inch
_FONT_SIZE = 8.5  # points, of words in lanes and legends
_LETTER_WIDTH = 0.58 * _FONT_SIZE / 72.0  # inches, mean width of a letter of that size, with some margin
_WORD_STYLE: dict[str, Any] = {"fontsize": _FONT_SIZE, "va": "center", "in_layout": False}
# A legend is above its panel, where it covers no curve
_LEGEND_STYLE: dict[str, Any] = {
    "loc": "lower right", "bbox_to_anchor": (1.0, 0.98), "borderaxespad": 0.0, "fontsize": _FONT_SIZE, "frameon": False,
}  # fmt: skip
# Half the error axis is this percentile [%] of the error magnitudes times this factor
_REACH_PERCENTILE, _REACH_FACTOR = 98.0, 1.5
_LEAST_REACH = 0.1  # Nm, of half the error axis: the quantised pressure alone causes 0.08 Nm
_MARK_HEIGHT = 0.94  # of half the error axis: position of a mark for values outside, below the legend
_MOST_MARKS = 100  # along the time axis: more marks would overlap


class Sheet:
    """A picture of `columns` (n,) with panels of these `heights` [inches]. `controllers`: prefix of columns by name."""

    def __init__(
        self, columns: Mapping[str, np.ndarray], title: str, heights: Sequence[float], controllers: Mapping[str, str]
    ) -> None:
        from matplotlib.backends.backend_agg import FigureCanvasAgg
        from matplotlib.figure import Figure

        self.time = columns["time_s"]
        self._faults: list[float] = []  # s
        rows = [(f"{who} {lane.name}".strip(), lane, columns[f"{prefix}{lane.column}"])
                for who, prefix in controllers.items() for lane in list_lanes()]  # fmt: skip
        strip = _LANE_HEIGHT * len(rows)
        self._figure = Figure(figsize=(_WIDTH, sum(heights) + strip + 0.6), layout="constrained")
        FigureCanvasAgg(self._figure)
        self._figure.suptitle(title, x=0.01, ha="left", fontsize=11, parse_math=False)  # a name may have a $
        *self.panels, self.strip = self._figure.subplots(
            len(heights) + 1, 1, sharex=True, height_ratios=(*heights, strip)
        )
        self._draw_lanes(rows)

    def mark(self, times: Iterable[float], label: str, colour: str, style: str = ":") -> None:
        """Draw a line through all panels at each of `times` [s], with `label` in the legend of the first panel."""
        for axes in self.panels if (at := sorted(set(times))) else ():
            named = label if axes is self.panels[0] else "_"  # matplotlib omits _ from a legend
            axes.vlines(at, 0.0, 1.0, colour, style, label=named, lw=0.9, transform=axes.get_xaxis_transform())

    def save(self, path: Path) -> None:
        """Write the picture into a PNG at `path`. Raises InputError."""
        with whole_file(path) as part:
            self.finish().savefig(part, format="png", dpi=_RESOLUTION)

    def finish(self) -> "Figure":
        """Add legends and faults; return the figure. Call it once."""
        self.mark(self._faults, "fault", palette.LIMIT, "-")
        for axes in self.panels:
            axes.grid(alpha=0.3)
            axes.spines[["top", "right"]].set_visible(False)
            axes.margins(x=0.0)
            if axes.get_legend_handles_labels()[0]:
                axes.legend(ncols=6, **_LEGEND_STYLE)
        self.strip.set_xlim(self.time[0], self.time[-1])
        self.strip.set_xlabel("time [s]")
        self._figure.align_ylabels()
        return self._figure

    def _draw_lanes(self, rows: Sequence[tuple[str, Lane, np.ndarray]]) -> None:
        axes, step = self.strip, float(self.time[1] - self.time[0])
        colours: dict[str, str] = {}
        written: set[str] = set()
        for y, (_, lane, values) in enumerate(rows):
            spans = find_stretches(values)
            words = {value: lane.find_word(value) for value in sorted({stretch.value for stretch in spans})}
            for value, word in words.items():
                colours[word] = palette.choose_state_colour(word)
                bars = [(self.time[s.begin], (s.end - s.begin) * step) for s in spans if s.value == value]
                axes.broken_barh(bars, (y - 0.42, 0.84), color=colours[word], lw=0)
            faults = [s for s in spans if lane.name == "fault" and words[s.value] != "none"]
            written |= self._name_faults(y, faults, words) if faults else self._name_stretches(y, spans, words)
        axes.set_ylim(len(rows) - 0.5, -0.5)
        axes.set_yticks(range(len(rows)), [name for name, _, _ in rows], fontsize=_FONT_SIZE)
        axes.tick_params(axis="y", length=0)
        axes.spines[["top", "right", "left"]].set_visible(False)
        self._draw_legend({word: colour for word, colour in colours.items() if word not in written and word != "none"})

    def _name_stretches(self, y: int, spans: Sequence[Stretch], words: Mapping[float, str]) -> set[str]:
        """Write the word of each stretch that has room for it; return the written words."""
        written = set()
        for stretch in spans:
            word = words[stretch.value]
            begin, end = self.time[stretch.begin], self.time[stretch.end - 1]
            if self._measure_length(word) < end - begin:
                self.strip.text(0.5 * (begin + end), y, word, color=palette.PAPER, ha="center", **_WORD_STYLE)
                written.add(word)
        return written

    def _name_faults(self, y: int, faults: Sequence[Stretch], words: Mapping[float, str]) -> set[str]:
        """Write each fault and its time beside its begin where there is room; return the written words."""
        written = set()
        begins = [float(self.time[fault.begin]) for fault in faults]
        free = float(self.time[0])
        for fault, at, ends in zip(faults, begins, [*begins[1:], float(self.time[-1])], strict=True):
            word = f" {words[fault.value]}, {at:.3f} s "
            if at + self._measure_length(word) <= ends:
                side, free = "left", at + self._measure_length(word)
            elif at - self._measure_length(word) >= free:
                side, free = "right", at
            else:
                continue
            self.strip.text(at, y, word, color=palette.PAPER, ha=side, **_WORD_STYLE)
            written.add(words[fault.value])
        self._faults += begins
        return written

    def _measure_length(self, word: str) -> float:
        """Return the length of a word in a lane [s]."""
        return len(word) * _LETTER_WIDTH * float(self.time[-1] - self.time[0]) / (_WIDTH - _LEFT)

    def _draw_legend(self, colours: Mapping[str, str]) -> None:
        """Draw a legend for the words that had no room in any lane."""
        from matplotlib.patches import Patch

        if colours:
            self.strip.legend(
                handles=[Patch(color=colour, label=word) for word, colour in colours.items()],
                ncols=8, handlelength=1.0, **_LEGEND_STYLE,
            )  # fmt: skip


def set_speed_axis(axes: Any, *lines: np.ndarray) -> None:
    """Set the axis for these speeds [rad/s]: from 0 up, or symmetric with a line at 0 where a speed is negative."""
    if reach := find_symmetric_reach(*lines):
        axes.set_ylim(-reach, reach)
        draw_zero(axes)
    else:
        axes.set_ylim(0.0, max(axes.get_ylim()[1], MOVING_SLIP))


def show_at_least(axes: Any, high: float) -> None:
    """Extend the axis to 0 and `high`, so that noise about 0 appears small."""
    low, top = axes.get_ylim()
    axes.set_ylim(min(low, -0.05 * high), max(top, high))


def draw_zero(axes: Any) -> None:
    """Draw a line at 0."""
    axes.axhline(0.0, color=palette.INK, lw=0.7)


def plot_errors(
    axes: Any, time: np.ndarray, errors: Mapping[str, tuple[np.ndarray, str, float]], closed: np.ndarray
) -> None:
    """Plot errors [Nm] by label, each with its colour and width [pt].

    The axis has room for most samples in which the clutch is `closed`, a mask (n,). Values outside are marked at the edge of
    the axis, and the label gives their extreme.
    """
    reach = choose_error_reach([values[closed] for values, *_ in errors.values()])
    axes.set_ylim(-reach, reach)
    draw_zero(axes)
    for label, (values, colour, width) in errors.items():
        known = values[np.isfinite(values)]
        low, high = float(known.min(initial=0.0)), float(known.max(initial=0.0))
        ends = [f"{end:+.1f}" for end in (low, high) if abs(end) > reach]
        axes.plot(time, values, color=colour, lw=width, label=f"{label} (to {' and '.join(ends)})" if ends else label)
        for side, mark in ((1.0, "^"), (-1.0, "v")):
            at = _find_places(time, side * values > reach)
            axes.plot(
                at,
                np.full(len(at), side * _MARK_HEIGHT * reach),
                mark,
                color=colour,
                ms=5,
                ls="none",
                clip_on=False,
                in_layout=False,
            )


def choose_error_reach(errors: Iterable[np.ndarray]) -> float:
    """Return half the error axis [Nm]. It has room for all errors, unless a few samples are far outside the others."""
    sizes = np.abs(np.concatenate([np.empty(0), *(error[np.isfinite(error)] for error in errors)]))
    if not len(sizes):
        return _LEAST_REACH
    most, everything = _REACH_FACTOR * float(np.percentile(sizes, _REACH_PERCENTILE)), 1.05 * float(sizes.max())
    return max(everything if everything <= _REACH_FACTOR * most else most, _LEAST_REACH)


def _find_places(time: np.ndarray, beyond: np.ndarray) -> np.ndarray:
    """Return the times at which values are `beyond` an axis, at most _MOST_MARKS."""
    at = time[beyond]
    places = np.floor((at - time[0]) / (time[-1] - time[0]) * _MOST_MARKS)
    return at[np.unique(places, return_index=True)[1]]
