"""Arguments: check what Python callers pass, and convert it: NumPy numbers to Python numbers, a single item to a list."""

import reprlib
from collections.abc import Iterable, Mapping
from math import inf
from numbers import Real
from operator import index
from os import PathLike
from pathlib import Path
from typing import Any

import numpy as np

from protocols.errors import InputError
from protocols.files.run import Run

_ALONE = (str, bytes, PathLike, Run)  # a single item, though some of these types are iterable


def take_iterable(name: str, value: Any) -> Iterable[Any]:
    """Return `value` as an iterable; a single name, path or run becomes a list of one. Raises InputError for other types."""
    if isinstance(value, _ALONE):
        return [value]
    if not isinstance(value, Iterable):
        raise InputError(f"{name} is {_show(value)}; allowed is a list")
    return value


def take_list(name: str, value: Any) -> list[Any]:
    """Return `value` as a list, see `take_iterable`."""
    return list(take_iterable(name, value))


def take_whole(name: str, value: Any, least: float, most: float = inf) -> int:
    """Return `value`, a Python or NumPy number, as a whole number from `least` to `most`. Raises InputError.

    With -inf as `least` the caller checks the range: the message of this function names none.
    """
    try:
        number = None if isinstance(value, (bool, np.bool_)) else index(value)
    except TypeError:
        number = None
    if number is None or not least <= number <= most:
        if most < inf:
            allowed = f"allowed are {least} to {most}, whole numbers"
        else:
            allowed = "a whole number is needed" if least == -inf else f"allowed are {least} and more, whole numbers"
        raise InputError(f"{name} is {_show(value)}; {allowed}")
    return number


def take_number(name: str, value: Any) -> float:
    """Return `value`, a Python or NumPy number, as a float. Raises InputError."""
    if isinstance(value, bool) or not isinstance(value, Real):
        raise InputError(f"{name} is {_show(value)}; a number is needed")
    return float(value)


def take_range(name: str, value: Any) -> tuple[float, float]:
    """Return `value`, two numbers, as a low and a high one; their order is not checked. Raises InputError."""
    if not isinstance(value, Iterable) or isinstance(value, (str, bytes, Mapping)) or len(ends := list(value)) != 2:
        raise InputError(f"{name} is {_show(value)}; a low and a high number are needed")
    low, high = (take_number(name, end) for end in ends)
    return low, high


def take_flag(name: str, value: Any) -> bool:
    """Return `value` as a bool. Raises InputError."""
    if not isinstance(value, (bool, np.bool_)):
        raise InputError(f"{name} is {_show(value)}; allowed are True and False")
    return bool(value)


def take_function(name: str, value: Any) -> Any:
    """Return `value` if it is callable. Raises InputError."""
    if not callable(value):
        raise InputError(f"{name} is {_show(value)}; allowed is a function")
    return value


def take_mapping(name: str, value: Any) -> dict[str, Any]:
    """Return `value` as a mapping by name; None becomes an empty one. Raises InputError."""
    if value is None:
        return {}
    if not isinstance(value, Mapping) or not all(isinstance(key, str) for key in value):
        raise InputError(f"{name} is {_show(value)}; allowed is a mapping of names to values")
    return dict(value)


def take_name(name: str, value: Any) -> str:
    """Return `value` if it is a string. Raises InputError."""
    if not isinstance(value, str):
        raise InputError(f"{name} is {_show(value)}; a name is needed")
    return value


def take_run(name: str, value: Any) -> Run:
    """Return `value` if it is a Run; the path of a run is not accepted. Raises InputError."""
    if not isinstance(value, Run):
        raise InputError(f"{name} is {_show(value)}; a Run is needed, as of read_run or simulate")
    return value.with_numbers()


def take_runs(name: str, value: Any) -> list[Run | str | Path]:
    """Return `value` as a list of runs, or of the paths of their files, see `take_iterable`. Raises InputError."""
    runs = take_list(name, value)
    if odd := [run for run in runs if not isinstance(run, (Run, str, PathLike))]:
        raise InputError(f"{name} has {_show(odd[0])}; allowed are runs, and paths of run files")
    return [run.with_numbers() if isinstance(run, Run) else run if isinstance(run, str) else Path(run) for run in runs]


def take_path(name: str, value: Any) -> Path:
    """Return `value` as a path. Raises InputError."""
    if not isinstance(value, (str, PathLike)):
        raise InputError(f"{name} is {_show(value)}; the path of a file is needed")
    return Path(value)


def _show(value: Any) -> str:
    return reprlib.repr(value)
