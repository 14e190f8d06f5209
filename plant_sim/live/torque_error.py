"""Torque error: true and estimated torque less the demand of the same sample, though the nodes' rows come apart.

A demand is a magnitude; the torque, signed as the slip, counts with its own.
"""

from collections import deque

import numpy as np
import rerun as rr

from plant_sim.live import palette
from plant_sim.live.canvas import Canvas, wide
from plant_sim.live.times import Times
from protocols.telemetry.batch import Batch

PATH = "torque_error"
_WAITING = 3000  # batches that wait for the other node: a minute of 20 ms batches, more than the 30 s of history
_TRUE, _ESTIMATE = f"{PATH}/true", f"{PATH}/estimate"


class TorqueError:
    """Joins plant rows with the demand that the controller had for them."""

    def __init__(self, canvas: Canvas) -> None:
        self._canvas = canvas
        self._demands: deque[tuple[np.ndarray, np.ndarray]] = deque(maxlen=_WAITING)  # rig time [ns], demand
        self._true: deque[tuple[Times, np.ndarray]] = deque(maxlen=_WAITING)

    def open(self) -> None:
        """Log labels and colours."""
        for path, label, color, width in (
            (_TRUE, "true [Nm]", palette.TRUE, 2.0),
            (_ESTIMATE, "estimate [Nm]", palette.ESTIMATE, 1.0),
        ):
            self._canvas.static(path, rr.SeriesLines(names=[label], colors=[color], widths=[width]))

    def log(self, batch: Batch, times: Times) -> None:
        """Log the errors that the rows complete."""
        names = {column.name for column in batch.columns}
        if "controller_torque_demand_nm" in names:
            demand = batch["controller_torque_demand_nm"]
            self._send(_ESTIMATE, times, np.abs(batch["controller_torque_estimate_nm"]) - demand)
            self._add_demand(times.rig, demand)
        if "truth_clutch_torque_nm" in names:
            if self._true and times.rig[0] < self._true[-1][0].rig[-1]:
                self._true.clear()  # a new life of the plant
            self._true.append((times, np.abs(batch["truth_clutch_torque_nm"])))
        self._join()

    def _add_demand(self, rig: np.ndarray, demand: np.ndarray) -> None:
        if self._demands and rig[0] < self._demands[-1][0][-1]:
            self._demands.clear()  # a new life of the controller
        self._demands.append((rig, demand))

    def _join(self) -> None:
        """Log every waiting batch of the plant whose samples the controller has all answered."""
        while self._true and self._demands and self._true[0][0].rig[-1] <= self._demands[-1][0][-1]:
            times, true = self._true.popleft()
            while len(self._demands) > 1 and self._demands[1][0][0] <= times.rig[0]:
                self._demands.popleft()
            rig = np.concatenate([rig for rig, _ in self._demands])
            demand = np.concatenate([demand for _, demand in self._demands])
            held = np.searchsorted(rig, times.rig, side="right") - 1  # newest cycle that knew no later sample
            self._send(_TRUE, times, np.where(held >= 0, true - demand[held], np.nan))

    def _send(self, path: str, times: Times, error: np.ndarray) -> None:
        known = np.flatnonzero(np.isfinite(error))
        if len(known):
            self._canvas.send(path, times[known], wide(error[known, None]))
