"""Whether a kept answer is still valid: by version and content hash, and by running a few cases again.

An answer belongs to a version of the engine (`clutch_hil/discrepancy/version.py`) and to the content of its own case. The
content is the name of the case, from which all its random numbers come, the laws of its effects, and TRUTH_VERSION. The
location and format of files do not matter. If a version was not raised by mistake, `list_differences` detects this by
comparing new answers with the kept ones.
"""

import hashlib
import json
from collections.abc import Mapping
from dataclasses import asdict
from typing import Any

from benchmarks.battery.cases import Case
from benchmarks.battery.truth_laws import LAWS
from clutch_hil.discrepancy.version import ENGINE_VERSION

# Version of the truth: its rig, solver, inputs, noise and the equations of its laws. Raise it when any of them changes.
TRUTH_VERSION = 1
CHECKED_CASES = (  # a quick case of each family except triples; together they have every verdict of the engine
    "null/none/1.0/0.005/s134",
    "warm/pressure_sensor_gain/2.0/0.02/s101",
    "pair/coarse_quantisation+shaft_angle_ripple/2.0/0.02/s101",
    "unknown/torque_bursts/4.0/0.05/s101",
    "single/valve_deadband/2.0/0.02/s101",
    "single/valve_deadband/1.3/0.02/s102",
    "closed/torque_sensor_gain/4.0/0.02/s101",
)


def format_engine_name() -> str:
    """Return the name of this engine version, as used for kept answers."""
    return f"engine-{ENGINE_VERSION}"


def hash_content(name: str) -> str:
    """Hash everything that the case of this name depends on, 12 hex digits. Raises InputError for a wrong name."""
    laws = [asdict(LAWS[effect]) for effect in Case.of(name).effects]
    text = json.dumps([TRUTH_VERSION, name, laws], sort_keys=True)
    return hashlib.sha256(text.encode()).hexdigest()[:12]


def is_valid(answer: Mapping[str, Any]) -> bool:
    """Return whether an answer belongs to the case as it is now."""
    return bool(answer.get("content") == hash_content(answer["case"]))


def list_differences(kept: Mapping[str, Any], answer: Mapping[str, Any]) -> list[str]:
    """List how `answer` differs from the `kept` one, one sentence each.

    Compared are verdict, names, and each parameter, which must lie in its kept 95 % interval.
    """
    if "error" in answer:
        return [f"the engine broke: {answer['error'].strip().splitlines()[-1]}"]
    differences = [
        f"{part}: {kept[part]} was kept, now it is {answer[part]}"
        for part in ("verdict", "effects", "alternatives")
        if kept[part] != answer[part]
    ]
    before = {parameter["name"]: parameter for parameter in kept["parameters"]}
    for parameter in answer["parameters"]:
        kept_parameter = before.get(parameter["name"])
        if kept_parameter is None:
            continue
        low, high = kept_parameter["ci95"]
        if not low <= parameter["value"] <= high:
            interval = f"{kept_parameter['value']:.6g} in [{low:.6g}, {high:.6g}]"
            differences.append(f"{parameter['name']}: now {parameter['value']:.6g}, kept {interval}")
    return differences
