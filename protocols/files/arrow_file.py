"""ArrowFile: a table in a Parquet or Arrow IPC (Feather 2) file; reads single columns within limits of memory."""

import contextlib
import struct
from collections.abc import Callable, Iterator, Mapping, Sequence
from pathlib import Path

import pyarrow as pa
import pyarrow.compute as pc
import pyarrow.ipc
import pyarrow.parquet as pq

from protocols.errors import InputError, tell_reason
from protocols.files.bounds import MOST_BYTES, check_bytes, check_rows
from protocols.files.child_reader import ChildReader

PARQUET, IPC_FILE, IPC_STREAM, FEATHER_1 = b"PAR1", b"ARROW1\0\0", b"\xff\xff\xff\xff", b"FEA1"  # first bytes of a file
_MOST_FOOTER = 64 << 20  # bytes of a Parquet footer: one of 10 000 columns has 3 MB
_DEEPEST = 8  # structures within each other
_LONGEST_REASON = 200  # characters of another library's error message


class ArrowFile:
    """An open file. schema: its columns; described: their names and types. rows: number of rows. metadata: of the table.

    The fields of a structure are columns of their own, `pose.x`.
    """

    def __init__(self, path: Path, head: bytes) -> None:
        self._path, self._parquet = path, None
        self._sizes: ChildReader | None = None  # reads the sizes of columns
        with reading(self._path):
            if head.startswith(PARQUET):
                self._check_footer()
                self._parquet = pq.ParquetFile(path)
                self._stored: pa.Schema = self._parquet.schema_arrow
                self.rows = int(self._parquet.metadata.num_rows)
                self.metadata: Mapping[bytes, bytes] = self._parquet.metadata.metadata or {}
                self._check_groups(self._parquet.metadata)
            elif head.startswith(FEATHER_1):
                raise InputError(f"recording {path} is Feather of version 1; write it again as Feather 2 or Parquet")
            else:
                self._open = pa.ipc.open_file if head.startswith(IPC_FILE) else pa.ipc.open_stream
                with pa.memory_map(str(path)) as source, self._open(source) as reader:
                    self._stored = reader.schema
                self.metadata = self._stored.metadata or {}
                self.rows = self._count()
            flat = [leaf for k, field in enumerate(self._stored) for leaf in _flatten(field, k, ())]
            self.schema = pa.schema([field for field, _, _ in flat])
            self._places = [(k, path) for _, k, path in flat]
            self.described = [
                (field.name, str(field.type)) for field in self.schema
            ]  # raises for names that are not text
        if self.rows < 0:
            raise InputError(f"recording {path} is damaged: it has {self.rows} rows")

    def read(self, indices: Sequence[int]) -> list[pa.ChunkedArray]:
        """Return columns by their indices in the schema. Raises InputError if they need more memory than is allowed."""
        check_rows(f"recording {self._path} has", self.rows, len(indices))
        with reading(self._path):
            if self._parquet is None:
                columns = self._read_ipc(indices)
            else:
                columns = [self._read_parquet(self._parquet, index) for index in indices]
        if any(len(column) != self.rows for column in columns):
            raise InputError(
                f"recording {self._path} cannot be read: it is damaged, its columns do not have {self.rows} rows"
            )
        return columns

    def _read_parquet(self, file: pq.ParquetFile, index: int) -> pa.ChunkedArray:
        """Return a column by its name; several of the same name are read together."""
        place, path = self._places[index]
        name = self._stored.names[place]
        leaf = ".".join((name, *path))
        check_bytes(f"recording {self._path}: column {leaf!r} needs", self._count_column_bytes(file.metadata, leaf))
        same = [k for k, other in enumerate(self._stored.names) if other == name]
        table = file.read(columns=[leaf])
        found = [k for k, other in enumerate(table.column_names) if other == name]
        return _take_field(table.column(found[same.index(place)]), path)

    def _count_column_bytes(self, footer: pq.FileMetaData, name: str) -> int:
        """Return the bytes of a column, or of all columns if these are few.

        To read the size of one can end the process (`serve_sizes`).
        """
        of_all = sum(footer.row_group(k).total_byte_size for k in range(footer.num_row_groups))
        if of_all <= MOST_BYTES:
            return of_all
        if self._sizes is None:
            self._sizes = ChildReader(f"recording {self._path}", f"{__name__}:serve_sizes", str(self._path))
        return int(self._sizes.ask(name))

    def _read_ipc(self, indices: Sequence[int]) -> list[pa.ChunkedArray]:
        wanted = sorted({self._places[index][0] for index in indices})
        options = pa.ipc.IpcReadOptions(included_fields=wanted)
        with pa.memory_map(str(self._path)) as source, self._open(source, options=options) as reader:
            table = reader.read_all()
        table.validate(full=True)  # numbers of a damaged file would be used as memory addresses
        places = [self._places[index] for index in indices]
        return [_take_field(table.column(wanted.index(place)), path) for place, path in places]

    def _count(self) -> int:
        """Return the number of rows of an IPC file, from its smallest column; the others are not read."""
        fixed = [k for k, field in enumerate(self._stored) if pa.types.is_primitive(field.type)]
        if not len(self._stored):
            return 0
        narrowest = min(fixed, key=lambda k: self._stored.field(k).type.bit_width, default=0)
        options = pa.ipc.IpcReadOptions(included_fields=[narrowest])
        rows = 0
        with pa.memory_map(str(self._path)) as source, self._open(source, options=options) as reader:
            batches = (
                (reader.get_batch(k) for k in range(reader.num_record_batches))
                if self._open is pa.ipc.open_file
                else iter(reader)
            )
            for batch in batches:
                rows += batch.num_rows
                check_rows(f"recording {self._path} has", rows, 1)
        return rows

    def _check_footer(self) -> None:
        with self._path.open("rb") as file:
            size = file.seek(0, 2)
            file.seek(max(size - 8, 0))
            tail = file.read(8)
        length, magic = struct.unpack("<I4s", tail.rjust(8, b"\0"))
        if magic != PARQUET:
            raise InputError(f"recording {self._path} cannot be read: it is a Parquet file that was cut")
        if length > min(_MOST_FOOTER, size):
            raise InputError(
                f"recording {self._path} cannot be read: its footer has {length} bytes; allowed are {min(_MOST_FOOTER, size)}"
            )

    def _check_groups(self, footer: pq.FileMetaData) -> None:
        """Raise InputError if the row counts of the row groups do not add up to that of the Parquet file."""
        groups = [footer.row_group(k) for k in range(footer.num_row_groups)]
        if sum(group.num_rows for group in groups) != self.rows or any(group.num_rows < 0 for group in groups):
            raise InputError(
                f"recording {self._path} cannot be read: it is damaged, its parts do not have {self.rows} rows together"
            )


