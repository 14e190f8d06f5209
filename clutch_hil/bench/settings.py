"""Settings of a run: simulated, in lock-step or in real time."""

from collections.abc import Callable, Mapping
from dataclasses import asdict, dataclass, field, fields
from math import inf
from pathlib import Path
from typing import Any

from clutch_hil.bench.arguments import take_flag, take_number, take_whole
from clutch_hil.command import check_rate
from plant_sim.profiles.profile import check_seconds
from protocols.can.two_clutches import CLUTCHES, CONTROLLERS
from protocols.errors import InputError, suggest_closest
from protocols.files.parameters import CONTROLLER, list_changed
from protocols.node import load_node
from rt_controller.law.valve_gains import VALVE

MANUAL = "manual"  # instead of a profile: the demand comes over the bus, from `clutch-hil demand` or `panel`


@dataclass(frozen=True)
class RunSettings:
    """Settings of a run; None means the default.

    rate: [Hz]. seconds: length of the profile [s]. temperature: of the oil at the start [degC]. out: folder for files.
    controller: changes parameters of the controller, by dotted name, in their declared units. controller_parameters: a file
    that does the same and overrides `controller`. Raises InputError for an invalid length `seconds`.
    """

    rate: int = 1000
    profile: str = "engagement"
    seconds: float | None = None
    plant_parameters: Path | None = None
    controller_parameters: Path | None = None
    seed: int = 1
    temperature: float | None = None
    law: str = "both"
    adaptation: bool = True
    out: Path = field(default_factory=lambda: Path("runs"))
    controller: Mapping[str, float] = field(default_factory=dict)

    def __post_init__(self) -> None:
        """Raise InputError for an invalid length `seconds`, with or without a profile."""
        if self.seconds is not None:
            check_seconds(self.seconds)

    def make_controller(self, clutch: str | None = None) -> Any:
        """Make a controller node with these settings; `clutch` is a or b where there are two. Raises InputError."""
        node = load_node("controller")(
            rate=self.rate, parameters_file=self.controller_parameters, law=self.law, adaptation=self.adaptation,
            clutch=clutch,
        )  # fmt: skip
        part = dict(zip((None, *CLUTCHES), (CONTROLLER, *CONTROLLERS), strict=True))[clutch]
        in_file = list_changed(self.controller_parameters, part) if self.controller_parameters else ()
        values = {name: value for name, value in self.controller.items() if name not in in_file}
        known = node.parameters.keys() - VALVE  # before the start the gains follow the valve
        if reasons := [reason for name in values if name in known and (reason := node.explain_fixed(name))]:
            raise InputError(reasons[0])
        following = node.follow_clutch(node.parameters.with_values(values), {*in_file, *values})
        node.tune({**values, **following})
        return node

    def write_controller_file(self, folder: Path, clutch: str | None = None) -> Path | None:
        """Return a file with the controller parameters that these settings change, for its process; None without changes.

        clutch: see `make_controller`. The file is `controller_parameters` itself, or a new file in `folder`.
        """
        if not self.controller:
            return self.controller_parameters
        node, path = self.make_controller(clutch), folder / f"controller{f'_{clutch}' if clutch else ''}.toml"
        values = {
            name: value for name, value in node.parameters.as_values().items() if node.explain_fixed(name) is None
        }
        path.write_text("".join(f"{name} = {value!r}\n" for name, value in values.items()), encoding="utf-8")
        return path

    def describe_changes(self) -> str:
        """Return the parameter files as text: ", changed by rig.toml", or empty if there are none."""
        files = dict.fromkeys(str(path) for path in (self.plant_parameters, self.controller_parameters) if path)
        return f", changed by {' and '.join(files)}" if files else ""

    def as_text(self) -> dict[str, str]:
        """Return the settings that are not None, as text, for metadata."""
        return {name: str(value) for name, value in asdict(self).items() if value is not None and value != {}}


# Settings that functions and commands take as arguments of these names; controller parameters are given separately
_ARGUMENTS = tuple(setting.name for setting in fields(RunSettings) if setting.name != "controller")


def _take_rate(name: str, value: Any) -> int:
    return check_rate(take_whole(name, value, -inf))


def _take_seed(name: str, value: Any) -> int:
    return take_whole(name, value, 0)


_TAKEN: Mapping[str, Callable[[str, Any], Any]] = {
    "rate": _take_rate, "seed": _take_seed, "seconds": take_number, "temperature": take_number, "adaptation": take_flag,
}  # fmt: skip


def take_settings(given: Mapping[str, Any]) -> dict[str, Any]:
    """Return the given settings that are not None, as RunSettings take them. Raises InputError for another type."""
    settings = {name: value for name, value in given.items() if value is not None}
    if unknown := [name for name in settings if name not in _ARGUMENTS]:
        raise InputError(f"{unknown[0]!r} is not a setting of a run; {suggest_closest(unknown[0], _ARGUMENTS)}")
    return {name: _TAKEN[name](name, value) if name in _TAKEN else value for name, value in settings.items()}


def select_settings(arguments: Mapping[str, Any]) -> dict[str, Any]:
    """Return the settings among the arguments of a function, given as its `locals()`."""
    return {name: arguments[name] for name in _ARGUMENTS if name in arguments}
