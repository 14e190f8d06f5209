"""Identification: from recorded runs of a clutch to a calibration of its model and its controller."""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from time import monotonic

import numpy as np

from clutch_hil.bench.arguments import take_function, take_name, take_runs
from clutch_hil.bench.rig import DEFAULT_RIG, find_rig
from clutch_hil.bench.run_file import read_run
from clutch_hil.fitting.fit import FreeParameter
from clutch_hil.fitting.intervals import NORMAL_95
from clutch_hil.fitting.model import Columns, Model, Values, simulate_seen
from clutch_hil.fitting.noise import estimate_floors
from clutch_hil.fitting.run_checks import check_evidence, check_without_baseline, list_findings
from clutch_hil.identify.behind_slip import (
    EFFECTS_BEHIND_SLIP,
    FITTED_BEHIND_SLIP,
    MOTOR_COLUMNS,
    add_motor,
    describe_missing_motor,
    fit_motor,
    put_behind_slip,
)
from clutch_hil.identify.calibration import Calibration, Identified
from clutch_hil.identify.clutch_effects import (
    PRESSURE,
    declare_effects,
    widen_interval,
)
from clutch_hil.identify.clutch_fit import ClutchFit, Progress, fit_clutch
from clutch_hil.identify.clutch_parameters import (
    FITTED,
)
from clutch_hil.identify.controller_values import derive_controller_values
from clutch_hil.identify.fit_plan import FitPlan, Subject, Wishes, check_names, check_ties, plan_fit, take_wishes
from clutch_hil.identify.frequency_response import LoopResponse, measure_response
from clutch_hil.identify.misfit import measure_misfit, warn_misfit
from clutch_hil.identify.recorded_runs.converters import find_converter_bits
from clutch_hil.identify.recorded_runs.missing_torque import (
    CLUTCH_TORQUE,
    EFFECTS_WITHOUT_TORQUE,
    complete_torque,
    describe_missing_torque,
)
from clutch_hil.identify.recorded_runs.motor_limit import LIMIT, find_limit_at_steps, find_motor_limit
from clutch_hil.identify.recorded_runs.other_clutch import find_other_clutch
from clutch_hil.identify.recorded_runs.run_evidence import (
    Evidenced,
    find_rig_name,
    read_evidence,
    replace_spikes,
    require_columns,
)
from clutch_hil.identify.recorded_runs.torque_balance import find_other_torque
from clutch_hil.identify.stick_stiffness import measure_stick
from clutch_hil.identify.thesis_quantities import (
    Propagation,
    Quantity,
    compute_quantities,
    compute_slope,
    find_highest_pressure,
)
from clutch_hil.recordings.checks.finding import Finding, refuse_hard
from clutch_hil.recordings.checks.repeated import find_repeated
from protocols.errors import InputError, format_count
from protocols.files.parameters import ParameterSet
from protocols.files.run import Run
from protocols.node import load_node

NOT_EXCITED = "the runs do not excite it"  # reason for which a parameter is held
# Limits of the rig. They are never fitted, because few runs reach them; a rig of another size has other limits
_SELDOM_SHOWN = {
    LIMIT: "another value would show only if the motor gave more torque, or less than demanded",
    "valve.supply_pressure": "it shows only if the valve is commanded beyond it",
}
# Reason why the value differs: the runs hardly excite the parameter, and it is fitted with a prior
MOVED = "the runs hardly excite it: it is known roughly, and fitted with the others"
# Ratio of residual to noise: above it the runs give no usable calibration; GOOD_FIT is the usual limit
_POOR_FIT = 10.0
_MOVED = 1e-6  # units of moves: a smaller change from the declared value is rounding
_DRIVEN = "motor.inertia"  # fitted only where the motor is part of the model
_TEMPERATURE = "oil_temperature_degc"
_FORCE = "--force-checks"  # command-line option that continues in spite of hard findings


@dataclass(frozen=True)
class Identification:
    """Result of an identification: a `calibration` and how well it fits.

    measured, simulated: columns by run. units: by output. misfit: root mean square residual divided by the noise floor, by
    output. findings: results of the checks. seconds: computing time. propagation: parameters with their covariance, from which
    the intervals of the thesis `quantities` follow. response: frequency response of the pressure loop, None where the runs do
    not excite it.
    """

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

    @property
    def highest_pressure(self) -> float:
        """See `find_highest_pressure`."""
        return find_highest_pressure(self.measured.values(), self.propagation.values)

    def __str__(self) -> str:
        """Return a summary in one line."""
        worst = max(self.misfit, key=lambda column: self.misfit[column])
        warned = f"; {format_count(len(self.calibration.warnings), 'warning')}" if self.calibration.warnings else ""
        poor = " poorly" if self.misfit[worst] > _POOR_FIT else ""
        return (
            f"{format_count(len(self.calibration.parameters), 'parameter')} identified{poor} from"
            f" {format_count(len(self.measured), 'run')}; worst fit: {worst},"
            f" residual {self.misfit[worst]:.3g} times its noise{warned}"
        )


