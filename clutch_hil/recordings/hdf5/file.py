"""HDF5 files, read within limits: only data in the file itself, and no part larger than allowed."""

from collections.abc import Iterator
from contextlib import contextmanager
from math import prod
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from protocols.errors import InputError, tell_reason
from protocols.files.bounds import check_bytes, check_rows

if TYPE_CHECKING:
    import h5py

SIGNATURE = b"\x89HDF\r\n\x1a\n"
_OFFSETS = (0, 512, 1024, 2048)  # bytes, possible positions of the signature within the head that decides the format
# Bytes of a chunk, which the library reads at once: HDF5's default cache is 1 MiB, writers use up to some MiB
_MOST_CHUNK = 1 << 26
_MOST_NUMBERS = 100  # numbers in one attribute that mark missing values
_MOST_TEXTS = 1000  # texts in one attribute: one for each column
_TEXT_OBJECT = 64  # bytes that Python takes for a short text, beside its characters
_MOST_ATTRIBUTE = 1 << 16  # numbers or bytes of one attribute; HDF5's own limit without dense storage


def is_hdf5(head: bytes) -> bool:
    """Return whether a file that begins with `head` is an HDF5 file, with or without a user block before the signature."""
    return any(head[offset : offset + len(SIGNATURE)] == SIGNATURE for offset in _OFFSETS)


class Hdf5File:
    """An HDF5 file that is open within a `with` statement, which may be entered several times."""

    def __init__(self, path: Path) -> None:
        self.path, self.name = path, f"recording {path}"
        self._file: h5py.File | None = None

    def __enter__(self) -> "Hdf5File":
        import h5py

        with self.errors("the file"):
            self._file = h5py.File(self.path, "r", locking=False)
        return self

    def __exit__(self, *_: object) -> None:
        if self._file:
            self._file.close()

    @property
    def root(self) -> "h5py.File":
        assert self._file is not None
        return self._file

    @contextmanager
    def errors(self, what: str) -> Iterator[None]:
        """Convert the various exceptions of the library to InputError."""
        try:
            yield
        except InputError:
            raise
        except Exception as error:
            raise InputError(f"{self.name} is cut or damaged: {what} cannot be read ({tell_reason(error)})") from None

    def list_members(self, group: "h5py.Group") -> list[tuple[str, Any]]:
        """Return names and objects in a group, without soft and external links, whose targets may be elsewhere."""
        import h5py

        with self.errors("a group"):
            return [(name, group[name]) for name in group if isinstance(group.get(name, getlink=True), h5py.HardLink)]

    def read_attribute(self, entry: Any, *names: str) -> str:
        """Return the first of the attributes `names` as a text, "" if there is none."""
        for name in names:
            with self.errors(f"attribute {name}"):
                if name not in entry.attrs:
                    continue
                attribute = entry.attrs.get_id(name)
                if (attribute.shape and prod(attribute.shape) > 1) or attribute.get_storage_size() > _MOST_ATTRIBUTE:
                    continue
                value = entry.attrs[name]
            while isinstance(value, np.ndarray) and value.size == 1:
                value = value.ravel()[0]
            return value.decode("utf-8", "replace") if isinstance(value, bytes) else str(value)
        return ""

    def read_texts(self, entry: Any, name: str) -> list[str]:
        """Return the texts of an attribute, one or a list; empty for other values, or too many."""
        import h5py

        with self.errors(f"attribute {name}"):
            attribute = entry.attrs.get_id(name)
            if h5py.check_string_dtype(attribute.dtype) is None or attribute.shape is None:
                return []
            if prod(attribute.shape) > _MOST_TEXTS or attribute.get_storage_size() > _MOST_ATTRIBUTE:
                return []
            values = np.asarray(entry.attrs[name], object).ravel().tolist()
        return [_decode(value) for value in values]

    def read_text(self, data: "h5py.Dataset") -> str:
        """Return the text of a text dataset, "" if it is too long."""
        if data.dtype.itemsize > _MOST_ATTRIBUTE:
            return ""
        return _decode(self.read(data.name).ravel().tolist()[0])

    def read_text_list(self, data: "h5py.Dataset") -> list[str]:
        """Return the texts of a dataset with one axis; empty if they are too many or too long."""
        if data.size > _MOST_TEXTS or data.dtype.itemsize > _MOST_ATTRIBUTE:
            return []
        return [_decode(value) for value in self.read(data.name).ravel().tolist()]

    def read_text_column(self, place: str, field: str) -> list[str]:
        """Return the texts of a dataset with one axis, or of a field of its rows. Raises InputError for too many."""
        with self.errors(place):
            data = self.root[place]
            check_bytes(f"{self.name}: {place} needs", data.size * (data.dtype.itemsize + _TEXT_OBJECT))
        return [_decode(value) for value in self.read(place, field or ()).ravel().tolist()]

    def read_numbers(self, entry: Any, name: str) -> list[int | float]:
        """Return the numbers of an attribute, stored as numbers or as one in a text; empty if there are none, or too many."""
        with self.errors(f"attribute {name}"):
            if name not in entry.attrs:
                return []
            attribute = entry.attrs.get_id(name)
            if attribute.dtype.kind in "fiu" and attribute.shape is not None and prod(attribute.shape) <= _MOST_NUMBERS:
                return np.asarray(entry.attrs[name]).ravel().tolist()
        try:
            return [float(self.read_attribute(entry, name))]
        except ValueError:
            return []

    def read(self, place: "str | h5py.Reference", index: Any = ()) -> np.ndarray:
        """Read the part `index` of the dataset at `place`. Raises InputError where it is too large, or damaged."""
        with self.errors(place if isinstance(place, str) else "a dataset"):
            data = self.root[place]
            self.check(data)
            return np.asarray(data[index])

    def check(self, data: "h5py.Dataset") -> None:
        """Raise InputError for a dataset with data in another file, with chunks that are too large, or with missing bytes."""
        if data.is_virtual or data.external:
            raise InputError(
                f"{self.name}: {data.name} keeps its numbers in another file; copy them into this one (h5repack)"
            )
        item = data.dtype.itemsize
        if data.chunks and prod(data.chunks) * item > _MOST_CHUNK:
            raise InputError(
                f"{self.name}: {data.name} has chunks of {prod(data.chunks) * item / (1 << 20):.4g} MiB; allowed are"
                f" {_MOST_CHUNK / (1 << 20):g} MiB (h5repack -l CHUNK=...)"
            )
        stored = data.id.get_storage_size()
        if data.chunks is None and data.size and stored and stored < data.size * item:
            raise InputError(f"{self.name} is damaged: {data.name} has {stored} bytes for {data.size} values")

    def read_column(self, place: "str | h5py.Reference", index: tuple[Any, ...], rows: int) -> np.ndarray:
        """Read numbers (rows,) as float64 from a dataset; `index` selects one axis. Raises InputError."""
        check_rows(f"{self.name}: {place if isinstance(place, str) else 'a dataset'} has", rows, 1)
        values = self.read(place, index)
        if values.dtype.names:
            values = values[values.dtype.names[0]]  # the real part of a complex number
        if values.size != rows or values.dtype.kind not in "fiub":
            raise InputError(f"{self.name} changed while it was read")
        return np.asarray(values, float).reshape(rows)


def _decode(value: Any) -> str:
    return (value.decode("utf-8", "replace") if isinstance(value, bytes) else str(value)).strip()
