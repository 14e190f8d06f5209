"""SlideRecord: position, force and load of a sliding contact in SI, from the columns of any run.

Units           of a column: as the user says (`COLUMN:mm`), else the run's own, else in brackets in its name (`Force [uN]`),
                else the end of its name (`force_kn`). A unit with a minus (`COLUMN:-N`) reverses the sign
Families        position in m and force in N, or angle in rad and torque in Nm; load in N, Nm or Pa
Rate            columns are brought to one constant rate as in an import map (`recordings/rasters.py`); gaps cut a record
"""

import hashlib
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np

from clutch_hil.bench.sealed import compute_checksum
from clutch_hil.recordings.checks.finding import refuse_hard
from clutch_hil.recordings.checks.knowledge import Knowledge, Recorded
from clutch_hil.recordings.checks.values import find_wrapped
from clutch_hil.recordings.import_map import ImportMap
from clutch_hil.recordings.measured_motion import compute_path as hold
from clutch_hil.recordings.measured_motion import smooth
from clutch_hil.recordings.rasters import ANTI_ALIAS_SHARE, Sampling, TimedColumn, join
from protocols.errors import InputError, name_run, suggest_closest
from protocols.files.run import Run
from protocols.files.runs import read_columns
from protocols.files.units import have_same_quantity, to_si

LEAST_SAMPLES = 100  # of a record: chosen, ten for each of the ten parameters that a law may have
LARGEST = 1e15  # of any value, in SI: chosen, far beyond every rig; squares of it are still numbers
WINDOW = 5  # samples of the quartic that gives speed and acceleration: the least, as in `position_axis_model.toml`
FLICKER_SIGMAS = 3.0  # of the position's noise that are held: 99.7 % of it
_FIFTH_DIFFERENCE = 252.0**0.5  # gain of a fifth difference on white noise: the root of the sum of its squares
# Names without unit by which a column is recognised, the first that a run has counts
NAMES: Mapping[str, tuple[str, ...]] = {
    "position": ("position", "displacement", "angle", "shaft_angle", "slide_position"),
    "speed": ("speed", "velocity", "slip_speed"),
    "force": ("friction_force", "motor_force", "rod_force", "force", "friction_torque", "motor_torque", "torque"),
    "load": ("normal_load", "load", "normal_force", "pressure"),
    "gap": ("gap", "lift", "separation"),
}
# Units of each, in SI: the first of a pair goes with the first of the others
_FAMILIES: Mapping[str, tuple[str, ...]] = {
    "position": ("m", "rad"), "speed": ("m/s", "rad/s"), "force": ("N", "Nm"), "load": ("N", "Nm", "Pa"), "gap": ("m",),
}  # fmt: skip
# End of a column's name -> its unit; `recordings.foreign_column.UNITS` has those of run files
_ENDS = {
    "m_s": "m/s", "mm_s": "mm/s", "um_s": "um/s", "rad_s": "rad/s", "deg_s": "deg/s", "rpm": "rpm", "m": "m", "cm": "cm",
    "mm": "mm", "um": "um", "rad": "rad", "mrad": "mrad", "deg": "deg", "n": "N", "kn": "kN", "mn": "mN", "un": "uN",
    "nm": "Nm", "knm": "kNm", "mnm": "mNm", "bar": "bar", "mbar": "mbar", "pa": "Pa", "kpa": "kPa", "mpa": "MPa", "psi": "psi",
    "s": "s", "ms": "ms", "us": "us", "v": "V", "a": "A", "degc": "degC", "1": "1", "hz": "Hz", "w": "W",
}  # fmt: skip


@dataclass(frozen=True)
class Columns:
    """Which columns to use, each `COLUMN` or `COLUMN:UNIT`; "" for the one that is recognised by its name."""

    position: str = ""
    force: str = ""
    load: str = ""
    speed: str = ""
    time: str = ""


@dataclass(frozen=True)
class SlideRecord:
    """One record without gaps: `position` [m or rad], `force` [N or Nm], `load` [its unit], all (n,), every `period` [s].

    `source` names the file and the span, `digest` is its SHA-256 (of the values where there is no file). `units` of position,
    force and load; the load's is "" and its values are 1 where none was measured. `low_pass` [Hz]: of all three, 0 for none.
    """

    source: str
    digest: str
    period: float
    position: np.ndarray
    force: np.ndarray
    load: np.ndarray
    units: tuple[str, str, str]
    low_pass: float = 0.0
    speed: np.ndarray = field(init=False)
    acceleration: np.ndarray = field(init=False)
    flicker: float = field(init=False)

    def __post_init__(self) -> None:
        moved = smooth(self.position, self.period, WINDOW * self.period)
        object.__setattr__(self, "speed", moved.speed)
        object.__setattr__(self, "acceleration", moved.acceleration)
        differences = np.abs(np.diff(self.position, 5)) / _FIFTH_DIFFERENCE
        object.__setattr__(self, "flicker", FLICKER_SIGMAS * float(np.quantile(differences, 0.683)))

    @property
    def size(self) -> int:
        """Samples n."""
        return self.position.size

    @property
    def loaded(self) -> bool:
        """Whether a load was measured."""
        return bool(self.units[2])

    @property
    def path(self) -> np.ndarray:
        """The position (n,) without the flicker of its last digits, which would be reversals."""
        steps = hold(self.position, self.period, self.flicker).speed * self.period
        return np.asarray(self.position[0] + np.cumsum(steps))


