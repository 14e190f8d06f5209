"""MATLAB files as dSPACE ControlDesk exports them, one vector for each name. Single numbers become metadata."""

from pathlib import Path
from typing import Any

import numpy as np

from protocols.errors import InputError
from protocols.files.run import Run

_NUMBERS = "fiub"  # kinds of NumPy types that are real numbers
_HDF5 = b"MATLAB 7.3 MAT-file"


def read_mat(path: Path) -> Run:
    """Read every vector of numbers in a file of level 4 or 5 (MATLAB's `-v7` and before), of any length. Raises InputError.

    Text, structures, matrices and complex numbers are left out.
    """
    from scipy.io import loadmat

    try:
        with path.open("rb") as file:
            if file.read(len(_HDF5)) == _HDF5:
                raise InputError(f"run {path} is a MATLAB 7.3 file (HDF5); save it again with `save(..., '-v7')`")
        content: dict[str, Any] = loadmat(path)
    except FileNotFoundError:
        raise InputError(f"run {path} does not exist") from None
    except InputError:
        raise
    except Exception as error:  # scipy raises many kinds
        raise InputError(f"run {path} cannot be read: {' '.join(str(error).split())}") from None
    columns, metadata = {}, {}
    for name, value in content.items():
        if name.startswith("__") or not isinstance(value, np.ndarray) or value.dtype.kind not in _NUMBERS:
            continue
        if value.size == 1:
            metadata[name] = value.item()
        elif value.size == max(value.shape):  # a row or a column
            columns[name] = value.ravel().astype(float)
    if not columns:
        raise InputError(f"run {path} has no vectors of numbers")
    return Run(columns, metadata)
