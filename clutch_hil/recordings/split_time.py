"""Split times: whole seconds in one column and their fraction in another, as `ts_sec, ts_usec` of C and `secs, nsecs` of ROS.

Beside a date and a time of day, too, as in `Date, Time, ms`. A column that is called as a fraction may count from the start of
the recording, or be something else: it is one only where all its numbers are below a second, and begin anew with it.
"""

import re
from collections.abc import Sequence
from contextlib import suppress
from dataclasses import replace

import numpy as np

from clutch_hil.recordings.channel import Channel, Recording, Signal, simplify_unit
from protocols.errors import InputError

# End of a name, unit -> parts of a second
_PARTS = {
    (r"ms(ec)?s?|milli(s|second|sec|sekunde|seconde|tm)?[sn]?", "ms"): 1e3,
    (r"[uµμ]s(ec)?s?|micro(s|second|sec|sekunde|seconde)?[sn]?", "us"): 1e6,
    (r"ns(ec)?s?|nano(s|second|sec|sekunde|seconde)?[sn]?", "ns"): 1e9,
    (r"fraction|frac|sub_?sec(ond)?s?", "s"): 1.0,
}
_SECONDS = re.compile(r"(?:.*[\W_])?s(?:ec(?:ond)?s?)?", re.IGNORECASE)
_PATTERNS = [
    (re.compile(rf"(?:(?P<stem>.*?)[\W_]+)?(?:{name})", re.IGNORECASE), unit, parts)
    for (name, unit), parts in _PARTS.items()
]


def find_fraction(channels: Sequence[Channel], seconds: Signal | None, unit: str) -> tuple[Channel, float] | None:
    """Return the channel that may have the fractions of whole `seconds`, and its parts of a second; None if there is none.

    It is the first one behind the seconds, else before them, in their raster, that is called so. unit: by the map.
    """
    clock = seconds.channel if seconds else None
    if not seconds or not clock or not clock.number or {simplify_unit(clock.unit), unit} - {"", "s"}:
        return None
    if not np.isfinite(seconds.values).all() or np.any(seconds.values != np.rint(seconds.values)):
        return None
    beside = [one for one in channels if one.raster == clock.raster and one.number != clock.number]
    others = [one for one in beside if one.kind in ("number", "status")]
    others.sort(key=lambda one: one.number < clock.number)  # HDF5 has them in the order of their names
    for channel in others:
        for pattern, own, parts in _PATTERNS:
            match = pattern.fullmatch(channel.name)
            of_clock = match and clock.name.lower().startswith((match["stem"] or "").lower())  # not `speed_ms`, in m/s
            if of_clock and simplify_unit(channel.unit).replace("µ", "u") in ("", own):
                return channel, parts
    return None


def find_seconds(recording: Recording, channels: Sequence[Channel]) -> Channel | None:
    """Return the first of `channels` that is called as seconds, is whole, and has its fractions in another; None for none."""
    named = [channel for channel in channels if channel.kind == "number" and _SECONDS.fullmatch(channel.name)]
    for channel in named:
        with suppress(InputError):  # words in one of them
            (seconds,) = recording.read([channel])
            split = find_fraction(channels, seconds, "s")
            if split and _belong_together(seconds.values, recording.read([split[0]])[0].values, split[1]):
                return channel
    return None


def join_fraction(seconds: Signal, fraction: Signal, parts: float, notes: list[str]) -> Signal:
    """Return times with the fractions of their seconds, or without where these are none. A note tells it."""
    first, second = seconds.values, fraction.values
    beside = fraction.channel.number == seconds.channel.number + 1
    if not _belong_together(first, second, parts) or not (beside or np.any(np.diff(first) == 0.0)):
        return seconds
    notes.append(
        f"{seconds.channel.path}: with the fractions of its seconds in {fraction.channel.path!r}, 1/{parts:g} s"
    )
    begin = second[0] if seconds.channel.kind == "time" else 0.0  # times of day are counted from the first one
    return replace(seconds, values=first + (second - begin) / parts, whole=None)


def _belong_together(seconds: np.ndarray, fraction: np.ndarray, parts: float) -> bool:
    if len(seconds) != len(fraction) or not np.isfinite(fraction).all():
        return False
    if np.any((fraction < 0.0) | (fraction >= parts)):
        return False
    if parts > 1.0 and np.any(fraction != np.rint(fraction)):
        return False
    steps, rises = np.diff(seconds), np.diff(fraction) > 0.0
    from_start = rises.all() and np.any(steps)  # it goes on where a second begins
    return not from_start and bool(rises.any())
