"""Commands that record a running bench, and that write a run in another format."""

from pathlib import Path

import typer

from protocols.command import report
from protocols.errors import InputError, listing

FILE = typer.Argument(
    None,
    help="its suffix decides. Telemetry: .parquet, .mf4, .csv, .rrd; frames on the bus: .blf, .asc, .log (candump), .trc;"
    " runs/DATE-recorded.parquet if not given",
)
SOURCE = typer.Argument(help="run file: .parquet, .mf4 or .csv")
TARGET = typer.Argument(help="what to write: .parquet, .mf4, .csv or .rrd")
_PRIORITY = 1  # SCHED_RR, below the services at 80: a bus queues half a second, on a busy machine others wait longer
JSON = typer.Option(False, "--json", help="print the result as JSON")


def register(app: typer.Typer) -> None:
    """Add the commands."""
    for command in (record, convert):
        app.command()(command)


def record(
    file: Path | None = FILE,
    bus: str | None = typer.Option(None, help="bus of the bench, where several are running"),
    router: str | None = typer.Option(None, help="zenoh router of another machine, such as tcp/192.168.1.5:7447"),
    seconds: float | None = typer.Option(
        None, help="how long from now on; until Ctrl-C, or the bench's end, if not given"
    ),
    blind: bool = typer.Option(False, "--blind", help="keep the truth out of the run file, in a sealed file beside it"),
    json_output: bool = JSON,
) -> None:
    """Record a running bench: its telemetry, the last 30 s before included, or the frames on its bus."""
    import os
    from contextlib import suppress

    from plant_sim.bench.can_log import WRITERS, CanLog, Logged
    from plant_sim.bench.progress import Doing
    from plant_sim.live.conversion import FORMATS, new_file
    from plant_sim.live.record import record as record_telemetry
    from plant_sim.live.recorder import Recorded
    from protocols.stopping import Stop

    if seconds is not None and not 0.0 <= seconds < float("inf"):
        raise InputError(f"--seconds {seconds:g} is not possible; allowed are 0 (of telemetry only the past) and more")
    path = file.with_suffix(".parquet") if file and not file.suffix else file
    if path and path.suffix not in (*FORMATS, *WRITERS):
        raise InputError(f"{path} cannot be recorded as {path.suffix!r}; allowed are {listing((*FORMATS, *WRITERS))}")
    result: Logged | Recorded
    with Doing(f"waiting for {bus or 'a bus'}", json_output) as doing, Stop() as stop:
        if path and path.suffix in WRITERS:
            if router:
                raise InputError(f"frames on a bus do not come from the router {router}; leave --router away")
            if blind:
                raise InputError(f"frames on a bus hold no truth to keep out of {path}; leave --blind away")
            new_file(path)
            with suppress(OSError):  # only root may
                os.sched_setscheduler(0, os.SCHED_RR, os.sched_param(_PRIORITY))
            result = CanLog(bus or "auto", path).record(stop, seconds, doing.update)
        else:
            result = record_telemetry(path, bus, router, seconds, stop, doing.update, blind, doing.note)
    report(result.document, result.text, result.verdict, result.good, json_output)


def convert(
    source: Path = SOURCE,
    target: Path = TARGET,
    json_output: bool = JSON,
) -> None:
    """Write a run file in another format."""
    from plant_sim.live.conversion import convert as write

    samples = write(source, target)
    verdict = f"{samples} samples written" + (", without units and metadata" if target.suffix == ".csv" else "")
    document = {"read": str(source), "wrote": str(target), "samples": samples, "verdict": verdict}
    report(document, f"read:    {source}\nwrote:   {target}", verdict, True, json_output)
