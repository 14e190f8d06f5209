"""Process fault: a service of the bench that is killed, or stopped for a while."""

import signal
from collections.abc import Callable
from dataclasses import dataclass
from math import inf

from clutch_hil.bench.faults.bench_fault import BenchFault, Surroundings
from protocols.can.two_clutches import CONTROLLERS
from protocols.errors import InputError, suggest_closest

SERVICES = ("plant", *CONTROLLERS)
SIGNALS = {"kill": signal.SIGKILL, "stop": signal.SIGSTOP}


@dataclass(frozen=True)
class ProcessFault(BenchFault):
    """The `service` gets the signal `does`, kill or stop; a stopped one goes on at `until` [s].

    Raises InputError for another service or signal, an impossible time, or an end of what is killed.
    """

    kind = "process"
    service: str
    does: str

    def __post_init__(self) -> None:
        if self.service not in SERVICES:
            raise InputError(f"process is {self.service!r}; {suggest_closest(self.service, SERVICES)}")
        if self.does not in SIGNALS:
            raise InputError(f"signal is {self.does!r}; allowed are {' and '.join(SIGNALS)}")
        if self.does == "kill" and self.until != inf:
            raise InputError(
                f"until is {self.until:g} s, and {self.service} is killed and cannot continue; leave until out"
            )
        super().__post_init__()

    @property
    def what(self) -> str:
        """See `BenchFault`."""
        return f"{self.service} {'killed' if self.does == 'kill' else 'stopped'}"

    def begin(self, around: Surroundings) -> Callable[[], None]:
        """See `BenchFault`."""
        around.services.send_signal(self.service, SIGNALS[self.does])
        if self.does == "kill":
            return lambda: None
        return lambda: around.services.send_signal(self.service, signal.SIGCONT)
