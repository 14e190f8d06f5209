"""Bus fault: changes the frames that pass in one direction between two samples."""

from abc import ABC, abstractmethod
from collections.abc import Mapping
from dataclasses import dataclass
from random import Random
from typing import ClassVar

from plant_sim.effects.effect import Shape, Strength
from protocols.can.frames import Frame, FrameCodec

COMMANDS, SAMPLES = "commands", "samples"  # directions: from the controllers to the plant, and from the plant to them
SOURCE = "[D] fault injection"


@dataclass(frozen=True)
class Surroundings:
    """Inputs of a bus fault: the direction, `rate` [Hz], frames of the bus by identifier and name, a random generator."""

    direction: str
    rate: int
    by_id: Mapping[int, FrameCodec]
    by_name: Mapping[str, FrameCodec]
    chance: Random


class BusFault(ABC):
    """A fault of the bus in one direction, from the time when it is switched on until it is switched off.

    The first line of a subclass's docstring describes its effect. `parameters` has its strengths and other parameters, as of an
    effect. Frames that it still holds when it is switched off are lost.
    """

    name: ClassVar[str]
    parameters: ClassVar[tuple[Strength | Shape, ...]]

    def __init__(self, around: Surroundings) -> None:
        self.around = around

    @abstractmethod
    def pass_on(self, tick: int, frames: list[Frame], values: Mapping[str, float]) -> list[Frame]:
        """Return the frames that arrive in the period before the sample `tick`, out of the `frames` sent in it.

        `values` are those of `parameters` by name, each in its unit.
        """

    @classmethod
    def list_strengths(cls) -> tuple[Strength, ...]:
        """Return the parameters that switch the fault on."""
        return tuple(p for p in cls.parameters if isinstance(p, Strength))

    @classmethod
    def list_off_values(cls) -> dict[str, float]:
        """Return the strengths at which the fault is off, by dotted name."""
        return {f"{cls.name}.{strength.name}": strength.off for strength in cls.list_strengths()}


def declare_shares(typical: float) -> tuple[Strength, ...]:
    """Return a strength for each direction: the share of its frames that the fault affects."""
    return declare_strengths("1", typical, 1.0)


def declare_strengths(unit: str, typical: float, most: float) -> tuple[Strength, ...]:
    """Return a strength for each direction, from 0 (off) to `most`, in `unit`."""
    return tuple(Strength(name, unit, 0.0, typical, (0.0, most), SOURCE) for name in (COMMANDS, SAMPLES))
