"""`clutch-hil panel`: drive the clutch from the keyboard."""

import typer

from clutch_hil.command import report
from clutch_hil.commands.options import BUS, ROUTER


def register(app: typer.Typer) -> None:
    """Add the command."""
    app.command()(panel)


def panel(bus: str = BUS, router: str | None = ROUTER) -> None:
    """Drive the clutch from the keyboard."""
    from clutch_hil.live.driving.panel import drive

    report({}, *drive(bus, router), as_json=False)
