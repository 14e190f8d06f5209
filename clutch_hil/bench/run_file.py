"""Run file of any rig: read and checked for what every run of its rig has."""

from collections.abc import Sequence
from pathlib import Path

from clutch_hil.bench.rig import DEFAULT_RIG, rig_named, rig_names
from protocols.files.run import Run
from protocols.files.runs import check_columns, read_columns

_COLUMNS_OF_ANY_RIG = ("time_s",)  # columns of a run whose rig is not installed here, such as a measured one


def read_run(path: Path | str, required: Sequence[str] | None = None) -> Run:
    """A run with the columns `required`, or, where that is None, with all that its rig measures.

    The rig is the one that the metadata name; a CSV has none and is of the wet-clutch rig. Raises InputError naming the file,
    the column and the first bad row.
    """
    path = Path(path)
    run = read_columns(path)
    if required is None:
        name = run.metadata.get("rig", DEFAULT_RIG)
        required = rig_named(name).plant.measured if name in rig_names() else _COLUMNS_OF_ANY_RIG
    check_columns(path, run.columns, required)
    return run
