"""Run: columns of numbers over time with units, meanings and metadata; and files that appear only when they are complete."""

import contextlib
import json
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from protocols.errors import InputError
from protocols.node import Column


@dataclass(frozen=True)
class Run:
    """A recorded run: `columns` by name, each (samples,), with `units` and `meanings` by name, and `metadata` of the run."""

    columns: Mapping[str, np.ndarray]
    metadata: Mapping[str, Any]
    units: Mapping[str, str] = field(default_factory=dict)
    meanings: Mapping[str, str] = field(default_factory=dict)

    def __getitem__(self, name: str) -> np.ndarray:
        if name not in self.columns:
            raise InputError(f"the run has no column {name!r}; it has {', '.join(self.columns)}")
        return self.columns[name]

    def describe_columns(self) -> list[Column]:
        """Name, unit and meaning of every column; unit and meaning are empty where the file has none."""
        return [Column(name, self.units.get(name, ""), self.meanings.get(name, "")) for name in self.columns]


@contextlib.contextmanager
def whole_file(path: Path) -> Iterator[Path]:
    """Path to write a file to. It gets the name `path` at the end, and is removed after an exception. Raises InputError."""
    part = path.with_name(path.name + ".part")
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        yield part
        part.rename(path)
    except OSError as error:
        raise InputError(f"file {path} cannot be written: {error.strerror or error}") from None
    finally:
        with contextlib.suppress(OSError):  # the folder itself may be missing
            part.unlink(missing_ok=True)


def new_file(path: Path, overwrite: bool = False, inputs: Iterable[Path] = ()) -> Path:
    """`path`, if a file can be created there and no other is lost by it. Raises InputError.

    overwrite: whether a file that exists may be replaced. inputs: files that are read; none of them is ever replaced.
    """
    if not path.parent.is_dir():
        raise InputError(f"folder {path.parent} of {path.name} does not exist")
    try:
        path.touch(exist_ok=False)  # tried, as root has every right but cannot write everywhere
        path.unlink()
    except FileExistsError:
        if any(source.exists() and path.samefile(source) for source in inputs):
            raise InputError(f"file {path} is read by this command and would be lost; give another name") from None
        if not path.is_file():
            raise InputError(f"{path} exists and is no file; give another name") from None
        if not overwrite:
            raise InputError(f"file {path} exists already; give another name, or --overwrite to replace it") from None
    except OSError as error:
        raise InputError(f"file {path} cannot be written: {error.strerror}") from None
    return path


def parse_json(text: str) -> Any:
    """A metadata value from its JSON `text`; text that is no JSON, in files of other programs, is returned as it is."""
    try:
        return json.loads(text)
    except json.JSONDecodeError:
        return text
