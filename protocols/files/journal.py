"""Journal: the rows of a run being recorded, in a file that stays readable up to its last rows however its writer ends.

It is an Arrow IPC stream without compression. Each piece is written to the operating system at once, and there is no
footer. So rows survive the end of the process by any signal. A power cut loses the last seconds. The writer keeps the file
locked while it runs, so that no other process takes it for abandoned.
"""

import contextlib
import fcntl
import json
import os
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any, BinaryIO

import numpy as np
import pyarrow as pa
import pyarrow.ipc

from protocols.errors import InputError
from protocols.files.arrow import from_rows
from protocols.files.arrow_file import reading
from protocols.files.disk import Disk
from protocols.files.run import parse_json
from protocols.node import Column

_SUFFIX = ".journal"
_MOST_COLUMNS = 10_000  # of a journal that is read: a run of two clutches has 150


def make_journal_path(run: Path) -> Path:
    """Return the path of the journal of the run at `run`."""
    return run.with_name(run.name + _SUFFIX)


def find_run(journal: Path) -> Path:
    """Return the path of the run that a journal is of. Raises InputError for another file."""
    if not journal.name.endswith(_SUFFIX):
        raise InputError(f"{journal} is not a journal of a run; the name of a journal ends with {_SUFFIX}")
    return journal.with_name(journal.name.removesuffix(_SUFFIX))


def list_journals(folder: Path) -> list[Path]:
    """Return the journals in a folder, of running and ended writers."""
    return sorted(path for path in folder.glob(f"*{_SUFFIX}") if path.is_file())


class Journal:
    """Writes rows of `columns` to the journal of the `run` on `disk`, with the `metadata` known so far. Raises InputError."""

    def __init__(
        self, run: Path, columns: Sequence[Column], metadata: Mapping[str, Any], disk: Disk | None = None
    ) -> None:
        self.path, self._disk = make_journal_path(run), disk or Disk()
        self._schema = pa.schema(
            [pa.field(c.name, pa.float64(), metadata={"unit": c.unit, "meaning": c.meaning}) for c in columns],
            {name: json.dumps(value) for name, value in metadata.items()},
        )
        if self.path.exists():
            raise InputError(
                f"journal {self.path} exists: another recorder writes it, or clutch-hil recover is to take it"
            )
        with self._writing():
            self._file = self._open_locked()
            try:
                self._writer = pa.ipc.new_stream(self._file, self._schema)
            except OSError:
                self.path.unlink(missing_ok=True)
                with contextlib.suppress(OSError):
                    self._file.close()
                raise

    def _open_locked(self) -> BinaryIO:
        """Return the new, locked file, created again if a recovery removed it before it was locked: it looked abandoned."""
        while True:
            # buffered: an unbuffered file on a full disk writes only a part of a piece, and Arrow does not check that
            file = self.path.open("xb")
            try:
                fcntl.flock(file, fcntl.LOCK_EX)
            except OSError:
                self.path.unlink(missing_ok=True)
                file.close()
                raise
            if os.fstat(file.fileno()).st_nlink:
                return file
            file.close()

    def append(self, rows: np.ndarray) -> None:
        """Add `rows`, shape (samples, columns). Raises InputError; rows added before stay readable.

        It is an error if the journal has been removed: its rows would be lost.
        """
        if len(rows):
            if not os.fstat(self._file.fileno()).st_nlink:
                raise InputError(f"journal {self.path} was removed while it was written")
            with self._writing():
                self._disk.before_write()
                self._writer.write_batch(pa.record_batch(from_rows(rows), schema=self._schema))
                self._file.flush()

    def close(self) -> None:
        """Close the file and keep it. May be called again."""
        if self._file.closed:
            return
        for part in (self._writer, self._file):
            with contextlib.suppress(OSError):  # the disk may be full
                part.close()

    def remove(self) -> None:
        """Remove the file: its rows are in the run."""
        self.close()
        self.path.unlink(missing_ok=True)

    @contextlib.contextmanager
    def _writing(self) -> Iterator[None]:
        try:
            yield
        except OSError as error:
            raise InputError(f"journal {self.path} cannot be written: {error.strerror or error}") from None


class LivingWriterError(InputError):
    """A journal is being written."""


class JournalReader:
    """A journal whose writer has ended. `columns` of its rows; `metadata` of the run. Raises InputError.

    Use as a context manager; it holds the writer's lock meanwhile. A journal whose writer is running is refused.
    """

    def __init__(self, path: Path) -> None:
        self.path = path
        self.whole = False  # whether the file could be read to its end
        try:
            self._lock = path.open("rb")
            fcntl.flock(self._lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            self._lock.close()
            raise LivingWriterError(
                f"journal {path} is being written; recover it when its recorder has ended"
            ) from None
        except OSError as error:
            raise InputError(f"journal {path} cannot be read: {error.strerror}") from None
        try:
            self._open()
        except BaseException:
            self._lock.close()
            raise

    def _open(self) -> None:
        if not self.path.stat().st_size:  # its writer ended before the first row; an empty file cannot be mapped
            self._source = self._stream = None
            self.columns, self.metadata = [], {}
            return
        with reading(self.path):
            self._source = pa.memory_map(str(self.path))
            self._stream = pa.ipc.open_stream(self._source)
            schema = self._stream.schema
            fields = [schema.field(k) for k in range(len(schema))] if len(schema) <= _MOST_COLUMNS else []
            if not fields or any(field.type != pa.float64() for field in fields):
                raise InputError(f"journal {self.path} is not that of a run: it has columns that are not numbers")
            texts = [{k.decode(): v.decode() for k, v in (field.metadata or {}).items()} for field in fields]
            self.columns = [
                Column(field.name, text.get("unit", ""), text.get("meaning", ""))
                for field, text in zip(fields, texts, strict=True)
            ]
            self.metadata = {k.decode(): parse_json(v.decode()) for k, v in (schema.metadata or {}).items()}

    def __enter__(self) -> "JournalReader":
        return self

    def __exit__(self, *_: object) -> None:
        if self._source is not None:
            self._source.close()
        self._lock.close()

    def __iter__(self) -> Iterator[np.ndarray]:
        """Yield pieces of rows, each of shape (rows, columns), up to the first one that is cut or damaged."""
        if self._stream is None:
            return
        with contextlib.suppress(InputError):
            while True:
                with reading(self.path):
                    try:
                        batch = self._stream.read_next_batch()
                    except StopIteration:
                        self.whole = True
                        return
                    batch.validate(full=True)  # numbers of a damaged file would be used as memory addresses
                    if any(column.null_count for column in batch.columns):
                        raise InputError(f"journal {self.path} is damaged")
                    rows = np.column_stack([np.from_dlpack(column) for column in batch.columns])
                yield rows
