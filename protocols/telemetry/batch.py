"""Batch: consecutive rows of one node, sent as an Arrow IPC stream that any Arrow reader understands.

Columns are named as in a run file, 64-bit floats, each with its unit in the field's metadata; the schema's metadata hold
`node`, `session`, `first_row`, `rate_hz`, `epoch_s` (to add to a CLOCK_MONOTONIC time for UNIX time) and `rows_lost`.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import pyarrow as pa

from protocols.errors import InputError
from protocols.files.arrow import from_rows, numbers
from protocols.node import Column

ENCODING = "application/vnd.apache.arrow.stream"  # media type registered with IANA


@dataclass(frozen=True)
class Batch:
    """Rows of a node: `rows`, shape (rows, columns); the first has the number `first_row` since the start of the service.

    session: number of this start of the service. rate [Hz]. epoch [s]: CLOCK_MONOTONIC + epoch = UNIX time. rows_lost: rows
    since the start that were overwritten in the ring before they could be published.
    """

    node: str
    session: int
    first_row: int
    rate: float
    epoch: float
    rows_lost: int
    columns: tuple[Column, ...]
    rows: np.ndarray

    @property
    def end(self) -> int:
        """Number of the row after the last."""
        return self.first_row + len(self.rows)

    def __getitem__(self, name: str) -> np.ndarray:
        """A column by name, shape (rows,)."""
        return self.rows[:, [column.name for column in self.columns].index(name)]

    def after(self, row: int) -> "Batch":
        """The part from row number `row` on."""
        skip = min(max(row - self.first_row, 0), len(self.rows))
        return Batch(
            self.node, self.session, self.first_row + skip, self.rate, self.epoch, self.rows_lost,
            self.columns, self.rows[skip:],
        )  # fmt: skip


def run_file_columns(node: str, columns: Sequence[Column]) -> tuple[Column, ...]:
    """Columns of a node with their names in a run file: terms of a controller begin with its name, `controller_`."""
    if not node.startswith("controller"):
        return tuple(columns)
    return tuple(Column(f"{node}_{name}", unit, meaning) for name, unit, meaning in columns)


class BatchEncoder:
    """Encodes the batches of one node; its fields are made once."""

    def __init__(self, node: str, session: int, rate: float, epoch: float, columns: Sequence[Column]) -> None:
        self._fixed = {"node": node, "session": str(session), "rate_hz": repr(rate), "epoch_s": repr(epoch)}
        self._fields = [pa.field(name, pa.float64(), metadata={"unit": unit}) for name, unit, _ in columns]

    def encode(self, first_row: int, rows: np.ndarray, rows_lost: int) -> bytes:
        """`rows`, shape (rows, columns), as an Arrow IPC stream."""
        counts = {"first_row": str(first_row), "rows_lost": str(rows_lost)}
        schema = pa.schema(self._fields, metadata=self._fixed | counts)
        record = pa.record_batch(from_rows(rows), schema=schema)
        sink = pa.BufferOutputStream()
        with pa.ipc.new_stream(sink, schema) as writer:
            writer.write_batch(record)
        return sink.getvalue().to_pybytes()


def decode(payload: bytes) -> Batch:
    """The batch in an Arrow IPC stream. Raises InputError for a stream of another kind or version."""
    try:
        with pa.ipc.open_stream(payload) as reader:
            schema, table = reader.schema, reader.read_all()
        meta = {key.decode(): value.decode() for key, value in (schema.metadata or {}).items()}
        columns = tuple(Column(f.name, (f.metadata or {}).get(b"unit", b"").decode(), "") for f in schema)
        rows = np.column_stack([numbers(column) for column in table.columns])
        return Batch(
            meta["node"], int(meta["session"]), int(meta["first_row"]), float(meta["rate_hz"]), float(meta["epoch_s"]),
            int(meta["rows_lost"]), columns, rows,
        )  # fmt: skip
    except (pa.ArrowException, KeyError, ValueError) as error:
        raise InputError(f"telemetry of another version came: {error}") from None
