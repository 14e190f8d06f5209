"""Faults of a controller since its start: their number, and the records of the first fault.

The records are those of the cycle in which the fault began and of the cycle before. The service reports them when it ends, even
if no process has read its record. During the run, readers of the record report faults by protocols/can/fault_text.py.
"""

import numpy as np
from numba import njit

from rt_controller.loop.cycle_record import RECORD

# count: of faults; last: Fault of the cycle before; first, before: records of the cycle in which the first fault began and of
# the cycle before it
FAULTS = np.dtype([("count", "i8"), ("last", "i8"), ("before", RECORD), ("first", RECORD)])


@njit
def note_fault(faults, record):
    """Update FAULTS with the record of a cycle."""
    fault = np.int64(record.fault)
    if fault != 0 and fault != faults.last:
        faults.count += 1
        if faults.count == 1:
            faults.first = record
    if faults.count == 0:
        faults.before = record
    faults.last = fault
