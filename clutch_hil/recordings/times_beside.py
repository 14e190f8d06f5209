"""Times beside a column: which channel of a file has the times of a column, where time_s has those of another one.

In its group, as `slow/time` for `slow/speed`. By its name, as `speed_time` for `speed`, where time_s is `torque_time`: so
FAMOS and DEWESoft write. In the first column of its matrix, where time_s is that of another one: so CANape writes. In a vector
of as many rows that is called a time, where time_s is that of a structure: so Simulink writes `tout` beside a scope.
"""

import re
from collections.abc import Mapping, Sequence

import numpy as np

from clutch_hil.recordings.channel import Channel, Signal, is_time_name

_TIME = r"(?:time|zeit|t)"
# The part of a name that says that it is a time: `time_speed`, `Data1_time_speed`, `speed_time`, `speedTime`
_PART = re.compile(rf"(?i:(?<![^\W_]){_TIME}[\W_]+)|(?i:[\W_]+{_TIME}$)|(?<=[a-z0-9])Time$")
_OF_MATRIX = re.compile(r"(?P<matrix>.+)\((?::,(?P<column>[0-9]+)|(?P<row>[0-9]+),:)\)")  # path of a vector in a matrix


def find_times_beside(channels: Sequence[Channel], sources: Mapping[str, Channel]) -> dict[str, Channel]:
    """Return the channel with the times of each column for which it is another one than that of time_s."""
    clock = sources.get("time_s")
    if not clock:
        return {}
    others = {name: channel for name, channel in sources.items() if name != "time_s"}
    if clock.kind != "number":
        return _find_on_raster(channels, clock, others)
    if times := _find_by_name(channels, clock, others):
        return times
    return (_find_in_group if is_time_name(clock.name) else _find_in_matrix)(channels, clock, others)


def keep_rising(times: Mapping[str, Signal]) -> dict[str, Signal]:
    """Return the times without the first columns of matrices that do not rise: these are no times."""
    return {
        name: signal
        for name, signal in times.items()
        if not _OF_MATRIX.fullmatch(signal.channel.path) or np.all(np.diff(signal.values) > 0.0)
    }


def _find_on_raster(channels: Sequence[Channel], clock: Channel, others: Mapping[str, Channel]) -> dict[str, Channel]:
    """Return the only channel of the same raster that is called a time, for columns without a time axis of their own."""
    with_axis = {channel.raster for channel in channels if channel.kind == "time"} | {clock.raster}
    times = {}
    for name, channel in others.items():
        named = [one for one in channels if one.raster == channel.raster and _is_time_vector(one)]
        if channel.raster not in with_axis and len(named) == 1:
            times[name] = named[0]
    return times


def _is_time_vector(channel: Channel) -> bool:
    return channel.kind == "number" and is_time_name(channel.name)


def _find_in_group(channels: Sequence[Channel], clock: Channel, others: Mapping[str, Channel]) -> dict[str, Channel]:
    named = [one for one in channels if one.name == clock.name and one.kind == "number"]
    times = {}
    for name, channel in others.items():
        groups = [one for one in named if channel.path.startswith(_find_group(one))]
        if not groups and channel.raster != clock.raster:  # a path has no group where the name is unique
            groups = [one for one in named if one.raster == channel.raster]
        nearest = max(groups, key=lambda one: len(_find_group(one)), default=clock)
        if _find_group(nearest) != _find_group(clock) and nearest.rows == channel.rows:
            times[name] = nearest
    return times


def _find_group(channel: Channel) -> str:
    """Return the part of a path before the name, as `fast/` in `fast/time` and `fast/time [ms]`."""
    return channel.path.rpartition(channel.name)[0]


def _find_by_name(channels: Sequence[Channel], clock: Channel, others: Mapping[str, Channel]) -> dict[str, Channel]:
    names = {channel.name for channel in channels}
    if _remove_time(clock.name) not in names:
        return {}
    by_name = {_remove_time(one.name): one for one in channels if one.kind == "number" and _remove_time(one.name)}
    found = {name: by_name[channel.name] for name, channel in others.items() if channel.name in by_name}
    return {name: one for name, one in found.items() if one != clock and one.rows == others[name].rows}


def _remove_time(name: str) -> str:
    """Return a name without the part that says that it is a time, "" if it has none."""
    rest, count = _PART.subn("", name, count=1)
    return rest if count else ""


def _find_in_matrix(channels: Sequence[Channel], clock: Channel, others: Mapping[str, Channel]) -> dict[str, Channel]:
    own = _OF_MATRIX.fullmatch(clock.path)
    if not own or (own["column"] or own["row"]) != "1":
        return {}
    by_path = {channel.path: channel for channel in channels}
    times = {}
    for name, channel in others.items():
        place = _OF_MATRIX.fullmatch(channel.path)
        if place and place["matrix"] != own["matrix"] and (place["column"] or place["row"]) != "1":
            first = by_path.get(f"{place['matrix']}({'1,:' if place['row'] else ':,1'})")
            if first and first.rows == channel.rows:
                times[name] = first
    return times
