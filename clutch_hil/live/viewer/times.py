"""Times of rows on rerun's timelines: `time` (UNIX time, live only), `rig_time` (since the run's start) and `row`."""

from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
import rerun as rr

from protocols.telemetry.batch import Batch

TIME, RIG_TIME, ROW = "time", "rig_time", "row"


@dataclass(frozen=True)
class Times:
    """Times of rows, int64 (n,): `row` numbers, `rig` time [ns since the run's start], `unix` time [ns], None in a replay."""

    row: np.ndarray
    rig: np.ndarray
    unix: np.ndarray | None

    def __len__(self) -> int:
        return len(self.row)

    def __getitem__(self, rows: Any) -> "Times":
        """Return the times of some of the rows, by slice or index array."""
        return Times(self.row[rows], self.rig[rows], None if self.unix is None else self.unix[rows])

    @property
    def monotonic(self) -> np.ndarray:
        """Return time [ns] (n,) that increases even without samples: UNIX time, in a replay the rig's time."""
        return self.rig if self.unix is None else self.unix

    @cached_property
    def indexes(self) -> list[rr.TimeColumn]:
        """Return time columns for rerun, made once for all data logged at these times."""
        indexes = [
            rr.TimeColumn(ROW, sequence=self.row),
            rr.TimeColumn(RIG_TIME, duration=self.rig.astype("timedelta64[ns]")),
        ]
        if self.unix is not None:
            indexes.append(rr.TimeColumn(TIME, timestamp=self.unix.astype("datetime64[ns]")))
        return indexes


def make_times(batch: Batch, live: bool) -> Times:
    """Return the times of a batch's rows. live: with UNIX time. A row with unknown clock gets the epoch plus its rig time."""
    row = np.arange(batch.first_row, batch.end)
    names = {column.name for column in batch.columns}
    tick, clock_name = f"{batch.node}_sample_tick", f"{batch.node}_clock_s"
    if "time_s" in names:
        seconds = batch["time_s"]
    elif tick in names:  # -1 before the first sample; not-a-number in a run file
        seconds = np.nan_to_num(batch[tick], nan=-1.0) / batch.rate
    else:
        seconds = row / batch.rate
    rig = _convert_to_nanoseconds(np.where(np.isfinite(seconds), seconds, row / batch.rate))
    if not live:
        return Times(row, rig, None)
    clock = rig
    if clock_name in names:
        ticking = np.isfinite(batch[clock_name])
        clock = np.where(ticking, _convert_to_nanoseconds(np.where(ticking, batch[clock_name], 0.0)), rig)
    return Times(row, rig, clock + round(batch.epoch * 1e9))


def _convert_to_nanoseconds(seconds: np.ndarray) -> np.ndarray:
    return np.rint(seconds * 1e9).astype(np.int64)
