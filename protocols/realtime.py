"""Make the calling process as punctual as this machine allows; what it does not allow is said, not hidden."""

import ctypes
import gc
import os

_MCL_CURRENT, _MCL_FUTURE = 1, 2  # sys/mman.h
PRIORITY = 80  # SCHED_FIFO: above ordinary work, below the kernel's own threads at 99 (realtime.md)


def prepare(cpu: int | None = None, priority: int = PRIORITY) -> list[str]:
    """Set priority, memory lock, CPU and garbage collector for a control loop.

    `cpu` binds the process to one CPU; None leaves it free. Returns one line for each thing that was not possible.
    """
    missing = []
    try:
        os.sched_setscheduler(0, os.SCHED_FIFO, os.sched_param(priority))
    except (OSError, AttributeError):
        missing.append(f"no real-time priority: the right to SCHED_FIFO {priority} is missing (root, or LimitRTPRIO)")
    try:
        if cpu is not None:
            os.sched_setaffinity(0, {cpu})
    except (OSError, AttributeError):
        missing.append(f"not bound to CPU {cpu}: there is none of that number or the right is missing")
    try:
        libc = ctypes.CDLL(None, use_errno=True)
        if libc.mlockall(_MCL_CURRENT | _MCL_FUTURE):
            raise OSError(ctypes.get_errno())
    except (OSError, AttributeError):
        missing.append("memory is not locked: the right to mlockall is missing (root, or LimitMEMLOCK=infinity)")
    gc.collect()
    gc.freeze()
    gc.disable()
    return missing
