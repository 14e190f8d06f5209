"""`clutch-hil controller`: the controller as a service on a bus."""

from pathlib import Path

import typer

from clutch_hil.command import check_rate, emit, end_with_verdict, write_summary
from clutch_hil.commands.options import (
    BUS,
    CONTROLLER_ADAPTATION,
    CONTROLLER_LAW,
    CPU,
    OVERWRITE,
    PARAMETERS,
    PUBLISH_ROUTER,
    SERVICE_TELEMETRY,
    SUMMARY,
)


def register(app: typer.Typer) -> None:
    """Add the command."""
    app.command()(controller)


def controller(
    bus: str = BUS,
    rate: int = typer.Option(1000, help="control rate, in Hz"),
    lockstep: bool = typer.Option(False, help="run a cycle for each sample instead of by the clock"),
    parameters: Path | None = PARAMETERS,
    law: str = CONTROLLER_LAW,
    adaptation: bool = CONTROLLER_ADAPTATION,
    clutch: str | None = typer.Option(None, help="a or b, if two clutches are on the bus"),
    ring: Path | None = typer.Option(None, help="shared-memory file with the record of every cycle"),
    summary: Path | None = SUMMARY,
    overwrite: bool = OVERWRITE,
    telemetry: bool = SERVICE_TELEMETRY,
    router: str | None = PUBLISH_ROUTER,
    cpu: int | None = CPU,
    trigger: str = typer.Option(
        "clock",
        help="what starts a cycle: clock, bus (the arrival of a sample), or pll (a clock synchronised to the samples)",
    ),
    overrun: str = typer.Option("skip", help="what to do about missed cycles: skip, catch-up or fault"),
    spin_us: float = typer.Option(
        0.0,
        help="longest busy wait before a cycle, in us; at most the recent lateness of sleeps, and a tenth of the period",
    ),
    json_output: bool = typer.Option(False, "--json", help="print the summary as JSON"),
) -> None:
    """Run the controller on a bus until it is stopped."""
    from clutch_hil.bench.service_text import format_service
    from protocols.can.two_clutches import check_clutch
    from protocols.files.output_file import check_new_file
    from protocols.kernels.progress_notice import compile_first
    from protocols.realtime.stopping import Stop
    from rt_controller.loop.service import ControllerService

    for file in filter(None, (ring, summary)):
        check_new_file(file, overwrite)
    service = ControllerService(
        bus=bus,
        rate=check_rate(rate),
        lockstep=lockstep,
        parameters_file=parameters,
        law=law,
        adaptation=adaptation,
        ring=ring,
        telemetry=telemetry,
        router=router,
        cpu=cpu,
        clutch=None if clutch is None else check_clutch(clutch),
        trigger=trigger,
        overrun=overrun,
        spin_us=spin_us,
    )
    compile_first(service.warm)
    with Stop():  # a second signal does not interrupt the end of the service
        result = service.run(lambda text: typer.echo(text, err=True))
        write_summary(summary, result)
    if json_output:
        emit(result)
        if result["overrun"] or result["faults"]:
            raise typer.Exit(1)
    else:
        closed, missed, count = result["valve_closed"], result["overrun"], result["faults"]
        text = f"controller stopped{f' because {missed}' if missed else ''}"
        text += f", {'valve closed' if closed else 'the safe command could not be sent'}"
        if count:
            text += f"; {'' if count == 1 else f'{count} faults, the first: '}{result['first_fault']}"
        typer.echo("\n".join(format_service(service.name, result)))
        end_with_verdict(text, closed and not missed and not count)
