"""States: phase, fault, clutch state and flags of a clutch's controller, as lanes of text over time."""

import numpy as np
import rerun as rr

from clutch_hil.bench.pictures import lanes, palette
from clutch_hil.live.viewer.canvas import Canvas
from clutch_hil.live.viewer.clutch_batches import make_path_suffix
from clutch_hil.live.viewer.times import Times
from protocols.telemetry.batch import Batch

_REPEAT = 5_000_000_000  # ns after which a state is logged again, because a viewer drops its oldest data
_FLAGS = {
    "in_contact": "in contact",
    "adaptation_active": "learning",
    "frozen": "integrator held",
    "saturated": "saturated",
}


def _list_lanes(clutch: str) -> dict[str, lanes.Lane]:
    """Return the lanes of a clutch by entity path."""
    flags = (lanes.Lane(flag, flag, {0: "no", 1: text}) for flag, text in _FLAGS.items())
    end = make_path_suffix(clutch)
    return {f"states/{lane.name}{end}": lane for lane in lanes.list_lanes()} | {
        f"flags/{lane.name}{end}": lane for lane in flags
    }


class States:
    """Log each change in the lanes' columns of the controller of a clutch, a or b."""

    def __init__(self, canvas: Canvas, clutch: str) -> None:
        self._canvas = canvas
        self._lanes = _list_lanes(clutch)
        self._last: dict[str, tuple[float, int]] = {}  # value and time [ns] by path, as logged

    def open(self) -> None:
        """Log names and colours; the present state follows with the next rows."""
        self._last.clear()
        for path, lane in self._lanes.items():
            words = list(lane.words.values())
            colours = np.array(
                [palette.make_rgba(palette.choose_state_colour(word)) for word in words], dtype=np.uint32
            )
            self._canvas.log_static(path, rr.StateConfiguration(values=words, colors=colours))

    def log(self, batch: Batch, times: Times) -> None:
        """Log the changes in these rows."""
        names = {column.name for column in batch.columns}
        for path, lane in self._lanes.items():
            column = f"controller_{lane.column}"
            if column in names:
                self._log_lane(path, lane, batch[column], times)

    def _log_lane(self, path: str, lane: lanes.Lane, values: np.ndarray, times: Times) -> None:
        known = np.flatnonzero(np.isfinite(values))
        if not len(known):
            return
        values, times = values[known], times[known]
        last, since = self._last.get(path, (np.nan, 0))
        changed = values != np.concatenate([[last], values[:-1]])
        if not 0 <= times.monotonic[0] - since < _REPEAT:
            changed[0] = True
        rows = np.flatnonzero(changed)
        if not len(rows):
            return
        self._canvas.send(
            path, times[rows], rr.StateChange.columns(state=[lane.find_word(value) for value in values[rows]])
        )
        self._last[path] = float(values[-1]), int(times.monotonic[rows[-1]])
