"""Contents of a recording for the user: a table of its channels, and a draft of an import map."""

import re
from collections.abc import Sequence
from contextlib import suppress
from math import isfinite
from pathlib import Path
from unicodedata import combining, normalize

import numpy as np

from clutch_hil.recordings.channel import NO_VALUES, TIME_NAMES, Channel, Recording, name_first, simplify_unit
from clutch_hil.recordings.foreign_column import UNITS, can_become, is_absolute, offset_air
from clutch_hil.recordings.split_time import find_seconds
from clutch_hil.recordings.stated_rate import list_stated_rates
from clutch_hil.recordings.text.arrival import ARRIVAL
from clutch_hil.recordings.time_axis import EPOCH_S
from clutch_hil.recordings.unit_in_name import hint_unit, is_known
from protocols.errors import InputError
from protocols.files.runs import REQUIRED
from protocols.files.units import contradict

_DEVICE = re.compile(r"\\[^\\/]*:\d+$")  # behind a name of INCA: `torque\ETKC:1`
_MOST_TRIED = 20  # channels that are read to find one that rises as a time
_NO_UNIT = "  # the file states no known unit: set unit, and the ending of the name"
_LONGEST_NAME = 60  # characters of a column's name in a draft
_MOST_TEXTS = 100  # channels of text that a draft reads to see whether they are numbers
_VALVE, _MOST_CURRENTS = "valve_voltage_v", 5


def list_contents(recording: Recording) -> list[tuple[str, ...]]:
    """Return the rows of a table of channels, header first, without columns that are empty for all channels."""
    header = ("number", "name", "path", "unit", "kind", "rows", "rate [Hz]", "from [s]", "to [s]", "raster")
    rows = [_make_row(channel) for channel in recording.channels]
    filled = [k for k in range(len(header)) if k < 2 or any(row[k] != "-" for row in rows)]
    return [tuple(row[k] for k in filled) for row in (header, *rows)]


def _make_row(c: Channel) -> tuple[str, ...]:
    numbers = (_format_number(value, digits) for value, digits in ((c.rate_hz, 6), (c.start_s, 6), (c.end_s, 6)))
    path = c.path if c.path != c.name else "-"
    return (str(c.number), c.name or "-", path, c.unit or "-", c.kind, str(c.rows), *numbers, c.raster or "-")


def _format_number(value: float, digits: int) -> str:
    return f"{value:.{digits}g}" if isfinite(value) else "-"


def make_document(recording: Recording) -> dict:
    """Return the contents as a JSON document."""
    channels = [
        {
            "number": c.number, "name": c.name, "path": c.path, "unit": c.unit, "kind": c.kind, "rows": c.rows,
            "rate_hz": c.rate_hz, "start_s": c.start_s, "end_s": c.end_s, "raster": c.raster, "comment": c.comment,
        }
        for c in recording.channels
    ]  # fmt: skip
    return {
        "channels": channels, "numbers": dict(recording.numbers), "notes": list(recording.notes), "start": recording.start,
    }  # fmt: skip


