"""Canvas: a rerun recording under an entity prefix; what the parts of a screen draw on."""

from collections.abc import Iterable
from typing import Any

import numpy as np
import rerun as rr
from rerun.components import ScalarBatch

from clutch_hil.live.times import Times


class Canvas:
    """`recording` below `prefix` ("" or "/a")."""

    def __init__(self, recording: rr.RecordingStream, prefix: str = "") -> None:
        self._recording = recording
        self._prefix = prefix.rstrip("/")

    def static(self, path: str, *archetypes: Any) -> None:
        """Log what has no time."""
        self._recording.log(f"{self._prefix}/{path}", *archetypes, static=True)

    def send(self, path: str, times: Times, columns: Iterable[Any]) -> None:
        """Log component columns, one cell a time. Of no time nothing: an empty chunk kills the viewer (rerun 0.41)."""
        if len(times):
            self._recording.send_columns(f"{self._prefix}/{path}", times.indexes, columns)


def wide(values: np.ndarray) -> list[rr.ComponentColumn]:
    """Scalars of several lines at once; `values`, shape (rows, lines). `rr.Scalars.columns` does the same in twice the time."""
    lengths = np.full(len(values), values.shape[1])
    return [rr.ComponentColumn(rr.Scalars.descriptor_scalars(), ScalarBatch(values.ravel()), lengths=lengths)]