def identify_clutch(
    runs: Sequence[Run | str | Path],
    *,
    rig: str = "",
    hold: Mapping[str, float | None] | None = None,
    bounds: Mapping[str, tuple[float, float]] | None = None,
    ties: Mapping[str, str] | None = None,
    force: bool = False,
    progress: Progress = lambda what, share: None,
) -> Identification:
    """Identify a clutch from `runs`, in memory or by path, like the command `clutch-hil identify`.

    rig: name of the rig of the runs; default: that of the first run. On a rig with two clutches, both clutches and the
    hand-over are identified.
    hold: parameters that are not fitted, with their values; None keeps the declared value. bounds: (low, high) of parameters,
    in their units. ties: parameter -> other parameter, to which it keeps its declared ratio. A run that ends in a fault is used
    up to the fault. force: continue in spite of hard findings of the checks. progress(what, share) is called from time to time.

    Takes about a minute. Raises InputError, also for hard findings without `force`.
    """
    runs, progress, rig = take_runs("runs", runs), take_function("progress", progress), take_name("rig", rig)
    wishes = take_wishes(hold, bounds, ties, force)
    if not runs:
        raise InputError("the identification has no runs; one or more are needed")
    rig = rig or find_rig_name(runs[0] if isinstance(runs[0], Run) else read_run(runs[0], ())) or DEFAULT_RIG
    known_rig = find_rig(rig)
    if known_rig.identify_at:
        both: Identification = known_rig.identify(
            runs, hold=wishes.hold, bounds=wishes.bounds, ties=wishes.ties, force=wishes.force, progress=progress
        )
        return both
    model = known_rig.model()
    if lacking := [name for name in FITTED if name not in model.parameters]:
        raise InputError(f"rig {rig} has no parameter {lacking[0]}; wet clutches are identified: wet_clutch")
    check_names(ParameterSet({**model.parameters, **declare_effects()}), [*wishes.hold, *wishes.bounds])
    check_names(model.parameters, [*wishes.ties, *wishes.ties.values()])
    check_ties(wishes)
    clutch, declared = known_rig.clutch_model(), known_rig.plant.load_parameters()
    optional = (*MOTOR_COLUMNS, CLUTCH_TORQUE)
    columns = ("time_s", *clutch.inputs, *(output.column for output in clutch.outputs), "shaft_angle_rad")
    evidence = read_evidence(runs, rig, [name for name in columns if name not in optional], optional)
    subject, behind_slip = (Subject(rig, declared, make) for make in (known_rig.model, known_rig.clutch_model))
    warnings = []
    if evidence.find_constant(_TEMPERATURE) is not None:
        subject, behind_slip = (one.without_output(_TEMPERATURE) for one in (subject, behind_slip))
        warnings.append(
            f"{_TEMPERATURE} is a constant of the import map: parameters of the oil are identified from the torque alone"
        )
    if missing := describe_missing_motor(evidence):
        identification = _identify_behind_slip(behind_slip, evidence, wishes, progress)
    elif missing := describe_missing_torque(evidence):
        identification = _identify_by_motor(subject, evidence, wishes, progress)
    else:
        identification = identify_subject(subject, evidence, wishes, progress)
    calibration = identification.calibration
    warnings = [*filter(None, [missing]), *warnings, *calibration.warnings]
    return replace(identification, calibration=replace(calibration, warnings=warnings))


def _identify_behind_slip(subject: Subject, evidence: Evidenced, wishes: Wishes, progress: Progress) -> Identification:
    """Identify a clutch from runs without the speed demand or the torque of the motor. Raises InputError."""
    require_columns(evidence, (CLUTCH_TORQUE,))
    behind, declared = put_behind_slip(evidence), subject.nominal
    subject = replace(
        subject, nominal=fit_motor(declared, behind.measured), fitted=FITTED_BEHIND_SLIP, effects=EFFECTS_BEHIND_SLIP
    )
    one = identify_subject(subject, behind, wishes, progress)
    calibration, known = add_motor(one.calibration, one.propagation, evidence, declared, wishes.hold)
    return replace(one, calibration=calibration, propagation=known)


