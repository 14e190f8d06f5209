"""Plant rig: the node, parameters and profiles of a plant in one object, as needed to run it."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Protocol

from protocols.can.two_clutches import CONTROLLERS
from protocols.errors import InputError
from protocols.files.parameters import ParameterSet
from protocols.node import Column
from protocols.renamed_methods import refuse_old_methods
from protocols.telemetry.truth import reveals_truth

_LATER = ("actuators",)  # beginnings of columns that runs from before 26 November 2026 lack
# Methods of a node by their old names
_RENAMED = {
    "fixed": "explain_fixed",
    "cycle": "run_cycle",
    "safe": "list_safe_frames",
    "row": "make_row",
    "heartbeat": "make_heartbeat",
    "reception_counts": "count_receptions",
    "stray_counts": "count_strays",
}


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
        refuse_old_methods(self.node, f"node of the rig {self.name}", _RENAMED)

    @property
    def controllers(self) -> dict[str, str | None]:
        """Names of the controllers on the bench, each with its clutch; with a single clutch, None."""
        return dict(zip(CONTROLLERS, self.clutches or (None,), strict=False))

    @property
    def measured_columns(self) -> tuple[str, ...]:
        """Columns in every run: time, inputs and measured values, without the true values and those that came later."""
        columns: Sequence[Column] = self.node.columns
        return tuple(c.name for c in columns if not (c.name.startswith(_LATER) or reveals_truth(c.name)))

    def check_blind(self, blind: bool) -> None:
        """Raise InputError when a `blind` run is requested but not possible."""
        if blind and self.not_blind:
            raise InputError(f"{self.not_blind}; leave --blind away")
