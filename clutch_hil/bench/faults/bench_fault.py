"""Bench fault: what happens to the processes, the computer or the network of a bench during a run, from one time to another."""

import heapq
import itertools
import signal
import time
from abc import ABC, abstractmethod
from collections.abc import Callable, Sequence
from contextlib import ExitStack
from dataclasses import dataclass
from math import inf
from typing import Any, ClassVar, Protocol

from protocols.errors import InputError
from protocols.files.disk import Disk

MOST_FAULTS = 64  # planned or begun in a run: chosen, a program that plans in a loop ends there


class Signalled(Protocol):
    """Services that take signals, by their `names`."""

    @property
    def names(self) -> Sequence[str]:
        """Names of the services."""

    def send_signal(self, name: str, number: signal.Signals) -> None:
        """Send a signal to a service, whose end is then no error."""


@dataclass(frozen=True)
class Surroundings:
    """What a bench fault may act on: services, the disk of the recording, and the network of the bench on `bus`.

    telemetry: whether it publishes. router: of its consumers, as of `clutch-hil view`.
    """

    services: Signalled
    disk: Disk
    bus: str
    telemetry: bool
    router: str | None


@dataclass(frozen=True, kw_only=True)
class BenchFault(ABC):
    """A fault from `at` to `until` [s of the run]. Raises InputError for impossible times."""

    kind: ClassVar[str]  # entry of a scenario that names it
    at: float
    until: float = inf

    def __post_init__(self) -> None:
        if not 0.0 <= self.at < inf:
            raise InputError(f"at is {self.at:g} s; allowed is 0 and more")
        if not self.until > self.at:
            raise InputError(f"until is {self.until:g} s; allowed are times after {self.at:g} s")

    @property
    @abstractmethod
    def what(self) -> str:
        """What happens, in a few words."""

    def check(self, bus: str, telemetry: bool) -> None:  # noqa: B027 - most can be played everywhere
        """Raise InputError where this computer, or a bench on `bus` with or without `telemetry`, cannot play it."""

    @abstractmethod
    def begin(self, around: Surroundings) -> Callable[[], None]:
        """Begin it; return what ends it. Raises InputError where that is not possible."""


class BenchFaults:
    """The faults of a run, each begun and ended when it is due. Leaving it ends those that are on.

    log: what was done: `kind`; `fault`, as text; `does`, which is began or ended; `time_s` of the run, by the newest sample.
    """

    def __init__(self, faults: Sequence[BenchFault], around: Surroundings) -> None:
        self.around = around
        self._due: list[
            tuple[float, int, BenchFault | None]
        ] = []  # a heap: begin the fault, or, if None, end that number
        self._numbers = itertools.count()
        self._on: dict[int, tuple[BenchFault, Callable[[], None]]] = {}  # with what ends it
        self._start: float | None = None  # s of time.monotonic at which the run began
        self.log: list[dict[str, Any]] = []
        for fault in faults:
            self.plan(fault)

    def __enter__(self) -> "BenchFaults":
        return self

    def __exit__(self, *_: object) -> None:
        self.end_all()

    @property
    def now(self) -> float | None:
        """Time of the run [s]; None before the first sample."""
        return None if self._start is None else time.monotonic() - self._start

    def plan(self, fault: BenchFault) -> None:
        """Plan a fault. Raises InputError for one too many, or where this computer cannot play it."""
        number = next(self._numbers)
        if number >= MOST_FAULTS:
            raise InputError(f"the run has {number} faults of the bench already; allowed are {MOST_FAULTS}")
        fault.check(self.around.bus, self.around.telemetry)
        heapq.heappush(self._due, (fault.at, number, fault))

    def play(self, newest: float | None) -> None:
        """Begin and end what is due; `newest` is the time [s of the run] of the newest sample, None if none came since.

        A stopped plant makes no samples: the clock of this computer goes on from the last one. Raises InputError.
        """
        if newest is not None:
            self._start = time.monotonic() - newest
        while self._due and (now := self.now) is not None and self._due[0][0] <= now:
            _, number, fault = heapq.heappop(self._due)
            if fault is None:
                self._end(number)
                continue
            self._on[number] = fault, fault.begin(self.around)
            self._note(fault, "began")
            if fault.until < inf:
                heapq.heappush(self._due, (fault.until, number, None))

    def end(self, names: Sequence[str]) -> list[str]:
        """End the faults of these `names` that are on, now; return what they were."""
        ended = [(number, fault) for number, (fault, _) in self._on.items() if fault.what.split()[0] in names]
        for number, _ in ended:
            self._end(number)
        return [fault.what for _, fault in ended]

    def end_all(self) -> None:
        """End all that are on, now; one that cannot be ended keeps no other on. Raises InputError for it."""
        with ExitStack() as stack:
            for number in reversed(self._on):
                stack.callback(self._end, number)

    def list_on(self) -> list[str]:
        """What is on."""
        return [fault.what for fault, _ in self._on.values()]

    def _end(self, number: int) -> None:
        if number in self._on:  # else it was ended before its time
            fault, end = self._on.pop(number)
            end()
            self._note(fault, "ended")

    def _note(self, fault: BenchFault, does: str) -> None:
        self.log.append({"kind": fault.kind, "fault": fault.what, "does": does, "time_s": self.now})
