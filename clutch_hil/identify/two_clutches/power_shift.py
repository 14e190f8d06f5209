"""Identification of a power-shift rig: both clutches, driveline and hand-over from one set of runs, as one calibration.

1. Each clutch is identified like a single one (identification.py), with its measured slip as input, from the runs in which
   its valve opens.
2. Motor, vehicle and road are identified with the torques of both clutches as inputs (driveline.py).
3. Hand-overs are found in the runs; their pressures follow from the maps (hand_over.py).

Assumptions     errors of clutch a, clutch b and driveline are independent, because each has its own sensors and noise. So
                their correlation is 0
Not modelled    zero offsets of motor torque and drive speed; the frequency response of the pressure loops, because no brake
                keeps the plates sliding at one pressure for 3 s
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from time import monotonic

import numpy as np
from scipy.linalg import block_diag

from clutch_hil.bench.rig import find_rig
from clutch_hil.fitting.model import Columns
from clutch_hil.fitting.noise import estimate_floors
from clutch_hil.fitting.run_checks import list_findings
from clutch_hil.identify.behind_slip import FITTED_BEHIND_SLIP, drive_by_slip, fit_motor
from clutch_hil.identify.calibration import Calibration, Identified
from clutch_hil.identify.clutch_effects import DELAY, DRAG, PRESSURE, TORQUE, estimate_line
from clutch_hil.identify.clutch_fit import Progress
from clutch_hil.identify.controller_values import derive_controller_values
from clutch_hil.identify.fit_plan import Subject, Wishes, check_names, check_ties, take_wishes
from clutch_hil.identify.identification import Identification, identify_subject
from clutch_hil.identify.misfit import measure_misfit, warn_misfit
from clutch_hil.identify.recorded_runs.motor_limit import LIMIT, find_motor_limit
from clutch_hil.identify.recorded_runs.run_evidence import Evidenced, read_evidence
from clutch_hil.identify.thesis_quantities import Propagation, as_covariance
from clutch_hil.identify.two_clutches import driveline as shafts
from clutch_hil.identify.two_clutches.clutch_columns import COLUMNS, name_column, select_clutch_columns
from clutch_hil.identify.two_clutches.hand_over import HandOver, compute_pressures, find_hand_overs
from clutch_hil.recordings.checks.finding import Finding
from plant_sim.rigs.power_shift import NAME as RIG
from plant_sim.rigs.power_shift import select_clutch_parameters
from protocols.can.two_clutches import CLUTCHES
from protocols.errors import InputError, join_names
from protocols.files.parameters import ParameterSet
from protocols.files.run import Run
from protocols.node import load_node

NEEDED = (  # required columns of a run
    "time_s", "input_speed_demand_rad_s", "motor_torque_nm", *(name_column(n, c) for c in CLUTCHES for n in COLUMNS),
)  # fmt: skip
_EFFECTS = (PRESSURE, TORQUE, DELAY, DRAG)  # effects that are fitted for a clutch
_OPENS = 0.01  # V: above it the valve opens; a hundredth of the voltage that moves a piston


@dataclass(frozen=True)
class ShiftIdentification(Identification):
    """Identification of a power shift. parts: the identifications of clutch a and b by name. hand_overs: those of all runs."""

    parts: Mapping[str, Identification] = field(default_factory=dict)
    hand_overs: Sequence[HandOver] = ()


def identify_power_shift(
    runs: Sequence[Run | str | Path],
    *,
    hold: Mapping[str, float | None] | None = None,
    bounds: Mapping[str, tuple[float, float]] | None = None,
    ties: Mapping[str, str] | None = None,
    force: bool = False,
    progress: Progress = lambda what, share: None,
) -> ShiftIdentification:
    """Identify both clutches, driveline and hand-over of a power-shift rig from `runs`, in memory or by path.

    Arguments as for `identify_clutch`; parameter names are those of the rig, such as `a.clutch.attraction`. Raises InputError.
    """
    started = monotonic()
    if not runs:
        raise InputError("the identification has no runs; one or more are needed")
    whole = find_rig(RIG).plant.load_parameters()
    wishes = take_wishes(hold, bounds, ties, force)
    held = _check(wishes, whole)
    evidence = read_evidence(runs, RIG, NEEDED)
    given = {n: (held[n].value, "held by the user") for n in wishes.hold if n.partition(".")[0] not in CLUTCHES}
    limit, larger = find_motor_limit(evidence.measured, held[LIMIT].value, held[LIMIT].bounds[1])
    if larger:
        given[LIMIT] = limit, f"taken as {limit:.4g} Nm, by the largest torque of the runs"
        held = held.with_values({LIMIT: limit})
    parts = {}
    split = {clutch: _split(evidence, clutch) for clutch in CLUTCHES}
    for k, (clutch, own) in enumerate(split.items()):
        subject = Subject(
            RIG, fit_motor(select_clutch_parameters(whole, clutch), own.measured), find_rig(RIG).clutch_model,
            FITTED_BEHIND_SLIP, _EFFECTS, shows_response=False,
        )  # fmt: skip
        try:
            parts[clutch] = identify_subject(subject, own, _take_wishes(wishes, clutch), _take_part(progress, k))
        except InputError as error:
            raise InputError(f"clutch {clutch}: {error}") from None
    measured = {name: _remove_offsets(run, parts) for name, run in evidence.measured.items()}
    line = shafts.identify_driveline(
        measured, held, {n: value for n, (value, _) in given.items()}, wishes.bounds,
        lambda share: progress("driveline", 0.9 + 0.1 * share),
    )  # fmt: skip
    ratios = (line.values["driveline.ratio_a"], line.values["driveline.ratio_b"])
    hand_overs = [one for name, run in measured.items() for one in find_hand_overs(name, run, ratios, held[LIMIT].si)]
    calibration = _join(parts, line, whole, evidence, given, larger)
    if not hand_overs:
        text = "the hand-over needs a run in which the torque passes from clutch a to clutch b; these runs have none"
        calibration = replace(calibration, warnings=[*calibration.warnings, text])
    known = {clutch: part.propagation for clutch, part in parts.items()}
    quantities = [replace(q, name=f"{clutch}: {q.name}") for clutch, part in parts.items() for q in part.quantities] + [
        q for one in hand_overs for q in compute_pressures(one, known, ratios)
    ]
    simulated, units, misfit = _compare(evidence, parts, line)
    of_driveline = {o.column: misfit[o.column] for o in shafts.DrivelineModel.outputs if o.column in misfit}
    calibration = replace(calibration, warnings=[*calibration.warnings, *warn_misfit(of_driveline)])
    findings = [*larger, *(f for part in parts.values() for f in part.findings)]
    progress("done", 1.0)
    return ShiftIdentification(
        calibration, {n: {c: run[c] for c in ("time_s", *units)} for n, run in evidence.measured.items()}, simulated, units,
        misfit, findings, monotonic() - started, _propagate(calibration, whole),
        quantities, None, parts, hand_overs,
    )  # fmt: skip


def _take_part(progress: Progress, number: int) -> Progress:
    """Return the progress function for the fit of one clutch, which takes 45 % of the whole."""
    return lambda what, share: progress(f"clutch {CLUTCHES[number]}: {what}", 0.45 * (number + share))


def _check(wishes: Wishes, whole: ParameterSet) -> ParameterSet:
    """Check the wishes, and return the rig's parameters with the held values inserted.

    Raises InputError for an unknown name, a tie of parameters that are not of the same clutch, a value out of bounds,
    bounds of a parameter that is not fitted, and equal gear ratios.
    """
    check_names(whole, [*wishes.hold, *wishes.bounds, *wishes.ties, *wishes.ties.values()])
    for name, other in wishes.ties.items():
        if name.partition(".")[0] not in CLUTCHES or name.partition(".")[0] != other.partition(".")[0]:
            raise InputError(f"{name} is tied to {other}; allowed is another parameter of the same clutch")
    check_ties(wishes)
    could_be = [name for name in shafts.FITTED if name not in wishes.hold]
    if unfitted := [n for n in wishes.bounds if n.partition(".")[0] not in CLUTCHES and n not in could_be]:
        raise InputError(
            f"bounds of {unfitted[0]} have no effect, because it is not fitted; fitted are parameters of a clutch, and"
            f" {join_names(could_be)}"
        )
    held = whole.with_values({name: value for name, value in wishes.hold.items() if value is not None})
    a, b = (held[f"driveline.ratio_{clutch}"].value for clutch in CLUTCHES)
    if a == b:
        raise InputError(f"driveline.ratio_a and driveline.ratio_b are both {a:g}; two gears must differ")
    return held


def _take_wishes(wishes: Wishes, clutch: str) -> Wishes:
    """Return the wishes for one clutch, with the parameter names of the wet-clutch rig."""
    start = f"{clutch}."

    def own(values: Mapping) -> dict:
        return {name.removeprefix(start): value for name, value in values.items() if name.startswith(start)}

    ties = {name: other.removeprefix(start) for name, other in own(wishes.ties).items()}
    return Wishes(own(wishes.hold), own(wishes.bounds), ties, wishes.force)


def _split(evidence: Evidenced, clutch: str) -> Evidenced:
    """Return the runs in which the valve of a clutch opens, as wet-clutch runs with the slip as motor speed. Raises
    InputError."""
    measured = {}
    for name, run in evidence.measured.items():
        if np.max(run[f"valve_voltage_{clutch}_v"]) < _OPENS:
            continue
        measured[name] = drive_by_slip(select_clutch_columns(run, clutch))
    if not measured:
        raise InputError(
            f"the runs do not open the valve of clutch {clutch}; runs in which it carries torque are needed"
        )
    findings = [f for f in evidence.findings if f.run in measured]
    return Evidenced(measured, {name: evidence.hashes[name] for name in measured}, findings)


def estimate_clutch_line(run: Columns, clutch: str) -> tuple[float, float]:
    """Return slope [Nm/bar] and contact pressure [bar] of a clutch from a run with a pressure staircase. Raises InputError."""
    own = _split(Evidenced({"": run}, {"": ""}), clutch).measured[""]
    line = estimate_line([own])
    if line is None:
        raise InputError(f"clutch {clutch} shows no torque that rises with the pressure: no contact pressure was found")
    return line


def _remove_offsets(run: Columns, parts: Mapping[str, Identification]) -> Columns:
    """Return a run with the identified torque sensor offsets subtracted."""
    offsets = {c: part.propagation.values[TORQUE] for c, part in parts.items()}
    return {**run, **{f"clutch_torque_{c}_nm": run[f"clutch_torque_{c}_nm"] - offset for c, offset in offsets.items()}}


def _join(
    parts: Mapping[str, Identification],
    line: shafts.Driveline,
    whole: ParameterSet,
    evidence: Evidenced,
    given: Mapping[str, tuple[float, str]],
    larger: Sequence[Finding],
) -> Calibration:
    """Return one calibration of both clutches and the driveline. given: held values of driveline and motor, with their
    reasons."""
    parameters = [
        replace(p, name=f"{clutch}.{p.name}") for clutch, part in parts.items() for p in part.calibration.parameters
    ] + [
        Identified(name, line.values[name], float(half), whole[name].unit, whole[name].value)
        for name, half in zip(line.fitted, line.half, strict=True)
    ]

    def each(of: str) -> dict:
        return {f"{c}.{n}": v for c, part in parts.items() for n, v in getattr(part.calibration, of).items()}

    notes = list_findings(larger)
    notes += [f"clutch {c}: {note}" for c, part in parts.items() for note in part.calibration.notes]
    if line.left_out:
        notes.append(f"driveline: {line.left_out} means over 4 ms are outliers and were left out")
    controllers = [_compute_controller_values(parts[c], line, whole, c) for c in CLUTCHES]
    return Calibration(
        rig=RIG,
        parameters=parameters,
        controller=controllers[0],
        controller_b=controllers[1],
        correlation=block_diag(*(part.calibration.correlation for part in parts.values()), line.correlation),
        runs=evidence.hashes,
        held=each("held")
        | shafts.HELD
        | {n: why for n, (_, why) in given.items()}
        | dict.fromkeys(line.silent, "the runs do not excite it"),
        warnings=[
            *(f"clutch {c}: {text}" for c, part in parts.items() for text in part.calibration.warnings),
            *dict.fromkeys(line.silent.values()),
        ],
        notes=notes,
        absent=[replace(p, name=f"{c}.{p.name}") for c, part in parts.items() for p in part.calibration.absent],
        fixed=each("fixed") | {n: one for n, one in given.items() if one[0] != whole[n].value},
    )


def _compute_controller_values(
    part: Identification, line: shafts.Driveline, whole: ParameterSet, clutch: str
) -> dict[str, tuple[float, str]]:
    """Return the values of one clutch's controller: those for a single clutch, and both gear ratios."""
    controller = load_node("controller")().parameters
    nominal = {name: p.value for name, p in select_clutch_parameters(whole, clutch).items()}
    motor = {name: value for name, value in line.values.items() if name.startswith("motor.")}
    values = derive_controller_values({**part.propagation.values, **motor}, nominal, controller)
    return values | {n: (line.values[n], "the gear of the plant") for n in ("driveline.ratio_a", "driveline.ratio_b")}


