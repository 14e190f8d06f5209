"""Curves: torque over pressure and over slip as x-y plots. rerun has no x-y plots, so their axes are drawn in a 2-D view.

Trails of two clutches are in the same plots.

Trails are logged in data units below a transform into the box of the plot. When data leave the axes, transform and axes change
together, and old trails stay correct.
"""

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np
import rerun as rr

from clutch_hil.bench.pictures import palette
from clutch_hil.live.viewer.canvas import Canvas
from clutch_hil.live.viewer.clutch_batches import make_path_suffix
from clutch_hil.live.viewer.decimator import Decimator
from clutch_hil.live.viewer.times import Times
from protocols.telemetry.batch import Batch

BOX = (190.0, 88.0)  # width and height of the axes in units of the view: the aspect ratio of its place in the layout
_PIECE_RATE = 10.0  # Hz, rate of pieces of a trail; each piece and its dot cost two calls of rerun
_POINT_RATE = 200.0  # Hz, rate of points of a trail; the pressure loop has a bandwidth of 10 Hz
_DIVISIONS = 5, 3  # largest number of divisions of an axis, and of each half of a symmetric axis


class Trail(NamedTuple):
    """A y column over an x column of the same node."""

    name: str
    x: str
    y: str


@dataclass
class Curve:
    """An x-y plot. Its axes (x, y) reach from `low` to `high` and grow with the data; negative data make them symmetric."""

    path: str
    title: str
    high: np.ndarray
    trails: tuple[Trail, ...]
    low: np.ndarray = field(default_factory=lambda: np.zeros(2))


def make_curves() -> tuple[Curve, ...]:
    """Return the two x-y plots. The initial axes have the range of the engagement profile."""
    return (
        Curve("torque_over_pressure", "torque [Nm] over pressure [bar]", np.array([4.0, 20.0]), (
            Trail("estimate", "controller_pressure_bar", "controller_torque_estimate_nm"),
            Trail("true", "truth_cylinder_pressure_bar", "truth_clutch_torque_nm"),
        )),
        Curve("torque_over_slip", "torque [Nm] over slip [rad/s]", np.array([25.0, 20.0]), (
            Trail("estimate", "controller_slip_rad_s", "controller_torque_estimate_nm"),
            Trail("true", "truth_slip_speed_rad_s", "truth_clutch_torque_nm"),
        )),
    )  # fmt: skip


