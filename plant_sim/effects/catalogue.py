"""Catalogue: all effects, of this package and of the user.

An effect is one file: in the folder of its block here, or in one of the user's folders. The environment variable
CLUTCH_HIL_EFFECTS lists those, separated by colons as in PATH.
"""

import importlib
import os
from collections.abc import Mapping
from functools import cache
from pathlib import Path
from types import ModuleType

from plant_sim.effects.effect import Effect
from protocols.errors import InputError, suggest_closest
from protocols.user_file import load_user_file

VARIABLE = "CLUTCH_HIL_EFFECTS"
_FOLDER = Path(__file__).parent


def load_effects() -> Mapping[str, Effect]:
    """Return every effect by name: those of this package, then those of the user's folders. Raises InputError."""
    return _load_effects(os.environ.get(VARIABLE, ""))


def find_effect(name: str) -> Effect:
    """Return an effect by name. Raises InputError that names the closest effects."""
    known = load_effects()
    if name not in known:
        raise InputError(f"effect {name!r} is unknown; {suggest_closest(name, known)}")
    return known[name]


@cache
def _load_effects(folders: str) -> dict[str, Effect]:
    catalogue: dict[str, Effect] = {}
    for folder in (_FOLDER, *(Path(part) for part in folders.split(os.pathsep) if part)):
        if not os.path.isdir(folder):
            wrong = "is a file; a folder of effect files is needed" if os.path.exists(folder) else "does not exist"
            raise InputError(f"folder {folder} of {VARIABLE} {wrong}")
        ours = folder == _FOLDER
        for path in sorted(folder.glob("*/*.py" if ours else "*.py"), key=lambda path: path.name):
            if path.stem.startswith(("_", ".")):  # a point: the lock of an editor
                continue
            if path.stem in catalogue:
                raise InputError(f"effect {path.stem} of {path} exists already, in {catalogue[path.stem].path}")
            module = _load_module(path, ours)
            one = getattr(module, "EFFECT", None)
            if not isinstance(one, Effect):
                raise InputError(f"effect file {path} defines no EFFECT = Effect(...)")
            _check_laws_of_file(one, module, path)
            catalogue[path.stem] = one
    for one in catalogue.values():
        _check_names(one, catalogue)
    return catalogue


def _check_laws_of_file(one: Effect, module: ModuleType, path: Path) -> None:
    """Raise InputError if a law of the effect is of another file: an effect has the name and the text of its laws' file."""
    for law in one.laws.values():
        if law.__module__ != module.__name__:
            raise InputError(
                f"effect file {path}: its law {law.__name__} is of {law.__module__}; allowed are functions that the file itself"
                " defines, which may call those of others"
            )


def _check_names(one: Effect, known: Mapping[str, Effect]) -> None:
    """Raise InputError if an effect names another one that does not exist."""
    for name in one.excludes:
        if name not in known:
            raise InputError(f"effect {one.name} excludes {name!r}, which is unknown; {suggest_closest(name, known)}")
    beside = one.display.beside
    if beside is not None and beside not in known:
        raise InputError(
            f"effect {one.name} is shown together with {beside!r}, which is unknown; {suggest_closest(beside, known)}"
        )


def _load_module(path: Path, ours: bool) -> ModuleType:
    """Return the module of an effect file. Raises InputError for a user's file that cannot be loaded."""
    if ours:
        return importlib.import_module(f"{__package__}.{path.parent.name}.{path.stem}")
    return load_user_file(path, "clutch_hil_effects", f"effect file {path}")
