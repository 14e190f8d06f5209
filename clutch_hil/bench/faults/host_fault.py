"""Host fault: a fault of the computer that the bench runs on, or of its network."""

from abc import ABC, abstractmethod
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import ClassVar

from clutch_hil.bench.faults.bench_fault import Surroundings
from plant_sim.effects.effect import Shape

SOURCE = "[D] fault injection"


class HostFault(ABC):
    """A kind of fault of the computer. The first line of a subclass's docstring says what it does."""

    name: ClassVar[str]
    parameters: ClassVar[tuple[Shape, ...]]

    @classmethod  # noqa: B027 - most can be played everywhere
    def check(cls, bus: str, telemetry: bool) -> None:
        """Raise InputError where this computer, or a bench on `bus` with or without `telemetry`, cannot play the fault."""

    @classmethod
    @abstractmethod
    def begin(cls, around: Surroundings, values: Mapping[str, float]) -> Callable[[], None]:
        """Begin the fault with `values` of its parameters, each in its unit; return a function to end it. Raises InputError."""


def has_capability(number: int) -> bool:
    """Return whether this process has a capability of Linux, by its number in linux/capability.h."""
    for line in Path("/proc/self/status").read_text(encoding="ascii", errors="replace").splitlines():
        if line.startswith("CapEff:"):
            return bool(int(line.split()[1], 16) >> number & 1)
    return False
