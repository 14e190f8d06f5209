"""Level 7.3 of MATLAB's MAT-files: HDF5 with attributes that say what MATLAB makes of it (`save -v7.3`).

Undocumented by MathWorks. Source: what MATLAB and mat-io write.
HDF5 has the last index first: a shape here is the dataset's, reversed.
"""

import sys
from collections.abc import Sequence
from dataclasses import dataclass
from math import prod
from typing import Any

import numpy as np

from clutch_hil.recordings.hdf5.file import Hdf5File
from clutch_hil.recordings.matlab.objects import LateTable, ObjectTable, is_reference, read_reference
from clutch_hil.recordings.matlab.value import (
    FUNCTION,
    MOST_DEPTH,
    MOST_VALUES,
    SMALL,
    SPARSE,
    TOO_DEEP,
    Cell,
    LeftOut,
    Line,
    Numbers,
    Struct,
    Text,
    Value,
)  # fmt: skip
from protocols.errors import InputError

_NUMBERS = ("double", "single", "int8", "uint8", "int16", "uint16", "int32", "uint32", "int64", "uint64", "logical")
_MOST_TEXT = 1 << 20  # characters of one text
_ORDER = "<" if sys.byteorder == "little" else ">"  # of the table of objects, once it has been read


def is_level73(head: bytes) -> bool:
    """Whether a file that begins with `head`, and is an HDF5 file, says that it is MATLAB's."""
    return head.startswith(b"MATLAB 7.3 MAT-file")


def has_matlab_classes(file: Hdf5File) -> bool:
    """Whether an open HDF5 file without MATLAB's first bytes has its attributes."""
    return any("MATLAB_class" in entry.attrs for _, entry in file.list_members(file.root))


def read_level73(file: Hdf5File) -> dict[str, Value]:
    """All variables of an open file. Raises InputError."""
    reader = _Reader(file)
    variables: dict[str, Value] = {}
    for name, entry in file.list_members(file.root):
        if name == "#subsystem#":
            reader.read_objects(entry)
        elif name != "#refs#":
            variables[name] = reader.read(entry, 0)
    return variables


@dataclass(frozen=True)
class _DatasetBlock:
    """Numbers of a dataset with `axes` axes: others than MATLAB write vectors with one. place: order in which it was met.

    reference: to the dataset, which holds while the file is closed. Its name would take milliseconds to look up.
    """

    file: Hdf5File
    reference: Any
    axes: int
    place: tuple[int, int]

    def read(self, shape: tuple[int, ...], lines: Sequence[Line]) -> list[np.ndarray]:
        columns = []
        for line in lines:
            index = tuple(slice(None) if axis == line.axis else n for axis, n in enumerate(line.fixed))
            columns.append(self.file.read_column(self.reference, index[: self.axes][::-1], shape[line.axis]))
        return columns

    def read_exact(self, count: int) -> np.ndarray:
        return self.file.read(self.reference).ravel()[:count]

    def check(self) -> None:
        pass


class _Reader:
    def __init__(self, file: Hdf5File) -> None:
        self._file, self._left = file, MOST_VALUES
        self._objects, self._inside_objects = LateTable(), False

    def read_objects(self, group: Any) -> None:
        """Take the objects of the file."""
        self._inside_objects = True
        for name, entry in self._file.list_members(group):
            if name == "MCOS":
                table = self._read_cell(entry, 0)
                if isinstance(table, Cell):
                    self._objects.table = ObjectTable(self._file.name, table, _ORDER)
        self._inside_objects = False

    def read(self, entry: Any, depth: int) -> Value:
        import h5py

        self._left -= 1
        if self._left < 0:
            raise InputError(
                f"{self._file.name} has more than {MOST_VALUES} values in structures and cells; save fewer of them"
            )
        if depth > MOST_DEPTH:
            return TOO_DEEP
        if isinstance(entry, h5py.Group):
            return self._read_group(entry, depth)
        if isinstance(entry, h5py.Dataset):
            return self._read_dataset(entry, depth)
        return LeftOut("a named type of HDF5")

    def _read_group(self, group: Any, depth: int) -> Value:
        import h5py

        if "MATLAB_sparse" in group.attrs:
            return SPARSE
        kind = self._file.read_attribute(group, "MATLAB_class")
        if kind == "function_handle":
            return FUNCTION
        if kind not in ("struct", "") and "MATLAB_object_decode" not in group.attrs:
            return LeftOut(f"an object of the class {kind}")
        members = self._file.list_members(group)
        rank = [
            isinstance(entry, h5py.Dataset) and _holds_references(entry) and "MATLAB_class" not in entry.attrs
            for _, entry in members
        ]
        if members and all(rank):  # an array: one reference for each element
            arrays = {name: self._read_cell(entry, depth) for name, entry in members}
            shape = next(iter(arrays.values())).shape
            return Struct(shape, {name: cell.items for name, cell in arrays.items()})
        return Struct((1, 1), {name: (self.read(entry, depth + 1),) for name, entry in members})

    def _read_cell(self, data: Any, depth: int) -> Cell:
        self._file.check(data)
        if data.size > self._left:
            raise InputError(
                f"{self._file.name} has an array of {data.size} cells; allowed are {MOST_VALUES} values in a file"
            )
        items = []
        for reference in np.asarray(data[()]).ravel():
            target = data.file[reference] if reference else None
            items.append(LeftOut("nothing") if target is None else self.read(target, depth + 1))
        return Cell(data.shape[::-1], items)

    def _read_dataset(self, data: Any, depth: int) -> Value:
        kind = self._file.read_attribute(data, "MATLAB_class")
        if data.shape is None:
            return Cell((0, 0), ())
        if "MATLAB_empty" in data.attrs:
            return Text(()) if kind == "char" else Cell((0, 0), ())
        if _holds_references(data):
            return self._read_cell(data, depth)
        if kind == "char":
            return self._read_text(data)
        kinds = data.dtype.kind
        imaginary = data.dtype.names is not None and set(data.dtype.names) == {"real", "imag"}
        if not (kinds in "fiub" or imaginary):
            return LeftOut(f"a dataset of the type {data.dtype}")
        shape = data.shape[::-1] if len(data.shape) > 1 else (*data.shape, 1) if data.shape else (1, 1)
        block = _DatasetBlock(self._file, data.ref, len(data.shape), (0, -self._left))
        few = None
        if prod(shape) <= SMALL and not imaginary:
            self._file.check(data)
            few = np.asarray(data[()]).ravel()
        numbers = Numbers(shape, "b" if kind == "logical" else "f" if imaginary else kinds, block, imaginary, few)
        if kind == "function_handle":
            return FUNCTION
        is_class = bool(kind) and kind not in _NUMBERS
        if is_class or (self._inside_objects and is_reference(numbers)):
            return read_reference(numbers, self._objects, kind if is_class else "")
        return numbers

    def _read_text(self, data: Any) -> Value:
        if data.size > _MOST_TEXT:
            return LeftOut(f"a text of {data.size} characters")
        self._file.check(data)
        codes = np.asarray(data[()])
        if codes.dtype.kind not in "ui":
            return LeftOut(f"a text of the type {codes.dtype}")
        rows = codes.T.reshape(codes.shape[-1] if codes.ndim > 1 else 1, -1)
        return Text(tuple(row.astype("<u2").tobytes().decode("utf-16-le", "replace") for row in rows))


def _holds_references(data: Any) -> bool:
    import h5py

    return h5py.check_ref_dtype(data.dtype) is h5py.Reference
