"""`clutch-hil unseal`: show the truth of a blind run."""

from pathlib import Path

import typer

from clutch_hil.command import report
from clutch_hil.commands.options import JSON


def register(app: typer.Typer) -> None:
    """Add the command."""
    app.command()(unseal)


def unseal(
    run: Path = typer.Argument(help="run file that was recorded with --blind"),
    truth: Path | None = typer.Option(None, help="folder of the truth file; that of the run if not given"),
    json_output: bool = JSON,
) -> None:
    """Show what a blind run hides, unless the run or its truth file was changed."""
    from clutch_hil.bench.unseal import describe_truth, read_truth

    report(*describe_truth(run, *read_truth(run, truth)), json_output)
