"""Tape: one run file of a recording, without a gap. Rows of plant and controller are joined as `clutch-hil up` does."""

from collections import deque
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from clutch_hil.bench.recording import Recording
from protocols.node import Column
from protocols.telemetry.batch import Batch

_PREFIX = "controller_"
_TIE_POINTS = 400  # ends of batches: the history of 30 s comes in 30 batches, later ones at 50 a second
_TICK_WRAP = 1 << 16  # a controller knows the low 16 bits of the plant's tick, and counts on from its first sample


class Tape:
    """Writes a run file: plant rows without a gap from batch `first` on, and the controller's rows of that time.

    plant, controller: columns. recording: class that writes the file.
    """

    def __init__(
        self,
        path: Path,
        first: Batch,
        plant: Sequence[Column],
        controller: Sequence[Column],
        recording: type[Recording] = Recording,
    ) -> None:
        bare = [Column(name.removeprefix(_PREFIX), unit, meaning) for name, unit, meaning in controller]
        self.rows = 0
        self._recording = recording(path, plant, bare, round(first.rate))
        self._session, self._end = first.session, first.first_row
        self._nothing = {"plant": np.empty((0, len(plant))), "controller": np.empty((0, len(controller)))}
        self._tie_points: deque[tuple[float, float]] = deque(maxlen=_TIE_POINTS)  # clock [s], tick of the plant
        self._clock = first["plant_clock_s"][0]
        self._tick = -1.0  # newest sample the controller has answered

    def follows(self, batch: Batch) -> bool:
        """Whether a batch of the plant continues where the last one ended."""
        return (batch.session, batch.first_row) == (self._session, self._end)

    def add_plant(self, batch: Batch) -> None:
        """Add the plant's next rows."""
        self._tie_points.extend((batch["plant_clock_s"][k], batch["time_s"][k] * batch.rate) for k in (0, -1))
        self._recording.add(batch.rows, self._nothing["controller"])
        self._end = batch.end
        self.rows += len(batch.rows)

    def add_controller(self, batch: Batch) -> None:
        """Add rows of the controller. Their ticks are converted to the plant's, and do not decrease after a restart."""
        rows = batch.rows.copy()
        ticks = rows[:, [column.name for column in batch.columns].index("controller_sample_tick")]  # a view
        clock = batch["controller_clock_s"]
        near = np.interp(clock, *np.array(self._tie_points).T)
        ticks += np.where(ticks < 0.0, 0.0, _TICK_WRAP * np.rint((near - ticks) / _TICK_WRAP))
        ticks[clock < self._clock] = -1.0  # before this run's first sample
        ticks[:] = np.maximum.accumulate(np.maximum(ticks, self._tick))
        self._tick = ticks[-1]
        self._recording.add(self._nothing["plant"], rows)

    def close(self, metadata: dict[str, Any]) -> None:
        """Complete the file; a file with a single row is no run and is removed."""
        if self.rows > 1:
            self._recording.finish(metadata)
        self.abandon()

    def abandon(self) -> None:
        """Remove a file that is not complete."""
        self._recording.__exit__(None, None, None)
