"""Long run: a Parquet run file whose columns are read on access."""

from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path

import numpy as np

from protocols.files.arrow import convert_numbers
from protocols.files.arrow_file import ArrowFile
from protocols.files.bounds import check_bytes
from protocols.files.run import Run
from protocols.files.runs import PART_ADVICE, REQUIRED, check_columns, parse_metadata
from protocols.input_file import read_head


def open_run(path: Path, required: Sequence[str] = REQUIRED) -> Run:
    """Open a Parquet run file as `read_run` does, but read each column that is not `required` on first access.

    This allows the evaluation of a run whose columns together need more memory than is allowed. Raises InputError, also on
    access to a column.
    """
    file = ArrowFile(path, read_head(path, "run"))
    columns = _ColumnsOnDemand(path, file)
    check_columns(path, {name: columns[name] for name in required if name in columns}, required)
    return Run(columns, parse_metadata(file.metadata))


class _ColumnsOnDemand(Mapping[str, np.ndarray]):
    """Columns of a file by name, (rows,) each, read on first access, within limits of memory."""

    def __init__(self, path: Path, file: ArrowFile) -> None:
        self._path, self._file = path, file
        self._places = {name: place for place, name in enumerate(file.schema.names)}
        self._read: dict[str, np.ndarray] = {}

    def __getitem__(self, name: str) -> np.ndarray:
        if name not in self._read:
            place = self._places[name]
            held = 8.0 * self._file.rows * (len(self._read) + 1)
            check_bytes(f"run {self._path}: the requested columns need", held, PART_ADVICE)
            self._read[name] = convert_numbers(self._file.read([place])[0])
        return self._read[name]

    def __contains__(self, name: object) -> bool:
        return name in self._places

    def __iter__(self) -> Iterator[str]:
        return iter(self._places)

    def __len__(self) -> int:
        return len(self._places)
