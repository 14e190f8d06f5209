"""Benchmarks by one command: python -m benchmarks [clutches | friction | kills | loop | requests | soak]; not the battery."""

import typer

from clutch_hil.command import report, run_command
from clutch_hil.commands.options import BUS, JSON
from protocols.errors import InputError


def benchmark(
    what: str = typer.Argument(
        "loop",
        help="loop: kernel, controller and closed loop; clutches: cost of 1 to 8; friction: friction models; requests: the"
        " loops under requests over telemetry; soak: what a bench uses over time, --seconds 1200 or 7200; kills: what is left"
        " of recordings after kill -9, --kills 50",
    ),
    bus: str = BUS,
    seconds: float = typer.Option(60.0, help="length of the closed loop in real time, in s"),
    kills: int = typer.Option(50, help="number of benches that are killed"),
    seed: int = typer.Option(1, help="seed of the moments of the kills", min=0),
    json_output: bool = JSON,
) -> None:
    """Measure the loop, alone or under requests, the cost of several clutches, or friction models beside other packages'."""
    import platform

    from benchmarks.loop import Target, format_loop, measure_loop
    from clutch_hil.bench.progress import format_table, progress_bar

    if what == "loop":
        targets, document = measure_loop(bus, seconds, json_output)
        extra = format_loop(document)
    elif what == "friction":
        from benchmarks.friction import measure_friction_models

        with progress_bar("friction models", json_output) as progress:
            models, targets, document = measure_friction_models(progress)
        extra = format_table(models)
    elif what == "clutches":
        from benchmarks.clutches import measure_clutch_costs, tabulate_costs

        with progress_bar("clutches", json_output) as progress:
            targets, document = measure_clutch_costs(min(seconds, 24.0), progress)
        extra = format_table(tabulate_costs(document))
    elif what == "requests":
        from benchmarks.requests import measure_requests, tabulate_requests

        targets, document = measure_requests(bus, seconds, lambda line: typer.echo(line, err=True))
        extra = format_table(tabulate_requests(document))
    elif what == "soak":
        from benchmarks.soak import measure_soak, tabulate_soak

        targets, document = measure_soak(bus, seconds, lambda line: typer.echo(line, err=True))
        extra = format_table(tabulate_soak(document))
    elif what == "kills":
        from benchmarks.kills import measure_kills, tabulate_kills

        targets, document = measure_kills(kills, seed, lambda line: typer.echo(line, err=True))
        extra = format_table(tabulate_kills(document))
    else:
        raise InputError(
            f"benchmark {what!r} does not exist; known are clutches, friction, kills, loop, requests, soak"
        )
    rows = [Target.HEAD, *(target.format_row() for target in targets)]
    machine = f"machine: {platform.machine()}, Linux {platform.release()}, Python {platform.python_version()}"
    missed = [target.name for target in targets if not target.is_met]
    verdict_text = "all met" if not missed else f"not met: {', '.join(missed)}"
    if without := document.get("not_installed"):
        verdict_text += f"; not measured: {', '.join(without)}, not installed"
    report(document, "\n".join([machine, extra, "", format_table(rows)]), verdict_text, not missed, json_output)


if __name__ == "__main__":
    run_command(benchmark)
