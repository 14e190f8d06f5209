"""`clutch-hil secure`: make the files for a bench on a network: encryption, certificates on both sides, rights by role."""

from pathlib import Path

import typer

from clutch_hil.command import report
from clutch_hil.commands.options import JSON

FOLDER = typer.Argument(help="folder for bench.json, operator.json and viewer.json")
HOST = typer.Option(
    [],
    help="address or name of the bench's machine, on which it accepts connections; may be given more than once, for further"
    " names; only this machine if not given",
)
OPERATOR = typer.Option("operator", help="name of the operator; it is logged with each change")
DAYS = typer.Option(90, help="validity of the certificates, in days")
OVERWRITE = typer.Option(
    False, help="replace the files by new ones; the bench refuses the old ones from its next start on"
)


def register(app: typer.Typer) -> None:
    """Add the command."""
    app.command()(secure)


def secure(
    folder: Path = FOLDER,
    host: list[str] = HOST,
    operator: str = OPERATOR,
    days: int = DAYS,
    overwrite: bool = OVERWRITE,
    json_output: bool = JSON,
) -> None:
    """Make the files by which a bench is reached over a network: viewers read, one operator changes, others are refused."""
    from clutch_hil.live.network.lab_network import make_lab

    report(*make_lab(folder, host, operator, days, overwrite), json_output)
