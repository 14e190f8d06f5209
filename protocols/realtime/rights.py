"""Rights for real time: makes the calling process as punctual as this machine allows, and lists missing rights.

The measures are independent: a process without one of the rights runs with the others. `clutch-hil doctor` lists them.
"""

import ctypes
import gc
import os
import threading
from collections.abc import Callable, Sequence
from contextlib import suppress
from pathlib import Path
from typing import NamedTuple

from protocols.errors import InputError
from protocols.kernels.progress_notice import PROGRESS_NOTICE

_MCL_CURRENT, _MCL_FUTURE = 1, 2  # sys/mman.h
_M_TRIM_THRESHOLD, _M_MMAP_MAX = -1, -4  # malloc.h
_PR_SET_TIMERSLACK = 29  # linux/prctl.h
_DMA_LATENCY = Path("/dev/cpu_dma_latency")
_HEAP, _STACK = 16 << 20, 512 << 10  # bytes touched beforehand: a loop in steady state needs less
_POOLS = 4 << 20  # bytes of Python's pools of small objects: its arenas are 1 MiB, a new one causes 256 page faults
_SMALL_OBJECT = 450  # bytes; up to 512 with the object's head come from the pools
_PINNED_EVERY = 256  # objects: some stay in each arena, otherwise it would be freed
PRIORITY = 80  # SCHED_FIFO: above ordinary work, below the kernel's own threads at 99 (docs/timing.md)

_LIBC = ctypes.CDLL(None, use_errno=True)
_pinned_objects: list[bytes] = []  # small objects that keep their arenas
_held_descriptors: list[int] = []  # open descriptors that keep a request to the kernel valid


class LoopRequest(NamedTuple):
    """Requested scheduling of a loop. cpu: number of the CPU it is bound to, None for any. priority: of SCHED_FIFO, 1..99."""

    cpu: int | None = None
    priority: int = PRIORITY


class Measure(NamedTuple):
    """One measure that makes a process punctual. `take` raises OSError if the right is missing.

    why: its benefit. missing: message if it is not possible. remedy: command that gives the right.
    """

    name: str
    why: str
    take: Callable[[LoopRequest], None]
    missing: str
    remedy: str


def _set_priority(wanted: LoopRequest) -> None:
    os.sched_setscheduler(0, os.SCHED_FIFO, os.sched_param(wanted.priority))


def _bind(wanted: LoopRequest) -> None:
    if wanted.cpu is not None:
        os.sched_setaffinity(0, {wanted.cpu})


def _lock_memory(wanted: LoopRequest) -> None:
    _raise_if_failed(_LIBC.mlockall(_MCL_CURRENT | _MCL_FUTURE))


def _touch_memory(wanted: LoopRequest) -> None:
    """Touch heap, which malloc then keeps, and stack now; locked pages stay in memory."""
    for option, value in ((_M_TRIM_THRESHOLD, -1), (_M_MMAP_MAX, 0)):
        if not _LIBC.mallopt(option, value):
            raise OSError
    touched = bytearray(_HEAP)
    del touched
    small = [bytes(_SMALL_OBJECT) for _ in range(_POOLS // _SMALL_OBJECT)]
    _pinned_objects.extend(small[::_PINNED_EVERY])
    del small
    ctypes.memset(ctypes.create_string_buffer(_STACK), 1, _STACK)


def _set_timer_slack(wanted: LoopRequest) -> None:
    _raise_if_failed(_LIBC.prctl(_PR_SET_TIMERSLACK, 1, 0, 0, 0))


def _stay_awake(wanted: LoopRequest) -> None:
    descriptor = os.open(_DMA_LATENCY, os.O_WRONLY | os.O_CLOEXEC)
    os.write(descriptor, (0).to_bytes(4, "little"))
    _held_descriptors.append(descriptor)


def _disable_collector(wanted: LoopRequest) -> None:
    gc.collect()
    gc.freeze()
    gc.disable()


def _raise_if_failed(result: int) -> None:
    if result:
        raise OSError(ctypes.get_errno(), os.strerror(ctypes.get_errno()))


MEASURES = (  # priority last: the others take a quarter of a second, in which no other process would get the CPU
    Measure(
        "memory locked", "the loop never waits for a page from disk", _lock_memory,
        "memory is not locked: the permission for mlockall is missing (root, or LimitMEMLOCK=infinity)",
        "echo '* - memlock unlimited' | sudo tee /etc/security/limits.d/memlock.conf, and log in again",
    ),
    Measure(
        "memory touched beforehand", "no page is used for the first time in the loop", _touch_memory,
        "memory is not touched beforehand: this C library has no mallopt", "use glibc",
    ),
    Measure(
        "timer slack 1 ns", "the kernel does not group wake-ups; with real-time priority it never does", _set_timer_slack,
        "timer slack is left at 50 us: this kernel refuses PR_SET_TIMERSLACK", "real-time priority has no timer slack",
    ),
    Measure(
        "CPU kept awake", "no deep sleep of the processor between cycles", _stay_awake,
        f"the CPU may sleep deeply: {_DMA_LATENCY} is missing or not writable", f"sudo chmod o+w {_DMA_LATENCY}",
    ),
    Measure(
        "garbage collector off", "no collection interrupts the loop, which creates no reference cycles",
        _disable_collector,
        "the garbage collector is on", "use CPython",
    ),
    Measure(
        "bound to a CPU", "its caches stay warm, and other processes can be kept on other CPUs", _bind,
        "not bound to a CPU: this CPU does not exist or the permission is missing", "choose --cpu from those of `nproc --all`",
    ),
    Measure(
        "real-time priority", "the loop runs before all normal processes", _set_priority,
        "no real-time priority: the permission for SCHED_FIFO is missing (root, or LimitRTPRIO)",
        "echo '* - rtprio 95' | sudo tee /etc/security/limits.d/rt.conf, and log in again",
    ),
)  # fmt: skip


def check_cpu(cpu: int | None) -> int | None:
    """Return `cpu` if this machine has it. Raises InputError. `prepare` checks whether the process may run there."""
    count = os.cpu_count() or 1
    if cpu is not None and not 0 <= cpu < count:
        raise InputError(f"CPU {cpu} does not exist; allowed are 0 to {count - 1}")
    return cpu


def prepare(cpu: int | None = None, priority: int = PRIORITY, measures: Sequence[Measure] = MEASURES) -> list[str]:
    """Take every measure for this process; return one line for each that was not possible."""
    if threading.current_thread() is threading.main_thread():  # otherwise other threads share the process
        PROGRESS_NOTICE.end()
    missing = []
    for measure in measures:
        try:
            measure.take(LoopRequest(cpu, priority))
        except OSError:
            missing.append(measure.missing)
    return missing


def relax() -> None:
    """Return to ordinary priority after the loop: ending takes a tenth of a second, which must not delay other processes."""
    with suppress(OSError):
        os.sched_setscheduler(0, os.SCHED_OTHER, os.sched_param(0))


def is_possible(measure: Measure, wanted: LoopRequest) -> bool:
    """Return whether this process may take a measure.

    It is tried in a child process, so that nothing changes here.
    """
    child = os.fork()
    if child == 0:
        try:
            measure.take(wanted)
            os._exit(0)
        except BaseException:
            os._exit(1)
    return os.waitpid(child, 0)[1] == 0
