"""Witness: an empty loop and a stall watch, both beside a measured loop (`clutch_hil.bench.timing.jitter`)."""

import contextlib
import subprocess
import time
from collections.abc import Iterator
from pathlib import Path

import numpy as np

from clutch_hil.bench.timing.measurements import Setting
from clutch_hil.bench.timing.stalls import StallWatch
from clutch_hil.bench.timing.witness_loop import Pace, read, start_file
from protocols.errors import InputError
from protocols.realtime.child import await_end
from protocols.realtime.shared_folder import SharedFolder

WITNESS_PRIORITY = 90  # of SCHED_FIFO; chosen: above the services (`protocols.realtime.rights`), below kernel threads
START_TIMEOUT = 60.0  # s for the loop to close, and for other processes to start and to end
_CHECKS_PER_PERIOD = 4  # of the stall watch; chosen: detects a stall of a fraction of a period
_MOST_CHECKS = 4000  # of the stall watch per second: each takes 10 us
# of the stall watch per second, for loops above _MOST_CHECKS Hz: 10 us of a period of 125 us would be too much
_FAST_CHECKS = 1000
POLL_INTERVAL = 0.02  # s; chosen: short compared with a phase, and a negligible load


@contextlib.contextmanager
def run_witness(setting: Setting, seconds: float, phase_ns: int) -> Iterator[list[np.ndarray]]:
    """Run a witness while entered. Afterwards the list has three arrays (n,) [ns]: slots, wake-ups, times of the next sleep."""
    folder = SharedFolder()
    out = folder.path / "witness"
    times: list[np.ndarray] = []
    pace = Pace(str(out), setting.rate, seconds + START_TIMEOUT, setting.cpu, WITNESS_PRIORITY, phase_ns)
    process = pace.spawn()
    try:
        wait_for_start(process, start_file(out), "witness")
        yield times
        process.terminate()
        await_end(process, START_TIMEOUT, "witness")
        times += read(out)
    finally:
        process.kill()
        process.wait()
        folder.remove()


def make_stall_watch(setting: Setting, seconds: float, phase_ns: int) -> StallWatch:
    """Return a watch whose slots lie midway between the slots of the witness and those of the loop."""
    most = _MOST_CHECKS if setting.rate <= _MOST_CHECKS else _FAST_CHECKS
    every = 1_000_000_000 // min(_CHECKS_PER_PERIOD * setting.rate, most)
    return StallWatch(setting.cpu, WITNESS_PRIORITY, every, phase_ns + every // 2, seconds + START_TIMEOUT)


def wait_for_start(process: "subprocess.Popen[bytes]", ready_file: Path, what: str) -> None:
    """Wait for the file `ready_file` that a process creates when it starts. Raises InputError when it does not appear."""
    end = time.monotonic() + START_TIMEOUT
    while not ready_file.exists():
        if process.poll() is not None or time.monotonic() > end:
            raise InputError(f"the {what} of the measurement did not start")
        time.sleep(POLL_INTERVAL)
