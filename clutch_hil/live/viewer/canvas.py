"""Canvas: a rerun recording below an entity prefix, to which the parts of a screen draw."""

from collections.abc import Iterable
from typing import Any

import numpy as np
import rerun as rr
from rerun.components import ScalarBatch

from clutch_hil.live.viewer.times import Times


class Canvas:
    """`recording` below `prefix` ("" or "/a")."""

    def __init__(self, recording: rr.RecordingStream, prefix: str = "") -> None:
        self._recording = recording
        self._prefix = prefix.rstrip("/")

    def log_static(self, path: str, *archetypes: Any) -> None:
        """Log archetypes that do not depend on time."""
        self._recording.log(f"{self._prefix}/{path}", *archetypes, static=True)

    def send(self, path: str, times: Times, columns: Iterable[Any]) -> None:
        """Log component columns, one cell per time. Without times nothing is logged: an empty chunk kills rerun 0.41."""
        if len(times):
            self._recording.send_columns(f"{self._prefix}/{path}", times.indexes, columns)


def make_scalar_columns(values: np.ndarray) -> list[rr.ComponentColumn]:
    """Return a component column of `values` (rows, lines), one scalar per line; `rr.Scalars.columns` takes twice as long."""
    lengths = np.full(len(values), values.shape[1])
    return [rr.ComponentColumn(rr.Scalars.descriptor_scalars(), ScalarBatch(values.ravel()), lengths=lengths)]
