"""Part of a rig: the search in one clutch of two takes runs of its rig, and returns parameters of its rig."""

from dataclasses import replace

from clutch_hil.discrepancy.result import Estimate, Result
from clutch_hil.fitting.model import Model, PartOfRig
from protocols.errors import InputError, name_run
from protocols.files.run import Run


def take_part(model: Model, name: str, run: Run) -> Run:
    """Return the run `name` with the columns of `model`, which may be a part of its rig. Raises InputError."""
    if not isinstance(model, PartOfRig):
        return run
    try:
        return model.take_run(run)
    except InputError as error:
        raise InputError(f"{name_run(name)} {error}") from None


def name_as_rig(result: Result, model: Model) -> Result:
    """Return a result whose parameters have the names of the rig, of which `model` may be a part."""
    if not isinstance(model, PartOfRig):
        return result

    def rename(estimates: list[Estimate]) -> list[Estimate]:
        return [replace(one, name=model.name_in_whole(one.name)) for one in estimates]

    surrogate = result.surrogate
    if surrogate:
        values = surrogate.get("values", {})
        surrogate = {**surrogate, "values": {model.name_in_whole(name): value for name, value in values.items()}}
    return replace(result, parameters=rename(result.parameters), baseline=rename(result.baseline), surrogate=surrogate)


def note_part(model: Model) -> list[str]:
    """Return a note on the names of columns and parameters if `model` is a part of a rig."""
    if not isinstance(model, PartOfRig):
        return []
    example = next(name for name in model.parameters if model.name_in_whole(name) != name)
    return [
        f"{model.name} is a part of the rig {model.whole}; columns and parameters have the names of a rig with one clutch."
        f" model.toml has the rig's names, such as {model.name_in_whole(example)} for {example}"
    ]
