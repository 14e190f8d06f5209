"""`clutch-hil peak`: the highest torque of a run, as a command of one's own (CONTRIBUTING.md)."""

from pathlib import Path

import numpy as np
import typer

import clutch_hil as ch
from clutch_hil.command import report
from clutch_hil.commands.options import JSON


def register(app: typer.Typer) -> None:
    """Add the command."""
    app.command()(peak)


def peak(run: Path = typer.Argument(help="run file"), json_output: bool = JSON) -> None:
    """Find the highest torque of a run."""
    torque = np.abs(ch.read_run(run)["clutch_torque_nm"])
    if not np.isfinite(torque).any():
        raise ch.InputError(f"run {run}: clutch_torque_nm has no numbers")
    highest = float(np.nanmax(torque))
    text = f"read:    {run}\nwrote:   nothing"
    report({"run": str(run), "peak_nm": highest}, text, f"highest torque {highest:.2f} Nm", True, json_output)
