"""Pictures of an identification report as PNG: parameters, fit and residual of each output, correlation."""

import re
from collections.abc import Sequence
from pathlib import Path

import numpy as np
from matplotlib.ticker import FuncFormatter, LogLocator, NullFormatter

from clutch_hil.bench.pictures.palette import CYCLE, DEMAND, LIMIT, MEASURED, TRUE
from clutch_hil.identify.calibration import Identified
from clutch_hil.identify.identification import Identification
from clutch_hil.page.figures import compute_envelope, page_figure, render_png
from clutch_hil.page.wording import format_axis_label, format_unit

_ROW = 0.24  # inch, height of a parameter's row
_WIDE = 2.0  # stated values, width of an interval that shows nothing of its parameter: 100 % to each side
FAR = 2.0  # ratio to the stated value above which percent are hard to read
_STAMP = re.compile(r"^\d{8}-\d{6}-")  # time of recording at the beginning of a run's name
_MOST_LETTERS = 18  # longest name of a run in a picture
_BAND = 2.0  # multiples of the noise that contain 95 % of a white residual


def draw_parameters(parameters: Sequence[Identified]) -> bytes:
    """Draw each parameter with its 95 % interval relative to its stated value; on a logarithmic axis if one is far from it.

    An interval wider than the stated value is cut at the edge of the picture, with an arrow: it would hide all others.
    """
    shown = [p for p in parameters if p.declared != 0.0 and p.unit != "degC"]
    ratios = [tuple(v / p.declared for v in (p.interval[0], p.value, p.interval[1])) for p in shown]
    far = any(not 1.0 / FAR < value < FAR for _, value, _ in ratios)
    ends = [end for low, value, high in ratios for end in ((low, value, high) if high - low <= _WIDE else (value,))]
    logarithmic = far and min(ends) > 0.0
    with page_figure(1.1 + _ROW * len(shown)) as figure:
        axes, stated = figure.subplots(), 1.0 if logarithmic else 0.0
        if logarithmic:
            axes.set_xscale("log")
            axes.xaxis.set_major_locator(LogLocator(subs=(1.0, 2.0, 5.0)))
            axes.xaxis.set_major_formatter(FuncFormatter(lambda ratio, _: f"{ratio:g}"))
            axes.xaxis.set_minor_formatter(NullFormatter())
        for y, one in enumerate(ratios):
            cut = [min(max(ratio, min(ends)), max(ends)) for ratio in one]
            low, value, high = cut if logarithmic else (100.0 * (ratio - 1.0) for ratio in cut)
            axes.plot([stated, value], [y, y], color=DEMAND, lw=0.7, zorder=1)
            axes.plot([low, high], [y, y], color=TRUE, lw=3.0, solid_capstyle="butt", zorder=2)
            axes.plot(value, y, "|", color=TRUE, ms=9, mew=2.0, zorder=3)
            for end, at, arrow in ((0, low, "<"), (2, high, ">")):
                if cut[end] != one[end]:
                    axes.plot(at, y, arrow, color=TRUE, ms=7, clip_on=False, zorder=3)
        axes.axvline(stated, color=DEMAND, lw=1.0)
        axes.set_yticks(range(len(shown)), [p.name for p in shown])
        axes.set_ylim(len(shown) - 0.4, -0.6)
        axes.set_xlabel("identified over stated value" if logarithmic else "identified over stated value, minus 1 [%]")
        axes.grid(axis="y", visible=False)
        return render_png(figure)


def draw_fit(identification: Identification, column: str) -> bytes:
    """Draw an output of all runs in sequence, measured and simulated, and its residual with the noise band."""
    with page_figure(4.2) as figure:
        top, low = figure.subplots(2, 1, sharex=True, height_ratios=(2.0, 1.0))
        begin, noise = 0.0, _compute_noise(identification, column)
        labels = shorten_names(list(identification.measured))
        for k, (name, measured) in enumerate(identification.measured.items()):
            simulated, time = identification.simulated[name][column], measured["time_s"] - measured["time_s"][0] + begin
            end = 2.0 * float(time[-1]) - float(time[-2])
            if k % 2:
                for axes in (top, low):
                    axes.axvspan(begin, end, color=DEMAND, alpha=0.09, lw=0)
            mark = "_" if k else ""  # a legend leaves out labels that begin so
            top.plot(*compute_envelope(time, measured[column]), color=MEASURED, lw=1.4, label=f"{mark}measured")
            top.plot(*compute_envelope(time, simulated), color=TRUE, lw=0.8, label=f"{mark}identified model")
            low.plot(*compute_envelope(time, measured[column] - simulated), color=CYCLE[0], lw=0.6)
            top.annotate(
                labels[k], (0.5 * (begin + end), 1.0), xycoords=("data", "axes fraction"), xytext=(0, 3),
                textcoords="offset points", ha="center", fontsize=7.5,
            )  # fmt: skip
            begin = end
        low.axhspan(-_BAND * noise, _BAND * noise, color=LIMIT, alpha=0.12, lw=0)
        top.set_ylabel(format_axis_label(column, identification.units[column]))
        low.set_ylabel(f"residual [{format_unit(identification.units[column]) or '1'}]")
        low.set_xlabel("time, all runs one after the other [s]")
        top.margins(x=0.0)
        top.legend(loc="best", ncols=2)
        return render_png(figure)


def draw_correlation(names: Sequence[str], correlation: np.ndarray) -> bytes:
    """Draw the correlation (p, p) of the parameters as a map."""
    with page_figure(1.6 + 0.2 * len(names)) as figure:
        axes = figure.subplots()
        image = axes.imshow(correlation, cmap="RdBu_r", vmin=-1.0, vmax=1.0, aspect="auto")
        axes.set_xticks(range(len(names)), names, rotation=60, ha="right", rotation_mode="anchor", fontsize=7)
        axes.set_yticks(range(len(names)), names, fontsize=7)
        axes.grid(False)
        figure.colorbar(image, ax=axes, label="correlation", pad=0.01)
        return render_png(figure)


def _compute_noise(identification: Identification, column: str) -> float:
    """Compute the noise of an output, in its unit: root mean square residual over misfit."""
    left = [run[column] - identification.simulated[name][column] for name, run in identification.measured.items()]
    return float(np.sqrt(np.nanmean(np.concatenate(left) ** 2))) / identification.misfit[column]


def shorten_names(names: Sequence[str]) -> list[str]:
    """Shorten names of runs for a picture: without folder, time of recording, suffix, and words that all names begin with."""
    words = [_STAMP.sub("", Path(name).stem).split("_") for name in names]
    common = 0
    while len(words) > 1 and len({tuple(one[: common + 1]) for one in words}) == 1 < min(map(len, words)) - common:
        common += 1
    short = ["_".join(one[common:]) for one in words]
    return [one if len(one) <= _MOST_LETTERS else f"{one[: _MOST_LETTERS - 1]}…" for one in short]
