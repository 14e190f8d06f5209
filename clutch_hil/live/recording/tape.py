"""Tape: one run file of a recording, without a gap. Rows of plant and controllers are joined as in `clutch-hil up`."""

from collections import deque
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from clutch_hil.bench.recording import Recording
from protocols.can.frames import load_frames
from protocols.node import Column
from protocols.telemetry.batch import Batch

_TIE_POINTS = 400  # ends of batches: the history of 30 s arrives in 30 batches, later ones at 50 per second
# A controller knows the lowest bits of the plant's tick and counts on from its first sample
_TICK_WRAP = 1 << load_frames()["ENCODER"].bits["sample_tick"]


class Tape:
    """Write a run file: plant rows without a gap from batch `first` on, and the controllers' rows of that time.

    `plant` has the plant's columns, `controllers` those of each controller by its name, clutch a's first where there are two.
    `recording` determines how the file is written.
    """

    def __init__(
        self,
        path: Path,
        first: Batch,
        plant: Sequence[Column],
        controllers: Mapping[str, Sequence[Column]],
        recording: type[Recording] = Recording,
    ) -> None:
        bare = [
            [Column(name.removeprefix(f"{node}_"), unit, meaning) for name, unit, meaning in columns]
            for node, columns in controllers.items()
        ]
        self.rows = 0
        self._recording = recording(path, plant, bare, round(first.rate))
        self._session, self._end = first.session, first.first_row
        self._no_rows = np.empty((0, len(plant)))
        self._no_terms = {node: np.empty((0, len(columns))) for node, columns in controllers.items()}
        self._tie_points: deque[tuple[float, float]] = deque(maxlen=_TIE_POINTS)  # clock [s] and tick of the plant
        self._clock = first["plant_clock_s"][0]
        self._ticks = dict.fromkeys(controllers, -1.0)  # newest sample that each controller has answered

    def keep_journal(self, metadata: Mapping[str, Any]) -> None:
        """See `Recording`."""
        self._recording.keep_journal(metadata)

    def follows(self, batch: Batch) -> bool:
        """Return whether a batch of the plant continues where the last batch ended."""
        return (batch.session, batch.first_row) == (self._session, self._end)

    def add_plant(self, batch: Batch) -> None:
        """Add the plant's next rows."""
        self._tie_points.extend((batch["plant_clock_s"][k], batch["time_s"][k] * batch.rate) for k in (0, -1))
        self._recording.add(batch.rows, *self._no_terms.values())
        self._end = batch.end
        self.rows += len(batch.rows)

    def add_controller(self, batch: Batch) -> None:
        """Add rows of a controller. Their ticks are converted to the plant's ticks, and do not decrease after a restart."""
        node, rows = batch.node, batch.rows.copy()
        ticks = rows[:, [column.name for column in batch.columns].index(f"{node}_sample_tick")]  # a view
        clock = batch[f"{node}_clock_s"]
        near = np.interp(clock, *np.array(self._tie_points).T)
        ticks += np.where(ticks < 0.0, 0.0, _TICK_WRAP * np.rint((near - ticks) / _TICK_WRAP))
        ticks[clock < self._clock] = -1.0  # before this run's first sample
        ticks[:] = np.maximum.accumulate(np.maximum(ticks, self._ticks[node]))
        self._ticks[node] = ticks[-1]
        self._recording.add(self._no_rows, *(self._no_terms | {node: rows}).values())

    def close(self, metadata: dict[str, Any]) -> None:
        """Complete the file; a file with a single row is no run and is removed."""
        if self.rows > 1:
            self._recording.finish(metadata)
        self.abandon()

    def abandon(self, error: BaseException | None = None) -> None:
        """Finish an incomplete file, with the reason; a file with a single row is removed."""
        self._recording.__exit__(type(error) if error else None, error, None)
