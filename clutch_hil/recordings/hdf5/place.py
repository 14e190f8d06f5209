"""Places of numbers in an HDF5 file: a dataset, a field of its rows, a column."""

from dataclasses import dataclass
from typing import Any

import numpy as np

from clutch_hil.recordings.hdf5.fields import read_field
from clutch_hil.recordings.hdf5.file import Hdf5File
from clutch_hil.recordings.hdf5.packing import Packing


@dataclass(frozen=True)
class Place:
    """Where the numbers of a channel are: in a dataset, in a field of its rows or "", in a column or None.

    inside: the steps from the values of the field to the numbers: names of fields, and numbers of elements.
    """

    dataset: str
    field: str = ""
    inside: tuple[str | int, ...] = ()
    column: int | None = None
    axis: int = 0  # of the rows
    factor: float = 1.0  # of a time axis, in s
    time: "Place | None" = None
    packing: Packing | None = None

    @property
    def index(self) -> tuple[Any, ...]:
        """Of the numbers in the dataset."""
        own = () if self.column is None else (self.column,)
        return (slice(None), *own) if self.axis == 0 else (*own, slice(None))

    def describe(self) -> str:
        """The column as h5py writes it."""
        return f"[:,{self.column}]" if self.axis == 0 else f"[{self.column},:]"


def read_place(file: Hdf5File, place: Place, rows: int, notes: list[str] | None = None) -> np.ndarray:
    """Values (rows,) of a channel. notes: where to tell what is missing. Raises InputError."""
    if place.field:
        values = read_field(file, place.dataset, place.field, place.inside, rows)
    else:
        values = file.read_column(place.dataset, place.index, rows)
    if packing := place.packing:
        values, outside = packing.unpack(values)
        if outside and notes is not None:
            name = place.dataset.lstrip("/") + ("" if place.column is None else place.describe())
            note = f"{name}: {outside} of {rows} samples are outside of its valid range, and count as missing"
            notes += [note] if note not in notes else []
    return values if place.factor == 1.0 else values * place.factor


def list_state_names(file: Hdf5File, place: Place) -> dict[float, str]:
    """Names of the numbers of a channel by its type, an enumeration; none for another one."""
    import h5py

    with file.errors(place.dataset):
        kind = file.root[place.dataset].dtype
        for step in (place.field, *place.inside) if place.field else ():
            kind = kind[step] if isinstance(step, str) else kind.base
        members = h5py.check_enum_dtype(kind) or {}
    return {float(number): name.strip() for name, number in members.items()}
