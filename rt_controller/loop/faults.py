"""Faults a controller has had, kept in its state: how many, and the record of the cycle in which the first began.

For the end of the service, whether somebody reads its record or not; while it runs, whoever reads the record tells of faults
(protocols/can/fault_text.py).
"""

import numpy as np
from numba import njit

_FAULT = 3  # column of the record


def faults_kept(columns: int) -> np.dtype:
    """The type of what is kept of a record with so many columns."""
    return np.dtype([("count", "i8"), ("last", "i8"), ("first", "f8", (columns,))])


@njit
def note_fault(faults, row):
    """Take the record of a cycle."""
    fault = np.int64(row[_FAULT])
    if fault != 0 and fault != faults.last:
        faults.count += 1
        if faults.count == 1:
            faults.first[:] = row
    faults.last = fault
