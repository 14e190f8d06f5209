"""Location of measured data of real rigs: next to the project, or in `$CLUTCH_HIL_DATA`. They are not part of the project."""

import os
from pathlib import Path

from protocols.errors import InputError

VARIABLE = "CLUTCH_HIL_DATA"
SOURCES = {  # by folder
    "emps": "github.com/wmkouw/NSI-EMPS, data",
    "microtribometer": "github.com/jchristopherson/FrictionModels.jl, examples/test_data_2.txt",
    "pneumatic_seal_friction": "github.com/EvaZillen/3D-printed-pneumatic-actuator, results_pneumatic-actuator/data/friction",
}
NEIGHBOUR_FOLDER = Path(__file__).resolve().parents[3] / "shared" / "data"  # ../shared/data, seen from the project


class MissingDataError(InputError):
    """Measured data are not on this machine."""


def find_measured_file(name: str) -> Path:
    """Return the path of the data file `name`, such as `microtribometer/test_data_2.txt`. Raises MissingDataError."""
    folder = Path(os.environ.get(VARIABLE) or NEIGHBOUR_FOLDER)
    path = folder / name
    if not path.is_file():
        source = SOURCES[name.partition("/")[0]]
        raise MissingDataError(
            f"measured data {name} are not in {folder}; set {VARIABLE} to the folder that contains them (source: {source})"
        )
    return path
