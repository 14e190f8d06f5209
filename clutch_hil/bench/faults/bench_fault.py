"""Bench fault: a fault of the processes, the computer or the network of a bench, from one time of a run to another."""

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

MOST_FAULTS = 64  # planned or begun in a run: chosen, to stop a program that plans faults in a loop


class Signalled(Protocol):
    """Services that accept signals, by their `names`."""

    @property
    def names(self) -> Sequence[str]:
        """Return the names of the services."""

    def send_signal(self, name: str, number: signal.Signals) -> None:
        """Send a signal to a service, whose end is then no error."""


@dataclass(frozen=True)
class Surroundings:
    """What a bench fault may act on: services, the disk of the recording, and the network of the bench on `bus`.

    telemetry: whether the bench publishes. router: of its consumers, as in `clutch-hil view`.
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
        """Return the fault in a few words."""

    def check(self, bus: str, telemetry: bool) -> None:  # noqa: B027 - most can be played everywhere
        """Raise InputError where this computer, or a bench on `bus` with or without `telemetry`, cannot play the fault."""

    @abstractmethod
    def begin(self, around: Surroundings) -> Callable[[], None]:
        """Begin the fault; return a function that ends it. Raises InputError where that is not possible."""


class BenchFaults:
    """The faults of a run; each begins and ends at its time. Leaving the context ends active faults.

    log: `kind`; `fault`, as text; `does`: began or ended; `time_s` of the run, by the newest sample.
    """

    def __init__(self, faults: Sequence[BenchFault], around: Surroundings) -> None:
        self.around = around
        self._due: list[
            tuple[float, int, BenchFault | None]
        ] = []  # a heap: begin the fault, or, if None, end the fault of that number
        self._numbers = itertools.count()
        self._on: dict[int, tuple[BenchFault, Callable[[], None]]] = {}  # with the function that ends it
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
        """Return the time of the run [s]; None before the first sample."""
        return None if self._start is None else time.monotonic() - self._start

    def plan(self, fault: BenchFault) -> None:
        """Plan a fault. Raises InputError for too many faults, or where this computer cannot play the fault."""
        number = next(self._numbers)
        if number >= MOST_FAULTS:
            raise InputError(f"the run has {number} faults of the bench already; allowed are {MOST_FAULTS}")
        fault.check(self.around.bus, self.around.telemetry)
        heapq.heappush(self._due, (fault.at, number, fault))

    def play(self, newest: float | None) -> None:
        """Begin and end faults that are due. newest: time [s of the run] of the newest sample, None if no new sample arrived.

        A stopped plant makes no samples: time then continues by this computer's clock. Raises InputError.
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
        """End the active faults of these `names` now; return their descriptions."""
        ended = [(number, fault) for number, (fault, _) in self._on.items() if fault.what.split()[0] in names]
        for number, _ in ended:
            self._end(number)
        return [fault.what for _, fault in ended]

    def end_all(self) -> None:
        """End all active faults now; an error in one does not keep others active. Raises InputError for it."""
        with ExitStack() as stack:
            for number in reversed(self._on):
                stack.callback(self._end, number)

    def list_on(self) -> list[str]:
        """Return the descriptions of the active faults."""
        return [fault.what for fault, _ in self._on.values()]

    def _end(self, number: int) -> None:
        if number in self._on:  # otherwise it was ended before its time
            fault, end = self._on.pop(number)
            end()
            self._note(fault, "ended")

    def _note(self, fault: BenchFault, does: str) -> None:
        self.log.append({"kind": fault.kind, "fault": fault.what, "does": does, "time_s": self.now})
