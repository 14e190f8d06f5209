"""`clutch-hil convert`: write a run file in another format."""

from pathlib import Path

import typer

from clutch_hil.command import report
from clutch_hil.commands.options import FROM, JSON, OVERWRITE, TO

SOURCE = typer.Argument(help="run file: .parquet, .mf4 or .csv")
TARGET = typer.Argument(help="what to write: .parquet, .mf4, .csv or .rrd")


def register(app: typer.Typer) -> None:
    """Add the command."""
    app.command()(convert)


def convert(
    source: Path = SOURCE,
    target: Path = TARGET,
    from_s: float = FROM,
    to_s: float = TO,
    overwrite: bool = OVERWRITE,
    json_output: bool = JSON,
) -> None:
    """Write a run file, or a part of it, in the same or another format."""
    from clutch_hil.live.conversion import convert as write
    from protocols.files.stretch import Stretch

    time = write(source, target, overwrite, Stretch(from_s, to_s))["time_s"]
    samples, first, last = len(time), float(time[0]), float(time[-1])
    less = ", without units and metadata" if target.suffix.lower() == ".csv" else ""
    verdict = f"{samples} samples written, from {first:.6g} to {last:.6g} s{less}"
    document = {
        "read": str(source), "wrote": str(target), "samples": samples, "from_s": first, "to_s": last, "verdict": verdict,
    }  # fmt: skip
    report(document, f"read:    {source}\nwrote:   {target}", verdict, True, json_output)
