"""ImportMap: how the columns of a foreign file become those of a run. One TOML file:

    notes = "where the data come from"

    [file]                        # all optional
    delimiter = "\\t"              # of a text file; a comma for .csv, else a tab
    header = false                # its first line is data
    skip_rows = 15                # rows of data to leave out
    low_pass_hz = 40.0            # all columns alike, Butterworth of order 4 forwards and backwards: no delay
    resample_hz = 250.0           # straight lines between samples, where the rate is not constant or is too high
    from_s = 0.1                  # part of the record to keep
    to_s = 24.7

    [columns]                     # ours = the foreign one, in its unit
    position_m = { from = "qm", unit = "m" }
    motor_force_n = { from = "vir", unit = "N", scale_by = "gtau" }  # times a number that the file has
    friction_force_n = { number = 4, unit = "uN", scale = -1.0 }     # the fourth column, times a number

The unit of our column is the end of its name. The metadata `import` of the run say what was done to the data.
"""

import contextlib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from math import inf
from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.csv
from scipy.signal import butter, sosfiltfilt

from protocols.errors import InputError, closest
from protocols.files.run import Run
from protocols.files.runs import check_columns, read_columns
from protocols.files.toml_table import TomlTable, read_toml
from protocols.files.units import from_si, same_quantity, to_si

MAPS = Path(__file__).parent / "maps"
TEXT_SUFFIXES = (".csv", ".txt", ".tsv", ".dat")
_FILE_KEYS = ("delimiter", "header", "skip_rows", "low_pass_hz", "resample_hz", "from_s", "to_s")
_FILTER_ORDER = 4  # of the low pass, as is usual before inverse dynamics: Gautier 1997
_PERIOD_TOLERANCE = 0.01  # of the median step: as protocols/files/runs.py
# End of a column's name -> its unit (docs/rig.md, "Signals of a recorded run")
_UNITS = {
    "s": "s", "v": "V", "rad": "rad", "rad_s": "rad/s", "bar": "bar", "degc": "degC", "nm": "Nm", "n": "N", "m": "m",
    "m_s": "m/s", "a": "A", "w": "W", "hz": "Hz", "1": "1",
}  # fmt: skip


@dataclass(frozen=True)
class ForeignColumn:
    """A foreign column: its name, or its number from 1.

    scale: factor. scale_by: name of a further factor in the file, "" for none.
    """

    column: str | int
    unit: str
    scale: float
    scale_by: str


@dataclass(frozen=True)
class ImportMap:
    """How the columns of a foreign file become those of a run; fields as in the TOML file, see above.

    low_pass_hz, resample_hz [Hz]: 0 leaves the data as they are.
    """

    name: str
    notes: str
    columns: Mapping[str, ForeignColumn]
    delimiter: str
    header: bool
    skip_rows: int
    low_pass_hz: float
    resample_hz: float
    from_s: float
    to_s: float

    def cut(self, from_s: float | None, to_s: float | None) -> "ImportMap":
        """This map for the part of the record from `from_s` to `to_s` [s]; None keeps an end."""
        return replace(self, from_s=self.from_s if from_s is None else from_s, to_s=self.to_s if to_s is None else to_s)

    def read(self, path: Path, required: Sequence[str] = ()) -> Run:
        """The run in the foreign file `path`; it must have the columns `required`.

        Raises InputError naming the column and its first bad row.
        """
        raw = self._read_raw(path)
        rows = slice(self.skip_rows, None)
        columns = {name: self._convert(path, raw, name, source)[rows] for name, source in self.columns.items()}
        wanted = tuple(dict.fromkeys((*columns, *required)))
        check_columns(path, columns, wanted, steady=self.low_pass_hz > 0.0 or self.resample_hz == 0.0)
        columns, done = self._condition(path, columns)
        check_columns(path, columns, wanted)
        units = {name: _unit_of(name) for name in columns}
        origin = {"from": path.name, "map": self.name, "notes": self.notes, "done": done}
        return Run(columns, {**raw.metadata, "import": origin}, units)

    def _read_raw(self, path: Path) -> Run:
        if path.suffix not in TEXT_SUFFIXES:
            return read_columns(path)
        delimiter = self.delimiter or ("," if path.suffix == ".csv" else "\t")
        try:
            table = pyarrow.csv.read_csv(
                path,
                read_options=pyarrow.csv.ReadOptions(autogenerate_column_names=not self.header),
                parse_options=pyarrow.csv.ParseOptions(delimiter=delimiter),
            )
        except FileNotFoundError:
            raise InputError(f"run {path} does not exist") from None
        except (OSError, pa.ArrowException) as error:
            raise InputError(f"run {path} cannot be read: {error}") from None
        return Run(
            {name: _parse_numbers(column) for name, column in zip(table.column_names, table.columns, strict=True)}, {}
        )

    def _convert(self, path: Path, raw: Run, name: str, source: ForeignColumn) -> np.ndarray:
        known, column = list(raw.columns), source.column
        if isinstance(column, int):
            if not 1 <= column <= len(known):
                raise InputError(f"run {path} has {len(known)} columns; {name} is asked for as number {column}")
            column = known[column - 1]
        if column not in raw.columns:
            raise InputError(f"run {path} has no column {column!r} for {name}; {closest(column, known)}")
        scale = source.scale
        if source.scale_by:
            factor = raw.metadata.get(source.scale_by)
            if not isinstance(factor, (int, float)):
                raise InputError(f"run {path} has no number {source.scale_by!r} to scale {name} by")
            scale *= factor
        return np.asarray(from_si(to_si(scale * raw.columns[column], source.unit), _unit_of(name)))  # type: ignore[arg-type]

    def _condition(self, path: Path, columns: dict[str, np.ndarray]) -> tuple[dict[str, np.ndarray], list[str]]:
        """Columns after filter, resampling and cut, and a list of what was done."""
        done = []
        time = columns["time_s"]
        if self.skip_rows:
            done.append(f"left out the first {self.skip_rows} rows")
        if self.low_pass_hz:
            nyquist = 0.5 / (time[1] - time[0])
            if not self.low_pass_hz < nyquist:
                raise InputError(
                    f"{self.name}: low_pass_hz is {self.low_pass_hz:g}; allowed is below {nyquist:g} for {path}"
                )
            low = butter(_FILTER_ORDER, self.low_pass_hz / nyquist, output="sos")
            columns = {n: c if n == "time_s" else sosfiltfilt(low, c) for n, c in columns.items()}
            done.append(f"low-passed all columns at {self.low_pass_hz:g} Hz, forwards and backwards")
        if self.resample_hz:
            steps = np.diff(time)
            median = float(np.median(steps))
            odd = int(np.sum(np.abs(steps - median) > _PERIOD_TOLERANCE * median))
            grid = time[0] + np.arange(int((time[-1] - time[0]) * self.resample_hz + 1e-6) + 1) / self.resample_hz
            columns = {n: grid if n == "time_s" else np.interp(grid, time, c) for n, c in columns.items()}
            done.append(
                f"resampled at {self.resample_hz:g} Hz from {1.0 / median:.4g} Hz: {odd} of {steps.size} steps differed from"
                f" {1e3 * median:.4g} ms, the longest was {1e3 * steps.max():.4g} ms"
            )
        kept = (columns["time_s"] >= self.from_s) & (columns["time_s"] <= self.to_s)
        if not kept.all():
            done.append(f"kept {self.from_s:g} to {min(self.to_s, columns['time_s'][-1]):g} s")
        return {n: c[kept] for n, c in columns.items()}, done


