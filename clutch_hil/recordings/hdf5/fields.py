"""Fields of the rows of an HDF5 table: also fields of fields, and arrays in a field."""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from clutch_hil.recordings.hdf5.file import Hdf5File
from protocols.errors import InputError
from protocols.files.bounds import check_bytes, check_rows

_MOST_ELEMENTS = 100  # of an array in a field: more are a picture
_MOST_DEPTH = 8  # of fields inside fields


@dataclass(frozen=True)
class Field:
    """One number or text of each row. outer: name of the outermost field, number: its number from 0. kind: type.

    inside: names of fields, and numbers of elements, that lead to it from there. path: as in the path of a channel, `v/torque`
    or `v[:,0]`.
    """

    number: int
    outer: str
    inside: tuple[str | int, ...]
    path: str
    name: str
    kind: np.dtype


def list_fields(kind: np.dtype) -> Iterator[Field]:
    """All fields of rows of the type `kind`. An array with several axes, or many elements, is one field."""
    for number, name in enumerate(kind.names or ()):
        yield from _list_inside(Field(number, name, (), name, name, kind[name]), 1)


def _list_inside(one: Field, depth: int) -> Iterator[Field]:
    kind = one.kind
    if kind.names and depth < _MOST_DEPTH:
        for name in kind.names:
            inside = Field(one.number, one.outer, (*one.inside, name), f"{one.path}/{name}", name, kind[name])
            yield from _list_inside(inside, depth + 1)
    elif len(kind.shape) == 1 and kind.shape[0] <= _MOST_ELEMENTS and depth < _MOST_DEPTH:
        for k in range(kind.shape[0]):
            inside = Field(
                one.number, one.outer, (*one.inside, k), f"{one.path}[:,{k}]", f"{one.name}({k + 1})", kind.base
            )
            yield from _list_inside(inside, depth + 1)
    else:
        yield one


def read_field(file: Hdf5File, dataset: str, field: str, inside: tuple[str | int, ...], rows: int) -> np.ndarray:
    """Numbers (rows,) of a field, float64. inside: steps behind the outermost field. Raises InputError."""
    check_rows(f"{file.name}: {dataset} has", rows, 1)
    with file.errors(dataset):
        check_bytes(f"{file.name}: {dataset} needs", rows * file.root[dataset].dtype[field].itemsize)
    values = file.read(dataset, field)
    elements = values.size // rows
    values = values.reshape(rows, elements) if elements > 1 else values.reshape(rows)
    for step in inside:
        values = values[step] if isinstance(step, str) else values[:, step]
    if values.size != rows:
        raise InputError(f"{file.name} changed while it was read")
    return np.asarray(values, float).reshape(rows)
