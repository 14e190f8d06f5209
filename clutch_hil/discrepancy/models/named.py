"""Models by their name in `--rig`: that of a rig, an entry point in `clutch_hil.models`, or a class in a user's file."""

from collections.abc import Callable
from pathlib import Path
from typing import Any

from clutch_hil.bench.rig import find_rig, list_rigs, list_rigs_with_model
from clutch_hil.discrepancy.models.model_check import check_declarations
from clutch_hil.fitting.model import Columns, Completing, Demanding, Model, PartOfRig
from clutch_hil.identify.recorded_runs.run_evidence import check_run_columns
from clutch_hil.recordings.not_measured import find_source, read_not_measured
from protocols.entry_points import list_entries, load_entry
from protocols.errors import InputError, suggest_closest
from protocols.files.parameters import ParameterSet, load_overlay
from protocols.files.run import Run
from protocols.input_file import check_file
from protocols.renamed_methods import refuse_old_methods
from protocols.user_code import describe_error
from protocols.user_file import load_user_file

GROUP = "clutch_hil.models"
_MOST = 5.0  # stated uncertainties: five standard deviations
_NEEDED = ("name", "inputs", "outputs", "parameters", "candidates", "simulate")  # attributes of `Model`
# Methods of a model by their old names
_RENAMED = {
    "limits": "list_limits",
    "implied": "imply_inputs",
    "starts": "suggest_starts",
    "evident": "find_evident_effects",
    "bench": "make_bench",
    "nominal": "list_nominal_parameters",
    "find_derived": "describe_completed",
}


def find_model(rig: str, changed: Path | None = None) -> Model:
    """Return the model `rig`, a name or PATH.py:CLASS, with the parameters of the model file `changed`. Raises InputError."""
    return _make_model(_load_user_class(rig) if ".py" in rig else _find_installed_class(rig), rig, changed)


def find_models(rig: str, changed: Path | None = None) -> list[Model]:
    """Return the model `rig` as `find_model` does, then others of the same rig, for runs that lack its inputs."""
    models = [find_model(rig, changed)]
    if rig in list_rigs() and find_rig(rig).clutch_model_at:
        models.append(_make_model(find_rig(rig).clutch_model, rig, changed))
    return models


def _make_model(made: Callable[..., Model], rig: str, changed: Path | None) -> Model:
    try:
        model = made()
        if changed:
            of_rig = model.whole if isinstance(model, PartOfRig) else model.name
            model = made(load_overlay(changed, declare_parameters(model), rig=of_rig))
    except InputError:
        raise
    except (Exception, SystemExit) as error:  # a user's class may raise anything
        how = f"with the parameters of {changed}" if changed else "without arguments"
        raise InputError(f"rig {rig} cannot be made {how}: {describe_error(error)}") from None
    refuse_old_methods(model, f"rig {rig}", _RENAMED)
    if lacking := [name for name in _NEEDED if not hasattr(model, name)]:
        raise InputError(f"rig {rig} lacks {lacking[0]}; a model has {', '.join(_NEEDED)} (docs/own_model.md)")
    check_declarations(model, rig)
    return model


def set_calibration(model: Any, share: float) -> Any:
    """Return `model` with another `calibration`. Raises InputError."""
    model.calibration = check_refit(share)
    return model


def check_refit(share: float, name: str = "calibration") -> float:
    """Return `share` if it is an allowed number of stated uncertainties for a re-fit. Raises InputError, which has `name`."""
    if not 0.0 < share <= _MOST:
        raise InputError(f"{name} {share:g} is not possible; allowed is more than 0 and at most {_MOST:g}")
    return share


def declare_parameters(model: Model) -> ParameterSet:
    """Return the parameters of a model as shipped, with every effect off: those that a model file may change."""
    if hasattr(model, "list_nominal_parameters"):
        return ParameterSet(model.list_nominal_parameters())
    return ParameterSet(
        {**model.parameters, **{n: p for c in model.candidates for n, p in c.declare_parameters().items()}}
    )


def list_required_columns(model: Model) -> tuple[str, ...]:
    """Return the columns that a run of the model must have."""
    if isinstance(model, Demanding):
        return model.run_columns
    return ("time_s", *model.inputs, *(output.column for output in model.outputs))


def select_evidence(path: Path, run: Run, model: Model) -> Columns:
    """Return the columns of `run` that can be compared with the model; errors name it `path`. Raises InputError."""
    columns, rig = list_required_columns(model), run.metadata.get("rig")
    completed = model.complete_run(run.columns) if isinstance(model, Completing) else run.columns
    if rig in list_rigs() and find_rig(rig).plant.clutches and not set(columns) <= set(completed):
        raise InputError(
            f"run {path} is a run of two clutches, of the rig {rig}, which the model {model.name} does not describe;"
            f" {_suggest_parts(rig) or 'allowed are runs of one clutch'}"
        )
    outputs = {output.column for output in model.outputs}
    for name in (*model.inputs, *outputs):
        if source := find_source(given := read_not_measured(run), name, outputs - {name}):
            raise InputError(
                f"run {path}: {name} is {given[name]} by its import map, so it is not measured independently of"
                f" {source}; compared are only columns with a measurement of their own"
            )
    check_run_columns(path, completed, columns)
    return completed


def _suggest_parts(rig: str) -> str:
    """Return a sentence that names the models of parts of a rig, such as its clutches; "" if there are none."""
    parts = [f"--rig {name}" for name in list_entries(GROUP) if name.startswith(f"{rig}.")]
    return f"one of its clutches is compared by {' or '.join(parts)}" if parts else ""


def _find_installed_class(name: str) -> Any:
    if name in list_rigs():
        rig = find_rig(name)
        if not rig.model_at and (parts := _suggest_parts(name)):
            raise InputError(f"rig {name}{rig.of_two} has no discrepancy model; {parts}")
        return rig.model
    if name in (others := list_entries(GROUP)):
        return load_entry(GROUP, "model", name)
    known = sorted((*list_rigs_with_model(), *others))
    raise InputError(f"rig {name!r} is neither known nor PATH.py:CLASS; {suggest_closest(name, known)}")


def _load_user_class(rig: str) -> Any:
    file, _, name = rig.rpartition(":")
    path = Path(file)
    if not file or not name.isidentifier():
        raise InputError(f"rig {rig!r} is not of the form PATH.py:CLASS")
    check_file(path, f"rig {rig}: the file")
    module = load_user_file(path, "clutch_hil_models", f"rig {rig}: {path}")
    if not hasattr(module, name):
        classes = [
            n for n, thing in vars(module).items() if isinstance(thing, type) and thing.__module__ == module.__name__
        ]
        raise InputError(
            f"rig {rig}: {path} has no class {name!r}; {suggest_closest(name, classes) if classes else 'it has none'}"
        )
    return getattr(module, name)
