"""Pace: a real-time loop that only keeps time. Run as `python -m clutch_hil.bench.timing.witness_loop JSON`.

As a witness it runs beside another loop, on the same CPU, with a higher priority and out of phase. It shows how punctual the
machine was at the same time. Alone it shows the least jitter of a loop in Python.
"""

import json
import sys
import time
from array import array
from dataclasses import asdict, dataclass
from pathlib import Path
from subprocess import Popen
from typing import TYPE_CHECKING

from protocols.realtime.child import spawn
from protocols.realtime.clock import Clock
from protocols.realtime.rights import prepare, relax
from protocols.realtime.stopping import Stop
from protocols.realtime.waiting import choose_waiting

if TYPE_CHECKING:
    import numpy as np

_START_DELAY = 20_000_000  # ns, least time to the first slot


@dataclass(frozen=True)
class Pace:
    """A loop of `seconds` [s] at `rate` [Hz], which can be ended earlier.

    cpu, priority: where it runs, with SCHED_FIFO. phase_ns: offset of its slots from whole periods [ns]. spin_us: it spins for
    this time before a slot [us]. out: file for the measured times, see `read`.
    """

    out: str
    rate: int
    seconds: float
    cpu: int
    priority: int
    phase_ns: int = 0
    spin_us: float = 0.0

    def spawn(self) -> "Popen[bytes]":
        """Start the loop in a separate process."""
        return spawn([sys.executable, "-P", "-m", "clutch_hil.bench.timing.witness_loop", json.dumps(asdict(self))])

    def run(self) -> None:
        """Run the loop; at its end write slots, wake-ups and the times of the next sleep."""
        period = 1_000_000_000 // self.rate
        clock = Clock(period, choose_waiting(self.spin_us, period))
        count = round(self.seconds * self.rate)
        waited_for, woken, ended = (array("q", bytes(8 * count)) for _ in range(3))
        prepare(self.cpu, self.priority)
        clock.start((time.monotonic_ns() + _START_DELAY) // period * period + period + self.phase_ns % period)
        with Stop() as stop:
            start_file(Path(self.out)).touch()
            while clock.run < count and not stop.asked:
                clock.wait()
                waited_for[clock.run - 1], woken[clock.run - 1] = clock.woken_ns - clock.lateness_ns, clock.woken_ns
                clock.end_cycle()
                ended[clock.run - 1] = time.monotonic_ns()
        relax()
        part = Path(self.out).with_suffix(".part")
        part.write_bytes(b"".join(times[: clock.run].tobytes() for times in (waited_for, woken, ended)))
        part.rename(self.out)


def start_file(out: Path) -> Path:
    """Return the path of the file that appears when the loop that will write `out` runs."""
    return out.with_suffix(".begun")


def read(out: Path) -> "tuple[np.ndarray, np.ndarray, np.ndarray]":
    """Read slots, begins and ends of the cycles from `out`, each (n,) [ns of CLOCK_MONOTONIC]."""
    import numpy as np

    slots, woken, ended = np.fromfile(out, np.int64).reshape(3, -1)
    return slots, woken, ended


if __name__ == "__main__":
    Pace(**json.loads(sys.argv[1])).run()
