"""`clutch-hil reproduce`: check results of the thesis by running them."""

import os
from pathlib import Path

import typer

from clutch_hil.command import emit, report
from clutch_hil.commands.options import JSON, OUT, OVERWRITE
from protocols.errors import InputError


def register(app: typer.Typer) -> None:
    """Add the command."""
    app.command()(reproduce)


def reproduce(
    name: str | None = typer.Argument(None, help="name of a reproduction, or number of a figure"),
    list_all: bool = typer.Option(False, "--list", help="list what can be reproduced"),
    every: bool = typer.Option(False, "--all", help="reproduce everything and write one page with all pictures"),
    out: Path = OUT,
    overwrite: bool = OVERWRITE,
    json_output: bool = JSON,
) -> None:
    """Check a result of the thesis by running it."""
    from clutch_hil.bench.progress import format_table, progress_bar
    from clutch_hil.bench.recording import writable_folder
    from clutch_hil.thesis import find_entry, load_entries
    from clutch_hil.thesis.reproduction import format_checks, run, run_all
    from clutch_hil.thesis.reproduction import reproduce as check
    from protocols.files.output_file import check_new_files

    if list_all and (name or every):
        raise InputError(f"--list and {name or '--all'} were both given; only one of them is allowed")
    if list_all or not (name or every):
        rows = [("name", "what"), *((e.name, e.title) for e in load_entries().values())]
        if json_output:
            emit(dict(rows[1:]))  # only names
        else:
            report({}, format_table(rows), f"{len(rows) - 1} entries", True, as_json=False)
        return
    if every and name:
        raise InputError(f"{name!r} and --all were both given; only one of them is allowed")
    chosen = find_entry(name) if name else None
    names = [chosen.name] if chosen else list(load_entries())
    pictures = [f"{each}.png" for each in names]
    kept = chosen is not None and os.path.isfile(out / pictures[0]) and not overwrite
    with writable_folder(out), progress_bar(name or "reproduce", json_output) as progress:
        if not kept:
            check_new_files(out, pictures if chosen else [*pictures, "index.html"], overwrite)
        if chosen is None:
            report(*run_all(out, progress), json_output)
            return
        result = check(chosen.name, progress) if kept else run(chosen, out, progress)
    wrote = f"nothing; {out / pictures[0]} exists already, --overwrite replaces it" if kept else result.picture
    text = "\n".join([f"{chosen.name}: {chosen.title}", format_checks(result), f"wrote:   {wrote}"])
    report(result.make_document(), text, result.verdict, result.holds, json_output)