def draft_map(file: Path, recording: Recording, options: Sequence[tuple[str, object]] = ()) -> str:
    """Return the draft of an import map with all numeric channels. options: entries of [file] to keep.

    Raises InputError if there are fewer than two such channels, or one if the file states its rate.
    """
    empty = [channel for channel in recording.channels if channel.comment == NO_VALUES]
    usable = [channel for channel in _convert_texts(recording) if channel.kind != "text" and channel not in empty]
    timed = any(channel.kind == "time" for channel in usable)
    seconds = None if timed else find_seconds(recording, usable[:_MOST_TRIED])
    clock = seconds or _find_clock(usable) or _find_rising(usable, recording, True)
    stated = list_stated_rates(recording.numbers, usable)
    if len(usable) < (1 if stated else 2):
        raise InputError(
            f"recording {file} has no two columns of numbers to map; list it with: clutch-hil import --list"
        )
    rasters = {channel.raster for channel in usable}
    lines = [
        f"# Draft of an import map for {_format_comment(file.name)}.",
        "# Keep the columns that you need, and give them the names that your rig uses (docs/rig.md).",
        "# The ending of a name is its unit; the unit in the file is converted to it.",
        'notes = "where the data come from"',
        "",
        "[file]",
        *(f"{key} = {_format_toml(value)}" for key, value in options),
        *(["# sample times differ: choose a common rate", "resample_hz = 100.0"] if len(rasters) > 1 else []),
        "",
        "[columns]",
        _draft_time(clock, recording),
    ]
    names = {"time_s"}
    for channel in usable:
        if clock and (channel is clock or (channel.kind == "time" and channel.raster != clock.raster)):
            continue
        hinted = _take_hint(channel)
        unit = simplify_unit(channel.unit or hinted)
        turns = _counts_turns(unit)
        end = "rad_s" if turns else _find_ending(unit)
        stem = hint_unit(channel.name)[0] if hinted else channel.name
        name = _choose_unused_name(_simplify_name(stem), end or "1", names)
        names.add(name)
        entry = _make_reference(channel, recording)
        entry += ', unit = "rpm"' if turns else _make_unit_entry(channel, hinted or "1")
        remark = "  # unit taken from its name" if hinted else "" if end else _NO_UNIT
        if not end and unit not in ("", "1") and is_known(unit):
            entry = f'{_make_reference(channel, recording)}, unit = "1", unit_from = "map"'
            remark = (
                f"  # in {_format_comment(channel.unit or hinted)}, for which no ending of a name exists: its numbers"
            )
        if turns:
            written = _format_comment(channel.unit or hinted)
            remark = f"  # {written} in the file: turns, perhaps; else name it _hz, without unit"
        if end == "bar" and is_absolute(channel):
            entry += f", offset = {offset_air(unit):.5g}"
            remark = "  # absolute, by its name or unit: the offset subtracts the air pressure"
        lines.append(f"{name} = {{ {entry} }}{remark}")
    if empty:
        lines.append(f"# left out, with {NO_VALUES}: {name_first([_format_comment(c.path) for c in empty])}")
    if missing := [name for name in REQUIRED if name not in names]:
        lines += [
            "",
            "# A run of a wet clutch (docs/rig.md) also has the columns below: give yours these names.",
            f"# {', '.join(missing)}",
            '# What was not measured may be left out, constant = 0.0 or formula = "..." (docs/identify.md, A missing sensor).',
            *(_draft_valve(usable, recording) if _VALVE in missing else []),
        ]
    return "\n".join([*lines, ""])


def _convert_texts(recording: Recording) -> list[Channel]:
    """Return the channels; those of text whose values are numbers, times or flags as text are of that kind."""
    channels, left = [], _MOST_TEXTS
    for channel in recording.channels:
        if channel.kind == "text" and left:
            left -= 1
            with suppress(InputError):  # words
                channel = recording.read([channel])[0].channel
        channels.append(channel)
    return channels


def _draft_valve(channels: Sequence[Channel], recording: Recording) -> list[str]:
    """Return a line for each current channel: the current of a valve can replace its voltage."""
    currents = [
        channel for channel in channels if _find_ending(simplify_unit(channel.unit or _take_hint(channel))) == "a"
    ]
    return [
        f'# {_VALVE} = {{ {_make_reference(c, recording)}, unit = "V", unit_from = "map", scale = }}  # a valve current'
        f" can replace the voltage: scale is in V per {simplify_unit(c.unit or _take_hint(c))} (docs/identify.md)"
        for c in currents[:_MOST_CURRENTS]
    ]


def _draft_time(clock: Channel | None, recording: Recording) -> str:
    """Return the line of time_s from `clock`, or a comment to be completed if no column has the name or unit of a time.

    Whole numbers with steps of one and more and no unit in the file are more likely ms than s: the user decides.
    """
    if clock is None:
        if stated := list_stated_rates(recording.numbers, recording.channels)[:1]:
            other = _find_rising(recording.channels, recording)
            remark = f"by the file, {_format_comment(str(stated[0]))}: check this"
            remark += f", as {_format_comment(other.name)} rises otherwise" if other else ""
            return f"{'# ' if other else ''}time_s = {{ rate_hz = {stated[0].rates[0]:.12g} }}  # {remark}"
        tried = (_find_rising([channel], recording) for channel in recording.channels[:_MOST_TRIED])
        if rising := next(filter(None, tried), None):
            return (
                f'# time_s = {{ {_make_reference(rising, recording)}, unit = "s" }}  # no column has the name or unit of a'
                " time; this one rises: set its unit, name another, or set rate_hz"
            )
        return (
            '# time_s = { from = "", unit = "s" }  # no column has the name or unit of a time: name one, or set rate_hz'
        )
    hinted = _take_hint(clock)
    entry = _make_unit_entry(clock, hinted or "s")
    if entry and not hinted and (step := _find_whole_step(clock, recording)):
        return (
            f'# time_s = {{ {_make_reference(clock, recording)}, unit = "ms" }}  # rises by {step:g} a row, and the file states'
            " no unit: set ms, us or s, or rate_hz where it counts rows"
        )
    remark = f"  # the file states no unit of time: check that it is {hinted or 's'}" if entry else ""
    return f"time_s = {{ {_make_reference(clock, recording)}{entry} }}{remark}"


