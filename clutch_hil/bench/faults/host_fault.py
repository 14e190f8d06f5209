"""Host fault: a fault of the computer that the bench runs on, or of its network."""

from abc import ABC, abstractmethod
from collections.abc import Callable, Mapping
from typing import ClassVar

from clutch_hil.bench.faults.bench_fault import Surroundings
from plant_sim.effects.effect import Shape

SOURCE = "[D] fault injection"


class HostFault(ABC):
    """A kind of fault of the computer. The first line of a subclass's docstring says what it does."""

    name: ClassVar[str]
    parameters: ClassVar[tuple[Shape, ...]]

    @classmethod  # noqa: B027 - most can be played everywhere
    def check(cls, telemetry: bool) -> None:
        """Raise InputError where this computer, or a bench with or without `telemetry`, cannot play it."""

    @classmethod
    @abstractmethod
    def begin(cls, around: Surroundings, values: Mapping[str, float]) -> Callable[[], None]:
        """Begin it with `values` of its parameters, each in its unit; return what ends it. Raises InputError."""
