"""Run: columns of numbers over time with units, meanings and metadata."""

import json
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from protocols.errors import InputError
from protocols.node import Column


@dataclass(frozen=True, eq=False, repr=False)
class Run:
    """A recorded run: `columns` by name, each (samples,), with `units` and `meanings` by name, and `metadata` of the run.

    `run[name]` is a column, `name in run` is whether it exists, and iteration over a run gives the names.
    """

    columns: Mapping[str, np.ndarray]
    metadata: Mapping[str, Any]
    units: Mapping[str, str] = field(default_factory=dict)
    meanings: Mapping[str, str] = field(default_factory=dict)

    def __getitem__(self, name: str) -> np.ndarray:
        if name not in self.columns:
            raise InputError(f"the run has no column {name!r}; it has {', '.join(self.columns)}")
        return self.columns[name]

    def __contains__(self, name: object) -> bool:
        return name in self.columns

    def __iter__(self) -> Iterator[str]:
        return iter(self.columns)

    def __len__(self) -> int:
        return len(self.columns)

    def __repr__(self) -> str:
        time = np.asarray(self.columns.get("time_s", ()))
        timed = time.ndim == 1 and len(time) and time.dtype.kind in "fiu"
        span = f", {len(time)} samples, {time[0]:g} to {time[-1]:g} s" if timed else ""
        return f"<Run of {self.metadata.get('rig', 'no rig')}: {len(self.columns)} columns{span}>"

    def with_numbers(self) -> "Run":
        """Return this run with its columns as 64-bit numbers, as in a file; columns made in memory may have other types.

        Raises InputError for a column of another kind.
        """
        return replace(self, columns={name: _as_numbers(name, values) for name, values in self.columns.items()})

    def describe_columns(self) -> list[Column]:
        """Return the name, unit and meaning of every column; unit and meaning are empty if the file has none."""
        return [Column(name, self.units.get(name, ""), self.meanings.get(name, "")) for name in self.columns]


def _as_numbers(name: str, values: Any) -> np.ndarray:
    """Return a column (n,) as 64-bit numbers, flags as 0 and 1. Raises InputError for other types and masked values."""
    array = values if isinstance(values, np.ma.MaskedArray) else np.asarray(values)
    if not name or array.ndim != 1 or array.dtype.kind not in "fiub" or np.ma.is_masked(array):
        kind = "masked values" if np.ma.is_masked(array) else f"{array.ndim} dimensions of {array.dtype}"
        raise InputError(f"column {name!r} has {kind}; a run has columns with a name, and of numbers, (samples,) each")
    return np.asarray(array, float)


def parse_json(text: str) -> Any:
    """Return a metadata value from its JSON `text`. Text that is not JSON, from other programs, is returned unchanged."""
    try:
        return json.loads(text)
    except (ValueError, RecursionError):  # not JSON, or nested too deeply
        return text
