"""Metadata of a run file: its origin."""

import sys
from collections.abc import Mapping, Sequence
from datetime import datetime
from importlib.metadata import version
from typing import Any

from clutch_hil.bench.rig import Rig
from protocols.files.parameters import ParameterSet

_PACKAGES = ("clutch-hil", "numpy", "numba", "python-can", "cantools", "pyarrow")


def versions() -> dict[str, str]:
    """Versions of the packages that make a run, and of Python, by name."""
    return {name: version(name) for name in _PACKAGES} | {"python": sys.version.split()[0]}


def run_metadata(
    rig: Rig,
    rate: int,
    plant: ParameterSet,
    controllers: Mapping[str, Mapping[str, float]],
    injections: Sequence[Mapping[str, Any]] = (),
) -> dict[str, Any]:
    """Metadata of a run: rig, rate [Hz], versions, parameters, effects that are on at the start, and later injections.

    Parameters are in the units that their TOML files declare. `controllers` has those of each controller by its name.
    `injections` are those of `PlantNode.injected`.
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
