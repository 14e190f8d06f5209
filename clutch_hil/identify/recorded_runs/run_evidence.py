"""Evidence of an identification: the usable part of the runs, and what was cut or replaced."""

import hashlib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np

from clutch_hil.bench.rig import find_rig, list_rigs
from clutch_hil.bench.run_file import read_run
from clutch_hil.bench.sealed import compute_checksum
from clutch_hil.fitting.model import Columns, Values
from clutch_hil.identify.recorded_runs.shaft_angle import complete_angle
from clutch_hil.identify.recorded_runs.slip_lag import add_slip_lag
from clutch_hil.recordings.checks.finding import Finding
from clutch_hil.recordings.checks.timing import cut_at_fault
from clutch_hil.recordings.checks.values import are_few, find_spikes
from clutch_hil.recordings.not_measured import NotMeasured, find_source, read_not_measured
from protocols.errors import InputError, format_count, name_run
from protocols.files.run import Run
from protocols.files.runs import check_columns

# Replacements of a missing sensor. docs/identify_method.md has results without each of them
_INSTEAD = {
    "clutch_torque_nm": "it may be missing if torque and speed demand of the motor were recorded",
    "cylinder_pressure_bar": "nothing can replace it",
    "motor_speed_demand_rad_s": "it may be missing if the clutch torque was recorded",
    "motor_torque_nm": "it may be missing if the clutch torque was recorded",
    "oil_temperature_degc": "without that sensor, set a `constant` temperature in the import map",
    "slip_speed_rad_s": "the derivative of an angle, or a difference of speeds, can replace it: `formula` in the import map",
    "valve_voltage_v": "only the valve's current can replace it, with `scale` in the import map",
}


@dataclass(frozen=True)
class Evidenced:
    """The usable part of the runs: columns and SHA-256 by run, and findings on what was cut.

    not_measured: by run, the columns that an import map set to a constant (number) or computed by a formula (text).
    """

    measured: Mapping[str, Columns]
    hashes: Mapping[str, str]
    findings: Sequence[Finding] = ()
    not_measured: Mapping[str, NotMeasured] = field(default_factory=dict)

    def find_constant(self, column: str) -> float | None:
        """Return the constant to which the import map sets a column in all runs (their mean); None where it is measured."""
        values = [given.get(column) for given in self.not_measured.values()]
        constants = [float(value) for value in values if isinstance(value, (int, float))]
        return float(np.mean(constants)) if constants and len(constants) == len(self.measured) else None

    def find_formula(self, column: str, of: str) -> str:
        """Return the name of a run whose `column` the import map computes from the column `of`; "" if there is none."""
        return next((name for name, given in self.not_measured.items() if find_source(given, column, {of})), "")


def read_evidence(
    runs: Sequence[Run | str | Path], rig: str, needed: Sequence[str], optional: Sequence[str] = ()
) -> Evidenced:
    """Read the runs, each up to its first fault.

    Raises InputError for a run of another rig than `rig`, for one without a column of `needed`, and for invalid columns. The
    `optional` columns are checked if present.
    """
    read: dict[str, Columns] = {}
    hashes: dict[str, str] = {}
    not_measured: dict[str, NotMeasured] = {}
    findings: list[Finding] = []
    for number, given in enumerate(runs, 1):
        if isinstance(given, Run):
            name, run = f"run {number}", given
            _check_rig(name, run, rig)
            columns = add_slip_lag(complete_angle(run.columns))
            counting = check_run_columns(Path(name), columns, needed, optional)
            hashes[name] = hashlib.sha256(
                b"".join(np.ascontiguousarray(columns[c]).tobytes() for c in counting)
            ).hexdigest()
        else:
            name = Path(given).name if Path(given).name not in read else str(given)  # same file name in another folder
            if name in read:
                raise InputError(f"run {given} was given twice; give it once")
            _check_rig(name, run := read_run(given, ()), rig)
            columns = add_slip_lag(complete_angle(run.columns))
            check_run_columns(Path(given), columns, needed, optional)
            hashes[name] = compute_checksum(Path(given))
        kept, cut = cut_at_fault(columns)
        if cut:
            findings.append(replace(cut, run=name))
            if len(kept["time_s"]) < 2:
                raise InputError(
                    f"{name_run(name)} is in a fault from its first rows on ({cut.column}); it cannot be used"
                )
        read[name] = kept
        not_measured[name] = read_not_measured(run)
    return Evidenced(read, hashes, findings, not_measured)


def check_run_columns(path: Path, columns: Columns, needed: Sequence[str], optional: Sequence[str] = ()) -> list[str]:
    """Check the columns of a run, and return the names of those that are used.

    Raises InputError for invalid or missing columns; the message names a replacement for a missing one.
    """
    for name in needed:
        _require(str(path), columns, name)
    counting = [*needed, *(name for name in optional if name in columns and name not in needed)]
    check_columns(path, columns, counting)
    return counting


def require_columns(runs: Evidenced, names: Sequence[str]) -> None:
    """Raise InputError for a run that lacks one of these columns; the message names a replacement."""
    for run, columns in runs.measured.items():
        for name in names:
            _require(run, columns, name)


def _require(run: str, columns: Columns, name: str) -> None:
    if name not in columns:
        instead = f"; {_INSTEAD[name]} (docs/identify.md#a-missing-sensor)" if name in _INSTEAD else ""
        raise InputError(f"{name_run(run)} lacks the column {name}{instead}")


def _check_rig(name: str, run: Run, rig: str) -> None:
    if (own := find_rig_name(run)) and own != rig:
        raise InputError(f"{name} is a run of the rig {own}, but {rig} is identified; allowed are runs of one rig")


def find_rig_name(run: Run) -> str:
    """Return the rig of a run if it can be identified; "" for any other run, such as an imported one."""
    name = str(run.metadata.get("rig", ""))
    return name if name in list_rigs() and (find_rig(name).identify_at or find_rig(name).model_at) else ""


def replace_spikes(name: str, run: Columns, floors: Values) -> tuple[Columns, list[Finding]]:
    """Replace single outliers of the outputs by the median of five rows. Return the run and the findings.

    Such samples are glitches of a logger. If there are many, they stay, and a check refuses the run. floors: noise by output.
    """
    changed: dict[str, np.ndarray] = {}
    findings = []
    for column, floor in floors.items():
        rows, medians = find_spikes(run[column], floor)
        if len(rows) and are_few(rows, run[column]):
            changed[column] = run[column].copy()
            changed[column][rows] = medians
            text = f"{format_count(len(rows), 'sample')} far from the neighbours: replaced by the median of five rows"
            findings.append(Finding("outliers", column, (int(rows[0]), int(rows[-1])), text, False, name))
    return {**run, **changed}, findings
