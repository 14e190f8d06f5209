"""Run file of any rig: read and checked for what every run of its rig has."""

from pathlib import Path

from clutch_hil.bench.rig import DEFAULT_RIG, rig_named, rig_names
from protocols.files.run import Run
from protocols.files.runs import check_columns, read_columns

_OF_ANY = ("time_s",)  # columns of a run whose rig is not installed here, such as a measured one


def read_rig_run(path: Path | str) -> Run:
    """A run with the columns that its rig measures. Raises InputError naming the file, the column and the first bad row.

    The rig is the one that the metadata name; a CSV has none and is of the wet-clutch rig.
    """
    path = Path(path)
    run = read_columns(path)
    name = run.metadata.get("rig", DEFAULT_RIG)
    check_columns(path, run.columns, rig_named(name).plant.measured if name in rig_names() else _OF_ANY)
    return run
