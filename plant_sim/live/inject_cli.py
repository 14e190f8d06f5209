"""Commands that inject effects and faults into a running plant."""

import typer


def register(app: typer.Typer) -> None:
    """Add the commands of this file."""
