"""Settings of a run, however it is run."""

from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any

from plant_sim.profile import Profile, load_profile
from plant_sim.rigs import wet_clutch
from protocols.node import node_factory
from protocols.parameters import ParameterSet


@dataclass(frozen=True)
class RunSettings:
    """rate [Hz], seconds [s], temperature [degC]; `out` is the folder for what is written. None means the default."""

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

    def loaded_profile(self) -> Profile:
        """The profile to play. Raises InputError."""
        return load_profile(self.profile, self.seconds)

    def loaded_plant_parameters(self) -> ParameterSet:
        """The parameters of the plant. Raises InputError."""
        return wet_clutch.nominal(self.plant_parameters)

    def new_controller(self) -> Any:
        """A controller node with these settings. Raises InputError."""
        return node_factory("controller")(
            rate=self.rate, parameters_file=self.controller_parameters, law=self.law, adaptation=self.adaptation
        )

    def as_text(self) -> dict[str, str]:
        """The settings that were given, for metadata."""
        return {name: str(value) for name, value in asdict(self).items() if value is not None}
