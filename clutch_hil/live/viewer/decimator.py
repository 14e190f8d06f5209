"""Decimator: select a few rows per second for drawing."""

import numpy as np

from clutch_hil.live.viewer.times import Times


class Decimator:
    """Select the first row of each period; `rate` [Hz]."""

    def __init__(self, rate: float) -> None:
        self._period = round(1e9 / rate)  # ns
        self._slot: int | None = None

    def pick(self, times: Times) -> np.ndarray:
        """Return the indices of the rows to show, shape (picked,)."""
        slots = times.monotonic // self._period
        before = np.concatenate([[slots[0] - 1 if self._slot is None else self._slot], slots[:-1]])
        self._slot = int(slots[-1])
        return np.flatnonzero(slots != before)
