"""Conversion of a run file into another format."""

from collections.abc import Iterable
from pathlib import Path

from clutch_hil.bench.run_file import COLUMNS_OF_ANY_RIG, read_run
from protocols.errors import InputError, join_names
from protocols.files.output_file import check_new_file
from protocols.files.run import Run
from protocols.files.runs import SUFFIXES, write_run
from protocols.files.stretch import WHOLE, Stretch

FORMATS = (*SUFFIXES, ".rrd")


def convert(source: Path, target: Path, overwrite: bool = False, stretch: Stretch = WHOLE) -> Run:
    """Write the run in `source`, or a part of it, in the format given by the suffix of `target`; return the written run.

    overwrite: whether an existing `target` may be replaced. Raises InputError.
    """
    if source.suffix.lower() not in SUFFIXES:
        raise InputError(
            f"run {source} has the suffix {source.suffix or '-'}; files that can be read end with {join_names(SUFFIXES)}"
        )
    check_target(target, overwrite, [source])
    run = read_run(source, COLUMNS_OF_ANY_RIG, from_s=stretch.from_s, to_s=stretch.to_s)
    if target.suffix.lower() == ".rrd":
        from clutch_hil.live.run_replay import export_rrd

        export_rrd(source, target, stretch)
    else:
        write_run(run, target)
    return run


def check_target(path: Path, overwrite: bool = False, inputs: Iterable[Path] = ()) -> Path:
    """Return `path` if a run can be written there without loss of another file (`check_new_file`). Raises InputError."""
    if path.suffix.lower() not in FORMATS:
        raise InputError(
            f"run {path} has the suffix {path.suffix or '-'}; files that can be written end with {join_names(FORMATS)}"
        )
    return check_new_file(path, overwrite, inputs)
