"""Identification: from recorded runs of a clutch to the calibration of its model and its controller."""

import hashlib
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from time import monotonic

import numpy as np

from clutch_hil.bench.rig import DEFAULT_RIG, find_rig
from clutch_hil.bench.run_file import read_run
from clutch_hil.bench.sealed import compute_checksum
from clutch_hil.fitting.evidence import Evidence
from clutch_hil.fitting.fit import FreeParameter
from clutch_hil.fitting.intervals import NORMAL_95
from clutch_hil.fitting.model import Columns, Model, Values
from clutch_hil.fitting.noise import estimate_floors
from clutch_hil.fitting.run_checks import check_evidence
from clutch_hil.identify.calibration import Calibration, Identified
from clutch_hil.identify.clutch_effects import (
    EFFECTS,
    PRESSURE,
    choose_absent,
    correct_offsets,
    declare_effects,
    estimate_effects,
    widen_interval,
)
from clutch_hil.identify.clutch_parameters import (
    FITTED,
    HELD,
    NEEDS,
    FittedModel,
    compute_viscous_scale,
    from_fit,
    tie,
    to_fit,
)
from clutch_hil.identify.controller_values import derive_controller_values
from clutch_hil.identify.free_parameters import AS_DECLARED, TIMING, as_fitted, free_parameter, is_viscous
from clutch_hil.identify.frequency_response import LoopResponse, measure_response
from clutch_hil.identify.joint_fit import JointFit, fit_jointly
from clutch_hil.identify.starting_values import estimate_start
from clutch_hil.identify.stepwise import take_samples
from clutch_hil.identify.thesis_quantities import (
    Propagation,
    Quantity,
    as_covariance,
    compute_quantities,
    compute_slope,
)
from clutch_hil.live.catalogue import format_count
from clutch_hil.recordings.checks.finding import Finding, refuse_hard
from clutch_hil.recordings.checks.timing import cut_at_fault
from protocols.errors import InputError, join_names, suggest_closest
from protocols.files.parameters import ParameterSet
from protocols.files.run import Run
from protocols.files.runs import check_columns
from protocols.node import load_node

FINE_STEP = 1.25e-4  # s, of the accurate integration: a quarter of the quick one's
Progress = Callable[[str, float], None]


@dataclass(frozen=True)
class Identification:
    """A `calibration`, and how well it fits: columns measured and simulated by run, root mean square residual over the floor by
    output, `seconds` that it took, `findings` of the checks. propagation: of the parameters, by which `quantities` of the
    thesis have their intervals; response: of the pressure loop, None where the runs show none."""

    calibration: Calibration
    measured: Mapping[str, Columns]
    simulated: Mapping[str, Columns]
    units: Mapping[str, str]
    misfit: Mapping[str, float]
    findings: Sequence[Finding]
    seconds: float
    propagation: Propagation
    quantities: Sequence[Quantity]
    response: LoopResponse | None

    def __str__(self) -> str:
        """The verdict in one line."""
        worst = max(self.misfit, key=lambda column: self.misfit[column])
        warned = f"; {format_count(len(self.calibration.warnings), 'warning')}" if self.calibration.warnings else ""
        return (
            f"{format_count(len(self.calibration.parameters), 'parameter')} identified from"
            f" {format_count(len(self.measured), 'run')}; worst fit: {worst},"
            f" residual {self.misfit[worst]:.3g} times its noise{warned}"
        )


