"""Plant rig: the node, parameters and profiles of a plant in one object, as needed to run it."""

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
    """Set-points of the supervisor over time. Only the rig's node uses more of it than the duration."""

    @property
    def duration(self) -> float:
        """Time at which the profile ends [s]."""


@dataclass(frozen=True)
class PlantRig:
    """A plant that can be run on a bus or in one process.

    `node` is the class of its node, constructed and stepped as `PlantNode`. `nominal(path)` returns its parameters with all
    effects off, changed by the user's file at `path` if given. `load_profile(name, seconds)` returns a profile, cut or repeated
    to `seconds` [s] unless None; it raises InputError. `list_active_effects(parameters)` lists the effects that are on.
    `clutches` are the names of two clutches: each has a controller, and its parameters begin with its name. It is empty
    for one clutch. `not_blind` is the reason why the plant cannot run blind; empty when it can.
    """

    name: str
    node: Any
    nominal: Callable[[Path | None], ParameterSet]
    load_profile: Callable[[str, float | None], RigProfile]
    list_active_effects: Callable[[ParameterSet], Sequence[str]]
    clutches: tuple[str, ...] = ()
    not_blind: str = ""

    def __post_init__(self) -> None:
        """Raise InputError for a node whose class is from before a method was renamed."""
        if hasattr(self.node, "fixed") and not hasattr(self.node, "explain_fixed"):
            raise InputError(
                f"node of the rig {self.name} lacks explain_fixed; its method fixed() is called explain_fixed() now"
            )

    @property
    def controllers(self) -> dict[str, str | None]:
        """Names of the controllers on the bench, each with its clutch; with a single clutch, None."""
        return dict(zip(CONTROLLERS, self.clutches or (None,), strict=False))

    @property
    def measured_columns(self) -> tuple[str, ...]:
        """Columns in every run: time, inputs and measured values, without the true values."""
        columns: Sequence[Column] = self.node.columns
        return tuple(column.name for column in columns if not reveals_truth(column.name))

    def check_blind(self, blind: bool) -> None:
        """Raise InputError when a `blind` run is requested but not possible."""
        if blind and self.not_blind:
            raise InputError(f"{self.not_blind}; leave --blind away")
