"""Time axes of a text file: more than one where a tool wrote several tables side by side, each with its own time."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import pyarrow as pa

from clutch_hil.recordings.channel import Channel, simplify_unit
from clutch_hil.recordings.text.cells import Cells
from protocols.errors import InputError
from protocols.files.units import have_same_quantity, to_si

_NAMES = ("time", "zeit", "temps", "tempo", "tiempo", "tid")  # with which the name of an axis begins
_SAME = 0.01  # by which two clocks that run alike may differ: more than any real clock does
_FEWEST = 3  # rows that tell


@dataclass(frozen=True)
class Axis:
    """A column of time, by its number from 1, and the seconds in its unit."""

    number: int
    factor: float


def find_axes(channels: Sequence[Channel], samples: Sequence[Sequence[str]], cells: Cells) -> list[Axis]:
    """Axes of time, each for the columns from it to the next; none where all columns have one clock.

    Asked are columns of numbers that are called time and are in a unit of time. `samples` are cells of rows.
    """
    rows = list(dict.fromkeys(map(tuple, samples)))  # the last ones may be among the first
    axes: list[Axis] = []
    first: np.ndarray | None = None
    for channel in channels:
        factor = _find_factor(channel)
        if not factor:
            continue
        values = factor * cells.parse(pa.array([row[channel.number - 1] for row in rows])).values
        known = values[np.isfinite(values)]
        if len(known) < _FEWEST or not np.all(np.diff(known) > 0.0):
            continue
        if first is None or not _run_alike(first, values):
            axes.append(Axis(channel.number, factor))
        first = values if first is None else first
    return axes if len(axes) > 1 else []


def _find_factor(channel: Channel) -> float:
    """Seconds in the unit of a column that is called time, 0 for others."""
    unit = simplify_unit(channel.unit)
    if channel.kind != "number" or not channel.name.lower().startswith(_NAMES):
        return 0.0
    try:
        return to_si(1.0, unit) if have_same_quantity(unit, "s") else 0.0
    except InputError:
        return 0.0


def _run_alike(one: np.ndarray, other: np.ndarray) -> bool:
    """Whether two columns of times (n,) [s] pass the same time from row to row."""
    both = np.isfinite(one) & np.isfinite(other)
    if np.count_nonzero(both) < _FEWEST:
        return False
    (first, second), (third, fourth) = (values[both][[0, -1]] for values in (one, other))
    return bool(abs((fourth - third) / (second - first) - 1.0) < _SAME)
