"""`clutch-hil monitor`: watch a running bench in the terminal."""

import typer

from clutch_hil.command import report
from clutch_hil.commands.options import BENCH, JSON, ROUTER


def register(app: typer.Typer) -> None:
    """Add the command."""
    app.command()(monitor)


def monitor(
    bus: str | None = BENCH,
    router: str | None = ROUTER,
    once: bool = typer.Option(False, help="print one screen and exit"),
    seconds: float | None = typer.Option(None, help="how long; until Ctrl-C if not given"),
    json_output: bool = JSON,
) -> None:
    """Watch a running bench in the terminal."""
    from clutch_hil.live.monitor.monitor import watch

    report(*watch(bus, router, once, seconds, json_output), json_output)
