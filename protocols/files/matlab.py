"""MATLAB files as runs: one vector for each name. Single numbers become metadata.

The libraries for all levels can crash on a damaged file, so it is read in a child process.
"""

from collections.abc import Callable, Mapping
from math import prod
from pathlib import Path
from typing import Any

import numpy as np

from protocols.errors import InputError
from protocols.files.child_reader import ChildReader
from protocols.files.run import Run

_NUMBERS = "fiub"  # kinds of NumPy types that are real numbers
_CLASSES = ("double", "single", "logical", *(f"{sign}int{bits}" for sign in ("", "u") for bits in (8, 16, 32, 64)))
_LEVEL73 = b"MATLAB 7.3 MAT-file"
_LONGEST_REASON = 200  # characters of another library's error message
_MOST_NUMBERS = 1 << 27  # in one file: 1 GiB as float64, as much as a recording may have


def read_mat(path: Path) -> Run:
    """Read every numeric vector in a file of level 4, 5 or 7.3, of any length. Raises InputError.

    Text, structures, matrices and complex numbers are left out.
    """
    try:
        with path.open("rb") as file:
            is_level73 = file.read(len(_LEVEL73)) == _LEVEL73
        content = _read_by_child(path, "serve_level73" if is_level73 else "serve_level5")
    except FileNotFoundError:
        raise InputError(f"run {path} does not exist") from None
    columns, metadata = {}, {}
    for name, value in content.items():
        if not isinstance(value, np.ndarray) or value.dtype.kind not in _NUMBERS:
            continue
        if value.size == 1:
            metadata[name] = value.item()
        else:
            columns[name] = value.ravel().astype(float)
    if not columns:
        raise InputError(f"run {path} has no vectors of numbers")
    return Run(columns, metadata)


def _read_level5(path: Path) -> Mapping[str, Any]:
    """Return the vectors and single numbers of a file of level 4 or 5."""
    from scipy.io import loadmat, whosmat

    try:
        names = _list_vectors(path, {name: shape for name, shape, kind in whosmat(path) if kind in _CLASSES})
        content = loadmat(path, variable_names=names) if names else {}
    except (InputError, MemoryError):
        raise
    except Exception as error:  # scipy raises many exception types
        raise _make_error(path, error) from None
    return {
        name: value for name, value in content.items() if isinstance(value, np.ndarray) and value.dtype.kind in _NUMBERS
    }


def _read_by_child(path: Path, serve: str) -> Mapping[str, Any]:
    content: Mapping[str, Any] = ChildReader(f"run {path}", f"{__name__}:{serve}", str(path)).ask()
    return content


def serve_level5(path: str) -> Callable[[None], Mapping[str, Any]]:
    """Read a file of level 4 or 5 in the child process; see ChildReader."""
    return lambda _: _read_level5(Path(path))


def serve_level73(path: str) -> Callable[[None], Mapping[str, Any]]:
    """Read a file of level 7.3 in the child process; see ChildReader."""
    return lambda _: _read_level73(Path(path))


def _read_level73(path: Path) -> Mapping[str, Any]:
    """Return the vectors and single numbers of a file of level 7.3. Links are not followed."""
    import h5py

    try:
        with h5py.File(path, "r", locking=False) as file:
            entries = {name: file[name] for name in file if isinstance(file.get(name, getlink=True), h5py.HardLink)}
            shapes = {
                name: entry.shape or (0,)
                for name, entry in entries.items()
                if isinstance(entry, h5py.Dataset) and entry.attrs.get("MATLAB_class", b"").decode() in _CLASSES
            }
            wanted = [name for name in _list_vectors(path, shapes) if "MATLAB_empty" not in entries[name].attrs]
            return {name: entries[name][()] for name in wanted}
    except (InputError, MemoryError):
        raise
    except Exception as error:  # h5py raises many exception types
        raise _make_error(path, error) from None


def _make_error(path: Path, error: Exception) -> InputError:
    reason = "".join(one if one.isprintable() else " " for one in str(error)[:_LONGEST_REASON])  # scipy quotes the file
    return InputError(f"run {path} cannot be read: {' '.join(reason.split()) or type(error).__name__}")


def _list_vectors(path: Path, shapes: Mapping[str, tuple[int, ...]]) -> list[str]:
    """Return the names of the variables that are vectors or single numbers. Raises InputError if they are too large."""
    names = [name for name, shape in shapes.items() if 0 < prod(shape) == max(shape)]
    if (count := sum(prod(shapes[name]) for name in names)) > _MOST_NUMBERS:
        raise InputError(f"run {path} has {count:.4g} numbers; allowed are {_MOST_NUMBERS:.4g}")
    return names
