"""Whether an answer that was kept is still the engine's: by versions and content, and by playing a handful of cases again.

An answer belongs to a version of the engine (`clutch_hil/discrepancy/version.py`) and to the content of its own case: its name,
which all random numbers come from, the laws of its effects, and the version of what every case shares. Where files lie, how
they are formatted and what else the folder holds changes nothing. That a version was raised when it had to be is not believed
but checked: `differences` compares answers of today with those that were kept.
"""

import hashlib
import json
from collections.abc import Mapping
from dataclasses import asdict
from typing import Any

from benchmarks.battery.cases import Case
from benchmarks.battery.truth_laws import LAWS
from clutch_hil.discrepancy.version import ENGINE_VERSION

# Of the rig, the solver, the inputs and the noise of the truth, and of the equations of its laws: raised as the engine's is.
TRUTH_VERSION = 1
CHECKED = (  # of each family but triples a quick one; between them every verdict that the engine has
    "null/none/1.0/0.005/s134",
    "pair/coarse_quantisation+shaft_angle_ripple/2.0/0.02/s101",
    "unknown/torque_bursts/4.0/0.05/s101",
    "single/valve_deadband/2.0/0.02/s101",
    "single/valve_deadband/1.3/0.02/s102",
    "warm/pressure_sensor_gain/2.0/0.02/s101",
    "closed/torque_sensor_gain/4.0/0.02/s101",
)


def engine() -> str:
    """The name that answers of this engine are kept under."""
    return f"engine-{ENGINE_VERSION}"


def content(name: str) -> str:
    """Hash of what the case of this name depends on. Raises InputError."""
    laws = [asdict(LAWS[effect]) for effect in Case.of(name).effects]
    text = json.dumps([TRUTH_VERSION, name, laws], sort_keys=True)
    return hashlib.sha256(text.encode()).hexdigest()[:12]


def valid(answer: Mapping[str, Any]) -> bool:
    """Whether an answer is one to the case as it is now."""
    return bool(answer.get("content") == content(answer["case"]))


def differences(kept: Mapping[str, Any], now: Mapping[str, Any]) -> list[str]:
    """How an answer differs from the one that was kept, a sentence each: verdict, names, a strength beyond its interval."""
    if "error" in now:
        return [f"the engine broke: {now['error'].strip().splitlines()[-1]}"]
    found = [
        f"{part}: {kept[part]} was kept, now it is {now[part]}"
        for part in ("verdict", "effects", "alternatives")
        if kept[part] != now[part]
    ]
    before = {parameter["name"]: parameter for parameter in kept["parameters"]}
    for parameter in now["parameters"]:
        one = before.get(parameter["name"])
        if one is None:
            continue
        low, high = one["ci95"]
        if not low <= parameter["value"] <= high:
            found.append(
                f"{one['name']}: now {parameter['value']:.6g}, kept {one['value']:.6g} in [{low:.6g}, {high:.6g}]"
            )
    return found
