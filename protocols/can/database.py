"""Database: a DBC file read with any usual encoding, and whether it can carry the bench.

The bench can use other identifiers, scales, offsets and lengths than `clutch_rig.dbc`, and any further messages of other nodes.
Its own signals must exist as plain little-endian integers, in the units of the bench, with ranges that cover its values.
A database of version 1 is judged by version 1 (`version.py`).
"""

import codecs
import logging
from collections import Counter
from collections.abc import Iterator, Mapping
from keyword import iskeyword
from math import isfinite
from pathlib import Path

import cantools.database
from cantools.database.can import Database, Message, Signal

from protocols.can.multiplexing import complete_multiplexing
from protocols.can.version import DATA_ID, VERSION_2, Version, find_version
from protocols.errors import InputError, join_names
from protocols.input_file import read_raw

_MOST_BYTES = 64 << 20  # of a database: a hundred times a large automotive one
_FORMATS = ("dbc", "arxml", "kcd", "sym", "cdd")  # of cantools, each the suffix of its files
_MOST_PROBLEMS = 5  # named in one message
_MARKS = ((codecs.BOM_UTF8, "utf-8-sig"), (codecs.BOM_UTF16_LE, "utf-16"), (codecs.BOM_UTF16_BE, "utf-16"))
_HIGHEST_ID = 0x7FF  # of a standard frame; the bench sends no other

# Signal -> unit in clutch_rig.dbc, if a database may spell it differently
_UNITS: Mapping[str, str] = {
    "VALVE_VOLTAGE": "V", "SPEED_DEMAND": "rad/s", "TORQUE_LIMIT": "Nm", "CYLINDER_PRESSURE": "bar", "OIL_TEMPERATURE": "degC",
    "MOTOR_TORQUE": "Nm", "CLUTCH_TORQUE": "Nm", "SHAFT_ANGLE": "rad", "TORQUE_DEMAND": "Nm", "PRESSURE_DEMAND": "bar",
    "TORQUE_ESTIMATE": "Nm", "RATE": "Hz",
}  # fmt: skip
_SPELLINGS: Mapping[str, tuple[str, ...]] = {  # lower case, without punctuation, as databases write them
    "V": ("v", "volt", "volts"), "rad/s": ("rads", "radsec"), "Nm": ("nm", "newtonmeter", "newtonmetre"), "bar": ("bar",),
    "degC": ("degc", "c", "celsius", "degcelsius"), "rad": ("rad", "radian", "radians"), "Hz": ("hz", "1s", "s1"),
}  # fmt: skip


def read_text(path: Path) -> str:
    """Return the text of a DBC file: UTF-8 or UTF-16 with or without a mark, else Windows-1252. Raises InputError."""
    raw = read_raw(path, "DBC", _MOST_BYTES)
    marked = [encoding for mark, encoding in _MARKS if raw.startswith(mark)]
    without_mark = [
        name for name, odd in (("utf-16-le", 1), ("utf-16-be", 0)) if raw[odd:64:2].count(0) > len(raw[:64]) // 3
    ]
    for encoding in (*marked, *without_mark, "utf-8"):
        try:
            return raw.decode(encoding)
        except UnicodeDecodeError:
            if encoding in marked:
                raise InputError(f"DBC {path} begins like {encoding} but is not valid: save it as UTF-8") from None
    return raw.decode("cp1252", errors="replace")


def read_database(path: Path) -> Database:
    """Read a database of any bus. Raises InputError that names what is wrong."""
    return load_text(path, read_text(path))


def load_text(path: Path, text: str, strict: bool = True) -> Database:
    """Return the database of a `text`. strict: refuse signals that overlap or do not fit.

    Raises InputError caused by cantools.
    """
    if not text.strip():
        raise InputError(f"DBC {path} is empty")
    text = complete_multiplexing(path, text)
    kind = _format_of(path, text)
    log = logging.getLogger("cantools")
    level = log.level
    log.setLevel(logging.CRITICAL)  # it warns of errors that are refused below
    try:
        database = cantools.database.load_string(text, kind, strict=strict)
    except Exception as error:  # cantools raises many exception types
        why = " ".join(str(error).split())[:300] or "it is empty"
        if kind is None:  # cantools lists the error of each format then
            why = f"its text has none of the formats {', '.join(_FORMATS)}"
        raise InputError(f"DBC {path} is malformed: {why}") from error
    finally:
        log.setLevel(level)
    if not isinstance(database, Database):
        raise InputError(f"{path} is not a CAN database")
    return database


def check_carries(path: Path, database: Database) -> None:
    """Raise InputError, with each signal and reason, for a database that cannot carry the bench."""
    problems = list(_find_problems(database, find_version(database)))
    if problems:
        more = f"; and {len(problems) - _MOST_PROBLEMS} more" if len(problems) > _MOST_PROBLEMS else ""
        if silent := list_frames_without_cycle_time(database):
            more += f"; its load is unknown, as {join_names(silent)} have no cycle time"
        raise InputError(f"DBC {path}: {'; '.join(problems[:_MOST_PROBLEMS])}{more}")


def list_frames_without_cycle_time(database: Database) -> list[str]:
    """Return the names of the bench's frames without a cycle time (GenMsgCycleTime)."""
    return [
        message.name for message in database.messages if message.name in VERSION_2.carried and not message.cycle_time
    ]


def read_data_id(message: Message) -> int:
    """Return the data ID of a frame; 0 if the database has none."""
    attribute = message.dbc.attributes.get(DATA_ID) if message.dbc else None
    return int(attribute.value) if attribute else 0


