"""Run files: one row for each sample at a constant rate, as Parquet, ASAM MF4 (measurement.py) or CSV.

MATLAB files (matlab.py) can be read. The columns of docs/rig.md come first, then controller terms (`controller_...`), plant
truth (`truth_...`) and any others. Metadata are JSON values by key. A CSV file has neither units nor metadata.
"""

import contextlib
import fcntl
import json
from collections.abc import Mapping, Sequence
from dataclasses import replace
from os import PathLike
from pathlib import Path
from types import TracebackType
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.csv
import pyarrow.parquet as pq

from protocols.errors import InputError, join_names, name_run
from protocols.files import matlab, measurement
from protocols.files.arrow import convert_numbers, from_rows
from protocols.files.arrow_file import PARQUET, ArrowFile, reading
from protocols.files.bounds import check_rows
from protocols.files.disk import Disk
from protocols.files.mdf.file import MAGIC
from protocols.files.output_file import make_part_path, open_part, put_in_place, whole_file
from protocols.files.run import Run, parse_json
from protocols.files.stretch import WHOLE, Stretch
from protocols.files.units import contradict
from protocols.input_file import read_head
from protocols.node import Column

_UNITS = {
    "time_s": "s", "valve_voltage_v": "V", "motor_speed_demand_rad_s": "rad/s", "cylinder_pressure_bar": "bar",
    "slip_speed_rad_s": "rad/s", "shaft_angle_rad": "rad", "oil_temperature_degc": "degC", "clutch_torque_nm": "Nm",
    "motor_torque_nm": "Nm",
}  # fmt: skip
REQUIRED = tuple(_UNITS)
_TIME = "time_s"
PART = "part"  # metadata key of a part of a run: its file, begin and end
_NO_UNIT = ("", "-", "1")  # what loggers write for an unknown unit
SUFFIXES = (".parquet", ".mf4", ".csv")
_KINDS = {".mf4": "ASAM MDF", ".parquet": "Parquet"}  # by suffix
_MATLAB = b"MATLAB "  # first bytes of a file of level 5 and 7.3
# Rows of a row group: 4 min at 1 kHz. The writer keeps 0.9 kB for each column of each group until the file is finished
# (measured with pyarrow 26): 21 MiB a day of a run of 70 columns. The rows of a group wait in 134 MB.
_GROUP_ROWS = 240_000
_GROUP_BYTES = 256 << 20  # of waiting rows: limits their number if there are more columns than in a run of two clutches
_PART_BYTES = 1 << 20  # of a text file that are checked at once
PART_ADVICE = (
    "clutch-hil convert RUN PART --from S --to S writes a part of it"  # end of the error for a run that is too long
)
_TIME_TOLERANCE = 0.01  # of a sample period: times are written as decimal seconds


