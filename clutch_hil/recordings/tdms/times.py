"""Times of a TDMS channel, from what its properties say: a start, an offset and an increment, anew for each acquisition."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from datetime import datetime, timedelta
from itertools import pairwise
from math import isfinite, nan
from typing import TYPE_CHECKING, Any

import numpy as np

from clutch_hil.recordings.channel import simplify_unit
from protocols.errors import InputError
from protocols.files.units import have_same_quantity, to_si

if TYPE_CHECKING:
    from nptdms import TdmsChannel

_EPOCH = datetime(1904, 1, 1)  # of LabVIEW, UTC
FRACTION = 2.0**-64  # s, of LabVIEW's clock
TIMING = ("wf_start_time", "wf_start_offset", "wf_increment", "wf_xunit_string")  # properties with a channel's times
_SAME_STEP = 0.5  # of an increment: a segment that begins so near the end of the one before goes on with it


@dataclass(frozen=True)
class Timing:
    """Times of a channel: `start` [s] since 1904, None where it has none, and from there `offset` + k `increment` [s].

    k counts from the channel's row `row`.
    """

    start: tuple[int, int] | None
    offset: float
    increment: float
    row: int = 0

    def __str__(self) -> str:
        begin = f"{self.offset:.9g} s" if self.start is None else format_moment(self.start, self.offset)
        return f"at {begin or self.start} with an increment of {self.increment:.9g} s"


@dataclass(frozen=True)
class Statement:
    """What a segment says about the times of a channel that has `row` rows before. segment: its number, from 1."""

    segment: int
    row: int
    properties: tuple[Any, ...]


@dataclass(frozen=True)
class Times:
    """Times of a channel: pieces, each from its row on; none where it has no times. fault: why they are not known, or ""."""

    pieces: tuple[Timing, ...] = ()
    fault: str = ""

    def __bool__(self) -> bool:
        return bool(self.pieces or self.fault)


def read_times(channel: "TdmsChannel", statements: Sequence[Statement], notes: list[str]) -> Times:
    """Times of a channel, piece by piece where an acquisition was appended to another one.

    A segment that goes on with the one before belongs to its piece. What is said after all rows is about all of them.
    """
    last = _read_timing(channel, tuple(map(channel.properties.get, TIMING)), notes)
    if last is None:
        return Times()
    timings: list[tuple[int, Timing]] = []  # each after the number of its segment
    for statement in statements:
        timing = _read_timing(channel, statement.properties, [])
        if timing is None:  # not all is said yet
            continue
        if timings and timings[-1][1].row == statement.row:  # no row came between
            timings.pop()
        segment, before = timings[-1] if timings else (statement.segment, replace(timing, row=0))
        if before.start is None and _are_same(before, replace(timing, start=None)):
            timings[-1:] = [(segment, replace(timing, row=before.row))]  # only the start was not known yet
        elif not timings or not _are_same(before, timing):
            timings.append((statement.segment, replace(timing, row=statement.row if timings else 0)))
    if len(timings) == 2 and timings[-1][1].row >= len(channel):
        return Times((last,))
    pieces = [timing for _, timing in timings[:1]]
    for (number, before), (segment, timing) in pairwise(timings):
        late = _count_steps_late(before, timing)
        if not late >= -_SAME_STEP or timing.row >= len(channel):
            return Times(fault=f"begins {before} in segment {number}, and {timing} in segment {segment}")
        if late > _SAME_STEP or timing.increment != before.increment:
            pieces.append(timing)
    return Times(tuple(pieces))


def _read_timing(channel: "TdmsChannel", properties: tuple[Any, ...], notes: list[str]) -> Timing | None:
    """What `properties`, in the order of `TIMING`, say about times; None where they say none."""
    start, offset, increment, unit_text = properties
    offset = 0.0 if offset is None else offset
    if not is_number(increment) or not is_number(offset) or not increment > 0.0 or len(channel) == 0:
        return None
    unit = simplify_unit(str("" if unit_text is None else unit_text)) or "s"
    try:
        if not have_same_quantity(unit, "s"):
            notes.append(f"{channel.group_name}/{channel.name} is recorded over {unit}, which gives no time")
            return None
        factor = to_si(1.0, unit)
    except InputError:
        notes.append(f"{channel.group_name}/{channel.name} is recorded over the unknown unit {unit!r}; no time")
        return None
    known = start is not None and hasattr(start, "second_fractions") and start.seconds > 0
    return Timing((start.seconds, start.second_fractions) if known else None, factor * offset, factor * increment)


def _are_same(one: Timing, other: Timing) -> bool:
    """Whether two timings differ in the row alone."""
    return replace(one, row=other.row) == other


def _count_steps_late(before: Timing, timing: Timing) -> float:
    """Increments from the end of the rows of `before` to the begin of `timing`; not a number where only one has a start."""
    if (before.start is None) != (timing.start is None):
        return nan
    between = count_seconds_between(before.start, timing.start) if before.start and timing.start else 0.0
    return (between + timing.offset - before.offset) / before.increment - (timing.row - before.row)


def format_moment(start: tuple[int, int], offset: float = 0.0) -> str:
    """A time of LabVIEW's clock as ISO 8601; "" where it is no date."""
    try:
        moment = _EPOCH + timedelta(seconds=start[0] + start[1] * FRACTION) + timedelta(seconds=offset)
    except OverflowError:
        return ""
    return f"{moment.isoformat()}+00:00"


def count_seconds_between(first: tuple[int, int], second: tuple[int, int]) -> float:
    return (second[0] - first[0]) + (second[1] - first[1]) * FRACTION


def is_number(value: object) -> bool:
    return isinstance(value, int | float | np.integer | np.floating) and not isinstance(value, bool) and isfinite(value)