def identify_clutch(
    runs: Sequence[Run | str | Path],
    *,
    rig: str = DEFAULT_RIG,
    hold: Mapping[str, float | None] | None = None,
    bounds: Mapping[str, tuple[float, float]] | None = None,
    ties: Mapping[str, str] | None = None,
    force: bool = False,
    progress: Progress = lambda what, share: None,
) -> Identification:
    """Identify a clutch from `runs`, in memory or by path, as `clutch-hil identify` does.

    hold: parameters that are not fitted, with their value, None for the declared one. bounds: of parameters, in their units.
    ties: a parameter and the one that it keeps its declared ratio to. Runs that end in a fault count until there. Hard
    findings of the checks raise InputError, unless `force`. progress(what, share) is called now and then.

    It takes about a minute. Raises InputError.
    """
    started = monotonic()
    if not runs:
        raise InputError("an identification was asked for without runs; one or more are needed")
    made = find_rig(rig).model
    model = made()
    if lacking := [name for name in FITTED if name not in model.parameters]:
        raise InputError(f"rig {rig} has no parameter {lacking[0]}; wet clutches are identified: wet_clutch")
    known = ParameterSet({**model.parameters, **declare_effects()})
    _check_names(known, [*(hold or {}), *(bounds or {})])
    _check_names(model.parameters, [*(ties or {}), *(ties or {}).values()])
    findings: list[Finding] = []
    hashes: dict[str, str] = {}
    measured = _read(runs, model, hashes, findings)
    columns = list(measured.values())
    effects, silent = estimate_effects(columns)
    samples = take_samples(correct_offsets(columns, effects))
    floors = estimate_floors(columns, model.outputs)
    declared = {name: p.value for name, p in known.items()}
    held = {n: why for n, why in HELD.items() if n not in (bounds or {})} | dict.fromkeys(
        hold or {}, "held by the user"
    )
    given = {name: declared[name] if (value := (hold or {}).get(name)) is None else value for name in held}
    known.with_values(given)  # held within their bounds
    effects |= {name: value for name, value in given.items() if name in effects}
    ratios = {name: (other, _resolve_ratio(name, other, declared)) for name, other in (ties or {}).items()}
    names = [name for name in FITTED if name not in held and name not in ratios]
    names += [name for name in EFFECTS if name not in held and name not in silent]
    free = [free_parameter(known, name, (bounds or {}).get(name)) for name in names]
    progress("starting values", 0.0)
    begin = estimate_start(
        model, columns, samples, floors, free, {n: v for n, v in given.items() if n in model.parameters}, effects, TIMING,
        lambda share: progress("starting values", 0.2 * share),
    )  # fmt: skip
    start = dict(begin[0])
    unmet = {name: text for need in NEEDS if (text := need.warn(samples, start)) for name in need.parameters}
    free = [f for f in free if f.name not in unmet]
    unmet |= silent
    if not free:
        raise InputError(f"these runs excite no parameter of the clutch: {'; '.join(dict.fromkeys(unmet.values()))}")
    start |= {name: declared[name] for name in unmet if name in AS_DECLARED and name not in given}
    fitted = [as_fitted(f, start) for f in free]
    accurate = made(step=FINE_STEP)
    coarse, fine = (Evidence(FittedModel(one, ratios), columns, floors, timing=TIMING) for one in (model, accurate))
    joint = fit_jointly(
        coarse,
        fine,
        (to_fit(tie(start, ratios)), begin[1]),
        fitted,
        lambda share: progress("joint fit", 0.2 + 0.7 * share),
    )
    off = {name: p.value for name, p in declare_effects().items()}
    absent, joint = _hold_absent(joint, off, known)
    free = [f for f in free if f.name not in {a.name for a in absent}]
    values = from_fit(tie(joint.at.point[0], ratios)) | dict(joint.at.point[1])
    nominal = find_rig(rig).plant.nominal(None)
    findings += check_evidence(made(nominal.with_values(values)), measured)
    if not force:
        refuse_hard(findings)
    covariance = _compute_covariance(free, joint.half, joint.correlation, values)
    spread = np.sqrt(np.diag(covariance))
    parameters = [
        Identified(f.name, values[f.name], widen_interval(f.name, float(NORMAL_95 * deviation), values), known[f.name].unit,
                   declared[f.name])
        for f, deviation in zip(free, spread, strict=True)
    ]  # fmt: skip
    propagation = Propagation(values, [f.name for f in free], covariance)
    quantities, response, told = _describe(
        propagation, measured, model, nominal.with_values(values), load_node("controller")().parameters
    )
    notes = [f"{joint.left_out} of {fine.size} means over 4 ms are outliers, and left out"] if joint.left_out else []
    calibration = Calibration(
        rig=rig,
        parameters=parameters,
        controller=derive_controller_values(values, declared, load_node("controller")().parameters),
        correlation=covariance / np.outer(spread, spread),
        runs=hashes,
        held={**held, **dict.fromkeys(unmet, "the runs do not excite it")},
        warnings=[*dict.fromkeys(unmet.values()), *_list_at_bounds(free, values), *told],
        notes=[*map(str, findings), *notes],
        absent=absent,
        fixed={
            **{n: (v, "held by the user") for n, v in given.items() if v != declared[n]},
            **{n: (values[n], f"tied to {other}") for n, (other, _) in ratios.items()},
        },
    )
    simulated = {name: model.simulate(run, values, {}) for name, run in measured.items()}
    misfit = {o.column: _measure_misfit(o.column, measured, simulated) / floors[o.column] for o in model.outputs}
    progress("done", 1.0)
    units = {output.column: output.unit for output in model.outputs}
    return Identification(
        calibration,
        measured,
        simulated,
        units,
        misfit,
        findings,
        monotonic() - started,
        propagation,
        quantities,
        response,
    )


