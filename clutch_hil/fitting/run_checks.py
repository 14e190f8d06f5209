"""Run checks: knowledge from the model about each column of a run, for the checks of clutch_hil/recordings/checks.

The prediction is that of the declared baseline, before any fit. It may be wrong by a factor where the baseline is uncertain:
latitude = 1 + 3 max(calibration s/|x|) over its parameters x with the uncertainty s, three standard deviations of the worst.
"""

from collections.abc import Container, Iterable, Mapping
from dataclasses import replace

import numpy as np

from clutch_hil.fitting.model import (
    Columns,
    Completing,
    Implying,
    Model,
    Partial,
    Ranged,
    Redundant,
    Timed,
    find_calibration,
)
from clutch_hil.fitting.noise import estimate_floors, estimate_own_noise
from clutch_hil.fitting.recalibration import Identifiable
from clutch_hil.recordings.checks.baseline import is_turned
from clutch_hil.recordings.checks.every_check import check_run, check_runs
from clutch_hil.recordings.checks.finding import Finding
from clutch_hil.recordings.checks.knowledge import Knowledge, Limits, Recorded
from clutch_hil.recordings.foreign_column import find_unit
from plant_sim.effects.catalogue import load_effects as catalogue
from plant_sim.effects.start import ChannelEnds
from protocols.errors import InputError

_STANDARD_DEVIATIONS = 3.0  # standard deviations of the parameter with the largest relative uncertainty
_MOST_LATITUDE = 4.0  # a parameter known to 100 %; for values near 0 the ratio has no meaning
_ALONE = ("length", "range", "wrapped", "saturated")  # checks of a single column
_OF_WHOLE_RUNS = ("logged", "derived", "noisy")  # checks of all rows of a run
_NEARLY = 1.01  # tolerance of a ratio: the period of a recording is known to its digits
_NOISY = 1.5  # ratio of noises: below it the weights differ by a factor of 2 at most, which nobody needs to know
_ROUNDING = 1e-6  # share of its range: noise floor of a column that is computed from other columns


def check_evidence(model: Model, runs: Mapping[str, Columns]) -> list[Finding]:
    """Return the findings of the checks in `runs`, by file or name, with all columns that `model` needs; hard findings
    first."""
    # from all runs together, because an output that is constant in one run has no noise there
    floors = estimate_floors(list(runs.values()), model.outputs)
    limits = model.list_limits() if isinstance(model, Ranged) else {}
    identification = model.identification if isinstance(model, Identifiable) and not _is_calibrated(model) else ""
    latitude, clipped = _find_latitude(model), _list_clipped_columns(model)
    seen: list[Finding] = []
    recorded = []
    for name, run in runs.items():
        predicted = _predict(model, run)
        if predicted is None:
            text = "cannot be simulated by the baseline: check units and signs of the inputs in the import map"
            seen.append(Finding("input", model.inputs[0], (0, len(run["time_s"]) - 1), text, True, name))
            predicted = {}
        for column, text in (model.describe_completed(run) if isinstance(model, Completing) else {}).items():
            seen.append(Finding("derived", column, (0, len(run["time_s"]) - 1), text, False, name))
        seen += _judge_timing(model, name, run)
        known = {column: Knowledge(_find_unit(column), limits=limits.get(column, Limits())) for column in model.inputs}
        own = {column: estimate_own_noise(run[column], floor) for column, floor in floors.items()}
        seen += _note_noisy(name, run, floors, own)
        known |= _know_outputs(model, own, predicted, limits, clipped)
        known |= _know_from_others(model, run)
        implied = model.imply_inputs(run, floors) if isinstance(model, Implying) and predicted else {}
        recorded.append(Recorded(name, run, known, tuple(model.inputs), latitude, implied, identification))
    return sorted([*seen, *check_runs(recorded)], key=lambda finding: not finding.hard)


def check_without_baseline(model: Model, runs: Mapping[str, Columns]) -> list[Finding]:
    """Return the hard findings that hold for any parameters of the rig.

    These are short runs, values outside the range of the rig, saturated channels, wrong signs, and channels that contradict
    each other. They are for an identification, which has no baseline: it would fit a temperature in degF with a hotter sump. Of
    the declared `model` only signs are used: pressure rises with voltage, and slip with its demand, for any clutch.
    """
    floors = estimate_floors(list(runs.values()), model.outputs)
    limits = model.list_limits() if isinstance(model, Ranged) else {}
    findings = []
    for name, run in runs.items():
        findings += [finding for finding in _judge_timing(model, name, run) if finding.hard]
        predicted = _predict(model, run) or {}
        known = {column: Knowledge(_find_unit(column), limits=limits.get(column, Limits())) for column in model.inputs}
        own = {column: estimate_own_noise(run[column], floor) for column, floor in floors.items()}
        known |= _know_outputs(model, own, predicted, limits)
        derived = _know_from_others(model, run)
        seen = check_run(Recorded(name, run, {**known, **derived}, tuple(model.inputs)))
        turned = {c for c, values in predicted.items() if not known[c].slow and is_turned(run[c], values)}
        findings += [
            replace(f, run=name)
            for f in seen
            if f.hard and (f.check in _ALONE or f.column in derived or (f.check == "sign" and f.column in turned))
        ]
    return findings


def list_findings(findings: Iterable[Finding]) -> list[str]:
    """Return the texts of findings; one that applies to all rows of several runs is given once, with their names."""
    grouped: dict[tuple[str, ...], list[Finding]] = {}
    for number, one in enumerate(findings):
        alone = () if one.check in _OF_WHOLE_RUNS and one.run else (str(number),)
        grouped.setdefault((one.check, one.column, one.text, *alone), []).append(one)
    return [
        f"runs {', '.join(one.run for one in group)}: {group[0].column}, all rows, {group[0].text}"
        if len(group) > 1
        else str(group[0])
        for group in grouped.values()
    ]


