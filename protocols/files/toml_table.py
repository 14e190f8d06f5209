"""TomlTable: a table of a TOML file that a person wrote. Entries are read by type, and errors name the entry."""

import reprlib
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from sys import float_info
from typing import Any

from protocols.errors import InputError, suggest_closest
from protocols.input_file import read_toml

_KINDS: Mapping[type, str] = {
    str: "text", int: "a whole number", float: "a number", bool: "true or false", dict: "a table", list: "a list of tables",
}  # fmt: skip


class TomlTable:
    """The `entries` of the table `name` in the file at `path`. Raises InputError for an entry that is not in `known`.

    known: allowed keys, None for any.
    """

    def __init__(self, path: Path, name: str, entries: Mapping[str, Any], known: Sequence[str] | None = None) -> None:
        self.path, self.name, self._entries = path, name, entries
        if known is not None and (unknown := [key for key in entries if key not in known]):
            raise InputError(f"entry {self._join_name(unknown[0])} is unknown; {suggest_closest(unknown[0], known)}")

    def __iter__(self) -> Iterator[str]:
        return iter(self._entries)

    def __contains__(self, key: str) -> bool:
        return key in self._entries

    def get(self, key: str, kind: type, otherwise: Any = None) -> Any:
        """Return the entry `key` of type `kind` (a float may be written as an integer), or `otherwise`. Raises InputError."""
        if key not in self._entries:
            return otherwise
        value = self._entries[key]
        kinds = (int, float) if kind is float else (kind,)
        if type(value) not in kinds or (kind is float and not abs(value) <= float_info.max):
            raise InputError(f"{self._join_name(key)} is {reprlib.repr(value)}; allowed is {_KINDS[kind]}")
        return float(value) if kind is float else value

    def get_numbers(self, key: str) -> tuple[float, ...]:
        """Return the numbers in the entry `key`, one or a list; none if it is missing. Raises InputError."""
        value = self._entries.get(key, [])
        values = value if isinstance(value, list) else [value]
        return tuple(TomlTable(self.path, self.name, {key: one}).get(key, float) for one in values)

    def need(self, key: str, kind: type) -> Any:
        """Return the required entry `key` of type `kind`. Raises InputError if it is missing."""
        if key not in self._entries:
            raise InputError(f"entry {self._join_name(key)} is missing; {_KINDS[kind]} is needed")
        return self.get(key, kind)

    def read_subtable(self, key: str, known: Sequence[str] | None = None) -> "TomlTable":
        """Return the table `key` within this one; an empty one if it is missing."""
        return TomlTable(self.path, self._join_name(key), self.get(key, dict, {}), known)

    def read_subtables(self, key: str, known: Sequence[str]) -> Iterator["TomlTable"]:
        """Yield the tables of the list `key`, named by their number from 1."""
        for number, entries in enumerate(self.get(key, list, []), 1):
            if not isinstance(entries, dict):
                raise InputError(f"{self._join_name(key)} {number} is {reprlib.repr(entries)}; allowed is a table")
            yield TomlTable(self.path, f"{self._join_name(key)} {number}", entries, known)

    def read_numbers(self) -> dict[str, float]:
        """Return all numbers in this table and its subtables, by dotted name. Raises InputError for any other entry."""
        values: dict[str, float] = {}
        for key, value in self._entries.items():
            if isinstance(value, dict):
                values |= {f"{key}.{name}": number for name, number in self.read_subtable(key).read_numbers().items()}
            else:
                values[key] = self.get(key, float)
        return values

    def _join_name(self, key: str) -> str:
        return f"{self.name}.{key}" if self.name else key


def read_table(path: Path, known: Sequence[str]) -> TomlTable:
    """Read a TOML file, and return its outermost table, with the allowed keys `known`. Raises InputError."""
    return TomlTable(path, "", read_toml(path, "file"), known)
