"""Every check of a recording, in one list, and how they are applied."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace

import numpy as np

from clutch_hil.recordings.checks.baseline import (
    find_far,
    find_offset,
    find_reversed,
    find_scaled,
    find_still_prediction,
    find_unrelated,
)
from clutch_hil.recordings.checks.finding import Finding
from clutch_hil.recordings.checks.inputs import find_late_inputs, find_still_inputs, find_zero_of_inputs
from clutch_hil.recordings.checks.knowledge import Knowledge, Recorded
from clutch_hil.recordings.checks.repeated import find_repeated
from clutch_hil.recordings.checks.resampled import find_resampled
from clutch_hil.recordings.checks.speed_and_angle import find_scaled_speed
from clutch_hil.recordings.checks.timing import LEAST_TOTAL, find_drift, find_late, find_short, sum_seconds
from clutch_hil.recordings.checks.values import (
    find_dead,
    find_frozen,
    find_out_of_range,
    find_outliers,
    find_placeholders,
    find_saturated,
    find_wrapped,
)

# What a later check sees in a column that an earlier one refuses, or in one of _DECIDES, follows from that: it is left out
CHECKS: tuple[Callable[[Recorded], list[Finding]], ...] = (
    find_short, find_dead, find_wrapped, find_out_of_range, find_reversed, find_placeholders, find_saturated, find_frozen,
    find_drift, find_late, find_late_inputs, find_still_inputs, find_still_prediction, find_scaled, find_unrelated, find_offset,
    find_zero_of_inputs, find_outliers, find_resampled, find_scaled_speed, find_far,
)  # fmt: skip
_DECIDES = ("saturated", "placeholder")
_MOVES_AT_ALL = 0.5  # floors that an output moves by beside its noise, root mean square: chance gives a tenth


def check_runs(runs: Sequence[Recorded]) -> list[Finding]:
    """What the checks see in runs, each alone and all together, hard findings first."""
    findings = [replace(finding, run=run.name) for run in runs for finding in check_run(run)]
    findings += find_repeated([(run.name, run.columns) for run in runs])
    if runs and (seconds := sum_seconds(runs)) < LEAST_TOTAL and not any(f.check == "length" for f in findings):
        text = f"of all runs are {seconds:.3g} s together; {LEAST_TOTAL:g} s are needed: record more, or longer"
        findings.append(Finding("length", "time_s", runs[0].rows, text, True))
    predicted = [run for run in runs if run.predictions]
    if predicted and not any(_moves(run) for run in predicted) and not any(f.hard for f in findings):
        text = "has no output that moves above its noise, in any run: excite the rig; a rig at rest shows nothing"
        findings.append(Finding("excitation", "time_s", predicted[0].rows, text, True))
    return sorted(findings, key=lambda finding: not finding.hard)


def check_columns_alone(name: str, columns: Mapping[str, np.ndarray], units: Mapping[str, str]) -> list[Finding]:
    """What the checks see in an imported run, without a baseline: all of it soft, as nothing is concluded yet."""
    known = {column: Knowledge(units.get(column, "")) for column in columns if column != "time_s"}
    run = Recorded(name, columns, known)
    findings = check_run(run)
    told = {finding.column for finding in findings}  # not all, if the run is short: this check needs no time
    findings += [finding for finding in find_placeholders(run) if finding.column not in told]
    return [replace(finding, hard=False, run=name) for finding in findings]


def check_run(run: Recorded) -> list[Finding]:
    """What the checks see in one run."""
    findings: list[Finding] = []
    judged: set[str] = set()
    for check in CHECKS:
        if check is find_still_prediction and any(finding.check == "sign" and finding.hard for finding in findings):
            continue  # what goes against the baseline does not follow it: no input is dead by that
        for finding in check(run):
            if finding.column not in judged:
                findings.append(finding)
                if finding.hard or finding.check in _DECIDES:
                    judged.add(finding.column)
        if "time_s" in judged:
            break
    return findings


def _moves(run: Recorded) -> bool:
    """Whether an output moves above its noise."""
    return any(
        float(np.var(run.columns[name])) > (1.0 + _MOVES_AT_ALL**2) * run.known[name].floor ** 2
        for name in run.predictions
    )
