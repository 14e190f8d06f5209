"""Conversion: a run file in another format."""

from pathlib import Path

from protocols.errors import InputError, listing
from protocols.runs import SUFFIXES, read_run, write_run

FORMATS = (*SUFFIXES, ".rrd")


def convert(source: Path, target: Path) -> int:
    """Write the run in `source` as the suffix of `target` says; return its samples. Raises InputError."""
    checked_target(target)
    if source.resolve() == target.resolve():
        raise InputError(f"run {source} would be written over itself; name another file")
    run = read_run(source)
    if target.suffix == ".rrd":
        from plant_sim.live.replay import export_rrd

        export_rrd(source, target)
    else:
        write_run(run, target)
    return len(run["time_s"])


def checked_target(path: Path) -> Path:
    """`path` when a run can be written there. Raises InputError."""
    if path.suffix not in FORMATS:
        raise InputError(f"a run cannot be written as {path.suffix!r} ({path}); allowed are {listing(FORMATS)}")
    if path.suffix == ".rrd":
        from plant_sim.live.rrd_writer import checked_rrd

        checked_rrd(path)
    return path
