"""Plant rig: the node, parameters and profiles of a plant in one object, as needed to run it."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from math import isfinite
from pathlib import Path
from typing import Any, Protocol

from protocols.can.two_clutches import CONTROLLERS
from protocols.errors import InputError
from protocols.files.parameters import ParameterSet
from protocols.node import Column
from protocols.renamed_methods import refuse_old_methods
from protocols.telemetry.truth import reveals_truth
from protocols.user_code import describe_error

# Prefixes of columns that runs from before 26 and 28 November 2026 lack
_LATER = ("actuators", "motor_torque_limit_nm")
# New names of a node's methods by old names
_RENAMED = {
    "fixed": "explain_fixed",
    "cycle": "run_cycle",
    "safe": "list_safe_frames",
    "row": "make_row",
    "heartbeat": "make_heartbeat",
    "reception_counts": "count_receptions",
    "stray_counts": "count_strays",
}
_NODE = ("columns", "warm", "take", "show", "advance")  # attributes that a node class must have, see `PlantNode`


class RigProfile(Protocol):
    """Set-points of the supervisor over time. Other code than the rig's node uses only the duration."""

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
        """Raise InputError for a node class with renamed methods, or without the attributes of a node."""
        refuse_old_methods(self.node, f"node of the rig {self.name}", _RENAMED)
        if lacking := [name for name in _NODE if not hasattr(self.node, name)]:
            raise InputError(
                f"rig {self.name}: its node {self.node!r} lacks {lacking[0]}; allowed is a class that has"
                f" {', '.join(_NODE)}"
            )

    def load_parameters(self, changed: Path | None = None) -> ParameterSet:
        """Return the parameters, by `nominal`. Raises InputError, also if that function fails or returns another type."""
        parameters = self._call("nominal", self.nominal, changed)
        if not isinstance(parameters, ParameterSet):
            raise InputError(f"rig {self.name}: nominal returns {parameters!r}; a ParameterSet is needed")
        return parameters

    def make_profile(self, name: str, seconds: float | None) -> RigProfile:
        """Return a profile, by `load_profile`. Raises InputError, also if that function fails or returns another type."""
        profile: RigProfile = self._call("load_profile", self.load_profile, name, seconds)
        duration = getattr(profile, "duration", None)
        if not isinstance(duration, (int, float)) or not isfinite(duration):
            raise InputError(
                f"rig {self.name}: load_profile returns {profile!r}, whose duration is {duration}; a time in s is needed"
            )
        return profile

    def make_node(self, *arguments: Any, **options: Any) -> Any:
        """Return an object of the node class. Raises InputError, also if the class fails."""
        return self._call("node", self.node, *arguments, **options)

    def _call(self, field: str, function: Callable[..., Any], *arguments: Any, **options: Any) -> Any:
        """Return the result of the function in `field`. Raises InputError also for any other error of a user's function."""
        try:
            return function(*arguments, **options)
        except InputError:
            raise
        except Exception as error:
            raise InputError(f"rig {self.name}: {field} raises {describe_error(error)}") from error

    @property
    def controllers(self) -> dict[str, str | None]:
        """Names of the controllers on the bench, each with its clutch; with a single clutch, None."""
        return dict(zip(CONTROLLERS, self.clutches or (None,), strict=False))

    @property
    def measured_columns(self) -> tuple[str, ...]:
        """Columns in every run: time, inputs and measured values, without true values and columns added later."""
        columns: Sequence[Column] = self.node.columns
        return tuple(c.name for c in columns if not (c.name.startswith(_LATER) or reveals_truth(c.name)))

    def check_blind(self, blind: bool) -> None:
        """Raise InputError when a `blind` run is requested but not possible."""
        if blind and self.not_blind:
            raise InputError(f"{self.not_blind}; leave --blind out")
