"""Command of the telemetry process. Services start it; nobody needs to type it."""

import shutil
from pathlib import Path

import typer

READY = "ready"  # file that the telemetry process makes when it publishes


def register(app: typer.Typer) -> None:
    """Add the command."""
    app.command(hidden=True)(telemetry)


def telemetry(
    ring: Path = typer.Argument(help="ring of a service"),
    folder: Path = typer.Argument(help="folder of the service with its mailbox; removed at the end"),
    terminal: int | None = typer.Option(None, help="descriptor on which faults are told"),
    router: str | None = typer.Option(None, help="zenoh router, for example tcp/192.168.1.5:7447"),
) -> None:
    """Publish the record of a service over zenoh."""
    from protocols.telemetry.publisher import publish

    try:
        publish(ring, folder / "mailbox", router, (folder / READY).touch, terminal)
    finally:
        shutil.rmtree(folder, ignore_errors=True)  # the service may have been killed