def _flatten(field: pa.Field, place: int, path: tuple[str, ...]) -> Iterator[tuple[pa.Field, int, tuple[str, ...]]]:
    """Yield a column, or the fields in a structure, with the number of the stored column and the path in it."""
    if not pa.types.is_struct(field.type) or len(path) == _DEEPEST:
        yield field, place, path
        return
    for inner in field.type:
        named = inner.with_name(f"{field.name}.{inner.name}")
        yield from _flatten(named, place, (*path, inner.name))


def _take_field(column: pa.ChunkedArray, path: tuple[str, ...]) -> pa.ChunkedArray:
    """Return the field at a path in a structure; the column itself if the path is empty."""
    return pc.struct_field(column, list(path)) if path else column


def serve_sizes(path: str) -> Callable[[str], int]:
    """Return a function that reads the bytes of a column; runs in a child process.

    With damaged statistics in the file, pyarrow 26 ends the process.
    """
    footer = pq.ParquetFile(path).metadata

    def answer(name: str) -> int:
        leaves = [k for k in range(footer.num_columns) if footer.schema.column(k).path == name]
        groups = [footer.row_group(k) for k in range(footer.num_row_groups)]
        return sum(group.column(leaf).total_uncompressed_size for group in groups for leaf in leaves)

    return answer


@contextlib.contextmanager
def reading(path: Path) -> Iterator[None]:
    """Convert exceptions of pyarrow in a `with` block to InputError."""
    try:
        yield
        return
    except InputError:
        raise
    except Exception as error:  # pyarrow raises many exception types
        reason = tell_reason(error)[:_LONGEST_REASON]
    raise InputError(f"recording {path} cannot be read: {reason}")