def is_carried(message: Message, version: Version) -> bool:
    """Return whether the bench can use a frame of a database that passed `check_carries`: protected, standard, readable."""
    signals = list(message.signals)
    return message.name in version.carried or (
        not (message.is_extended_frame or message.is_fd)
        and version.lengths[0] <= message.length <= version.lengths[1]
        and not any(_list_protection_problems(message, version))
        and not any(_describe_unreadable(signal) for signal in signals)
    )


def _find_problems(database: Database, version: Version) -> Iterator[str]:
    messages = {message.name: message for message in database.messages}
    names = Counter(message.name for message in database.messages)
    yield from (f"the frame {name} occurs {count} times" for name, count in names.items() if count > 1)
    users: dict[tuple[int, bool], list[str]] = {}
    for message in database.messages:
        users.setdefault((message.frame_id, message.is_extended_frame), []).append(message.name)
    for (can_id, _), sharing in users.items():
        if len(sharing) > 1 and len(set(sharing)) > 1:
            yield f"the frames {join_names(sharing)} have the same identifier, 0x{can_id:03X}"
    owners: dict[int, list[str]] = {}
    for message in database.messages:
        owners.setdefault(read_data_id(message), []).append(message.name)
    for number, sharing in owners.items():
        if number and len(set(sharing)) > 1:
            yield f"the frames {join_names(sharing)} have the same data ID, {number}"
    for name, ranges in version.carried.items():
        if name not in messages:
            yield f"it lacks the frame {name}; it has {join_names(list(messages)[:20])}"
            continue
        for what in _list_frame_problems(messages[name], ranges, version):
            yield f"frame {name}{': ' if what.startswith('signal') else ' '}{what}"


def _list_frame_problems(
    message: Message, ranges: Mapping[str, tuple[float, float]], version: Version
) -> Iterator[str]:
    if message.is_extended_frame:
        yield f"has an extended identifier, 0x{message.frame_id:08X}; allowed are standard ones, to 0x{_HIGHEST_ID:X}"
    if message.is_fd:
        yield "is a CAN FD frame; allowed are classic ones"
    least, most = version.lengths
    if not least <= message.length <= most:
        yield f"has {message.length} bytes; allowed are {f'{least} to {most}' if least < most else most}"
    yield from _list_protection_problems(message, version)
    signals = {signal.name.upper(): signal for signal in message.signals}
    if len(signals) < len(message.signals):
        yield "has two signals whose names differ only in upper and lower case"
    known = {*ranges, *(name for name, _, _ in version.protection)}
    others = [name for name in signals if name not in known]
    for name, (low, high) in ranges.items():
        if (signal := signals.get(name)) is None:
            yield f"lacks the signal {name}" + (f"; it has {join_names(others)} instead" if others else "")
        elif problem := (
            _describe_unreadable(signal)
            or _describe_unit_problem(signal, _UNITS.get(name, ""))
            or _describe_range_problem(signal, low, high)
        ):
            yield f"signal {signal.name} {problem}"
    for name in others:
        if problem := _describe_unreadable(signals[name]):
            yield f"signal {signals[name].name} {problem}"


def _list_protection_problems(message: Message, version: Version) -> Iterator[str]:
    signals = {signal.name: signal for signal in message.signals}
    for name, start, length in version.protection:
        signal = signals.get(name)
        if signal is None or (signal.start, signal.length, signal.byte_order) != (start, length, "little_endian"):
            yield f"needs the signal {name} : {start}|{length}@1+"
    if version.needs_data_id and not read_data_id(message):
        yield f"has no data ID; it needs the attribute {DATA_ID}, 1 to 65535"


def _describe_unreadable(signal: Signal) -> str:
    """Return why the generated code cannot read or write a signal; "" if it can."""
    if iskeyword(signal.name.lower()) or signal.name.startswith("_"):
        return "has a name that cannot be used; rename it"
    if signal.is_multiplexer or signal.multiplexer_ids:
        return "is multiplexed; it must be a plain little-endian integer in every frame"
    if signal.byte_order != "little_endian" or signal.is_float:
        return "must be a plain little-endian integer"
    if signal.scale == 0 or not (isfinite(signal.scale) and isfinite(signal.offset)):
        return f"has the factor {signal.scale:g} and offset {signal.offset:g}; allowed is any factor but 0"
    return ""


def _describe_unit_problem(signal: Signal, own: str) -> str:
    """Return what is wrong with a signal's unit in a database; "" if it equals `own`, the bench's unit, or is empty."""
    stated = "".join(c for c in signal.unit or "" if c.isalnum()).lower()
    if not stated or not own or stated in _SPELLINGS[own]:
        return ""
    return f"is in {signal.unit!r}; the bench needs {own}"


def _describe_range_problem(signal: Signal, least: float, most: float) -> str:
    half = 1 << signal.length - 1
    raws = (-half, half - 1) if signal.is_signed else (0, 2 * half - 1)
    low, high = sorted(float(raw * signal.scale + signal.offset) for raw in raws)
    if low - abs(signal.scale) <= least and most <= high + abs(signal.scale):
        return ""
    unit = f" {signal.unit}" if signal.unit else ""
    return f"reaches from {low:.6g} to {high:.6g}{unit}; the bench needs {least:g} to {most:g}"


def _format_of(path: Path, text: str) -> str | None:
    """Return the format for cantools; None to try all known formats."""
    suffix = path.suffix.lower().removeprefix(".")
    return "dbc" if "BO_ " in text else suffix if suffix in _FORMATS else None