def _find_whole_step(clock: Channel, recording: Recording) -> float:
    """Return the median step of a time in whole numbers if it is 1 or more; 0.0 for others, and for seconds since 1970."""
    values = recording.read([clock])[0].values
    if len(values) < 2 or not np.isfinite(values).all() or values[0] > EPOCH_S or np.any(values != np.rint(values)):
        return 0.0
    step = float(np.median(np.diff(values)))
    return step if step >= 1.0 else 0.0


def _take_hint(channel: Channel) -> str:
    """Return the unit at the end of a channel's name where the file states none, else ""."""
    return "" if simplify_unit(channel.unit) else hint_unit(channel.name)[1]


def _find_clock(channels: Sequence[Channel]) -> Channel | None:
    """Return the channel that is most likely the time: a time axis, or by name, or by unit; None if there is none."""
    tests = (
        lambda c: c.kind == "time" and c.name != ARRIVAL,  # which is late, and uneven, beside a time of the sender
        lambda c: {hint_unit(c.name)[0].lower(), _simplify_name(hint_unit(c.name)[0])} & {*TIME_NAMES},
        lambda c: _simplify_name(c.name).removesuffix("_s") in TIME_NAMES,
        lambda c: _simplify_name(c.name).startswith("time"),
        lambda c: _find_ending(simplify_unit(c.unit or _take_hint(c))) == "s" and c.name != ARRIVAL,
        lambda c: c.kind == "time",
    )
    return next((channel for test in tests for channel in channels if test(channel) and not _is_other(channel)), None)


def _is_other(channel: Channel) -> bool:
    """Return whether a channel that is called as a time is something else: its unit is, or T, a torque or a temperature."""
    ending = _find_ending(simplify_unit(channel.unit or _take_hint(channel)))
    return channel.kind != "time" and (ending not in ("", "s") or (not ending and hint_unit(channel.name)[0] == "T"))


def _find_rising(channels: Sequence[Channel], recording: Recording, as_stated: bool = False) -> Channel | None:
    """Return the first channel if it rises as a time, and not as a number of the row; if `as_stated`, at a rate that the file
    states."""
    first = next(iter(channels), None)
    if not first or first.kind != "number" or simplify_unit(first.unit):
        return None
    values = recording.read([first])[0].values
    steps = np.diff(values) if np.isfinite(values).all() else np.zeros(0)
    if not len(steps) or not np.all(steps > 0.0) or np.all(steps == 1.0):
        return None
    rates = list_stated_rates(recording.numbers, [first]) if as_stated else []
    return first if not as_stated or any(one.agrees(1.0 / float(np.median(steps))) for one in rates) else None


def _make_unit_entry(channel: Channel, otherwise: str) -> str:
    known = _find_ending(simplify_unit(channel.unit))
    return "" if known else f', unit = "{otherwise}"'


def _make_reference(channel: Channel, recording: Recording) -> str:
    shared = sum(other.name == channel.name for other in recording.channels)
    if channel.path and sum(other.path == channel.path for other in recording.channels) == 1:
        return f"from = {_format_toml(channel.path if shared > 1 else channel.name)}"
    return f"number = {channel.number}"


def _find_ending(unit: str) -> str:
    """Return the end of a column's name in a run for `unit`; "" if there is none."""
    if not unit:
        return ""
    for end, own in UNITS.items():
        try:
            if can_become(unit, own):
                return end
        except InputError:
            return ""
    return ""


def _counts_turns(unit: str) -> bool:
    """Return whether `unit` is 1/min in any notation, in which DIN and ISO give speeds of rotation."""
    return bool(unit) and is_known(unit) and not contradict(unit, "1/min")


def _simplify_name(name: str) -> str:
    last = _DEVICE.sub("", name).replace("\\", "/").rstrip("/").rsplit("/", 1)[-1]
    plain = [c for c in normalize("NFKD", last.lower().replace("ß", "ss")) if not combining(c)]  # removes accents
    words = "".join(c if c.isascii() and c.isalnum() else " " for c in plain).split()
    return "_".join(words)[:_LONGEST_NAME] or "column"


def _choose_unused_name(stem: str, end: str, names: set[str]) -> str:
    stem = stem.removesuffix(f"_{end}") or stem  # `pressure_bar` in mbar
    if (name := f"{stem}_{end}") not in names:
        return name
    return next(text for k in range(2, len(names) + 3) if (text := f"{stem}_{k}_{end}") not in names)


def _format_comment(text: str) -> str:
    return "".join(c if c.isprintable() else "?" for c in text)


def _format_toml(value: object) -> str:
    """Format a number or text as TOML."""
    if isinstance(value, bool):
        return str(value).lower()
    if isinstance(value, str):
        plain = value.replace("\\", "\\\\").replace('"', '\\"')
        return '"' + "".join(c if c.isprintable() else f"\\U{ord(c):08X}" for c in plain) + '"'
    return repr(value)
