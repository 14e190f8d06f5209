"""States: phase, fault and clutch as the controller has them, and its flags, as lanes of text."""

from typing import NamedTuple

import numpy as np
import rerun as rr

from plant_sim.live import clutch_state
from plant_sim.live.canvas import Canvas
from plant_sim.live.times import Times
from protocols.frames import load_frames
from protocols.telemetry.batch import Batch

GROUPS = ("states", "flags")  # paths: the two that matter always, and the rest
_REPEAT = 5_000_000_000  # ns: a viewer that forgets its oldest data still knows the present state
_CALM, _BUSY, _GOOD, _LEAVING, _BAD = 0x455A64FF, 0xF9A825FF, 0x2E7D32FF, 0x6A4FB0FF, 0xD32F2FFF
_PHASES = {"idle": _CALM, "fill": _BUSY, "slip control": _GOOD, "lock": _GOOD, "release": _LEAVING, "fault": _BAD}
_CLUTCH = {"open": _CALM, "sliding": _GOOD, "sticking": _BUSY, "locked": _GOOD}
_FAULTS = {"none": _CALM}  # all others are bad


class Lane(NamedTuple):
    """A column as a lane: entity path, and text and colour by value; a value that has none is shown as its number."""

    column: str
    path: str
    texts: dict[int, str]
    colors: dict[str, int]


def lanes() -> tuple[Lane, ...]:
    """The lanes; names of phases and faults are those of the DBC."""
    status = load_frames()["CONTROLLER_STATUS"]
    phase, fault = status.choices("phase"), status.choices("fault")
    return (
        Lane("controller_phase", "states/phase", phase, {name: _PHASES.get(name, _BUSY) for name in phase.values()}),
        Lane(clutch_state.COLUMN, "states/clutch", dict(enumerate(clutch_state.STATES)), _CLUTCH),
        Lane("controller_fault", "states/reason", fault, {name: _FAULTS.get(name, _BAD) for name in fault.values()}),
        *(
            Lane(f"controller_{flag}", f"flags/{flag}", {0: "no", 1: text}, {"no": _CALM, text: color})
            for flag, text, color in (
                ("in_contact", "in contact", _GOOD),
                ("adaptation_active", "learning", _GOOD),
                ("frozen", "integrator held", _BUSY),
                ("saturated", "saturated", _BAD),
            )
        ),
    )


class States:
    """Logs each change of the lanes' columns."""

    def __init__(self, canvas: Canvas) -> None:
        self._canvas = canvas
        self._lanes = lanes()
        self._last: dict[str, tuple[float, int]] = {}  # value and time [ns] by column, as logged

    def open(self) -> None:
        """Log names and colours; the present state follows with the next rows."""
        self._last.clear()
        for lane in self._lanes:
            texts, colors = list(lane.colors), np.array(list(lane.colors.values()), dtype=np.uint32)
            self._canvas.static(lane.path, rr.StateConfiguration(values=texts, colors=colors))

    def log(self, batch: Batch, times: Times) -> None:
        """Log what changed in the rows."""
        names = {column.name for column in batch.columns}
        for lane in self._lanes:
            if lane.column in names:
                self._log_lane(lane, batch[lane.column], times)

    def _log_lane(self, lane: Lane, values: np.ndarray, times: Times) -> None:
        known = np.flatnonzero(np.isfinite(values))
        if not len(known):
            return
        values, times = values[known], times[known]
        last, since = self._last.get(lane.column, (np.nan, 0))
        changed = values != np.concatenate([[last], values[:-1]])
        if not 0 <= times.passing[0] - since < _REPEAT:
            changed[0] = True
        rows = np.flatnonzero(changed)
        if not len(rows):
            return
        texts = [lane.texts.get(int(value), f"{value:g}") for value in values[rows]]
        self._canvas.send(lane.path, times[rows], rr.StateChange.columns(state=texts))
        self._last[lane.column] = float(values[-1]), int(times.passing[rows[-1]])