def load_map(name: str) -> ImportMap:
    """The map in the TOML file `name`, or one of this package by name (`emps`). Raises InputError."""
    path = Path(name)
    if not path.suffix:
        known = sorted(p.stem for p in MAPS.glob("*.toml"))
        if name not in known:
            raise InputError(f"import map {name!r} is unknown; {closest(name, known)}, or give a TOML file")
        path = MAPS / f"{name}.toml"
    document = read_toml(path, ("notes", "file", "columns"))
    file, columns = document.table("file", _FILE_KEYS), document.table("columns")
    keys = ("from", "number", "unit", "scale", "scale_by")
    sources = {column: _read_column(column, columns.table(column, keys)) for column in columns}
    for column in sources:
        _unit_of(column)
    if "time_s" not in sources:
        raise InputError(f"import map {path} has no column time_s")
    low_pass, resample = (file.get(key, float, 0.0) for key in ("low_pass_hz", "resample_hz"))
    skip = file.get("skip_rows", int, 0)
    for key, value in (("low_pass_hz", low_pass), ("resample_hz", resample), ("skip_rows", skip)):
        if value < 0:
            raise InputError(f"import map {path}: {key} is {value:g}; allowed is 0 or more")
    return ImportMap(
        name=path.stem, notes=document.get("notes", str, ""), columns=sources, delimiter=file.get("delimiter", str, ""),
        header=file.get("header", bool, True), skip_rows=skip, low_pass_hz=low_pass, resample_hz=resample,
        from_s=file.get("from_s", float, -inf), to_s=file.get("to_s", float, inf),
    )  # fmt: skip


def _read_column(column: str, entry: TomlTable) -> ForeignColumn:
    if ("from" in entry) == ("number" in entry):
        raise InputError(f"import map: {column} needs either `from`, a name, or `number`, counted from 1")
    unit = entry.need("unit", str)
    if not same_quantity(unit, _unit_of(column)):
        raise InputError(
            f"import map: {column} is given in {unit!r}, which cannot be converted into {_unit_of(column)!r}"
        )
    return ForeignColumn(
        entry.get("from", str) if "from" in entry else entry.get("number", int),
        unit,
        entry.get("scale", float, 1.0),
        entry.get("scale_by", str, ""),
    )


def _parse_numbers(column: pa.ChunkedArray) -> np.ndarray:
    """A column as numbers (n,); a cell that is none becomes not-a-number, which the checks of a run refuse by its row."""
    if pa.types.is_floating(column.type) or pa.types.is_integer(column.type):
        return column.to_numpy().astype(float)
    numbers = np.full(len(column), np.nan)
    for row, cell in enumerate(column.to_pylist()):
        with contextlib.suppress(TypeError, ValueError):
            numbers[row] = float(cell)
    return numbers


def _unit_of(column: str) -> str:
    """Unit of one of our columns, by the end of its name."""
    words = column.split("_")
    for end in ("_".join(words[-2:]), words[-1]):
        if end in _UNITS and len(words) > 1:
            return _UNITS[end]
    raise InputError(f"column {column!r} tells no unit; allowed ends are {', '.join('_' + end for end in _UNITS)}")