def _judge_timing(model: Model, name: str, run: Columns) -> list[Finding]:
    """Return a finding if the rows are those of a logger; hard if they are too slow."""
    if not isinstance(model, Timed) or not (timing := model.estimate_timing(run)) > 0.0:
        return []
    text = (
        "are taken as a logger's, of a faster loop: commands move on straight lines between them, and what happens"
        f" between them is known to {1e3 * timing:.3g} ms"
    )
    hard = timing > _NEARLY * model.most_timing
    if timing > _NEARLY * model.doubtful_timing:
        text += "; with so few rows a sound rig " + (
            "seems to lack something" if hard else "may seem to need another calibration or an effect"
        )
        text += f": log {0.5 / model.doubtful_timing:.0f} rows a second or more"
    return [Finding("logged", "time_s", (0, len(run["time_s"]) - 1), text, hard, name)]


def _note_noisy(name: str, run: Columns, floors: Mapping[str, float], own: Mapping[str, float]) -> list[Finding]:
    """Return a note on each output of a run whose noise `own` is much larger than `floors`, those of most runs."""
    return [
        Finding(
            "noisy", column, (0, len(run["time_s"]) - 1),
            f"has {own[column] / floor:.2g} times the noise of most runs, and counts for less", False, name,
        )
        for column, floor in floors.items()
        if own[column] > _NOISY * floor
    ]  # fmt: skip


def _know_outputs(
    model: Model,
    floors: Mapping[str, float],
    predicted: Columns,
    limits: Mapping[str, Limits],
    clipped: Container[str] = (),
) -> dict[str, Knowledge]:
    """Return knowledge about the outputs of a model by column. clipped: columns that may be saturated."""
    return {
        o.column: Knowledge(o.unit, floors[o.column], predicted.get(o.column), limits.get(o.column, Limits()),
                            o.column in clipped)
        for o in model.outputs
    }  # fmt: skip


def _know_from_others(model: Model, run: Columns) -> dict[str, Knowledge]:
    """Return knowledge about the columns of a run that follow from other measured ones."""
    if not isinstance(model, Redundant):
        return {}
    limits = model.list_limits() if isinstance(model, Ranged) else {}
    return {
        column: Knowledge(_find_unit(column), _ROUNDING * float(np.ptp(values)), values, limits.get(column, Limits()),
                          source=source)
        for column, (source, values) in model.from_others(run).items()
    }  # fmt: skip


def _predict(model: Model, run: Columns) -> Mapping[str, np.ndarray] | None:
    """Predict the outputs (n,) of the declared baseline; measured values in unpredicted rows; None if it cannot be
    simulated."""
    try:
        with np.errstate(all="ignore"):
            shown = model.simulate(run, {name: p.value for name, p in model.parameters.items()}, {})
    except InputError:
        return None
    predicted = {output.column: np.asarray(shown[output.column], float) for output in model.outputs}
    for column, unseen in (model.find_unseen(run) if isinstance(model, Partial) else {}).items():
        predicted[column] = np.where(unseen, run[column], predicted[column])
    if not all(np.isfinite(values).all() for values in predicted.values()):
        return None
    return _continue_beginning(run, predicted)


def _continue_beginning(run: Columns, predicted: Mapping[str, np.ndarray]) -> Mapping[str, np.ndarray]:
    """Return `predicted`, where a beginning that is the measured one is moved so that the prediction continues it.

    A model may take the beginning of a run that was cut out of a longer one from the measurement. The jump to what it predicts
    afterwards is no movement of the rig.
    """
    equal = np.logical_and.reduce([values == run[column] for column, values in predicted.items()])
    if not equal[0] or equal.all():
        return predicted
    rows = int(np.argmin(equal))
    near = slice(rows, rows + max(1, min(rows, len(equal) - rows)))
    jumps = {c: np.mean((values - run[c])[near]) for c, values in predicted.items()}
    return {c: np.concatenate([values[:rows] + jumps[c], values[rows:]]) for c, values in predicted.items()}


def _find_latitude(model: Model) -> float:
    """Return the factor by which uncertain parameters may scale a prediction; effects such as offsets do not count."""
    shares = [
        p.uncertainty / abs(p.value)
        for name, p in model.parameters.items()
        if p.uncertainty > 0.0 and p.value != 0.0 and name.partition(".")[0] not in catalogue()
    ]
    return min(1.0 + _STANDARD_DEVIATIONS * find_calibration(model) * max(shares, default=0.0), _MOST_LATITUDE)


def _is_calibrated(model: Model) -> bool:
    """Return whether the baseline of `model` is that of a calibration or a file of parameters, not the nominal one."""
    nominal = model.list_nominal_parameters() if hasattr(model, "list_nominal_parameters") else {}
    return any(nominal[name].value != one.value for name, one in model.parameters.items() if name in nominal)


def _list_clipped_columns(model: Model) -> set[str]:
    """Return the columns whose saturation is a candidate of the model."""
    starts = [catalogue()[c.name].start for c in model.candidates if c.name in catalogue()]
    return {column for start in starts if isinstance(start, ChannelEnds) for column in start.limits.values()}


def _find_unit(column: str) -> str:
    """Return the unit from the end of a column's name, "" if it has none."""
    try:
        return find_unit(column)
    except InputError:
        return ""