class Curves:
    """Log pieces of the trails of a clutch, a or b, and a dot at the present. All clutches share the plots `drawn`."""

    def __init__(self, canvas: Canvas, drawn: Sequence[Curve], clutch: str) -> None:
        self._canvas, self._clutch = canvas, clutch
        self._curves = drawn
        self._paces: dict[str, Decimator] = {}
        self._ends: dict[
            str, np.ndarray
        ] = {}  # by trail: points not yet logged; the first is the end of the last piece

    def open(self) -> None:
        """Log the axes, and the colours of the trails."""
        for curve in self._curves:
            self._draw_axes(curve)
            for level, trail in enumerate(curve.trails):
                path = self._make_path(curve, trail)
                colour = [palette.make_rgba(palette.choose_clutch_colour(palette.choose_colour(trail.y), self._clutch))]
                order = level + 1.0  # later ones are drawn over earlier ones
                line, dot = rr.Radius.ui_points(1.2), rr.Radius.ui_points(4.5)
                self._canvas.log_static(path, rr.LineStrips2D.from_fields(colors=colour, radii=line, draw_order=order))
                self._canvas.log_static(
                    f"{path}/now", rr.Points2D.from_fields(colors=colour, radii=dot, draw_order=order)
                )

    def log(self, batch: Batch, times: Times) -> None:
        """Log the pieces of trail that these rows complete."""
        names = {column.name for column in batch.columns}
        for curve in self._curves:
            for trail in curve.trails:
                if trail.x in names and trail.y in names:
                    points = np.column_stack([batch[trail.x], batch[trail.y]])
                    self._log_trail(curve, trail, points, times, batch.rate)

    def _log_trail(self, curve: Curve, trail: Trail, points: np.ndarray, times: Times, rate: float) -> None:
        path = self._make_path(curve, trail)
        stride = max(1, round(rate / _POINT_RATE))
        cuts = self._paces.setdefault(path, Decimator(_PIECE_RATE)).pick(times)
        begin, rest = 0, self._ends.get(path, np.empty((0, 2)))
        pieces, rows = [], []
        for cut in cuts:
            piece = np.concatenate([rest, points[begin:cut:stride], points[cut : cut + 1]])
            piece = piece[np.isfinite(piece).all(axis=1)]
            begin, rest = cut, piece[-1:]
            if len(piece):
                pieces.append(piece)
                rows.append(cut)
        self._ends[path] = np.concatenate([rest, points[begin::stride]])
        if not pieces:
            return
        self._widen(curve, pieces)
        where = times[rows]
        self._canvas.send(path, where, rr.LineStrips2D.columns(strips=pieces))
        self._canvas.send(f"{path}/now", where, rr.Points2D.columns(positions=[piece[-1] for piece in pieces]))

    def _widen(self, curve: Curve, pieces: list[np.ndarray]) -> None:
        points = np.concatenate(pieces)
        low, high = points.min(axis=0), points.max(axis=0)
        slack = 0.02 * (curve.high - curve.low)  # noise about zero must not change the axes
        if (low < curve.low - slack).any() or (high > curve.high).any():
            curve.high = np.where(high > curve.high, 1.2 * high, curve.high)
            back = low < curve.low - slack
            curve.high = np.where(back, np.maximum(curve.high, -1.2 * low), curve.high)
            curve.low = np.where(back | (curve.low < 0.0), -curve.high, curve.low)
            self._draw_axes(curve)

    def _draw_axes(self, curve: Curve) -> None:
        parts = np.where(curve.low < 0.0, curve.high / _DIVISIONS[1], curve.high / _DIVISIONS[0])
        steps = np.array([_round_step(part) for part in parts])
        curve.low = np.floor(curve.low / steps + 1e-9) * steps
        curve.high = np.ceil(curve.high / steps - 1e-9) * steps
        width, height = BOX
        sx, sy = BOX / (curve.high - curve.low)
        shift = [-curve.low[0] * sx, curve.low[1] * sy, 0.0]
        self._canvas.log_static(f"{curve.path}/data", rr.Transform3D(translation=shift, scale=[sx, -sy, 1.0]))
        xs = np.arange(curve.low[0], curve.high[0] + steps[0] / 2, steps[0])
        ys = np.arange(curve.low[1], curve.high[1] + steps[1] / 2, steps[1])
        across = [[(x * sx + shift[0], 0.0), (x * sx + shift[0], -height)] for x in xs]
        along = [[(0.0, -y * sy + shift[1]), (width, -y * sy + shift[1])] for y in ys]
        grid = rr.LineStrips2D(
            across + along, colors=[palette.make_rgba(palette.GRID)], radii=rr.Radius.ui_points(0.4), draw_order=-1.0
        )
        self._canvas.log_static(f"{curve.path}/grid", grid)
        first = 0 if curve.low.any() else 1  # one 0 at the corner stands for both axes
        marks = [(line[0][0], 2.0) for line in across] + [(-7.0, line[0][1] - 5.0) for line in along[first:]]
        texts = [f"{value:g}" for value in (*np.round(xs, 9), *np.round(ys[first:], 9))]
        labels = rr.Points2D(marks, labels=texts, colors=[palette.make_rgba(palette.TEXT)], radii=0.0, show_labels=True)
        self._canvas.log_static(f"{curve.path}/labels", labels)

    def _make_path(self, curve: Curve, trail: Trail) -> str:
        return make_trail_path(curve, trail, self._clutch)


def make_trail_path(curve: Curve, trail: Trail, clutch: str) -> str:
    """Return the entity path of the trail of a clutch, a or b."""
    return f"{curve.path}/data/{trail.name}{make_path_suffix(clutch)}"


def _round_step(step: float) -> float:
    """Return the next larger of 1, 2, 5, 10, ... times a power of ten."""
    power = 10.0 ** np.floor(np.log10(step))
    return float(power * next(factor for factor in (1.0, 2.0, 5.0, 10.0) if factor * power >= step * (1.0 - 1e-9)))
