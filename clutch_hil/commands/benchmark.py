"""`clutch-hil benchmark`: print where the benchmarks are. They are not in the installed package."""

import typer

from protocols.errors import InputError


def register(app: typer.Typer) -> None:
    """Add the command."""
    app.command(hidden=True, context_settings={"ignore_unknown_options": True})(benchmark)


def benchmark(arguments: list[str] | None = typer.Argument(None)) -> None:
    """Say what the command is now."""
    words = " ".join(["python -m benchmarks", *(arguments or [])])
    raise InputError(f"clutch-hil has no benchmarks any more; run them in a clone of the project: {words}")
