"""`clutch-hil tune`: parameters of running services listed, shown and set."""

import typer

from clutch_hil.command import report
from clutch_hil.commands.options import BENCH, JSON, ROUTER

NAMES = typer.Argument(
    None, metavar="[NAME[=VALUE]]...", help="parameters to show, or to set; a group such as torque. shows all of it"
)


def register(app: typer.Typer) -> None:
    """Add the command."""
    app.command()(tune)


def tune(
    names: list[str] | None = NAMES,
    bus: str | None = BENCH,
    router: str | None = ROUTER,
    json_output: bool = JSON,
) -> None:
    """List, show and set the parameters of the running services."""
    from clutch_hil.live.tune import run_tune

    report(*run_tune(names or [], bus, router), json_output)