def read_records(
    runs: Sequence[Path | str | Run],
    columns: Columns | None = None,
    import_map: ImportMap | None = None,
    sampling: Sampling | None = None,
) -> list[SlideRecord]:
    """The records of `runs`, files or runs in memory; those of foreign files by an `import_map`. Raises InputError."""
    if not runs:
        raise InputError("no run was given; one or more is needed")
    records: list[SlideRecord] = []
    for number, run in enumerate(runs, 1):
        if isinstance(run, Run):
            records += _from_run(f"run {number}", "", run, columns or Columns(), sampling or Sampling())
            continue
        path, imported = Path(run), import_map.sampling.low_pass_hz if import_map else 0.0
        own = import_map.read_runs(path) if import_map else [read_columns(path)]
        digest = compute_checksum(path)
        for one in own:
            records += _from_run(str(path), digest, one, columns or Columns(), sampling or Sampling(), imported)
    units = {record.units for record in records}
    if len(units) > 1:
        shown = "; ".join(sorted(", ".join(filter(None, one)) for one in units))
        raise InputError(f"runs are of different quantities ({shown}); allowed are runs of one rig")
    return records


def _from_run(
    name: str, digest: str, run: Run, columns: Columns, sampling: Sampling, imported: float = 0.0
) -> list[SlideRecord]:
    """The records of one run; `imported`: limit of the low pass [Hz] that its import map has applied already."""
    if not run.columns:
        raise InputError(
            f"{name_run(name)} has no columns with names; read it with a map, of which `clutch-hil import --draft`"
            " writes a draft"
        )
    time, _ = _take(name, run, "time", columns.time or "time_s")
    force, force_unit = _need(name, run, "force", columns.force)
    load = find_column(name, run, "load", columns.load)
    position = find_column(name, run, "position", columns.position)
    if position is None:
        speed = find_column(name, run, "speed", columns.speed)
        if speed is None:
            raise InputError(
                f"{name_run(name)} has no column with a known name for position or speed; {_describe_choice(run)}"
            )
        way = np.concatenate([[0.0], np.cumsum(0.5 * (speed[0][1:] + speed[0][:-1]) * np.diff(time))])
        position = way, _FAMILIES["position"][_FAMILIES["speed"].index(speed[1])]
    if _FAMILIES["position"].index(position[1]) != _FAMILIES["force"].index(force_unit):
        raise InputError(
            f"{name_run(name)} has a position in {position[1]} and a force in {force_unit}; allowed are m and N, or rad and Nm"
        )
    values = {"position": position[0], "force": force, **({"load": load[0]} if load else {})}
    check_values(name, time, values)
    angle = Recorded(name, {"time_s": time, "position": position[0]}, {"position": Knowledge(position[1])})
    refuse_hard([replace(finding, run=name) for finding in find_wrapped(angle)], "")
    pieces, _ = join(Path(name), [TimedColumn(n, time, v) for n, v in values.items()], sampling)
    units = (position[1], force_unit, load[1] if load else "")
    thinned = ANTI_ALIAS_SHARE * sampling.resample_hz
    limits = [limit for limit in (imported, sampling.low_pass_hz, thinned) if limit]
    return [_make_record(name, digest, piece, units, len(pieces), min(limits, default=0.0)) for piece in pieces]