class RunWriter:
    """Writes a run of `columns` to `path` in pieces; the file gets its name only when the run is complete. Raises InputError.

    Rows wait in memory until they fill a row group. After a failed write the run cannot be finished. disk: the disk of `path`.
    Use as a context manager: leaving it by an exception, or without `finish`, removes the file. Until then the file is locked,
    so that no second writer uses it and `remove_dead_parts` can recognise files of killed writers.
    """

    def __init__(self, path: Path, columns: Sequence[Column], disk: Disk | None = None) -> None:
        self._path, self._part, self._disk = path, make_part_path(path), disk or Disk()
        self._schema = pa.schema(
            [pa.field(c.name, pa.float64(), metadata={"unit": c.unit, "meaning": c.meaning}) for c in columns]
        )
        size = max(min(_GROUP_ROWS, _GROUP_BYTES // (8 * max(len(columns), 1))), 1)
        self._waiting, self._count = np.empty((size, len(columns)), order="F"), 0
        self._failure: InputError | None = None
        try:
            path.parent.mkdir(parents=True, exist_ok=True)
            self._file = open_part(path)
        except OSError as error:
            raise InputError(f"run file {path} cannot be written: {error.strerror or error}") from None
        try:
            # few numbers of a run repeat: a dictionary makes its file larger, and slower to write and to read
            self._writer = pq.ParquetWriter(self._file, self._schema, compression="zstd", use_dictionary=False)
        except OSError as error:
            self._part.unlink(missing_ok=True)
            with contextlib.suppress(OSError):  # rows that could not be written before
                self._file.close()
            raise InputError(f"run file {path} cannot be written: {error.strerror or error}") from None
        self._finished = False

    def append(self, rows: np.ndarray) -> None:
        """Add `rows`, shape (samples, columns)."""
        while len(rows):
            if self._count == len(self._waiting):
                self._write_group()
            piece = rows[: len(self._waiting) - self._count]
            self._waiting[self._count : self._count + len(piece)] = piece
            self._count += len(piece)
            rows = rows[len(piece) :]

    def finish(self, metadata: Mapping[str, Any]) -> None:
        """Write the rows that wait, add metadata and give the file its name."""
        self._write_group()
        self._writer.add_key_value_metadata({name: json.dumps(value) for name, value in metadata.items()})
        try:
            self._disk.before_write()
            self._writer.close()
            self._file.flush()
            put_in_place(self._part, self._path)
            self._file.close()
        except OSError as error:
            self._failure = InputError(f"run file {self._path} cannot be written: {error.strerror or error}")
            raise self._failure from None
        self._finished = True

    def _write_group(self) -> None:
        """Write the rows that wait."""
        if self._failure:  # the file may end in half a row group
            raise self._failure
        if not self._count:
            return
        try:
            self._disk.before_write()
            self._writer.write_table(pa.table(from_rows(self._waiting[: self._count]), schema=self._schema))
        except OSError as error:
            self._failure = InputError(f"run file {self._path} cannot be written: {error.strerror or error}")
            raise self._failure from None
        self._count = 0

    def __enter__(self) -> "RunWriter":
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        if not self._finished:
            with contextlib.suppress(OSError):  # the disk may be full
                self._writer.close()
            self._part.unlink(missing_ok=True)
            with contextlib.suppress(OSError):
                self._file.close()


def remove_dead_parts(folder: Path) -> None:
    """Remove unfinished run files, which are not readable, of killed writers in a folder."""
    for part in folder.glob("*.parquet.part"):
        with contextlib.suppress(OSError), part.open("rb") as file:
            fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
            part.unlink()


def read_run(path: Path | str, required: Sequence[str] = REQUIRED) -> Run:
    """Read a run, and check that it has the columns `required`. Raises InputError naming file, column and first bad row."""
    path = Path(path)
    run = read_columns(path)
    check_columns(path, run.columns, required)
    return run


def read_columns(path: Path, stretch: Stretch = WHOLE) -> Run:
    """Read the numeric columns of a run file, unchecked. The content decides the format; if it is ambiguous, the suffix does.

    stretch: the part to read; of a long Parquet run no more is held in memory. The metadata of a part name the run it is from.
    Raises InputError for a file that cannot be read, needs more memory than is allowed, or declares a unit that differs from
    the one in a column's name.
    """
    run = _read_file(path, stretch)
    if not stretch.is_whole:
        run = _cut(path, run, stretch)
    for name, unit in _UNITS.items():
        declared = run.units.get(name, "").strip()
        if declared not in _NO_UNIT and contradict(declared, unit):
            raise InputError(
                f"run {path}: column {name} has the unit {declared}; by its name it is in {unit}. Write the values in"
                f" {unit}, or read the file by a map of clutch-hil import"
            )
    return run


def _cut(path: Path, run: Run, stretch: Stretch) -> Run:
    """Return the rows of a run within `stretch`."""
    if not len(time := run[_TIME]):
        return run
    rows = stretch.find_rows(str(path), time)
    columns = {name: values[rows] for name, values in run.columns.items()}
    kept = columns[_TIME]
    part = {"of": path.name, "from_s": float(kept[0]), "to_s": float(kept[-1])}
    return replace(run, columns=columns, metadata={**run.metadata, PART: part})


def _read_file(path: Path, stretch: Stretch) -> Run:
    head, suffix = read_head(path, "run"), path.suffix.lower()
    if head.startswith(MAGIC):
        return measurement.read_mf4(path)
    if head.startswith(PARQUET):
        return _read_parquet(path, head, stretch)
    if head.startswith(_MATLAB) or 0 in head[:4]:  # level 4 begins with a small whole number of 32 bits
        return _read_matlab(path, head)
    if suffix in _KINDS or (suffix != ".mat" and 0 in head):  # a picture, an archive: no text has a zero
        raise _make_strange_error(path, head)
    return matlab.read_mat(path) if suffix == ".mat" else _read_csv(path)


def _read_matlab(path: Path, head: bytes) -> Run:
    """Read a file that begins like a MATLAB file. Any file may begin like level 4, so only the suffix identifies that level."""
    try:
        return matlab.read_mat(path)
    except InputError:
        if head.startswith(_MATLAB) or path.suffix.lower() == ".mat":
            raise
        raise _make_strange_error(path, head) from None


def _make_strange_error(path: Path, head: bytes) -> InputError:
    """Return the error for a file of unknown format."""
    if kind := _KINDS.get(path.suffix.lower()):
        return InputError(f"run {path} cannot be read: it is not a {kind} file, it begins with {head[:8]!r}")
    return InputError(
        f"run {path} is not a table of numbers: it begins with {head[:8]!r}; allowed are {join_names(SUFFIXES)},"
        " .mat; a recording of another tool becomes a run by clutch-hil import"
    )


def read_last_row(path: Path) -> tuple[list[str], int, np.ndarray]:
    """Return the column names of a Parquet run file, its number of rows, and its last row. Raises InputError."""
    with reading(path):
        file = pq.ParquetFile(path)
        count, groups = file.metadata.num_rows, file.num_row_groups
        table = file.read_row_group(groups - 1) if groups else file.schema_arrow.empty_table()
        last = [column[-1].as_py() for column in table.columns] if len(table) else []
    return table.column_names, count, np.array(last, float)


def check_suffix(path: Path) -> None:
    """Raise InputError if a run cannot be written in the format that the suffix of `path` names."""
    if path.suffix.lower() not in SUFFIXES:
        how = f"as {path.suffix!r}" if path.suffix else "under a name without suffix"
        raise InputError(f"run {path} cannot be written {how}; allowed are {join_names(SUFFIXES)}")


def write_run(run: Run, path: Path | str) -> None:
    """Write a run in the format that the suffix of `path` names; the file appears only when complete.

    Columns are written as 64-bit numbers. Raises InputError, also for a run that `read_run` would refuse.
    """
    if not isinstance(path, (str, PathLike)):
        raise InputError(f"path of a run to be written is {path!r:.60}; the path of a file is needed")
    path = Path(path)
    check_suffix(path)
    if not isinstance(run, Run):
        raise InputError(f"what is to be written to {path} is of the type {type(run).__name__}; a Run is needed")
    if odd := [key for key in run.metadata if not isinstance(key, str)]:
        raise InputError(f"metadata of run {path} have the key {odd[0]!r}; allowed are texts")
    run = run.with_numbers()
    check_columns(path, run.columns, ())
    try:
        json.dumps(dict(run.metadata))
    except (TypeError, ValueError) as error:
        raise InputError(f"metadata of run {path} cannot be written as JSON: {error}") from None
    if path.suffix.lower() == ".mf4":
        measurement.write_mf4(run, path)
    elif path.suffix.lower() == ".csv":
        with whole_file(path) as part:
            # from arrays of NumPy pyarrow would make it with pandas, which takes 0.2 s of CPU to load
            columns = from_rows(np.array(list(run.columns.values())).T)
            pyarrow.csv.write_csv(pa.table(columns, names=list(run.columns)), part)
    else:
        with RunWriter(path, run.describe_columns()) as writer:
            writer.append(np.column_stack(list(run.columns.values())))
            writer.finish(run.metadata)


def _read_csv(path: Path) -> Run:
    try:
        with path.open("rb") as file:  # each cell of text becomes a number of 8 bytes
            cells = sum(part.count(b",") + part.count(b"\n") for part in iter(lambda: file.read(_PART_BYTES), b""))
        check_rows(f"run {path} has", cells, 1)
        table = pyarrow.csv.read_csv(path)
    except (OSError, pa.ArrowException) as error:
        raise InputError(
            f"run {path} cannot be read: {error}; a recording of another tool becomes a run by clutch-hil import"
        ) from None
    return _from_table(path, table, {})


def _read_parquet(path: Path, head: bytes, stretch: Stretch) -> Run:
    file = ArrowFile(path, head)
    places = [
        k for k, (name, _) in enumerate(file.described) if _is_number(file.schema.field(k).type) or name in REQUIRED
    ]
    rows = slice(0, file.rows)
    if not stretch.is_whole and _TIME in file.schema.names:
        rows = stretch.find_rows(str(path), convert_numbers(file.read([file.schema.names.index(_TIME)])[0]))
    check_rows(f"run {path} has", rows.stop - rows.start, len(places), PART_ADVICE)
    columns = file.read(places) if stretch.is_whole else [_take(file.read([place])[0], rows) for place in places]
    schema = pa.schema([file.schema.field(k).with_type(c.type) for k, c in zip(places, columns, strict=True)])
    return _from_table(path, pa.table(columns, schema=schema), file.metadata)


def _take(column: pa.ChunkedArray, rows: slice) -> pa.ChunkedArray:
    """Return a copy of some rows of a column, so that the other rows need not stay in memory."""
    part = column.slice(rows.start, rows.stop - rows.start)
    return pa.chunked_array(from_rows(convert_numbers(part)[:, None])) if _is_number(part.type) else part


def _is_number(kind: pa.DataType) -> bool:
    return bool(pa.types.is_floating(kind) or pa.types.is_integer(kind))


def _from_table(path: Path, table: pa.Table, raw: Mapping[bytes, bytes]) -> Run:
    columns: dict[str, np.ndarray] = {}
    texts_by_key: dict[bytes, dict[str, str]] = {b"unit": {}, b"meaning": {}}
    for column, described in zip(table.columns, table.schema, strict=True):
        name = described.name
        if name in columns:
            raise InputError(f"run {path} has the column {name} twice")
        if _is_number(column.type):
            columns[name] = convert_numbers(column)
            for key, texts in texts_by_key.items():
                if text := (described.metadata or {}).get(key):
                    texts[name] = _decode_text(text)
        elif name in REQUIRED:
            raise InputError(f"run {path}: {name} is not a number in row {_find_first_text(column)}")
    return Run(columns, parse_metadata(raw), texts_by_key[b"unit"], texts_by_key[b"meaning"])


def parse_metadata(raw: Mapping[bytes, bytes]) -> dict[str, Any]:
    """Return the metadata of an Arrow table: JSON values by key, as in a Run."""
    return {_decode_text(k): parse_json(_decode_text(v)) for k, v in raw.items() if not k.startswith(b"ARROW")}


def check_columns(path: Path, columns: Mapping[str, np.ndarray], required: Sequence[str], steady: bool = True) -> None:
    """Check the columns of a run. Raises InputError naming `path`, column and first bad row.

    All columns must have the same length. Those `required`, and time, must exist and be finite. Time must increase; if
    `steady`, by equal steps.
    """
    run, required = name_run(str(path)), tuple(dict.fromkeys((_TIME, *required)))
    for name in required:
        if name not in columns:
            raise InputError(f"{run} lacks the column {name}")
    for name, values in columns.items():
        if len(values) != (rows := len(columns[_TIME])):
            raise InputError(f"{run}: {name} has {len(values)} rows, time_s has {rows}")
    for name in required:
        if len(bad := np.flatnonzero(~np.isfinite(columns[name]))):
            raise InputError(f"{run}: {name} is not a number in row {bad[0]}")
    time = columns[_TIME]
    if len(time) < 2:
        raise InputError(f"{run} has {len(time)} rows; at least 2 are needed")
    steps = np.diff(time)
    if len(bad := np.flatnonzero(steps <= 0.0)):
        raise InputError(f"{run}: time_s does not increase in row {bad[0] + 1}")
    if steady and len(bad := np.flatnonzero(np.abs(steps - steps[0]) > _TIME_TOLERANCE * steps[0])):
        raise InputError(
            f"{run}: the sample rate changes in row {bad[0] + 1}; a run has equal steps, to {100.0 * _TIME_TOLERANCE:g} %:"
            " import it with resample_hz in the map"
        )


def _decode_text(raw: bytes) -> str:
    return raw.decode(errors="replace")  # files of other programs may contain any bytes


def _find_first_text(column: pa.ChunkedArray) -> int:
    """Return the first row of a column whose cell is not a number."""
    for row, cell in enumerate(column.to_pylist()):
        try:
            float(cell)
        except (TypeError, ValueError):
            return row
    return 0
