"""New benches: computing times of newly started benches, for comparison with one that runs for hours.

They are started, measured and ended one after the other, in a separate process. A slower machine also slows these down; growth
in the old bench does not.
"""

import multiprocessing
import tempfile
import time
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from multiprocessing.connection import Connection
from pathlib import Path

import numpy as np

from benchmarks.requests import compute_percentiles, read_work
from clutch_hil.bench.scenario import Scenario
from clutch_hil.bench.settings import RunSettings
from clutch_hil.bench.up import POLL, Bench
from protocols.errors import InputError, InterruptionError
from protocols.realtime.stopping import Stop

NODES = ("plant", "controller")
_SETTLING, _MEASURED = 5.0, 5.0  # s of a new bench
_BETWEEN = 20.0  # s between two: starting one takes 5 s of CPU time
_ENDING = 20.0  # s for the process to end its bench


class NewBenches:
    """The process in which new benches run, and the medians that it sends."""

    def __init__(self, process: int, medians: Connection) -> None:
        self.process = process
        self._medians = medians

    def read(self) -> dict[str, float]:
        """Return the medians [us] of the last bench measured since the last call, by node; NaN if there was none."""
        medians = dict.fromkeys(NODES, np.nan)
        while self._medians.poll():
            medians = self._medians.recv()
        return medians


@contextmanager
def new_benches(bus: str) -> Iterator[NewBenches]:
    """Run new benches on `bus`, one after the other, during the `with` block."""
    spawn = multiprocessing.get_context("spawn")
    ours, theirs = spawn.Pipe(duplex=False)
    process = spawn.Process(target=_run, args=(bus, theirs))
    process.start()
    theirs.close()
    assert process.pid
    try:
        yield NewBenches(process.pid, ours)
    finally:
        process.terminate()
        process.join(_ENDING)
        process.kill()


def _run(bus: str, medians: Connection) -> None:
    with Stop() as stop:
        while not stop.asked:
            with suppress(
                InputError, InterruptionError
            ):  # it ended in a fault, because the machine was busy, or at its start
                medians.send(_measure_one(bus, stop))
            _wait(_BETWEEN, stop)


def _measure_one(bus: str, stop: Stop) -> dict[str, float]:
    """Start a bench without telemetry, and return the median computing times [us] of its nodes."""
    with tempfile.TemporaryDirectory() as folder:
        settings = RunSettings(seconds=_SETTLING + 2 * _MEASURED, out=Path(folder))
        with Bench(Scenario.of(settings), bus, telemetry=False).start(stop, lambda _: None) as session:
            read_work(session, _SETTLING)
            work = read_work(session, _MEASURED)
            session.finish(interrupted=True)
    return {node: compute_percentiles(work[node])["p50_us"] for node in NODES}


def _wait(seconds: float, stop: Stop) -> None:
    end = time.monotonic() + seconds
    while time.monotonic() < end and not stop.asked:
        time.sleep(POLL)
