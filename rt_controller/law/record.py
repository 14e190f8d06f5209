"""Record: named numbers in one block of memory, for both compiled loops and Python."""

from collections.abc import Mapping
from typing import Any

import numpy as np


def make_float_type(*names: str) -> np.dtype:
    """Return the type of a record with the fields `names`, all doubles."""
    return np.dtype([(name, "f8") for name in names])


def make_record(layout: np.dtype, values: Mapping[str, Any] | None = None, /, **more: Any) -> Any:
    """Return a record of `layout` with its fields as attributes; a field without a value is zero.

    Raises AttributeError for a name that is no field.
    """
    fields = np.zeros(1, layout).view(np.recarray)[0]
    for name, value in ({**(values or {}), **more}).items():
        setattr(fields, name, value)
    return fields
