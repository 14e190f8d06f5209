"""Arrow: columns of numbers to and from Arrow, without pandas.

`pyarrow.array` and `to_numpy` import pandas if it is installed, to check whether their argument is a series: 0.4 s of a CPU
and 30 MB (measured with pandas 3.1) in every process that writes telemetry or a run.
"""

from collections.abc import Iterable, Sequence
from itertools import accumulate

import numpy as np
import pyarrow as pa
import pyarrow.compute as pc

TRUE, FALSE = pa.BooleanArray.from_buffers(pa.bool_(), 2, [None, pa.py_buffer(b"\x01")])  # scalars, as a flag of Python
NOT_A_NUMBER = pa.Array.from_buffers(pa.float64(), 1, [None, pa.py_buffer(np.array([np.nan]))])[0]


def from_texts(texts: Sequence[str]) -> pa.StringArray:
    """Return texts (n,) as an array."""
    data = [text.encode("utf-8", "replace") for text in texts]
    ends = np.array([0, *accumulate(map(len, data))], np.int32)
    return pa.StringArray.from_buffers(len(data), pa.py_buffer(ends), pa.py_buffer(b"".join(data)))


def from_rows(rows: np.ndarray) -> list[pa.Array]:
    """Return the columns of `rows`, shape (n, k), as k arrays of n float64; not copied if `rows` is in Fortran order."""
    columns: Iterable[np.ndarray] = np.asarray(rows.T, dtype=np.float64)
    if rows.strides[0] != rows.itemsize:
        columns = np.ascontiguousarray(columns)
    return [pa.Array.from_buffers(pa.float64(), len(rows), [None, pa.py_buffer(column)]) for column in columns]


def convert_numbers(column: pa.ChunkedArray) -> np.ndarray:
    """Return a column of n numbers of any type as n float64; NaN for a missing value."""
    floats = pc.cast(column, pa.float64(), safe=False)
    if floats.null_count:
        floats = pc.coalesce(floats, NOT_A_NUMBER)
    return np.concatenate([np.empty(0), *map(np.from_dlpack, floats.chunks)])
