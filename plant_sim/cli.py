"""Commands of the plant and the bench."""

from pathlib import Path

import typer

from protocols.command import checked_rate, emit, report, verdict, write_summary

BUS = typer.Option("auto", help="vcan0, can0, local:NAME or auto")
RATE = typer.Option(1000, help="rate of samples and commands [Hz]")
PROFILE = typer.Option("engagement", help="name of a profile, or a CSV file")
PLANT_PARAMETERS = typer.Option(None, "--plant-parameters", help="TOML file that changes plant parameters")
CONTROLLER_PARAMETERS = typer.Option(
    None, "--controller-parameters", help="TOML file that changes controller parameters"
)
SECONDS = typer.Option(None, help="repeat or cut the profile to this length [s]")
SEED = typer.Option(1, help="seed of the sensor noise")
TEMPERATURE = typer.Option(None, help="oil temperature at the start [degC]; the reference temperature if not given")
LAW = typer.Option("both", help="both, feedforward or feedback")
ADAPTATION = typer.Option(True, help="adapt the friction level on-line")
JSON = typer.Option(False, "--json", help="print the result as JSON")


def register(app: typer.Typer) -> None:
    """Add the commands of plant and bench."""
    for command in (plant, up):
        app.command()(command)


def plant(
    bus: str = BUS,
    rate: int = RATE,
    lockstep: bool = typer.Option(False, help="wait for the controller's answer to every sample"),
    parameters: Path | None = typer.Option(None, help="TOML file that changes plant parameters"),
    profile: str | None = typer.Option(None, help="profile to play; none if not given"),
    seconds: float | None = SECONDS,
    seed: int = SEED,
    temperature: float | None = TEMPERATURE,
    ring: Path | None = typer.Option(None, help="shared-memory file for the record of every sample"),
    summary: Path | None = typer.Option(None, help="JSON file for the summary"),
    cpu: int | None = typer.Option(None, help="CPU to run on"),
    json_output: bool = JSON,
) -> None:
    """Simulate the rig on a bus until its profile ends or it is stopped."""
    from plant_sim.profile import load_profile
    from plant_sim.rigs import wet_clutch
    from plant_sim.service import PlantService
    from protocols.parameters import load_overlay

    known = wet_clutch.nominal()
    service = PlantService(
        bus=bus,
        rate=checked_rate(rate),
        lockstep=lockstep,
        parameters=load_overlay(parameters, known) if parameters else known,
        profile=load_profile(profile, seconds) if profile else None,
        seed=seed,
        temperature=temperature,
        ring=ring,
        cpu=cpu,
    )
    result = service.run(lambda text: typer.echo(text, err=True))
    write_summary(summary, result)
    if json_output:
        emit(result)
    else:
        verdict(f"plant stopped after {result['samples']} samples")


def up(
    bus: str = BUS,
    rate: int = RATE,
    profile: str = PROFILE,
    seconds: float | None = SECONDS,
    lockstep: bool = typer.Option(False, help="deterministic, as fast as the machine allows"),
    plant_parameters: Path | None = PLANT_PARAMETERS,
    controller_parameters: Path | None = CONTROLLER_PARAMETERS,
    seed: int = SEED,
    temperature: float | None = TEMPERATURE,
    law: str = LAW,
    adaptation: bool = ADAPTATION,
    out: Path = typer.Option(Path("runs"), help="folder for the run file and its picture"),
    json_output: bool = JSON,
) -> None:
    """Start plant and controller, play a profile, record, judge, draw."""
    from plant_sim.bench.up import Bench

    bench = Bench(
        bus=bus,
        rate=checked_rate(rate),
        profile=profile,
        seconds=seconds,
        lockstep=lockstep,
        plant_parameters=plant_parameters,
        controller_parameters=controller_parameters,
        seed=seed,
        temperature=temperature,
        law=law,
        adaptation=adaptation,
        out=out,
    )
    result = bench.run(quiet=json_output)
    report(result.document, result.text, result.verdict, result.good, json_output)
