"""Metadata of a run file: where it comes from."""

import sys
from collections.abc import Mapping, Sequence
from datetime import datetime
from importlib.metadata import version
from typing import Any

from plant_sim.effects.table import switched_on
from plant_sim.rigs import power_shift
from protocols.files.parameters import ParameterSet

_PACKAGES = ("clutch-hil", "numpy", "numba", "python-can", "cantools", "pyarrow")


def versions() -> dict[str, str]:
    """Versions of what a run is made by, by name."""
    return {name: version(name) for name in _PACKAGES} | {"python": sys.version.split()[0]}


def run_metadata(
    rate: int,
    plant: ParameterSet,
    controller: Mapping[str, float],
    injections: Sequence[Mapping[str, Any]] = (),
    rig: str = "wet_clutch",
) -> dict[str, Any]:
    """Rig, rate [Hz], versions, parameters of both sides and effects that are on at the start, and what was injected later.

    Parameters are in the unit their TOML file declares; `injections` as `PlantNode.injected`.
    """
    return {
        "rig": rig,
        "sample_rate_hz": rate,
        "notes": "",
        "recorded_at": datetime.now().astimezone().isoformat(timespec="seconds"),
        "versions": versions(),
        "plant_parameters": plant.as_values(),
        "effects": list(power_shift.switched_on(plant) if rig == "power_shift" else switched_on(plant)),
        "injections": [dict(injection) for injection in injections],
        "controller_parameters": dict(controller),
    }