def _identify_by_motor(subject: Subject, evidence: Evidenced, wishes: Wishes, progress: Progress) -> Identification:
    """Identify a clutch from runs without a clutch torque column. Raises InputError."""
    inertia = wishes.hold.get(_DRIVEN) or subject.nominal[_DRIVEN].value
    subject = replace(subject.without_output(CLUTCH_TORQUE), effects=EFFECTS_WITHOUT_TORQUE)
    return identify_subject(subject, complete_torque(evidence, inertia), wishes, progress)


def identify_subject(subject: Subject, runs: Evidenced, wishes: Wishes, progress: Progress) -> Identification:
    """Identify a clutch from columns with the names of a wet-clutch run. Raises InputError."""
    started = monotonic()
    plan = plan_fit(subject, subject.make(subject.nominal), wishes)
    measured, floors, findings = _clean_runs(subject, runs)
    plan, other_size = _take_scale(subject, plan, measured)
    findings += other_size
    subject = replace(subject, nominal=subject.nominal.with_values(plan.select_given(subject.nominal)))
    model = subject.make(subject.nominal)
    if not wishes.force:
        _check_runs(model, measured, findings, runs)
    fit = fit_clutch(subject, plan, list(measured.values()), floors, progress)
    values = fit.values
    findings += check_evidence(subject.make(subject.nominal.with_values(values)), measured)
    if not wishes.force:
        refuse_hard(_select_measured(findings, runs), _FORCE)
    propagation = Propagation(values, [f.name for f in fit.free], fit.compute_covariance())
    quantities, response, unshown = _describe(
        propagation, measured, model, subject.nominal.with_values(values), load_node("controller")().parameters,
        subject.shows_response,
    )  # fmt: skip
    simulated = {name: simulate_seen(model, run, values, {}) for name, run in measured.items()}
    misfit = {o.column: measure_misfit(o, measured, simulated, floors[o.column]) for o in model.outputs}
    warnings = [
        *dict.fromkeys(_select_unmet(plan, fit).values()),
        *_list_at_bounds(fit.excited, values, wishes.bounds),
        *warn_misfit(misfit, [f.name for f in fit.hardly], any(finding.check == "logged" for finding in findings)),
        *unshown,
    ]
    calibration = _make_calibration(subject.rig, plan, fit, runs.hashes, warnings, findings)
    progress("done", 1.0)
    return Identification(
        calibration,
        measured,
        simulated,
        {output.column: output.unit for output in model.outputs},
        misfit,
        findings,
        monotonic() - started,
        propagation,
        quantities,
        response,
    )


def _select_unmet(plan: FitPlan, fit: ClutchFit) -> Mapping[str, str]:
    """Return the unmet needs by parameter, without those of held parameters."""
    return {name: need for name, need in fit.unmet.items() if name not in plan.held}


def _clean_runs(subject: Subject, runs: Evidenced) -> tuple[dict[str, Columns], dict[str, float], list[Finding]]:
    """Return the runs by name with spikes replaced, the noise floors of the outputs, and the findings in single runs."""
    measured, findings = dict(runs.measured), list(runs.findings)
    floors = estimate_floors(list(measured.values()), subject.make(subject.nominal).outputs)
    for name, run in measured.items():
        measured[name], replaced = replace_spikes(name, run, floors)
        findings += replaced
    if _DRIVEN in subject.fitted:
        findings += find_other_torque(measured)
    findings += find_other_clutch(measured)
    return measured, floors, findings


def _take_scale(subject: Subject, plan: FitPlan, measured: Mapping[str, Columns]) -> tuple[FitPlan, list[Finding]]:
    """Adapt the plan to the runs: motor limit, converter resolution and seldom reached limits.

    Returns the plan, and the findings from which a motor limit other than the declared one follows.
    """
    other_size: list[Finding] = []
    if _DRIVEN in subject.fitted:
        limit, other_size = find_motor_limit(
            measured, plan.given.get(LIMIT, plan.known[LIMIT].value), plan.known[LIMIT].bounds[1]
        )
        if other_size:
            plan = plan.give(LIMIT, limit, f"taken as {limit:.4g} Nm, by the largest torque of the runs")
        elif LIMIT not in plan.given:
            limit, other_size = find_limit_at_steps(measured, limit)
            if other_size:
                plan = plan.give(LIMIT, limit, f"taken as {limit:.4g} Nm, by steps of the speed demand that need more")
    for name, what in _SELDOM_SHOWN.items():
        if name in plan.known and name not in plan.held and (_DRIVEN in subject.fitted or name != LIMIT):
            kept = f"kept at {plan.known[name].value:g} {plan.known[name].unit}, as declared: {what}"
            plan = plan.give(
                name, plan.known[name].value, f"{kept}; set the value of the data sheet with --hold NAME=VALUE"
            )
    model = subject.make(subject.nominal)
    for name, (bits, why) in find_converter_bits(model, list(measured.values()), subject.nominal).items():
        if name not in plan.given:
            plan = plan.give(name, bits, f"taken as {bits:g} bit, as {why}")
    return plan, other_size


