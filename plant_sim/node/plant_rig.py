"""Plant rig: what must be known of a plant to run it: its node, parameters and profiles, in one object."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Protocol

from protocols.can.two_clutches import CONTROLLERS
from protocols.errors import InputError
from protocols.files.parameters import ParameterSet
from protocols.node import Column
from protocols.telemetry.truth import reveals_truth


class RigProfile(Protocol):
    """What the supervisor asks of a rig over time; the rig's node knows the rest of it."""

    @property
    def duration(self) -> float:
        """When it ends [s]."""


@dataclass(frozen=True)
class PlantRig:
    """A plant that can be run on a bus or in one process.

    `node` is the class of its node, made and stepped as `PlantNode`. `nominal(path)` returns its parameters with every effect
    off, or as the user's file at `path` changes them where one is given. `load_profile(name, seconds)` returns a profile, cut
    or repeated to `seconds` [s] unless None, or raises InputError. `switched_on(parameters)` names the effects that are on.
    `clutches` are the names of its clutches where it has two: each has a controller, and its parameters begin with its name.
    `not_blind` says why the plant cannot keep its truth back; it is empty where it can.
    """

    name: str
    node: Any
    nominal: Callable[[Path | None], ParameterSet]
    load_profile: Callable[[str, float | None], RigProfile]
    switched_on: Callable[[ParameterSet], Sequence[str]]
    clutches: tuple[str, ...] = ()
    not_blind: str = ""

    @property
    def controllers(self) -> dict[str, str | None]:
        """Names of the controllers on its bench, each with the clutch it controls; None for the only one."""
        return dict(zip(CONTROLLERS, self.clutches or (None,), strict=False))

    @property
    def measured(self) -> tuple[str, ...]:
        """Columns that every run of it has: time, inputs and what its sensors show, without the truth."""
        columns: Sequence[Column] = self.node.columns
        return tuple(column.name for column in columns if not reveals_truth(column.name))

    def check_blind(self, blind: bool) -> None:
        """Raise InputError where a `blind` run is asked for and cannot be."""
        if blind and self.not_blind:
            raise InputError(f"{self.not_blind}; leave --blind away")
