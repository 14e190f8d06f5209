"""Metadata of a run file: where it comes from."""

import sys
from collections.abc import Mapping, Sequence
from datetime import datetime
from importlib.metadata import version
from typing import Any

from clutch_hil.bench.rig import Rig
from protocols.files.parameters import ParameterSet

_PACKAGES = ("clutch-hil", "numpy", "numba", "python-can", "cantools", "pyarrow")


def versions() -> dict[str, str]:
    """Versions of what a run is made by, by name."""
    return {name: version(name) for name in _PACKAGES} | {"python": sys.version.split()[0]}


def run_metadata(
    rig: Rig,
    rate: int,
    plant: ParameterSet,
    controllers: Mapping[str, Mapping[str, float]],
    injections: Sequence[Mapping[str, Any]] = (),
) -> dict[str, Any]:
    """Rig, rate [Hz], versions, parameters of all sides and effects that are on at the start, and what was injected later.

    Parameters are in the unit their TOML file declares, those of the controllers by name of the controller; `injections` as
    `PlantNode.injected`.
    """
    return {
        "rig": rig.name,
        "sample_rate_hz": rate,
        "notes": "",
        "recorded_at": datetime.now().astimezone().isoformat(timespec="seconds"),
        "versions": versions(),
        "plant_parameters": plant.as_values(),
        "effects": list(rig.plant.switched_on(plant)),
        "injections": [dict(injection) for injection in injections],
        **{f"{name}_parameters": dict(values) for name, values in controllers.items()},
    }
