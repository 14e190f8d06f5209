"""Torque: its demand with the sign of the slip, and the errors of true and estimated torque for the same sample.

A demand is a magnitude, and a torque has the sign of the slip. The error is the torque in the direction of the slip minus the
demand: positive means too much torque in both directions. It is shown only where a torque is demanded while the plates slide.
A short time after contact and after a reversal is left out, so that its peaks do not determine the scale of the axis.
"""

from collections import deque
from typing import NamedTuple

import numpy as np
import rerun as rr

from clutch_hil.bench.clutch_state import STATES
from clutch_hil.bench.direction import find_directions
from clutch_hil.bench.pictures import palette
from clutch_hil.live.viewer.canvas import Canvas, make_scalar_columns
from clutch_hil.live.viewer.clutch_batches import make_path_suffix
from clutch_hil.live.viewer.times import Times
from protocols.can.request import Request
from protocols.telemetry.batch import Batch

DEMAND, ERROR = "torque/demand", "torque_error"
_COLUMNS = tuple(
    f"controller_{name}" for name in ("torque_demand_nm", "torque_estimate_nm", "slip_rad_s", "request", "clutch_state")
)
_SLIDING = STATES.index("sliding")
# ns left out after contact and reversal: plates touch 40 ms after the pressure reaches contact pressure, friction lags 20 ms
_SETTLING = 60_000_000
_MOST_WAITING = 3000  # batches that wait for the other node: a minute at 20 ms each, more than the history of 30 s


class _DemandRows(NamedTuple):
    """Rows of the controller, each (n,): rig time [ns], demand [Nm], direction +1 or -1, whether the demand is followed."""

    rig: np.ndarray
    demand: np.ndarray
    way: np.ndarray
    followed: np.ndarray

    def compute_error(self, torque: np.ndarray) -> np.ndarray:
        """Return the error [Nm] (n, 1) of a torque [Nm] (n,) of the same samples; not-a-number where no demand is followed."""
        return np.where(self.followed, self.way * torque - self.demand, np.nan)[:, None]


class _DemandTracker:
    """Extract the demand from the controller's batches, in their order."""

    def __init__(self) -> None:
        self._last: _DemandRows | None = None
        self._unsettled = -_SETTLING  # ns, rig time of the last sample in which no torque was followed

    def take(self, batch: Batch, times: Times) -> _DemandRows | None:
        """Return the demand of a batch; None when the batch lacks a column."""
        if not set(_COLUMNS) <= {column.name for column in batch.columns}:
            return None
        demand, estimate, slip, request, state = (batch[name] for name in _COLUMNS)
        if self._last and times.rig[0] < self._last.rig[-1]:
            self._last, self._unsettled = None, -_SETTLING  # the controller was restarted
        before = float(self._last.way[-1]) if self._last else None
        way = find_directions(slip, estimate, before)
        turns = np.diff(way, prepend=way[0] if before is None else before) != 0.0
        follows = (request == Request.ENGAGE) & (state == _SLIDING) & ~turns
        since = np.maximum.accumulate(np.where(follows, self._unsettled, times.rig))
        self._unsettled = int(since[-1])
        self._last = _DemandRows(times.rig, demand, way, follows & (times.rig - since > _SETTLING))
        return self._last


class TorqueDemand:
    """Draw the demand of a clutch, a or b, over its torque."""

    def __init__(self, canvas: Canvas, clutch: str) -> None:
        self._canvas, self._tracker = canvas, _DemandTracker()
        self._path, self._label = DEMAND + make_path_suffix(clutch), f"demand{_make_suffix(clutch)} [Nm]"

    def open(self) -> None:
        """Log label and colour."""
        _log_label(self._canvas, self._path, self._label, palette.DEMAND, 1.5)

    def log(self, batch: Batch, times: Times) -> None:
        """Log the demand in the rows."""
        if demand_rows := self._tracker.take(batch, times):
            self._canvas.send(self._path, times, make_scalar_columns((demand_rows.way * demand_rows.demand)[:, None]))


class TorqueError:
    """Join plant rows with the demand that the controller had for them, because the rows of both nodes arrive separately.

    `clutch` is a or b.
    """

    def __init__(self, canvas: Canvas, clutch: str) -> None:
        self._canvas, self._clutch, self._tracker = canvas, clutch, _DemandTracker()
        end = make_path_suffix(clutch)
        self._true_path, self._estimate_path = f"{ERROR}/true{end}", f"{ERROR}/estimate{end}"
        self._demands: deque[_DemandRows] = deque(maxlen=_MOST_WAITING)
        self._true: deque[tuple[Times, np.ndarray]] = deque(maxlen=_MOST_WAITING)

    def open(self) -> None:
        """Log labels and colours."""
        clutch = self._clutch
        for path, name, colour, width in (
            (self._true_path, "true", palette.TRUE, 2.0),
            (self._estimate_path, "estimate", palette.ESTIMATE, 1.0),
        ):
            label = f"{name}{_make_suffix(clutch)} - demand [Nm]"
            _log_label(self._canvas, path, label, palette.choose_clutch_colour(colour, clutch), width)

    def log(self, batch: Batch, times: Times) -> None:
        """Log the errors that these rows complete."""
        if demand_rows := self._tracker.take(batch, times):
            if self._demands and demand_rows.rig[0] < self._demands[-1].rig[-1]:
                self._demands.clear()  # the controller was restarted
            self._demands.append(demand_rows)
            self._canvas.send(
                self._estimate_path,
                times,
                make_scalar_columns(demand_rows.compute_error(batch["controller_torque_estimate_nm"])),
            )
        if "truth_clutch_torque_nm" in {column.name for column in batch.columns}:
            if self._true and times.rig[0] < self._true[-1][0].rig[-1]:
                self._true.clear()  # the plant was restarted
            self._true.append((times, batch["truth_clutch_torque_nm"]))
        self._log_complete()

    def _log_complete(self) -> None:
        """Log every waiting batch of the plant for whose samples the controller's rows have arrived."""
        while self._true and self._demands and self._true[0][0].rig[-1] <= self._demands[-1].rig[-1]:
            times, true = self._true.popleft()
            while len(self._demands) > 1 and self._demands[1].rig[0] <= times.rig[0]:
                self._demands.popleft()
            demand_rows = _DemandRows(*(np.concatenate(parts) for parts in zip(*self._demands, strict=True)))
            # newest cycle that knew no later sample
            held = np.searchsorted(demand_rows.rig, times.rig, side="right") - 1
            known = np.flatnonzero(held >= 0)
            answered = _DemandRows(*(part[held[known]] for part in demand_rows))
            self._canvas.send(self._true_path, times[known], make_scalar_columns(answered.compute_error(true[known])))


def _make_suffix(clutch: str) -> str:
    """Return the suffix of a line's name: the clutch if it is b; empty for a, which may be a single clutch."""
    return make_path_suffix(clutch).replace("_", " ")


def _log_label(canvas: Canvas, path: str, label: str, colour: str, width: float) -> None:
    canvas.log_static(path, rr.SeriesLines(names=[label], colors=[palette.make_rgba(colour)], widths=[width]))