def _make_record(
    name: str, digest: str, piece: Mapping[str, np.ndarray], units: tuple[str, str, str], pieces: int, low_pass: float
) -> SlideRecord:
    time = piece["time_s"]
    source = name if pieces == 1 else f"{name}, {time[0]:.4g} to {time[-1]:.4g} s"
    steps = np.diff(time)
    if time.size < LEAST_SAMPLES:
        raise InputError(f"{name_run(source)} has {time.size} rows; {LEAST_SAMPLES} or more are needed")
    if float(np.ptp(steps)) > 0.02 * float(steps.mean()):  # 2 %: decimal seconds of a file
        raise InputError(
            f"{name_run(source)} has steps of {steps.min():.4g} to {steps.max():.4g} s; set a rate for resampling"
        )
    position, force = (np.ascontiguousarray(piece[one], float) for one in ("position", "force"))
    for what, column, unit in (("position", position, units[0]), ("force", force, units[1])):
        if float(np.ptp(column)) == 0.0:
            raise InputError(f"{name_run(source)}: the {what} stays at {column[0]:g} {unit}; it must change")
    load = np.ascontiguousarray(piece.get("load", np.ones(time.size)), float)
    if (low := float(load.min())) < 0.0:
        if low < -0.05 * float(np.abs(load).max()):  # 5 %: chosen, the zero of a load cell
            raise InputError(
                f"{name_run(source)}: the load falls to {low:g} {units[2]}; allowed is 0 or more, see COLUMN:-UNIT"
            )
        load = np.maximum(load, 0.0)
    own = digest or hashlib.sha256(b"".join(c.tobytes() for c in (position, force, load))).hexdigest()
    return SlideRecord(source, own, float(steps.mean()), position, force, load, units, low_pass)


def check_values(name: str, time: np.ndarray, values: Mapping[str, np.ndarray]) -> None:
    """Raise InputError for what is no number or too large, and for times that do not rise."""
    if time.size < LEAST_SAMPLES:
        raise InputError(f"{name_run(name)} has {time.size} rows; {LEAST_SAMPLES} or more are needed")
    for what, column in {"time": time, **values}.items():
        if (bad := np.flatnonzero(~np.isfinite(column))).size:
            raise InputError(f"{name_run(name)}: the {what} is not a number in row {bad[0]}")
        if (bad := np.flatnonzero(np.abs(column) > LARGEST)).size:
            raise InputError(
                f"{name_run(name)}: the {what} is {column[bad[0]]:.3g} in row {bad[0]}; allowed is up to {LARGEST:g} in SI"
                " units"
            )
        if column.size != time.size:
            raise InputError(f"{name_run(name)}: the {what} has {column.size} rows, the time has {time.size}")
    if (bad := np.flatnonzero(np.diff(time) <= 0.0)).size:
        raise InputError(f"{name_run(name)}: the time does not increase in row {bad[0] + 1}")


def _need(name: str, run: Run, what: str, chosen: str) -> tuple[np.ndarray, str]:
    column = find_column(name, run, what, chosen)
    if column is None:
        raise InputError(f"{name_run(name)} has no column with a known name for the {what}; {_describe_choice(run)}")
    return column


def _describe_choice(run: Run) -> str:
    return f"choose its columns by --position, --speed, --force, --load or --gap: {', '.join(run.columns)}"


def find_column(name: str, run: Run, what: str, chosen: str) -> tuple[np.ndarray, str] | None:
    """The column of `what`, in SI, and its SI unit; None where the run has none and none was chosen."""
    if chosen:
        return _take(name, run, what, chosen)
    for stem in NAMES[what]:
        for column in run.columns:
            end = column.lower()[len(stem) :]
            if column.lower().startswith(stem) and (
                not end or end.lstrip("_ ") in _ENDS or end.lstrip("_ ")[:1] in "[("
            ):
                return _take(name, run, what, column)
    return None


def _take(name: str, run: Run, what: str, chosen: str) -> tuple[np.ndarray, str]:
    """Column `chosen`, `COLUMN` or `COLUMN:UNIT`, in SI, and its SI unit. Raises InputError."""
    column, unit = (
        (chosen, "") if chosen in run.columns else chosen.rpartition(":")[::2] if ":" in chosen else (chosen, "")
    )
    if column not in run.columns:
        raise InputError(
            f"{name_run(name)} has no column {column!r} for the {what}; {suggest_closest(column, run.columns)}"
        )
    sign = -1.0 if unit.startswith("-") else 1.0
    unit = unit.removeprefix("-").strip() or _find_unit(name, run, what, column)
    for si in ("s",) if what == "time" else _FAMILIES[what]:
        if have_same_quantity(unit, si):
            one, zero = to_si(1.0, unit), to_si(0.0, unit)
            return sign * ((one - zero) * np.asarray(run.columns[column], float) + zero), si
    allowed = " or ".join(("s",) if what == "time" else _FAMILIES[what])
    raise InputError(
        f"{name_run(name)}: column {column!r} for the {what} is in {unit!r}; allowed is what can be converted into {allowed}"
    )


def _find_unit(name: str, run: Run, what: str, column: str) -> str:
    if known := run.units.get(column, ""):
        return known
    if bracket := re.search(r"[\[(]\s*([^\])]+?)\s*[\])]\s*$", column):
        return bracket.group(1)
    words = column.lower().split("_")
    for end in ("_".join(words[-2:]), words[-1]):
        if end in _ENDS and len(words) > 1:
            return _ENDS[end]
    raise InputError(f"{name_run(name)} states no unit of {column!r} for the {what}; give it as {column}:UNIT")
