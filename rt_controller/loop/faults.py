"""Faults of a controller since its start: their number, and the record of the cycle in which the first began.

The service reports them at its end, also when nobody has read its record. While it runs, readers of the record report faults by
protocols/can/fault_text.py.
"""

import numpy as np
from numba import njit

from rt_controller.loop.cycle_record import RECORD

# count: of faults; last: Fault of the cycle before; first: record of the cycle in which the first fault began
FAULTS = np.dtype([("count", "i8"), ("last", "i8"), ("first", RECORD)])


@njit
def note_fault(faults, record):
    """Update FAULTS with the record of a cycle."""
    fault = np.int64(record.fault)
    if fault != 0 and fault != faults.last:
        faults.count += 1
        if faults.count == 1:
            faults.first = record
    faults.last = fault