def _select_measured(findings: Iterable[Finding], runs: Evidenced) -> list[Finding]:
    """Return the findings without those of columns that the import map sets to a constant, because these are not measured."""
    return [one for one in findings if runs.find_constant(one.column) is None]


def _check_runs(model: Model, measured: Mapping[str, Columns], findings: Sequence[Finding], runs: Evidenced) -> None:
    """Raise InputError for a hard finding: one of `findings`, or one of the checks that hold for any parameter values."""
    seen = [*model.inputs, *(output.column for output in model.outputs)]
    repeated = find_repeated([(name, {c: run[c] for c in seen}) for name, run in measured.items()])
    refuse_hard(_select_measured([*repeated, *check_without_baseline(model, measured), *findings], runs), _FORCE)


def _make_calibration(
    rig: str,
    plan: FitPlan,
    fit: ClutchFit,
    runs: Mapping[str, str],
    warnings: Sequence[str],
    findings: Sequence[Finding],
) -> Calibration:
    """Return the calibration from a fit. runs: SHA-256 by run name."""
    values, declared, covariance = fit.values, plan.declared, fit.compute_covariance()
    spread, kept = np.sqrt(np.diag(covariance)), len(fit.excited)
    parameters = [
        Identified(
            f.name,
            values[f.name],
            widen_interval(f.name, float(NORMAL_95 * deviation), values),
            plan.known[f.name].unit,
            declared[f.name],
        )
        for f, deviation in zip(fit.excited, spread[:kept], strict=True)
    ]
    left_out = fit.joint.left_out
    moved = [f for f in fit.hardly if abs(values[f.name] - declared[f.name]) > _MOVED * f.scale]
    return Calibration(
        rig=rig,
        parameters=parameters,
        controller=derive_controller_values(values, declared, load_node("controller")().parameters),
        correlation=(covariance / np.outer(spread, spread))[:kept, :kept],
        runs=runs,
        held={**plan.held, **dict.fromkeys(_select_unmet(plan, fit), NOT_EXCITED)},
        warnings=warnings,
        notes=[
            *list_findings(findings),
            *([f"{left_out} of {fit.means} means over 4 ms are outliers and were left out"] if left_out else []),
        ],
        absent=fit.absent,
        fixed={
            **{n: (v, plan.held[n]) for n, v in plan.given.items() if v != declared[n]},
            **{n: (values[n], f"tied to {other}") for n, (other, _) in plan.ratios.items()},
            **{f.name: (values[f.name], MOVED) for f in moved},
        },
    )


def _describe(
    known: Propagation,
    measured: Mapping[str, Columns],
    model: Model,
    clutch: ParameterSet,
    controller: ParameterSet,
    shows_response: bool,
) -> tuple[list[Quantity], LoopResponse | None, list[str]]:
    """Return the quantities of the thesis, the frequency response, and a sentence for each quantity that the runs do not
    excite."""
    values = known.values
    regulator = controller["pressure.proportional_gain"].value, controller["pressure.integral_gain"].value
    celsius = np.concatenate([run["oil_temperature_degc"] for run in measured.values()])
    quantities = compute_quantities(
        known, clutch, regulator, (float(celsius.min()), float(celsius.max())),
        find_highest_pressure(measured.values(), values),
    )  # fmt: skip
    if not shows_response:
        return quantities, None, []
    offset = values[PRESSURE]
    response, warnings = measure_response(
        measured, values["piston.contact_pressure"] + offset, clutch["sensors.dac_range"].value,
        lambda pressure, slip, temperature: compute_slope(values, pressure - offset, slip, temperature),
    )  # fmt: skip
    stick = measure_stick(list(measured.values()), values)
    return (
        [*quantities, *([stick.quantity] if stick.quantity else [])],
        response,
        [*warnings, *filter(None, [stick.warning])],
    )


def _list_at_bounds(
    free: Sequence[FreeParameter], values: Values, bounds: Mapping[str, tuple[float, float]]
) -> list[str]:
    """Return a sentence for each parameter that ends at a bound. bounds: those that the user gave."""
    remedy = {
        True: "widen --bounds, or record runs that excite it",
        False: "runs do not excite it, a channel is late, scaled or another one, or the rig is beyond what a model may have",
    }
    return [
        f"{f.name} rests at its bound {values[f.name]:g}; this is not an estimate: {remedy[f.name in bounds]}"
        for f in free
        if min(values[f.name] - f.low, f.high - values[f.name]) < 1e-6 * (f.high - f.low)
    ]
