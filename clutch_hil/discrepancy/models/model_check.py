"""Model check: whether a model is what a search needs, so that a mistake in a user's file is one sentence before any fit.

`check_declarations` reads what a model declares. `check_simulation` simulates a run without effects, and with each candidate.
"""

from collections.abc import Mapping
from math import isfinite
from typing import Any

import numpy as np

from clutch_hil.fitting.model import Candidate, Columns, Model, Output, Values
from plant_sim.effects.effect import Shape, Strength
from protocols.errors import InputError, join_names
from protocols.files.parameters import ParameterSet
from protocols.user_code import describe_error

_OURS = "clutch_hil."  # models that tests simulate in this way; any other is checked before a search
_LIMITS_OF_OUTPUT = ("resolution", "beginning", "accuracy")


def check_declarations(model: Any, rig: str) -> None:
    """Raise InputError, which names the model `rig`, if inputs, outputs, parameters or candidates are not as needed."""
    _check_texts(model.inputs, f"rig {rig}: inputs")
    outputs = _take_several(model.outputs, Output, f"rig {rig}: outputs")
    if not outputs:
        raise InputError(f"rig {rig} has no outputs; one or more are needed")
    _check_unique([one.column for one in outputs], f"rig {rig}: column of two outputs")
    for output in outputs:
        for name in _LIMITS_OF_OUTPUT:
            value = getattr(output, name)
            if not _is_number(value) or value < 0.0:
                raise InputError(
                    f"rig {rig}: output {output.column} has the {name} {value!r}; a number, 0 or more, is needed"
                )
    if not isinstance(model.parameters, ParameterSet):
        raise InputError(
            f"rig {rig}: parameters is of the type {type(model.parameters).__name__}; a ParameterSet is needed"
        )
    candidates = _take_several(model.candidates, Candidate, f"rig {rig}: candidates")
    _check_unique([one.name for one in candidates], f"rig {rig}: name of two candidates")
    for candidate in candidates:
        _check_candidate(candidate, f"rig {rig}: candidate {candidate.name}")


def check_simulation(model: Model, rig: str, run: Columns) -> None:
    """Raise InputError, which names the model `rig`, if it does not predict the outputs of `run` as a search needs it.

    Models of this package are not simulated.
    """
    if type(model).__module__.startswith(_OURS):
        return
    parameters = {name: p.value for name, p in model.parameters.items()}
    plain = _simulate(model, rig, run, parameters, {}, "without effects")
    again = _simulate(model, rig, run, parameters, {}, "without effects")
    if odd := [column for column in plain if not np.array_equal(plain[column], again[column])]:
        raise InputError(
            f"rig {rig}: simulate predicts other values of {odd[0]} when it is called again; it must be deterministic"
        )
    for candidate in model.candidates:
        off = _simulate(model, rig, run, parameters, candidate.list_off_values(), f"with {candidate.name} off")
        if odd := [column for column in plain if not np.array_equal(plain[column], off[column])]:
            raise InputError(
                f"rig {rig}: candidate {candidate.name} changes {odd[0]} although each of its strengths is off; it must be"
                " the same to the bit as without the candidate"
            )
        typical = candidate.list_typical_values()
        _simulate(model, rig, run, parameters, typical, f"with {candidate.name} at its typical values")


def _simulate(model: Model, rig: str, run: Columns, parameters: Values, effects: Values, how: str) -> Columns:
    """Return the predicted outputs (n,) of a run by column. Raises InputError, which says `how` it was simulated."""
    try:
        predicted = model.simulate(run, parameters, effects)
    except Exception as error:  # a user's function may raise anything
        raise InputError(f"rig {rig}: simulate raises {describe_error(error)}, {how}") from error
    if not isinstance(predicted, Mapping):
        raise InputError(
            f"rig {rig}: simulate returns the type {type(predicted).__name__}; a dictionary of columns is needed"
        )
    rows, outputs = len(run["time_s"]), {}
    for column in (output.column for output in model.outputs):
        if column not in predicted:
            raise InputError(
                f"rig {rig}: simulate does not return {column}, which is one of the outputs; it returns"
                f" {join_names(predicted)}"
            )
        values = np.asarray(predicted[column])
        if values.shape != (rows,) or values.dtype.kind not in "fiu":
            raise InputError(
                f"rig {rig}: simulate returns {column} of the shape {values.shape} and the type {values.dtype}; {rows} numbers"
                " are needed, one for each row"
            )
        if not np.isfinite(values).all():
            bad = int(np.argmin(np.isfinite(values)))
            raise InputError(f"rig {rig}: simulate returns {values[bad]} in row {bad} of {column}, {how}")
        outputs[column] = values
    return outputs


def _check_candidate(candidate: Candidate, name: str) -> None:
    parameters = _take_several(candidate.parameters, (Strength, Shape), f"{name}: parameters")
    _check_unique([p.name for p in parameters], f"{name}: name of two parameters")
    if not candidate.strengths:
        raise InputError(f"{name} has no Strength, which switches it on")
    for p in parameters:
        if not isinstance(p.bounds, (tuple, list)) or len(p.bounds) != 2:
            raise InputError(
                f"{name}: {p.name} has the bounds {p.bounds!r:.80}; a lowest and a highest value are needed"
            )
        low, high = p.bounds
        for what, value in (("off", p.off), ("typical", p.typical)):
            if not all(map(_is_number, (low, high, value))) or not low <= value <= high or low == high:
                raise InputError(
                    f"{name}: {p.name} has {what} {value!r} and the bounds {low!r} to {high!r}; it must be within"
                )
        if isinstance(p, Strength) and p.off == p.typical:
            raise InputError(
                f"{name}: {p.name} has the same value {p.off!r} at off and typical, so it switches nothing on"
            )


def _take_several(values: Any, kind: type | tuple[type, ...], name: str) -> tuple[Any, ...]:
    """Return `values` as a tuple. Raises InputError for anything but a list or tuple of `kind`."""
    kinds = kind if isinstance(kind, tuple) else (kind,)
    if not isinstance(values, (tuple, list)) or not all(isinstance(one, kinds) for one in values):
        needed = " or ".join(one.__name__ for one in kinds)
        raise InputError(
            f"{name} is {values!r:.80}; a tuple of {needed} is needed, with a comma also behind a single one"
        )
    return tuple(values)


def _check_texts(values: Any, name: str) -> None:
    if not isinstance(values, (tuple, list)) or not all(isinstance(one, str) for one in values):
        raise InputError(f"{name} is {values!r:.80}; a tuple of names is needed, with a comma also behind a single one")


def _check_unique(names: list[str], what: str) -> None:
    if twice := [name for k, name in enumerate(names) if name in names[:k]]:
        raise InputError(f"{what}: {twice[0]}; each needs one of its own")


def _is_number(value: object) -> bool:
    return isinstance(value, (int, float, np.number)) and not isinstance(value, bool) and isfinite(value)
