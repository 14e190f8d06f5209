"""`clutch-hil tune`: list, show and set parameters of running services."""

from pathlib import Path

import typer

from clutch_hil.command import report
from clutch_hil.commands.options import BENCH, JSON, ROUTER
from protocols.errors import InputError

NAMES = typer.Argument(
    None,
    metavar="[NAME[=VALUE]]...",
    help="parameters to show or to set, to a number or a number with a unit, such as 34psi; a group such as torque. shows all"
    " its parameters",
)
CALIBRATION_FILE = typer.Option(
    None,
    "--calibration",
    help="calibration.toml of `clutch-hil identify`: load it into the controller while its clutch is open",
)
WITH_PLANT = typer.Option(
    False,
    "--with-plant",
    help="load the calibration into the plant as well, which becomes the model of the identified rig",
)


def register(app: typer.Typer) -> None:
    """Add the command."""
    app.command()(tune)


def tune(
    names: list[str] | None = NAMES,
    bus: str | None = BENCH,
    router: str | None = ROUTER,
    calibration: Path | None = CALIBRATION_FILE,
    with_plant: bool = WITH_PLANT,
    json_output: bool = JSON,
) -> None:
    """List, show and set the parameters of the running services; load a calibration into them."""
    from clutch_hil.live.tuning.calibration_load import load_calibration
    from clutch_hil.live.tuning.tune import run_tune

    if calibration:
        if names:
            raise InputError(f"--calibration and {names[0]!r} were both given; only one of them is allowed")
        report(*load_calibration(calibration, bus, router, with_plant), json_output)
        return
    if with_plant:
        raise InputError("--with-plant needs --calibration")
    report(*run_tune(names or [], bus, router), json_output)
