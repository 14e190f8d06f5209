"""Lanes: states over time as words: phase, clutch state and fault of a controller."""

from collections.abc import Mapping
from itertools import pairwise
from typing import NamedTuple

import numpy as np

from clutch_hil.bench import clutch_state
from protocols.can.frames import load_frames


class Lane(NamedTuple):
    """A column of the controller, and the word for each of its values."""

    name: str
    column: str  # without the node's prefix
    words: Mapping[int, str]

    def find_word(self, value: float) -> str:
        """Return the word for a value; its number where it has none."""
        return self.words.get(int(value), f"{value:g}")


class Stretch(NamedTuple):
    """Samples `begin` to `end`, `end` excluded, with the same `value`."""

    begin: int
    end: int
    value: float


def list_lanes() -> tuple[Lane, ...]:
    """Return the lanes of phase, clutch state and fault, with the words of the DBC."""
    status = load_frames()["CONTROLLER_STATUS"]
    return (
        Lane("phase", "phase", status.list_choices("phase")),
        Lane("clutch", "clutch_state", dict(enumerate(clutch_state.STATES))),
        Lane("fault", "fault", status.list_choices("fault")),
    )


def find_stretches(values: np.ndarray) -> list[Stretch]:
    """Return stretches of equal values in `values`, shape (samples,). NaN belongs to no stretch."""
    changes = np.flatnonzero(np.diff(values) != 0.0) + 1  # NaN differs from NaN
    edges = [0, *changes.tolist(), len(values)]
    spans = [Stretch(begin, end, float(values[begin])) for begin, end in pairwise(edges)]
    return [stretch for stretch in spans if np.isfinite(stretch.value)]
