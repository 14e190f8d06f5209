"""`clutch-hil panel`: the clutch driven from the keyboard."""

import typer

from clutch_hil.command import report
from clutch_hil.commands.options import BUS


def register(app: typer.Typer) -> None:
    """Add the command."""
    app.command()(panel)


def panel(bus: str = BUS) -> None:
    """Drive the clutch from the keyboard."""
    from clutch_hil.live.panel import drive

    report({}, *drive(bus), as_json=False)
