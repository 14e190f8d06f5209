"""Record: named numbers in one piece of memory, which compiled loops and Python read and write alike."""

from collections.abc import Mapping
from typing import Any

import numpy as np


def floats(*names: str) -> np.dtype:
    """Layout of a record of doubles."""
    return np.dtype([(name, "f8") for name in names])


def record(layout: np.dtype, values: Mapping[str, Any] | None = None, /, **more: Any) -> Any:
    """A record of `layout`, its fields as attributes: zero where no value is given. Raises AttributeError for another name."""
    fields = np.zeros(1, layout).view(np.recarray)[0]
    for name, value in ({**(values or {}), **more}).items():
        setattr(fields, name, value)
    return fields
