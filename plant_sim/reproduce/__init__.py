"""Reproductions: results of the thesis, and claims of this project, each checked by running it.

An entry is one module with TITLE, CLAIM and `reproduce(out, progress) -> Outcome`, named in ENTRIES.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from importlib import import_module
from pathlib import Path
from types import ModuleType
from typing import Any

from protocols.errors import InputError, listing

ENTRIES = {
    "table-6.6": "plant_sim.reproduce.table_6_6",
    "adaptation": "plant_sim.reproduce.adaptation",
}
Progress = Callable[[int, int], None]  # (done, total)


@dataclass(frozen=True)
class Outcome:
    """A `table` (header first) for people, a `document` for machines, whether the claim `holds`, the `picture` drawn."""

    table: Sequence[Sequence[str]]
    notes: Sequence[str]
    document: dict[str, Any]
    holds: bool
    picture: Path


def entry(name: str) -> ModuleType:
    """The module of an entry. Raises InputError."""
    if name not in ENTRIES:
        raise InputError(f"reproduction {name!r} does not exist; known are {listing(ENTRIES)}")
    return import_module(ENTRIES[name])
