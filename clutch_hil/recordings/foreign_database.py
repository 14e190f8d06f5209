"""Foreign database: a DBC for decoding a log is read as far as possible; one that drives a bus must be valid (`database.py`).

Left out        signals that overlap in a frame, that do not fit into it, whose multiplexer is left out, whose factor is 0, or
                whose name another one of the message has; messages that differ and have one identifier; entries for signals
                that the database does not have
"""

import re
from collections import Counter
from collections.abc import Collection, Iterator, Sequence
from dataclasses import dataclass, field
from itertools import combinations
from pathlib import Path

from cantools.database import Error
from cantools.database.can import Database, Message, Signal

from clutch_hil.recordings.can_signals import list_bit_places, list_multiplexers
from clutch_hil.recordings.channel import name_first
from protocols.can.database import load_text, read_database, read_text
from protocols.errors import InputError

_FLOAT_BITS = (32, 64)  # of a float of a DBC
_UNUSED = re.compile(r"\b(VAL_|SIG_VALTYPE_) (\d+) (\w+)")  # in a message of cantools
_ENTRY = re.compile(r'^[ \t]*(VAL_|SIG_VALTYPE_)\s+(\d+)\s+(\w+)(?:"(?:[^"\\]|\\.)*"|[^";])*;', re.MULTILINE)


@dataclass(frozen=True)
class ForeignDatabase:
    """A database for a log. left_out: message and signal that cannot be read. notes: decisions, a sentence each."""

    database: Database
    left_out: frozenset[tuple[str, str]] = frozenset()
    notes: Sequence[str] = field(default_factory=list)


def read_foreign_database(path: Path) -> ForeignDatabase:
    """Read a database for a log. Raises InputError for errors other than those listed under Left out."""
    unreadable: dict[tuple[str, str], str] = {}
    notes: list[str] = []
    try:
        database = read_database(path)
    except InputError as error:
        database, unreadable, notes = _read_in_part(path, error)
    left_out: dict[tuple[str, str], str] = {}
    shared = _find_shared(database)
    for message in database.messages:
        left_out |= {(message.name, name): why for name, why in _find_meaningless(message)}
        left_out |= {
            (message.name, signal.name): why for signal in message.signals if (why := shared.get(message.name))
        }
    left_out |= unreadable
    notes += [f"left out {message}.{signal}: {why}" for (message, signal), why in left_out.items()]
    return ForeignDatabase(database, frozenset(left_out), notes)


def _read_in_part(path: Path, refusal: InputError) -> tuple[Database, dict[tuple[str, str], str], list[str]]:
    """The database without what is not valid; signals that cannot be read, with the reason; notes. Raises InputError."""
    text, notes = read_text(path), []
    database: Database | None = None
    for _ in range(3):  # cantools reports each kind of entry separately
        try:
            database = load_text(path, text, strict=False)
            break
        except InputError as error:
            unused = {one.groups() for one in _UNUSED.finditer(str(error.__cause__))}
            shorter = _remove_entries(text, unused)
            if shorter == text:
                raise refusal from None
            names = [" ".join(one) for one in sorted(unused)]
            notes.append(f"left out entries of {path.name} for signals that it does not have: {name_first(names)}")
            text = shorter
    if database is None:
        raise refusal
    left_out: dict[tuple[str, str], str] = {}
    for message in database.messages:
        left_out |= {(message.name, name): why for name, why in _find_unreadable(message)}
    return database, left_out, notes


def _find_meaningless(message: Message) -> Iterator[tuple[str, str]]:
    """Yield the names of signals whose values are not those of the bits of one signal, each with the reason."""
    names = Counter(signal.name for signal in message.signals)
    for signal in message.signals:
        if names[signal.name] > 1:
            yield signal.name, f"{message.name} has {names[signal.name]} signals of this name"
        elif signal.scale == 0:
            yield signal.name, "its factor is 0"
        elif signal.is_float and signal.length not in _FLOAT_BITS:
            yield signal.name, f"it has {signal.length} bits and is a float (SIG_VALTYPE_), which has 32 or 64"


def _find_shared(database: Database) -> dict[str, str]:
    """Messages that have their identifier in common with another one of other signals, by name, with the reason."""
    by_identifier: dict[tuple[int, bool], list[Message]] = {}
    for message in database.messages:
        by_identifier.setdefault((message.frame_id, message.is_extended_frame), []).append(message)
    reasons: dict[str, str] = {}
    for (can_id, _), messages in by_identifier.items():
        if len(messages) > 1 and len({repr(message.signals) for message in messages}) > 1:
            names = ", ".join(message.name for message in messages)
            reasons |= {message.name: f"{names} have the identifier 0x{can_id:X} in common" for message in messages}
    return reasons


def _remove_entries(text: str, entries: Collection[tuple[str, ...]]) -> str:
    return _ENTRY.sub(lambda entry: "" if entry.groups() in entries else entry[0], text)


def _find_unreadable(message: Message) -> Iterator[tuple[str, str]]:
    """Yield the names of signals that cannot be read, each with the reason."""
    try:
        message.refresh(strict=True)
        return
    except Error:
        message.refresh(strict=False)
    by_name = {signal.name: signal for signal in message.signals}
    places = [(signal, set(list_bit_places(signal))) for signal in message.signals]
    reasons = {
        signal.name: "its bits are not in the frame" for signal, bits in places if max(bits) >= 8 * message.length
    }
    for (one, bits), (other, others) in combinations(places, 2):
        if bits & others and _come_together(one, other, by_name):
            reasons.setdefault(one.name, f"it overlaps with {other.name}")
            reasons.setdefault(other.name, f"it overlaps with {one.name}")
    for signal in message.signals:
        for multiplexer, _ in list_multiplexers(signal, by_name):
            if multiplexer.name in reasons:
                reasons.setdefault(signal.name, f"{multiplexer.name}, which selects it, is left out")
    yield from reasons.items()


def _come_together(one: Signal, other: Signal, by_name: dict[str, Signal]) -> bool:
    """Return whether both signals can be in the same frame: no multiplexer selects only one of them."""
    pages = {multiplexer.name: set(ids) for multiplexer, ids in list_multiplexers(one, by_name)}
    others = {multiplexer.name: set(ids) for multiplexer, ids in list_multiplexers(other, by_name)}
    return all(pages[name] & others[name] for name in pages.keys() & others.keys())
