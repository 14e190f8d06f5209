"""Evidence of an identification: the runs as far as they count, and what was cut of them or replaced."""

import hashlib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from clutch_hil.bench.rig import find_rig, list_rigs
from clutch_hil.bench.run_file import read_run
from clutch_hil.bench.sealed import compute_checksum
from clutch_hil.fitting.model import Columns, Values
from clutch_hil.identify.shaft_angle import complete_angle
from clutch_hil.recordings.checks.finding import Finding
from clutch_hil.recordings.checks.timing import cut_at_fault
from clutch_hil.recordings.checks.values import MANY_SPIKES, find_spikes
from protocols.errors import InputError, name_run
from protocols.files.run import Run
from protocols.files.runs import check_columns

# What can take the place of a sensor that a rig does not have. docs/identify.md has what was measured with it
_INSTEAD = {
    "clutch_torque_nm": "without that sensor, give the motor's torque less inertia times acceleration of the slip",
    "oil_temperature_degc": "without that sensor, give one constant temperature, and hold the parameters of the oil",
    "motor_speed_demand_rad_s": "where it is not recorded, give the slip through a low pass, and believe no inertia",
    "valve_voltage_v": "nothing else can take its place but the valve's current, by `scale` of the import map",
}


@dataclass(frozen=True)
class Evidenced:
    """Runs as far as they count: columns and SHA-256 by name, and what was cut of them."""

    measured: Mapping[str, Columns]
    hashes: Mapping[str, str]
    findings: Sequence[Finding] = ()


def read_evidence(runs: Sequence[Run | str | Path], rig: str, needed: Sequence[str]) -> Evidenced:
    """Columns by name, as far as no run is in a fault. Raises InputError for a run of another rig than `rig`, and for one
    without the columns `needed`."""
    read: dict[str, Columns] = {}
    hashes: dict[str, str] = {}
    findings: list[Finding] = []
    for number, given in enumerate(runs, 1):
        if isinstance(given, Run):
            name, run = f"run {number}", given
            _check_rig(name, run, rig)
            columns = complete_angle(run.columns)
            _check_columns(Path(name), columns, needed)
            hashes[name] = hashlib.sha256(
                b"".join(np.ascontiguousarray(columns[c]).tobytes() for c in needed)
            ).hexdigest()
        else:
            name = Path(given).name if Path(given).name not in read else str(given)  # of another folder
            if name in read:
                raise InputError(f"run {given} is given twice; once is allowed")
            _check_rig(name, run := read_run(given, ()), rig)
            columns = complete_angle(run.columns)
            _check_columns(Path(given), columns, needed)
            hashes[name] = compute_checksum(Path(given))
        kept, cut = cut_at_fault(columns)
        if cut:
            findings.append(replace(cut, run=name))
            if len(kept["time_s"]) < 2:
                raise InputError(
                    f"{name_run(name)} is in a fault from its first rows on ({cut.column}); it is no evidence"
                )
        read[name] = kept
    return Evidenced(read, hashes, findings)


def _check_columns(path: Path, columns: Columns, needed: Sequence[str]) -> None:
    """Raise InputError for columns that are no run; where one of them is missing that can be replaced, it says by what."""
    for name in needed:
        if name not in columns and (instead := _INSTEAD.get(name)):
            raise InputError(
                f"{name_run(str(path))} lacks the column {name}; {instead} (docs/identify.md#a-missing-sensor)"
            )
    check_columns(path, columns, needed)


def _check_rig(name: str, run: Run, rig: str) -> None:
    if (own := find_rig_name(run)) and own != rig:
        raise InputError(f"{name} is a run of the rig {own}, and {rig} is identified; allowed are runs of one rig")


def find_rig_name(run: Run) -> str:
    """The rig of a run, where it can be identified; "" for any other run, such as an imported one."""
    name = str(run.metadata.get("rig", ""))
    return name if name in list_rigs() and (find_rig(name).identify_at or find_rig(name).model_at) else ""


def replace_spikes(name: str, run: Columns, floors: Values) -> tuple[Columns, list[Finding]]:
    """A run whose outputs have the median of five rows where single samples are far from their neighbours, as glitches of a
    logger are, and what was replaced. Where they are many they stay: a check refuses them. floors: of the outputs."""
    changed: dict[str, np.ndarray] = {}
    findings = []
    for column, floor in floors.items():
        rows, medians = find_spikes(run[column], floor)
        if 0 < len(rows) <= MANY_SPIKES * len(run[column]):
            changed[column] = run[column].copy()
            changed[column][rows] = medians
            text = f"{len(rows)} samples alone, far from their neighbours, are replaced by the median of five rows"
            findings.append(Finding("outliers", column, (int(rows[0]), int(rows[-1])), text, False, name))
    return {**run, **changed}, findings
