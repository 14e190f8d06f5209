"""Time axes of a text file: more than one where a tool wrote several tables side by side, each with its own time."""

import re
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from clutch_hil.recordings.channel import Channel, simplify_unit
from clutch_hil.recordings.text.cells import Cells
from clutch_hil.recordings.unit_in_name import is_unit
from protocols.errors import InputError
from protocols.files.arrow import from_texts
from protocols.files.units import have_same_quantity, to_si

_NAMES = ("time", "zeit", "temps", "tempo", "tiempo", "tid")  # with which the name of an axis begins
_NUMBERED = re.compile(r"[ ._]?\d*$")  # what tells columns of one name apart
_SAME = 0.01  # by which two clocks that run alike may differ: more than any real clock does
_FEWEST = 3  # rows that tell


@dataclass(frozen=True)
class Axis:
    """A column of time, by its number from 1, and the seconds in its unit."""

    number: int
    factor: float


def find_axes(channels: Sequence[Channel], samples: Sequence[Sequence[str]], cells: Cells) -> list[Axis]:
    """Axes of time, each for the columns from it to the next; none where all columns have one clock.

    Asked are columns of numbers that are called time, or as the first column, and are in a unit of time. `samples` are cells of
    rows.
    """
    rows = list(dict.fromkeys(map(tuple, samples)))  # the last ones may be among the first
    axes: list[Axis] = []
    first: np.ndarray | None = None
    for channel in channels:
        factor = _find_factor(channel, _NUMBERED.sub("", channels[0].name))
        if not factor:
            continue
        values = factor * cells.parse(from_texts([row[channel.number - 1] for row in rows])).values
        known = values[np.isfinite(values)]
        if len(known) < _FEWEST or not np.all(np.diff(known) > 0.0):
            continue
        if first is None or not _run_alike(first, values):
            axes.append(Axis(channel.number, factor))
        first = values if first is None else first
    return axes if len(axes) > 1 else []


def find_repeated_axes(
    channels: Sequence[Channel], samples: Sequence[Sequence[str]], cells: Cells
) -> list[tuple[Channel, Channel]]:
    """The first column and each later one of its name that rises as it does, and differently: perhaps a table beside another.

    Names count without what numbers them: X, X, and t1, t2. Whether these are times, and in which unit, is not told; where it
    is for both, as of a time in ms and in s, `find_axes` has judged them.
    """
    first = channels[0]
    rows = list(dict.fromkeys(map(tuple, samples)))
    base = _NUMBERED.sub("", first.name)
    if first.kind != "number" or base in ("", "column"):  # which files without names get
        return []
    rising = []
    for channel in channels:
        if channel.kind != "number" or _NUMBERED.sub("", channel.name) != base:
            continue
        values = cells.parse(from_texts([row[channel.number - 1] for row in rows])).values
        known = values[np.isfinite(values)]
        if len(known) >= _FEWEST and np.all(np.diff(known) > 0.0):
            rising.append((channel, values))
    if not rising or rising[0][0] is not first:
        return []
    return [
        (first, channel)
        for channel, values in rising[1:]
        if not _run_alike(rising[0][1], values) and not (is_unit(first.unit) and is_unit(channel.unit))
    ]


def _find_factor(channel: Channel, first: str) -> float:
    """Seconds in the unit of a column that is called time, or as the `first` column, 0 for others."""
    unit = simplify_unit(channel.unit)
    is_named = channel.name.lower().startswith(_NAMES) or (first and _NUMBERED.sub("", channel.name) == first)
    if channel.kind != "number" or not is_named:
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
