"""`clutch-hil plant`: the plant as a service on a bus."""

from pathlib import Path

import typer

from clutch_hil.command import emit, end_with_verdict, write_summary
from clutch_hil.commands.options import (
    BLIND,
    BUS,
    CPU,
    JSON,
    OVERWRITE,
    PUBLISH_ROUTER,
    RATE,
    SEED,
    SERVICE_TELEMETRY,
    SUMMARY,
    TEMPERATURE,
)


def register(app: typer.Typer) -> None:
    """Add the command."""
    app.command()(plant)


def plant(
    bus: str = BUS,
    rate: int | None = RATE,
    lockstep: bool = typer.Option(False, help="wait for the controller's answer to every sample"),
    scenario: str | None = typer.Option(
        None, help="scenario: its rig, profile, effects, injections; options override it"
    ),
    rig: str | None = typer.Option(None, help="name of a rig; the scenario's, or wet_clutch, if not given"),
    parameters: Path | None = typer.Option(
        None,
        "--model",
        "--parameters",
        "--calibration",
        help="TOML file that changes plant parameters: a rig of yours, a model.toml, or a calibration.toml",
    ),
    profile: str | None = typer.Option(
        None, help="profile to play, or manual; that of the scenario, or none, if not given"
    ),
    seconds: float | None = typer.Option(
        None, help="repeat or cut the profile to this length, in s; afterwards the plant continues until it is stopped"
    ),
    seed: int | None = SEED,
    temperature: float | None = TEMPERATURE,
    blind: bool = BLIND,
    ring: Path | None = typer.Option(None, help="shared-memory file with the record of every sample"),
    summary: Path | None = SUMMARY,
    overwrite: bool = OVERWRITE,
    telemetry: bool = SERVICE_TELEMETRY,
    router: str | None = PUBLISH_ROUTER,
    cpu: int | None = CPU,
    json_output: bool = JSON,
) -> None:
    """Simulate the rig on a bus until it is stopped; in lock-step until its profile ends."""
    from clutch_hil.bench.scenario import choose_scenario
    from clutch_hil.bench.service_text import format_service
    from clutch_hil.bench.settings import MANUAL
    from plant_sim.node.plant_service import PlantService
    from protocols.errors import name_file_in_errors
    from protocols.files.output_file import check_new_file
    from protocols.kernels.progress_notice import compile_first
    from protocols.realtime.stopping import Stop

    for file in filter(None, (ring, summary)):
        check_new_file(file, overwrite)
    given = {
        "rate": rate, "profile": profile or (None if scenario else MANUAL), "seconds": seconds, "seed": seed,
        "temperature": temperature, "plant_parameters": parameters,
    }  # fmt: skip
    played = choose_scenario(scenario, given, rig)
    played.rig.plant.check_blind(blind)
    settings = played.settings
    with name_file_in_errors("scenario", played.path):
        service = PlantService(
            bus=bus,
            rate=settings.rate,
            rig=played.rig.plant,
            lockstep=lockstep,
            parameters=played.plant,
            profile=None if settings.profile == MANUAL else played.load_profile(),
            seed=settings.seed,
            temperature=settings.temperature,
            injections=played.injections,
            blind=blind,
            ring=ring,
            telemetry=telemetry,
            router=router,
            cpu=cpu,
        )
    compile_first(service.warm)
    with Stop():  # a second signal does not interrupt the end of the service
        result = service.run(lambda text: typer.echo(text, err=True))
        write_summary(summary, result)
    if json_output:
        emit(result)
    else:
        typer.echo("\n".join(format_service("plant", result)))
        end_with_verdict(f"plant stopped after {result['samples']} samples")
