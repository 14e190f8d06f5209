"""RRD reader: read the rows of an .rrd file that a screen has logged."""

import warnings
from collections import defaultdict
from collections.abc import Mapping
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
from rerun.chunk import RrdReader
from rerun.error_utils import RerunWarning

from clutch_hil.live.viewer.times import ROW, TIME
from protocols.errors import InputError
from protocols.node import Column
from protocols.telemetry.batch import Batch

_SCALARS = "Scalars:scalars"


@dataclass(frozen=True)
class Table(Mapping[str, np.ndarray]):
    """All rows of a node in order; columns by name, each (n,).

    row: row numbers, which start again when the node is restarted. columns: with names and units. rows: (n, columns). rate
    [Hz].
    """

    node: str
    rate: float
    columns: tuple[Column, ...]
    row: np.ndarray
    rows: np.ndarray

    def __getitem__(self, name: str) -> np.ndarray:
        names = [column.name for column in self.columns]
        if name not in names:
            raise KeyError(name)
        return self.rows[:, names.index(name)]

    def __iter__(self) -> Any:
        return (column.name for column in self.columns)

    def __len__(self) -> int:
        return len(self.columns)

    def make_batches(self) -> list[Batch]:
        """Return the rows as batches without gaps, for `Screen.log`; their session counts the starts of the node from 1."""
        cuts = [0, *(np.flatnonzero(np.diff(self.row) != 1) + 1), len(self.row)]
        batches, session = [], 1
        for begin, end in pairwise(cuts):
            session += int(begin > 0 and self.row[begin] <= self.row[begin - 1])
            rows = self.rows[begin:end]
            batches.append(Batch(self.node, session, int(self.row[begin]), self.rate, 0.0, 0, self.columns, rows))
        return batches


def read_rrd(path: Path) -> dict[str, Table]:
    """Return the rows of each node in an .rrd file of a `Screen`, by "node", or by "prefix/node" for a run below a prefix.

    Raises InputError naming the file when it was written by another program or is incomplete.
    """
    labels: dict[str, dict[str, Any]] = {}
    chunks: dict[str, list[pa.RecordBatch]] = defaultdict(list)
    try:
        for chunk in _open_reader(path).stream():
            record = chunk.to_record_batch()
            if not chunk.is_static:
                if _SCALARS in record.schema.names:
                    chunks[chunk.entity_path].append(record)
            elif "columns" in record.schema.names:
                labels[chunk.entity_path] = {name: record[name].to_pylist()[-1] for name in LABELS}
        entities: dict[str, list[_Entity]] = defaultdict(list)
        for name, label in labels.items():
            if name in chunks:
                entity = _find_entity(label, chunks[name])
                prefix = name.strip("/").removesuffix(label["path"][0]).strip("/")
                entities[f"{prefix}/{entity.node}".strip("/")].append(entity)
    except (OSError, RuntimeError, ValueError, KeyError, TypeError, pa.ArrowException) as error:
        raise InputError(f"file {path} cannot be read as a saved view: {' '.join(str(error).split())}") from None
    if not entities:
        raise InputError(f"file {path} contains no rows of a bench")
    return {key: _make_table(path, own) for key, own in sorted(entities.items())}


LABELS = ("columns", "units", "index", "node", "rate_hz", "path")  # logged beside the lines of an entity


def _open_reader(path: Path) -> RrdReader:
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", RerunWarning)  # for a file without a footer, which only an index needs
        return RrdReader(path)


@dataclass(frozen=True)
class _Entity:
    """Columns of a node that were logged together, in the order of their rows."""

    node: str
    rate: float
    index: list[int]
    columns: list[Column]
    row: np.ndarray
    values: np.ndarray


def _find_entity(label: Mapping[str, Any], records: list[pa.RecordBatch]) -> _Entity:
    table = pa.Table.from_batches([record.select(_list_row_columns(record)) for record in records]).combine_chunks()
    row = table[ROW].to_numpy()
    width = len(label["columns"])
    values = table[_SCALARS].combine_chunks().flatten().to_numpy().reshape(-1, width)
    first = table[TIME].to_numpy().astype(np.int64) if TIME in table.schema.names else np.zeros(len(row))
    order = np.lexsort((row, first))  # by time first, because row numbers start again after a restart
    columns = [Column(name, unit, "") for name, unit in zip(label["columns"], label["units"], strict=True)]
    return _Entity(label["node"][0], label["rate_hz"][0], label["index"], columns, row[order], values[order])


def _list_row_columns(record: pa.RecordBatch) -> list[str]:
    return [name for name in (ROW, TIME, _SCALARS) if name in record.schema.names]


def _make_table(path: Path, entities: list[_Entity]) -> Table:
    """Return the table of the entities of a node, with the columns in the node's order. Raises InputError for unequal rows."""
    row = entities[0].row
    if any(not np.array_equal(entity.row, row) for entity in entities):
        raise InputError(f"file {path}: the signals of {entities[0].node} do not have the same rows")
    numbers = np.concatenate([entity.index for entity in entities])
    order = np.argsort(numbers)
    columns = [column for entity in entities for column in entity.columns]
    rows = np.column_stack([entity.values for entity in entities])[:, order]
    return Table(entities[0].node, entities[0].rate, tuple(columns[k] for k in order), row, rows)
