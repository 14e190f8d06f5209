"""Metadata of a run file: where it comes from."""

import sys
from collections.abc import Mapping
from datetime import datetime
from importlib.metadata import version
from typing import Any

from protocols.parameters import ParameterSet

_PACKAGES = ("clutch-hil", "numpy", "numba", "python-can", "cantools", "pyarrow")


def run_metadata(rate: int, plant: ParameterSet, controller: Mapping[str, float]) -> dict[str, Any]:
    """Rig, rate [Hz], versions and the parameters of both sides, each in the unit its TOML file declares."""
    return {
        "rig": "wet_clutch",
        "sample_rate_hz": rate,
        "notes": "",
        "recorded_at": datetime.now().astimezone().isoformat(timespec="seconds"),
        "versions": {name: version(name) for name in _PACKAGES} | {"python": sys.version.split()[0]},
        "plant_parameters": plant.as_values(),
        "controller_parameters": dict(controller),
    }
