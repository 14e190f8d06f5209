"""`clutch-hil recover`: write run files from the journals of recorders that were killed."""

import os
from pathlib import Path

import typer

from clutch_hil.command import report
from clutch_hil.commands.options import JSON
from protocols.errors import InputError


def register(app: typer.Typer) -> None:
    """Add the command."""
    app.command()(recover)


def recover(
    paths: list[Path] = typer.Argument(
        None, help="folders, or files NAME.parquet.journal; the folder runs if not given"
    ),
    json_output: bool = JSON,
) -> None:
    """Write the runs whose recorders were killed. `up` and `record` do the same in their folder when they start."""
    from clutch_hil.bench.recovery import recover as write
    from clutch_hil.bench.recovery import remove_remains
    from protocols.files.journal import find_run, list_journals

    paths = paths or [Path("runs")]
    for path in paths:
        if not os.path.exists(path):
            raise InputError(f"{path} does not exist; give a folder of runs, or a file NAME.parquet.journal")
        if not os.path.isdir(path):
            find_run(path)  # raises InputError for a file with another kind of name
    journals = [journal for path in paths for journal in (list_journals(path) if os.path.isdir(path) else [path])]
    done, left = [], []
    for journal in journals:
        try:
            done.append(write(journal))
        except InputError as error:
            left.append(str(error))
    for folder in {path if os.path.isdir(path) else path.parent for path in paths}:
        remove_remains(folder)
    written = [one for one in done if one.file]
    lines = [f"read:    {journal}" for journal in journals] or [f"read:    no journal in {', '.join(map(str, paths))}"]
    lines += [f"wrote:   {one.file}  ({one.samples} samples)" for one in written]
    lines += [str(one) for one in done if not one.file] + left
    verdict = f"{len(written)} of {len(journals)} recovered" if journals else "nothing to recover"
    document = {
        "recovered": {str(one.file): one.samples for one in written}, "left": left, "verdict": verdict, "good": not left,
    }  # fmt: skip
    report(document, "\n".join(lines), verdict, not left, json_output)
