"""Faults a controller has had, kept in its state: how many, and the record of the cycle in which the first began.

For the end of the service, whether somebody reads its record or not; while it runs, whoever reads the record tells of faults
(protocols/can/fault_text.py).
"""

import numpy as np
from numba import njit

from rt_controller.loop.cycle_record import RECORD

FAULTS = np.dtype([("count", "i8"), ("last", "i8"), ("first", RECORD)])


@njit
def note_fault(faults, record):
    """Take the record of a cycle."""
    fault = np.int64(record.fault)
    if fault != 0 and fault != faults.last:
        faults.count += 1
        if faults.count == 1:
            faults.first = record
    faults.last = fault
