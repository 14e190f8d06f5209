"""Runs that lack a sensor: choose the model of a rig, and its outputs, that can be compared with them.

A sensor is missing where a run lacks the column, where its import map computes the column from an output, and where the map
sets an output to a constant.
"""

from collections.abc import Mapping, Sequence

from clutch_hil.fitting.model import Model, Reducible
from clutch_hil.recordings.not_measured import find_source, read_not_measured
from protocols.errors import join_names, name_run
from protocols.files.run import Run


def choose_model(models: Sequence[Model], runs: Mapping[str, Run]) -> tuple[Model, list[str]]:
    """Return the first of `models` that can be compared with `runs`, without missing outputs, and notes on these.

    models: of one rig, best first; each has other inputs. Returns the first one, complete, if none can be compared.
    """
    reasons: list[str] = []  # why inputs of the models before are missing
    for model in models:
        missing = find_missing(model, runs)
        if set(missing) <= {*(model.may_lack if isinstance(model, Reducible) else ())}:
            notes = [f"{reason}; the rig is simulated from {join_names(model.inputs)}" for reason in reasons]
            notes += [f"{reason}; nothing is compared with it" for reason in missing.values()]
            return model.without(missing) if missing and isinstance(model, Reducible) else model, notes
        reasons += [missing[name] for name in model.inputs if name in missing]
    return models[0], []


def find_missing(model: Model, runs: Mapping[str, Run]) -> dict[str, str]:
    """Return the inputs and outputs of `model` that were not measured in one of `runs` (by name), each with the reason."""
    outputs = {output.column for output in model.outputs}
    may_lack = {*(model.may_lack if isinstance(model, Reducible) else ())}
    missing: dict[str, str] = {}
    for run, recorded in runs.items():
        given, columns = read_not_measured(recorded), {*recorded.columns}
        for column in (*model.inputs, *outputs):
            if source := find_source(given, column, outputs - {column}):
                reason = f"{column} of {name_run(run)} is computed from {source}"
            elif column in may_lack and isinstance(given.get(column), (int, float)):
                reason = f"{column} of {name_run(run)} is a constant of its import map"
            elif column not in columns:
                reason = f"{column} is missing in {name_run(run)}"
            else:
                continue
            missing.setdefault(column, reason)
    return missing
