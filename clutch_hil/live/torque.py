"""Torque: its demand the way round the clutch slips, and true and estimated torque less the demand of the same sample.

A demand is a magnitude; a torque, signed as the slip, counts along it, so that more than zero is too much either way. There is
an error where a torque is followed: it is asked for and the plates slide, for a while already, so that the axis, made for what
it shows, is not made for a touch or a turn of the slip.
"""

from collections import deque
from typing import NamedTuple

import numpy as np
import rerun as rr

from clutch_hil.bench import palette
from clutch_hil.bench.clutch_state import STATES
from clutch_hil.bench.direction import direction
from clutch_hil.live.canvas import Canvas, wide
from clutch_hil.live.times import Times
from protocols.can.request import Request
from protocols.telemetry.batch import Batch

DEMAND, ERROR = "torque/demand", "torque_error"
_TRUE, _ESTIMATE = f"{ERROR}/true", f"{ERROR}/estimate"
_NEEDED = tuple(
    f"controller_{name}" for name in ("torque_demand_nm", "torque_estimate_nm", "slip_rad_s", "request", "clutch_state")
)
_SLIDING = STATES.index("sliding")
# ns that are left out after a touch and a turn: plates touch 40 ms after the pressure is that of contact, friction lags 20 ms
_SETTLING = 60_000_000
_WAITING = 3000  # batches that wait for the other node: a minute of 20 ms batches, more than the 30 s of history


class _Asked(NamedTuple):
    """Of rows of the controller: rig time [ns], demand [Nm], way round, +1 or -1, and whether the demand is followed."""

    rig: np.ndarray
    demand: np.ndarray
    way: np.ndarray
    followed: np.ndarray

    def error(self, torque: np.ndarray) -> np.ndarray:
        """Of a torque [Nm] of the same samples, shape (rows, 1); not a number where none is followed."""
        return np.where(self.followed, self.way * torque - self.demand, np.nan)[:, None]


class _Asking:
    """Makes what was asked for of the controller's batches, in their order."""

    def __init__(self) -> None:
        self._last: _Asked | None = None
        self._unsettled = -_SETTLING  # ns, rig time of the last sample in which no torque was followed

    def take(self, batch: Batch, times: Times) -> _Asked | None:
        """Of a batch; None when it does not tell."""
        if not set(_NEEDED) <= {column.name for column in batch.columns}:
            return None
        demand, estimate, slip, request, state = (batch[name] for name in _NEEDED)
        if self._last and times.rig[0] < self._last.rig[-1]:
            self._last, self._unsettled = None, -_SETTLING  # a new life of the controller
        before = float(self._last.way[-1]) if self._last else None
        way = direction(slip, estimate, before)
        turns = np.diff(way, prepend=way[0] if before is None else before) != 0.0
        follows = (request == Request.ENGAGE) & (state == _SLIDING) & ~turns
        since = np.maximum.accumulate(np.where(follows, self._unsettled, times.rig))
        self._unsettled = int(since[-1])
        self._last = _Asked(times.rig, demand, way, follows & (times.rig - since > _SETTLING))
        return self._last


class TorqueDemand:
    """Draws the demand over the torque."""

    def __init__(self, canvas: Canvas) -> None:
        self._canvas, self._asking = canvas, _Asking()

    def open(self) -> None:
        """Log label and colour."""
        _label(self._canvas, DEMAND, "demand [Nm]", palette.DEMAND, 1.5)

    def log(self, batch: Batch, times: Times) -> None:
        """Log the demand in the rows."""
        if asked := self._asking.take(batch, times):
            self._canvas.send(DEMAND, times, wide((asked.way * asked.demand)[:, None]))


class TorqueError:
    """Joins plant rows with the demand that the controller had for them, though the nodes' rows come apart."""

    def __init__(self, canvas: Canvas) -> None:
        self._canvas, self._asking = canvas, _Asking()
        self._asked: deque[_Asked] = deque(maxlen=_WAITING)
        self._true: deque[tuple[Times, np.ndarray]] = deque(maxlen=_WAITING)

    def open(self) -> None:
        """Log labels and colours."""
        _label(self._canvas, _TRUE, "true - demand [Nm]", palette.TRUE, 2.0)
        _label(self._canvas, _ESTIMATE, "estimate - demand [Nm]", palette.ESTIMATE, 1.0)

    def log(self, batch: Batch, times: Times) -> None:
        """Log the errors that the rows complete."""
        if asked := self._asking.take(batch, times):
            if self._asked and asked.rig[0] < self._asked[-1].rig[-1]:
                self._asked.clear()  # a new life of the controller
            self._asked.append(asked)
            self._canvas.send(_ESTIMATE, times, wide(asked.error(batch["controller_torque_estimate_nm"])))
        if "truth_clutch_torque_nm" in {column.name for column in batch.columns}:
            if self._true and times.rig[0] < self._true[-1][0].rig[-1]:
                self._true.clear()  # a new life of the plant
            self._true.append((times, batch["truth_clutch_torque_nm"]))
        self._join()

    def _join(self) -> None:
        """Log every waiting batch of the plant whose samples the controller has all answered."""
        while self._true and self._asked and self._true[0][0].rig[-1] <= self._asked[-1].rig[-1]:
            times, true = self._true.popleft()
            while len(self._asked) > 1 and self._asked[1].rig[0] <= times.rig[0]:
                self._asked.popleft()
            asked = _Asked(*(np.concatenate(parts) for parts in zip(*self._asked, strict=True)))
            held = np.searchsorted(asked.rig, times.rig, side="right") - 1  # newest cycle that knew no later sample
            known = np.flatnonzero(held >= 0)
            answered = _Asked(*(part[held[known]] for part in asked))
            self._canvas.send(_TRUE, times[known], wide(answered.error(true[known])))


def _label(canvas: Canvas, path: str, label: str, colour: str, width: float) -> None:
    canvas.static(path, rr.SeriesLines(names=[label], colors=[palette.rgba(colour)], widths=[width]))