def _propagate(calibration: Calibration, whole: ParameterSet) -> Propagation:
    """Return all parameters of the rig with the covariance of the identified ones."""
    values = {name: p.value for name, p in whole.items()} | {n: v for n, (v, _) in calibration.fixed.items()}
    values |= {p.name: p.value for p in calibration.parameters}
    half = np.array([p.half for p in calibration.parameters])
    return Propagation(values, [p.name for p in calibration.parameters], as_covariance(half, calibration.correlation))


def _compare(
    evidence: Evidenced, parts: Mapping[str, Identification], line: shafts.Driveline
) -> tuple[dict[str, Columns], dict[str, str], dict[str, float]]:
    """Return simulated columns by run, units, and root mean square residual over noise, by output with the rig's column
    names."""
    names = {c: {column: name_column(column, c) for column in part.units} for c, part in parts.items()}
    units = {names[c][column]: unit for c, part in parts.items() for column, unit in part.units.items()}
    misfit = {names[c][column]: share for c, part in parts.items() for column, share in part.misfit.items()}
    simulated: dict[str, Columns] = {}
    for name, run in evidence.measured.items():
        shown = {column: np.full(len(run["time_s"]), np.nan) for column in units}
        for c, part in parts.items():
            if name in part.simulated:
                shown |= {names[c][column]: values for column, values in part.simulated[name].items()}
        simulated[name] = shown | dict(line.simulated.get(name, {}))
    if line.simulated:
        outputs = shafts.DrivelineModel.outputs
        units |= {o.column: o.unit for o in outputs}
        floors = estimate_floors(list(evidence.measured.values()), outputs)
        for o in outputs:
            misfit[o.column] = measure_misfit(o, evidence.measured, line.simulated, floors[o.column])
    return simulated, units, misfit
