"""Ring: the newest rows of a node's record in shared memory, written by the loop, read by any process.

The single writer never blocks. Readers copy rows, and count rows that were overwritten before they read them. One reader may be
the collector: it publishes its position, so that a writer without a clock can wait for it (`backlog`). The ring
is a file mapped into memory (in /dev/shm where there is one), so it needs no server and disappears with its folder.

Layout: 16 bytes (magic, length of the header), header JSON (columns, capacity, description), rows written (u64), rows collected
(i64, -1 without a collector), rows of doubles.
x86 keeps the order of stores, so a reader that sees the count also sees the row. ARM does not promise this, and the bench was
never run there. A reader that is overtaken while it copies detects this from the count.
"""

import json
import mmap
import os
import struct
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from protocols.errors import InputError
from protocols.node import Column

_MAGIC = b"clutchR2"
_PREFIX = struct.Struct("<8sQ")
_COUNT = struct.Struct("<Q")
_COLLECTED = struct.Struct("<q")
_NO_COLLECTOR = -1
_DOUBLE = 8  # bytes


class RingWriter:
    """Create a ring at `path` for rows of `columns`; it keeps the newest `capacity` rows. Raises InputError.

    description: for readers, stored as JSON. Compiled code (`beat.py`) writes to `rows`, shape (capacity + 1, columns), and
    counts them in `counts`, shape (1,).
    """

    def __init__(
        self, path: Path, columns: Sequence[Column], capacity: int, description: Mapping[str, Any] | None = None
    ) -> None:
        content = {"columns": columns, "capacity": capacity, "description": description or {}}
        header = json.dumps(content).encode()
        header += b" " * (-(_PREFIX.size + len(header)) % 8)
        count_at = _PREFIX.size + len(header)
        collected_at = count_at + _COUNT.size
        self._start = collected_at + _COLLECTED.size
        self._slots = capacity + 1  # one slot is written while the others are read
        size = self._start + self._slots * len(columns) * _DOUBLE
        part = path.with_suffix(".part")
        try:
            with part.open("w+b") as file:
                os.posix_fallocate(file.fileno(), 0, size)  # full memory is an error now, not SIGBUS in the loop
                self._map = mmap.mmap(file.fileno(), size)
        except OSError as error:
            part.unlink(missing_ok=True)
            raise InputError(f"ring {path} cannot be made: {error.strerror}") from None
        beginning = _PREFIX.pack(_MAGIC, len(header)) + header + _COUNT.pack(0) + _COLLECTED.pack(_NO_COLLECTOR)
        self._map[: self._start] = beginning
        for page in range(self._start, size, mmap.PAGESIZE):
            self._map[page] = 0  # touched now, so that the loop meets no page fault
        # An item of a memoryview is stored at once; struct.pack_into would zero it first, and readers would see that.
        self._count = memoryview(self._map)[count_at:collected_at].cast("Q")
        self._collected = memoryview(self._map)[collected_at : self._start].cast("q")
        self.rows = np.frombuffer(self._map, np.float64, offset=self._start).reshape(self._slots, len(columns))
        self.counts = np.frombuffer(self._map, np.int64, 1, count_at)
        part.rename(path)  # readers never see half a header

    @property
    def row_count(self) -> int:
        """Rows so far."""
        return self._count[0]

    @property
    def backlog(self) -> int:
        """Rows that the collector has not read yet; 0 without a collector."""
        collected = self._collected[0]
        return 0 if collected == _NO_COLLECTOR else self._count[0] - collected

    def write(self, row: Sequence[float] | np.ndarray, more: Sequence[float] = ()) -> None:
        """Append `row` followed by `more` as one row; the oldest row is overwritten when the ring is full."""
        written = self._count[0]
        place = self.rows[written % self._slots]
        place[: len(row)] = row
        place[len(row) :] = more
        self._count[0] = written + 1

    def close(self) -> None:
        """Release the memory. Readers keep their mappings."""
        self._count.release()
        self._collected.release()
        del self.rows, self.counts
        self._map.close()


class RingReader:
    """Reads a ring with `columns` and `description`; lost: rows overwritten before they were read. Raises InputError."""

    def __init__(self, path: Path) -> None:
        try:
            with path.open("rb") as file:
                self._map = mmap.mmap(file.fileno(), 0, access=mmap.ACCESS_READ)
            magic, length = _PREFIX.unpack_from(self._map)
            if magic != _MAGIC:
                raise ValueError("it is not a ring of this version")
            header = json.loads(self._map[_PREFIX.size : _PREFIX.size + length])
            self.columns = tuple(Column(*column) for column in header["columns"])
            self.description: dict[str, Any] = header["description"]
            self._slots = header["capacity"] + 1
            self._count_at = _PREFIX.size + length
            start = self._count_at + _COUNT.size + _COLLECTED.size
            rows = np.frombuffer(self._map, np.float64, self._slots * len(self.columns), offset=start)
            self._rows = rows.reshape(self._slots, len(self.columns))
        except (OSError, ValueError, KeyError, TypeError, struct.error) as error:
            raise InputError(f"ring {path} cannot be read: {error}") from None
        self.lost = 0
        self._read = 0

    def read(self) -> np.ndarray:
        """Return the rows written since the last call, shape (rows, columns), oldest first."""
        written = self._count_written()
        first = max(self._read, written - self._slots + 1)
        rows = self._rows[np.arange(first, written) % self._slots]
        overtaken = min(max(self._count_written() - self._slots + 1 - first, 0), len(rows))  # while they were copied
        self.lost += first - self._read + overtaken
        self._read = written
        return rows[overtaken:]

    def _count_written(self) -> int:
        return _COUNT.unpack_from(self._map, self._count_at)[0]


class RingCollector(RingReader):
    """The single reader of a ring for which its writer can wait. Raises InputError."""

    def __init__(self, path: Path) -> None:
        super().__init__(path)
        at = self._count_at + _COUNT.size
        with path.open("r+b") as file:
            self._collected = memoryview(mmap.mmap(file.fileno(), at + _COLLECTED.size))[at:].cast("q")
        self._collected[0] = 0

    def read(self) -> np.ndarray:
        """Return the rows written since the last call, shape (rows, columns), oldest first."""
        rows = super().read()
        self._collected[0] = self._read
        return rows
