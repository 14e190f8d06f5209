"""Process fault: a service of the bench that is killed, or stopped for a while, during a run."""

import signal
import time
from collections.abc import Sequence
from dataclasses import dataclass
from math import inf
from typing import Any, Protocol

from protocols.can.two_clutches import CONTROLLERS
from protocols.errors import InputError, suggest_closest

SERVICES = ("plant", *CONTROLLERS)
SIGNALS = {"kill": signal.SIGKILL, "stop": signal.SIGSTOP}


@dataclass(frozen=True)
class ProcessFault:
    """The `service` gets the signal `does`, kill or stop, at `at` [s of the run]; a stopped one goes on at `until` [s].

    Raises InputError for another service or signal, an impossible time, or an end of what is killed.
    """

    service: str
    does: str
    at: float
    until: float = inf

    def __post_init__(self) -> None:
        if self.service not in SERVICES:
            raise InputError(f"process is {self.service!r}; {suggest_closest(self.service, SERVICES)}")
        if self.does not in SIGNALS:
            raise InputError(f"signal is {self.does!r}; allowed are {' and '.join(SIGNALS)}")
        if not 0.0 <= self.at < inf:
            raise InputError(f"at is {self.at:g} s; allowed is 0 and more")
        if self.does == "kill" and self.until != inf:
            raise InputError(
                f"until is {self.until:g} s, and {self.service} is killed: it cannot go on; allowed is none"
            )
        if not self.until > self.at:
            raise InputError(f"until is {self.until:g} s; allowed are times after {self.at:g} s")


class Signalled(Protocol):
    """Services that take signals."""

    def send_signal(self, name: str, number: signal.Signals) -> None:
        """Send a signal to a service, whose end is then no error."""


class ProcessFaults:
    """The process faults of a run, each sent when it is due.

    `sent` are those that were: service, signal, and `time_s`, of the newest sample then.
    """

    def __init__(self, faults: Sequence[ProcessFault]) -> None:
        due = [(f.at, f.service, SIGNALS[f.does]) for f in faults]
        due += [(f.until, f.service, signal.SIGCONT) for f in faults if f.until < inf]
        self._due = sorted(due)
        self._start: float | None = None  # s of time.monotonic at which the run began
        self.sent: list[dict[str, Any]] = []

    def send(self, services: Signalled, newest: float | None) -> None:
        """Send what is due; `newest` is the time [s of the run] of the newest sample, None if none came since the last call.

        A stopped plant makes no samples: the clock of this computer goes on from the last one.
        """
        now = time.monotonic()
        if newest is not None:
            self._start = now - newest
        while self._start is not None and self._due and self._due[0][0] <= now - self._start:
            _, service, number = self._due.pop(0)
            services.send_signal(service, number)
            self.sent.append({"service": service, "signal": number.name, "time_s": now - self._start})
