"""Arguments: what callers from Python give, as what the bench takes: numbers of NumPy too, one thing for a list of one."""

import reprlib
from collections.abc import Iterable, Mapping
from numbers import Real
from operator import index
from os import PathLike
from pathlib import Path
from typing import Any

import numpy as np

from protocols.errors import InputError
from protocols.files.run import Run

_ALONE = (str, bytes, PathLike, Run)  # one thing, though some of them can be iterated over


def take_iterable(name: str, value: Any) -> Iterable[Any]:
    """`value` to be iterated over; one name, path or run stands for a list of one. Raises InputError for what is no list."""
    if isinstance(value, _ALONE):
        return [value]
    if not isinstance(value, Iterable):
        raise InputError(f"{name} is {_show(value)}; allowed is a list")
    return value


def take_list(name: str, value: Any) -> list[Any]:
    """`value` as a list, see `take_iterable`."""
    return list(take_iterable(name, value))


def take_whole(name: str, value: Any, least: int = 0) -> int:
    """`value` as a whole number, of NumPy or not. Raises InputError."""
    try:
        number = None if isinstance(value, (bool, np.bool_)) else index(value)
    except TypeError:
        number = None
    if number is None or number < least:
        raise InputError(f"{name} is {_show(value)}; allowed are {least} and more, whole numbers")
    return number


def take_number(name: str, value: Any) -> float:
    """`value` as a number, of NumPy or not. Raises InputError."""
    if isinstance(value, bool) or not isinstance(value, Real):
        raise InputError(f"{name} is {_show(value)}; a number is needed")
    return float(value)


def take_flag(name: str, value: Any) -> bool:
    """`value` as True or False. Raises InputError."""
    if not isinstance(value, (bool, np.bool_)):
        raise InputError(f"{name} is {_show(value)}; allowed are True and False")
    return bool(value)


def take_function(name: str, value: Any) -> Any:
    """`value`, which can be called. Raises InputError."""
    if not callable(value):
        raise InputError(f"{name} is {_show(value)}; allowed is a function")
    return value


def take_mapping(name: str, value: Any) -> dict[str, Any]:
    """`value` as a mapping of names, an empty one for None. Raises InputError."""
    if value is None:
        return {}
    if not isinstance(value, Mapping) or not all(isinstance(key, str) for key in value):
        raise InputError(f"{name} is {_show(value)}; allowed is a mapping of names to values")
    return dict(value)


def take_run(name: str, value: Any) -> Run:
    """`value` if it is a run, not the path of one. Raises InputError."""
    if not isinstance(value, Run):
        raise InputError(f"{name} is {_show(value)}; a Run is needed, as of read_run or simulate")
    return value.with_numbers()


def take_runs(name: str, value: Any) -> list[Run | str | Path]:
    """`value` as a list of runs, or of the paths of their files, see `take_iterable`. Raises InputError."""
    runs = take_list(name, value)
    if odd := [run for run in runs if not isinstance(run, (Run, str, PathLike))]:
        raise InputError(f"{name} has {_show(odd[0])}; allowed are runs, and paths of run files")
    return [run.with_numbers() if isinstance(run, Run) else run if isinstance(run, str) else Path(run) for run in runs]


def take_path(name: str, value: Any) -> Path:
    """`value` as a path. Raises InputError."""
    if not isinstance(value, (str, PathLike)):
        raise InputError(f"{name} is {_show(value)}; the path of a file is needed")
    return Path(value)


def _show(value: Any) -> str:
    return reprlib.repr(value)
