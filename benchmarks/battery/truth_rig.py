"""Parameters of the truth's rig in SI units: nominal, or drawn at random within their stated uncertainty.

The truth shares the parameter file with plant_sim, as a real rig shares its data sheet with a model. It shares no code.
"""

import tomllib
from functools import cache
from pathlib import Path

import numpy as np

PARAMETER_FILE = Path(__file__).parents[2] / "plant_sim" / "parameters" / "janssens2010.toml"
BAR = 1e5  # Pa
ZERO_CELSIUS = 273.15  # K
# standard deviation of a drawn parameter over its stated uncertainty; chosen: well inside the engine's priors
JITTER = 0.15
_SI_FACTORS = {  # factor to SI of every unit that is not SI already
    "bar": BAR, "bar/V": BAR, "V/bar": 1.0 / BAR, "m^3/(s bar)": 1.0 / BAR, "m^3/bar": 1.0 / BAR, "Nm/bar": 1.0 / BAR,
    "Nm/(bar (rad/s)^gamma)": 1.0 / BAR,
}  # fmt: skip


@cache
def _read_parameters() -> dict[str, tuple[float, float]]:
    """Read value and uncertainty of each parameter in SI, by `group_name`."""
    groups = tomllib.loads(PARAMETER_FILE.read_text(encoding="utf-8"))
    parameters = {}
    for group, entries in groups.items():
        for name, entry in entries.items():
            factor = _SI_FACTORS.get(entry["unit"], 1.0)
            zero = ZERO_CELSIUS if entry["unit"] == "degC" else 0.0
            parameters[f"{group}_{name}"] = entry["value"] * factor + zero, entry["uncertainty"] * factor
    return parameters


_DERIVED = "piston_preload", "piston_spring_stiffness", "oil_reference_coefficient"
RIG_RECORD = np.dtype([(name, np.float64) for name in (*_read_parameters(), *_DERIVED)])


def draw_rig(seed: int | None = None) -> np.ndarray:
    """Make a record (1,) of RIG_RECORD, SI: nominal without `seed`, else drawn.

    A drawn parameter is its nominal value plus JITTER times its uncertainty times a standard normal number.
    """
    record = np.zeros(1, RIG_RECORD)
    shifts = (
        np.zeros(len(_read_parameters()))
        if seed is None
        else np.random.default_rng(seed).standard_normal(len(_read_parameters()))
    )
    for (name, (value, uncertainty)), shift in zip(_read_parameters().items(), shifts, strict=True):
        record[name] = value + JITTER * uncertainty * shift
    area, touch = record["piston_area"], record["piston_contact_pressure"]
    record["piston_preload"] = area * record["piston_preload_pressure"]  # docs/rig.md, eq. 3
    record["piston_spring_stiffness"] = area * (touch - record["piston_preload_pressure"]) / record["piston_clearance"]
    above = record["oil_reference"] - record["oil_origin"]
    record["oil_reference_coefficient"] = (
        record["oil_slope"] * np.log10(above) + record["oil_offset"]
    )  # docs/rig.md, eq. 6
    return record


def list_changes(record: np.ndarray) -> dict[str, float]:
    """List the parameters of `record` that are not nominal: value in SI by name."""
    nominal = draw_rig()
    return {name: float(record[name][0]) for name in RIG_RECORD.names if record[name][0] != nominal[name][0]}
