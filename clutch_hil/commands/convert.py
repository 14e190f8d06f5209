"""`clutch-hil convert`: a run file written in another format."""

from pathlib import Path

import typer

from clutch_hil.command import report
from clutch_hil.commands.options import JSON, OVERWRITE

SOURCE = typer.Argument(help="run file: .parquet, .mf4 or .csv")
TARGET = typer.Argument(help="what to write: .parquet, .mf4, .csv or .rrd")


def register(app: typer.Typer) -> None:
    """Add the command."""
    app.command()(convert)


def convert(
    source: Path = SOURCE,
    target: Path = TARGET,
    overwrite: bool = OVERWRITE,
    json_output: bool = JSON,
) -> None:
    """Write a run file in another format."""
    from clutch_hil.live.conversion import convert as write

    samples = write(source, target, overwrite)
    verdict = f"{samples} samples written" + (", without units and metadata" if target.suffix.lower() == ".csv" else "")
    document = {"read": str(source), "wrote": str(target), "samples": samples, "verdict": verdict}
    report(document, f"read:    {source}\nwrote:   {target}", verdict, True, json_output)
