"""Run: columns of numbers over time with units, meanings and metadata; and files that are written whole or not at all."""

import contextlib
import json
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from protocols.errors import InputError
from protocols.node import Column


@dataclass(frozen=True)
class Run:
    """A recorded run: `columns` by name, each of shape (samples,), `metadata`, and what the file says of the columns."""

    columns: Mapping[str, np.ndarray]
    metadata: Mapping[str, Any]
    units: Mapping[str, str] = field(default_factory=dict)
    meanings: Mapping[str, str] = field(default_factory=dict)

    def __getitem__(self, name: str) -> np.ndarray:
        if name not in self.columns:
            raise InputError(f"the run has no column {name!r}; it has {', '.join(self.columns)}")
        return self.columns[name]

    def described(self) -> list[Column]:
        """Name, unit and meaning of every column; empty where the file says nothing."""
        return [Column(name, self.units.get(name, ""), self.meanings.get(name, "")) for name in self.columns]


@contextlib.contextmanager
def whole_file(path: Path) -> Iterator[Path]:
    """A place to write a file that gets its name when all is written, and disappears otherwise. Raises InputError."""
    part = path.with_name(path.name + ".part")
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        yield part
        part.rename(path)
    except OSError as error:
        raise InputError(f"file {path} cannot be written: {error.strerror or error}") from None
    finally:
        with contextlib.suppress(OSError):  # its folder may be what is wrong
            part.unlink(missing_ok=True)


def new_file(path: Path) -> Path:
    """`path` when a file can be made there and none is. Raises InputError."""
    if not path.parent.is_dir():
        raise InputError(f"folder {path.parent} of {path.name} does not exist")
    try:
        path.touch(exist_ok=False)  # root passes every look at rights, but does not write everywhere
        path.unlink()
    except FileExistsError:
        raise InputError(f"file {path} exists already; give another name or remove it") from None
    except OSError as error:
        raise InputError(f"file {path} cannot be written: {error.strerror}") from None
    return path


def parsed(text: str) -> Any:
    """A metadata value from its JSON; what is none, from files of others, stays text."""
    try:
        return json.loads(text)
    except json.JSONDecodeError:
        return text
