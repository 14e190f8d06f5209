"""Names of states: the values that they say, as `3` of a gear and `on` of a brake do."""

from collections.abc import Sequence

import numpy as np
import pyarrow as pa

from clutch_hil.recordings.text.cells import Cells

_CELLS = Cells()
_FLAG_NUMBERS = ("0", "1")


def value_states(names: Sequence[str | None]) -> np.ndarray | None:
    """Values (n,) of names that are all numbers, or all on and off, in any language of `Cells`; None where one is neither.

    What stands for no value, such as an empty name, is not-a-number.
    """
    given = [name for name in names if name is not None and not _CELLS.is_missing(name)]
    numbers = all(_CELLS.is_number(name) for name in given)
    if not given or not (numbers or all(_CELLS.is_flag(name) or name in _FLAG_NUMBERS for name in given)):
        return None
    return _CELLS.parse_flags(pa.array([name or "" for name in names], pa.string())).values
