"""Run files of any rig: read them, and check that they have the columns that each run of their rig must have."""

from collections.abc import Sequence
from math import inf
from pathlib import Path

from clutch_hil.bench.arguments import take_path
from clutch_hil.bench.rig import find_rig, list_rigs
from protocols.files.run import Run
from protocols.files.runs import check_columns, read_columns
from protocols.files.stretch import Stretch

COLUMNS_OF_ANY_RIG = ("time_s",)  # of any run, also a measured one; showing or converting a run needs no more


def read_run(
    path: Path | str, required: Sequence[str] | None = None, *, from_s: float = -inf, to_s: float = inf
) -> Run:
    """Read a run, or its rows from `from_s` to `to_s` [s].

    It must have the columns `required`; if None, all columns that its rig measures, or only `time_s` if its metadata name no
    rig, as of an imported recording or a CSV. Raises InputError, which names the file, the column and the first bad row.
    """
    path = take_path("path", path)
    run = read_columns(path, Stretch(from_s, to_s))
    if required is None:
        name = run.metadata.get("rig")
        required = find_rig(name).plant.measured_columns if name in list_rigs() else COLUMNS_OF_ANY_RIG
    check_columns(path, run.columns, required)
    return run
