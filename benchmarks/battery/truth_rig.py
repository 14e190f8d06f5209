"""Parameters of the truth's rig in SI, read from the file that gives them their uncertainty, and moved within it.

The truth shares numbers with plant_sim, as a real rig and its data sheet do, but not a line of code.
"""

import tomllib
from functools import cache
from pathlib import Path

import numpy as np

SOURCE = Path(__file__).parents[2] / "plant_sim" / "parameters" / "janssens2010.toml"
BAR = 1e5  # Pa
ZERO_CELSIUS = 273.15  # K
JITTER = 0.15  # of the stated uncertainty: the specification of the battery (discrepancy.md)
_SI = {  # factor of every unit that is not SI already
    "bar": BAR, "bar/V": BAR, "V/bar": 1.0 / BAR, "m^3/(s bar)": 1.0 / BAR, "m^3/bar": 1.0 / BAR, "Nm/bar": 1.0 / BAR,
    "Nm/(bar (rad/s)^gamma)": 1.0 / BAR,
}  # fmt: skip


@cache
def _declared() -> dict[str, tuple[float, float]]:
    """Value and uncertainty in SI by `group_name`."""
    groups = tomllib.loads(SOURCE.read_text(encoding="utf-8"))
    found = {}
    for group, entries in groups.items():
        for name, entry in entries.items():
            factor = _SI.get(entry["unit"], 1.0)
            zero = ZERO_CELSIUS if entry["unit"] == "degC" else 0.0
            found[f"{group}_{name}"] = entry["value"] * factor + zero, entry["uncertainty"] * factor
    return found


_DERIVED = "piston_preload", "piston_spring_stiffness", "oil_reference_coefficient"
RIG = np.dtype([(name, np.float64) for name in (*_declared(), *_DERIVED)])


def rig(seed: int | None = None) -> np.ndarray:
    """Record (1,) of RIG: nominal, or with every parameter moved by JITTER of its uncertainty times a normal number of
    `seed`.
    """
    record = np.zeros(1, RIG)
    shifts = (
        np.zeros(len(_declared())) if seed is None else np.random.default_rng(seed).standard_normal(len(_declared()))
    )
    for (name, (value, uncertainty)), shift in zip(_declared().items(), shifts, strict=True):
        record[name] = value + JITTER * uncertainty * shift
    area, touch = record["piston_area"], record["piston_contact_pressure"]
    record["piston_preload"] = area * record["piston_preload_pressure"]  # rig.md 3
    record["piston_spring_stiffness"] = area * (touch - record["piston_preload_pressure"]) / record["piston_clearance"]
    above = record["oil_reference"] - record["oil_origin"]
    record["oil_reference_coefficient"] = record["oil_slope"] * np.log10(above) + record["oil_offset"]  # rig.md 6
    return record


def changes(record: np.ndarray) -> dict[str, float]:
    """Parameters of `record` that are not nominal, SI."""
    nominal = rig()
    return {name: float(record[name][0]) for name in RIG.names if record[name][0] != nominal[name][0]}
