"""Options that several commands share, each with its help text."""

from math import inf
from pathlib import Path

import typer

from protocols.errors import InputError

BUS = typer.Option("auto", help="vcan0, can0, local:NAME or auto")
# A setting of a scenario is None if not given: then the scenario's value holds, or the default of RunSettings.
RATE = typer.Option(None, help="rate of samples and commands, in Hz; 1000 if not given")
# A model that `clutch-hil discrepancy` extended is such a file.
PLANT_PARAMETERS = typer.Option(
    None,
    "--model",
    "--plant-parameters",
    help="TOML file that changes plant parameters: a rig of yours, or a model.toml",
)
CALIBRATION = typer.Option(
    None, "--calibration", help="calibration.toml of `clutch-hil identify`: parameters of plant and controller"
)
CONTROLLER_PARAMETERS = typer.Option(
    None, "--controller-parameters", help="TOML file that changes controller parameters"
)
SECONDS = typer.Option(None, help="repeat or cut the profile to this length, in s")
SEED = typer.Option(None, help="seed of the sensor noise; 1 if not given", min=0)
TEMPERATURE = typer.Option(None, help="oil temperature at the start, in degC; the reference temperature if not given")
LAW = typer.Option(None, help="both, feedforward or feedback; both if not given")
ADAPTATION = typer.Option(None, help="adapt the friction level while it runs; on if not given")
BLIND = typer.Option(False, "--blind", help="keep the truth out of the run file, in a separate sealed file")
LOCKSTEP = typer.Option(False, help="deterministic, as fast as the machine allows")
JUNIT = typer.Option(None, help="XML file for the verdicts, as test benches read them")
OUT = typer.Option(Path("runs"), help="folder for the files to write")
OVERWRITE = typer.Option(False, help="replace existing files, but never an input file")
FROM = typer.Option(-inf, "--from", help="first time of a part of the run, in s", show_default=False)
TO = typer.Option(inf, "--to", help="last time of a part of the run, in s", show_default=False)
JSON = typer.Option(False, "--json", help="print the result as JSON")
# `auto`, which `clutch-hil up` takes, is the bench that runs
BENCH = typer.Option(
    None,
    "--bus",
    callback=lambda bus: None if bus == "auto" else bus,
    help="bus of the bench, where several are running",
)
ROUTER = typer.Option(
    None,
    "--router",
    "--network",
    help="zenoh router of another machine, such as tcp/192.168.1.5:7447, or a file of `clutch-hil secure`",
)

# Options of a service: plant and controller
SERVICE_TELEMETRY = typer.Option(True, help="publish every cycle over zenoh, from a separate process")
PUBLISH_ROUTER = typer.Option(
    None,
    "--router",
    "--network",
    help="zenoh router to publish to, such as tcp/192.168.1.5:7447, or bench.json of `clutch-hil secure`",
)
CPU = typer.Option(None, help="CPU to run on")
SUMMARY = typer.Option(None, help="JSON file for the summary")

# Options of the controller only, without a scenario
PARAMETERS = typer.Option(
    None, "--parameters", "--calibration", help="TOML file that changes controller parameters, or a calibration.toml"
)
CONTROLLER_LAW = typer.Option("both", help="both, feedforward or feedback")
CONTROLLER_ADAPTATION = typer.Option(True, help="adapt the friction level while it runs")


def take_calibration(
    calibration: Path | None, plant: Path | None, controller: Path | None
) -> tuple[Path | None, Path | None]:
    """Return the parameter files of plant and controller: both are the calibration if there is one. Raises InputError."""
    if not calibration:
        return plant, controller
    if plant or controller:
        other = "--plant-parameters" if plant else "--controller-parameters"
        raise InputError(
            f"--calibration and {other} were both given, but --calibration sets plant and controller; for one of them"
            " use --plant-parameters or --controller-parameters"
        )
    return calibration, calibration
