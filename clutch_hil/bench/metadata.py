"""Metadata of a run file: its origin."""

import sys
from collections.abc import Mapping, Sequence
from datetime import datetime
from importlib.metadata import version
from typing import Any

from clutch_hil.bench.scenario import Scenario

_PACKAGES = ("clutch-hil", "numpy", "numba", "python-can", "cantools", "pyarrow")


def list_versions() -> dict[str, str]:
    """Return the versions of the packages that produce a run, and of Python, by name."""
    return {name: version(name) for name in _PACKAGES} | {"python": sys.version.split()[0]}


def make_run_metadata(
    scenario: Scenario,
    controllers: Mapping[str, Mapping[str, float]],
    injections: Sequence[Mapping[str, Any]],
    mode: str,
) -> dict[str, Any]:
    """Return the metadata of a run: scenario, settings, versions, parameters, effects on at the start, and later injections.

    Parameters are in the units that their TOML files declare. `controllers` has the parameters of each controller by its name.
    `injections` are those of `PlantNode.injected_changes`. `mode`: in process, lock-step or real time.
    """
    plant = scenario.plant
    return {
        "rig": scenario.rig.name,
        "scenario": scenario.name,
        "settings": scenario.settings.as_text() | {"mode": mode},
        "sample_rate_hz": scenario.settings.rate,
        "notes": "",
        "recorded_at": datetime.now().astimezone().isoformat(timespec="seconds"),
        "versions": list_versions(),
        "plant_parameters": plant.as_values(),
        "effects": list(scenario.rig.plant.list_active_effects(plant)),
        "injections": [dict(injection) for injection in injections],
        **{f"{name}_parameters": dict(values) for name, values in controllers.items()},
    }


def list_injection_times(metadata: Mapping[str, Any]) -> list[float]:
    """Return the times [s] at which parameters were injected, each once; [] for metadata of another program that has none."""
    try:
        rate = float(metadata["sample_rate_hz"])
        return sorted({float(change["row"]) / rate for change in metadata.get("injections", ())})
    except (LookupError, TypeError, ValueError, ZeroDivisionError):
        return []
