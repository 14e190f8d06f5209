"""RecordingFormat: interface of a recording format. The format of a file is recognised by its content, never by its name.

A format of your own is a class with the members of `RecordingFormat`, and a line in the pyproject.toml of your package:

    [project.entry-points."clutch_hil.recording_formats"]
    my_logger = "my_package.my_logger:MyLogger"
"""

from collections.abc import Mapping
from functools import cache
from pathlib import Path
from typing import Any, Protocol

from clutch_hil.recordings.channel import Recording
from clutch_hil.recordings.foreign import describe_foreign
from clutch_hil.recordings.users_format import UsersFormat
from protocols.entry_points import comes_with_bench, find_package, list_entries, list_points, load_entry
from protocols.errors import InputError
from protocols.input_file import read_head

GROUP = "clutch_hil.recording_formats"
_SHOWN = 40  # bytes of a file in a message


class RecordingFormat(Protocol):
    """A file format.

    name: common name. keys: entries of [file] in an import map that it understands, with their types.
    order: formats with a lower order are tried first. 0: unique first bytes; 1: further content is examined; 2: any text.
    """

    name: str
    keys: Mapping[str, type]
    order: int

    def recognises(self, head: bytes, path: Path) -> bool:
        """Return whether a file that begins with `head` (HEAD_BYTES at most) has this format."""

    def open(self, path: Path, options: Mapping[str, Any]) -> Recording:
        """Open the file and return its contents. options: entries of [file] among `keys`. Raises InputError."""


@cache
def load_formats() -> tuple[RecordingFormat, ...]:
    """Return the formats of all installed packages, in the order in which they are tried."""
    return tuple(sorted(map(_load_format, list_entries(GROUP)), key=lambda one: (one.order, one.name)))


def _load_format(name: str) -> RecordingFormat:
    made = load_entry(GROUP, "recording format", name)
    point = next(point for point in list_points(GROUP) if point.name == name)
    if comes_with_bench(point):
        one: RecordingFormat = made()
        return one
    return UsersFormat(made, f"recording format {name} of the package {find_package(point)}")


def list_option_keys() -> dict[str, type]:
    """Return the entries of [file] of all formats, with their types."""
    return {key: kind for one in load_formats() for key, kind in one.keys.items()}


def recognise(path: Path) -> RecordingFormat:
    """Return the format of a file. Raises InputError where it is unknown."""
    head = read_head(path)
    for one in load_formats():
        if one.recognises(head, path):
            return one
    if foreign := describe_foreign(head):
        raise InputError(f"recording {path} cannot be read, as it is {foreign}")
    known = ", ".join(one.name for one in load_formats())
    raise InputError(f"recording {path} is of no known format: it begins with {head[:16]!r}; known are {known}")


def open_recording(path: Path, options: Mapping[str, Any] | None = None) -> Recording:
    """Open a file of any known format. options: entries of [file] of an import map.

    Raises InputError for an unknown format, and for an option that the format does not have.
    """
    one, given = recognise(path), dict(options or {})
    if wrong := [key for key in given if key not in one.keys]:
        allowed = ", ".join(one.keys) or "no entry"
        others = ", ".join(other.name for other in load_formats() if wrong[0] in other.keys and other is not one)
        known = f"; it is one of {others}, and the file begins with {read_head(path)[:_SHOWN]!r}" if others else ""
        raise InputError(
            f"import map: file.{wrong[0]} is not an option of {path}, which is {one.name}; allowed is {allowed}{known}"
        )
    return one.open(path, given)