def _describe(
    known: Propagation, measured: Mapping[str, Columns], model: Model, clutch: ParameterSet, controller: ParameterSet
) -> tuple[list[Quantity], LoopResponse | None, list[str]]:
    """Quantities of the thesis, the frequency response, and what the runs do not show of it."""
    values = known.values
    regulator = controller["pressure.proportional_gain"].value, controller["pressure.integral_gain"].value
    celsius = np.concatenate([run["oil_temperature_degc"] for run in measured.values()])
    quantities = compute_quantities(known, clutch, regulator, (float(celsius.min()), float(celsius.max())))
    offset = values[PRESSURE]
    response, told = measure_response(
        measured, values["piston.contact_pressure"] + offset, clutch["sensors.dac_range"].value,
        lambda pressure, slip, temperature: compute_slope(values, pressure - offset, slip, temperature),
    )  # fmt: skip
    return quantities, response, told


def _hold_absent(joint: JointFit, off: Values, known: ParameterSet) -> tuple[list[Identified], JointFit]:
    """Effects that are absent, with their intervals; and the fit with them off."""
    values = np.array([joint.at.find_value(f) for f in joint.at.free])
    names = [f.name for f in joint.at.free]
    absent = choose_absent(names, values, joint.half, joint.correlation)
    found = [
        Identified(name, float(values[k]), float(joint.half[k]), known[name].unit, off[name])
        for name, k in ((name, names.index(name)) for name in absent)
    ]
    return found, joint.hold(absent, ({}, off)) if absent else joint


def _check_names(known: ParameterSet, names: Sequence[str]) -> None:
    for name in names:
        if name not in known:
            raise InputError(f"parameter {name!r} is unknown; {suggest_closest(name, list(known))}")


def _resolve_ratio(name: str, other: str, declared: Values) -> float:
    if name == other or declared[other] == 0.0:
        raise InputError(
            f"{name} is tied to {other}, which is {declared[other]:g}; allowed is another parameter that is not 0"
        )
    return declared[name] / declared[other]


def _read(
    runs: Sequence[Run | str | Path], model: Model, hashes: dict[str, str], findings: list[Finding]
) -> dict[str, Columns]:
    """Columns by name, as far as no run is in a fault. Raises InputError."""
    needed = ("time_s", *model.inputs, *(output.column for output in model.outputs), "shaft_angle_rad")
    read: dict[str, Columns] = {}
    for number, given in enumerate(runs, 1):
        if isinstance(given, Run):
            name, run = f"run {number}", given
            check_columns(Path(name), run.columns, needed)
            hashes[name] = hashlib.sha256(b"".join(np.ascontiguousarray(run[c]).tobytes() for c in needed)).hexdigest()
        else:
            name, run = Path(given).name, read_run(given, needed)
            hashes[name] = compute_checksum(Path(given))
        if name in read:
            raise InputError(f"run {name} is given twice; once is allowed")
        kept, cut = cut_at_fault(run.columns)
        if cut:
            findings.append(replace(cut, run=name))
            if len(kept["time_s"]) < 2:
                raise InputError(f"run {name} is in a fault from its first rows on ({cut.column}); it is no evidence")
        if lacking := [column for column in needed if column not in kept]:
            raise InputError(f"run {name} lacks the column {lacking[0]}; needed are {join_names(needed)}")
        read[name] = kept
    return read


def _compute_covariance(
    free: Sequence[FreeParameter], half: np.ndarray, correlation: np.ndarray, values: Values
) -> np.ndarray:
    """Covariance (p, p) of the rig's parameters: of C_v = K/omega_r^gamma by its derivatives in K and gamma."""
    names = [f.name for f in free]
    change = np.eye(len(names))
    scale = compute_viscous_scale(values)
    for k, name in enumerate(names):
        if is_viscous(name):
            change[k, k] = 1.0 / scale
            if "clutch.viscous_exponent" in names:
                change[k, names.index("clutch.viscous_exponent")] = -values[name] * np.log(10.0)
    return np.asarray(change @ as_covariance(half, correlation) @ change.T)


def _list_at_bounds(free: Sequence[FreeParameter], values: Values) -> list[str]:
    return [
        f"{f.name} rests at its bound {values[f.name]:g}; that is no estimate: widen its bounds, or record runs that excite it"
        for f in free
        if min(values[f.name] - f.low, f.high - values[f.name]) < 1e-6 * (f.high - f.low)
    ]


def _measure_misfit(column: str, measured: Mapping[str, Columns], simulated: Mapping[str, Columns]) -> float:
    """Root mean square of what is left of an output, in its unit."""
    left = [run[column] - simulated[name][column] for name, run in measured.items()]
    return float(np.sqrt(np.mean(np.concatenate(left) ** 2)))
