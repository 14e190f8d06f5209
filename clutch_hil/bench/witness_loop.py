"""Pace: a real-time loop that does nothing but keep time. `python -m clutch_hil.bench.witness_loop JSON`

As a witness beside another loop, on its CPU, above its priority and out of its phase, it shows what the machine allows at that
moment; alone it is the floor of a loop in this language.
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

_START_DELAY = 20_000_000  # ns to the first slot at least


@dataclass(frozen=True)
class Pace:
    """`seconds` [s], or until it is asked to end, at `rate` [Hz] on a CPU with a priority of SCHED_FIFO; slots lie `phase_ns`
    behind whole periods.

    What was measured is written to `out`; see `read`.
    """

    out: str
    rate: int
    seconds: float
    cpu: int
    priority: int
    phase_ns: int = 0
    spin_us: float = 0.0

    def spawn(self) -> "Popen[bytes]":
        """The loop as a process of its own."""
        return spawn([sys.executable, "-P", "-m", "clutch_hil.bench.witness_loop", json.dumps(asdict(self))])

    def run(self) -> None:
        """Keep time; write slots, wake-ups and when it slept again when it is over."""
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
    """The file that is there once the loop that will write `out` runs."""
    return out.with_suffix(".begun")


def read(out: Path) -> "tuple[np.ndarray, np.ndarray, np.ndarray]":
    """Slots that were waited for, when their cycles began, and when they were over (n,), ns of CLOCK_MONOTONIC."""
    import numpy as np

    slots, woken, ended = np.fromfile(out, np.int64).reshape(3, -1)
    return slots, woken, ended


if __name__ == "__main__":
    Pace(**json.loads(sys.argv[1])).run()
