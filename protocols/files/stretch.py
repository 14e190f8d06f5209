"""Stretch: a part of a run, from one time to another."""

from dataclasses import dataclass
from math import inf, isinf, isnan

import numpy as np

from protocols.errors import InputError, name_run

_TOLERANCE = 0.01  # of a time step: times are decimal, so rounding may move a row beyond the end


@dataclass(frozen=True)
class Stretch:
    """The rows of a run from `from_s` to `to_s` [s], both ends included. Raises InputError for an empty range."""

    from_s: float = -inf
    to_s: float = inf

    def __post_init__(self) -> None:
        if isnan(self.from_s) or isnan(self.to_s) or self.from_s >= self.to_s:
            raise InputError(
                f"the part from {self.from_s:g} to {self.to_s:g} s is not possible; it must end after it begins"
            )

    @property
    def is_whole(self) -> bool:
        """Whether the range is unlimited, so that it includes every run completely."""
        return isinf(self.from_s) and isinf(self.to_s)

    def find_rows(self, run: str, time: np.ndarray) -> slice:
        """Return the rows of `run` in the range, from their times (n,) [s]. Raises InputError if there are none."""
        near = _TOLERANCE * float(np.min(np.abs(np.diff(time)))) if len(time) > 1 else 0.0
        rows = np.flatnonzero((time >= self.from_s - near) & (time <= self.to_s + near))
        if not len(rows):
            first, last = (f"{one:.6g}" for one in (np.min(time), np.max(time))) if len(time) else ("-", "-")
            raise InputError(
                f"{name_run(run)} has no row from {self.from_s:g} to {self.to_s:g} s; its rows are at {first} to {last} s"
            )
        return slice(int(rows[0]), int(rows[-1]) + 1)


WHOLE = Stretch()
