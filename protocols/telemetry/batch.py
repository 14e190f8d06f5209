"""Batch: consecutive rows of one node, sent as an Arrow IPC stream that any Arrow reader understands.

Columns are named as in a run file, 64-bit floats, each with its unit in the field's metadata; the schema's metadata hold
`node`, `session`, `first_row`, `rate_hz`, `epoch_s` (to add to a CLOCK_MONOTONIC time for UNIX time) and `rows_lost`.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import pyarrow as pa

from protocols.errors import InputError
from protocols.files.arrow import from_rows
from protocols.node import Column
from protocols.telemetry.message import LATEST

_MOST_BYTES = 64 << 20  # of a message: 1 s of history of two clutches at 10 kHz takes 12 MB
_MOST_NUMBER = 1 << 62  # of a row, a session
_HIGHEST_RATE = 1e6  # Hz: a hundred times the highest of a loop
_LONGEST_REASON = 200  # characters of another library's error message
_NEEDED_OF_PLANT, _NEEDED_OF_CONTROLLER = ("plant_clock_s", "time_s"), ("clock_s", "sample_tick")
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
        """Return a column by name, shape (rows,)."""
        return self.rows[:, [column.name for column in self.columns].index(name)]

    def cut_before(self, row: int) -> "Batch":
        """Return the part from row number `row` on."""
        skip = min(max(row - self.first_row, 0), len(self.rows))
        return Batch(
            self.node, self.session, self.first_row + skip, self.rate, self.epoch, self.rows_lost,
            self.columns, self.rows[skip:],
        )  # fmt: skip


def list_run_columns(node: str, columns: Sequence[Column]) -> tuple[Column, ...]:
    """Return the columns of a node with their names in a run file.

    Terms of a controller get its name as a prefix, `controller_`.
    """
    if not node.startswith("controller"):
        return tuple(columns)
    return tuple(Column(f"{node}_{name}", unit, meaning) for name, unit, meaning in columns)


class BatchEncoder:
    """Encodes the batches of one node; its fields are made once."""

    def __init__(self, node: str, session: int, rate: float, epoch: float, columns: Sequence[Column]) -> None:
        self._fixed = {"node": node, "session": str(session), "rate_hz": repr(rate), "epoch_s": repr(epoch)}
        self._fields = [pa.field(name, pa.float64(), metadata={"unit": unit}) for name, unit, _ in columns]

    def encode(self, first_row: int, rows: np.ndarray, rows_lost: int) -> bytes:
        """Return `rows`, shape (rows, columns), as an Arrow IPC stream."""
        counts = {"first_row": str(first_row), "rows_lost": str(rows_lost)}
        schema = pa.schema(self._fields, metadata=self._fixed | counts)
        record = pa.record_batch(from_rows(rows), schema=schema)
        sink = pa.BufferOutputStream()
        with pa.ipc.new_stream(sink, schema) as writer:
            writer.write_batch(record)
        return sink.getvalue().to_pybytes()


def decode(payload: bytes, node: str) -> Batch:
    """Return the batch of `node` in an Arrow IPC stream. Raises InputError for other data and for impossible values."""
    if len(payload) > _MOST_BYTES:
        raise InputError(f"a telemetry message has {len(payload)} bytes; allowed are {_MOST_BYTES}")
    try:
        batch = _decode(payload)
    except InputError:
        raise
    except Exception as error:  # pyarrow raises many exception types
        reason = " ".join(str(error).split())[:_LONGEST_REASON] or type(error).__name__
        raise InputError(f"a telemetry message is invalid or of another version: {reason}") from None
    _check(batch, node)
    return batch


def _decode(payload: bytes) -> Batch:
    with pa.ipc.open_stream(payload) as reader:
        schema, record = reader.schema, reader.read_next_batch()
    record.validate(full=True)
    if any(field.type != pa.float64() for field in schema) or any(column.null_count for column in record.columns):
        raise InputError("a telemetry message has columns that are not 64-bit floats")
    meta = {key.decode(): value.decode() for key, value in (schema.metadata or {}).items()}
    columns = tuple(Column(f.name, (f.metadata or {}).get(b"unit", b"").decode(), "") for f in schema)
    rows = np.column_stack([np.from_dlpack(column) for column in record.columns])
    return Batch(
        meta["node"], int(meta["session"]), int(meta["first_row"]), float(meta["rate_hz"]), float(meta["epoch_s"]),
        int(meta["rows_lost"]), columns, rows,
    )  # fmt: skip


def _check(batch: Batch, node: str) -> None:
    """Raise InputError where a batch that came for `node` cannot be true."""
    if batch.node != node:
        raise InputError(f"telemetry of the {batch.node[:_LONGEST_REASON]} was sent under the name of the {node}")
    names = [column.name for column in batch.columns]
    needed = _NEEDED_OF_PLANT if node == "plant" else tuple(f"{node}_{name}" for name in _NEEDED_OF_CONTROLLER)
    if lacking := [name for name in needed if name not in names]:
        raise InputError(f"telemetry of the {node} lacks the column {lacking[0]}")
    if len(set(names)) < len(names):
        raise InputError(f"telemetry of the {node} has a column twice")
    for what, number, most in (
        ("rate", batch.rate, _HIGHEST_RATE), ("first row", batch.first_row, _MOST_NUMBER),
        ("session", batch.session, _MOST_NUMBER), ("rows lost", batch.rows_lost, _MOST_NUMBER),
        ("epoch", batch.epoch, LATEST),
    ):  # fmt: skip
        if not (number > 0.0 if what == "rate" else number >= 0.0) or not number <= most:
            raise InputError(f"telemetry of the {node} has the {what} {str(number)[:30]}; allowed are 0 to {most:g}")
    clock = batch[f"{node}_clock_s"]
    if not (np.isfinite(clock).all() and (np.diff(clock) >= 0.0).all()):
        raise InputError(f"the clock in telemetry of the {node} is not a number, or goes back")
