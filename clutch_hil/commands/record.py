"""`clutch-hil record`: record a running bench."""

from pathlib import Path

import typer

from clutch_hil.command import report
from clutch_hil.commands.options import BENCH, BLIND, JSON, OVERWRITE, ROUTER
from protocols.errors import InputError, join_names

FILE = typer.Argument(
    None,
    help="file to write; its suffix sets the format. Telemetry: .parquet, .mf4, .csv, .rrd; frames on the bus: .blf, .asc,"
    " .log (candump), .trc; runs/DATE-recorded.parquet if not given",
)
_PRIORITY = 1  # of SCHED_RR, below the services at 80. A bus queues half a second; a busy machine may be later


def register(app: typer.Typer) -> None:
    """Add the command."""
    app.command()(record)


def record(
    file: Path | None = FILE,
    bus: str | None = BENCH,
    router: str | None = ROUTER,
    seconds: float | None = typer.Option(
        None, help="how long to record, in s; until Ctrl-C or the end of the bench if not given"
    ),
    blind: bool = BLIND,
    overwrite: bool = OVERWRITE,
    json_output: bool = JSON,
) -> None:
    """Record a running bench: its telemetry, the last 30 s before included, or the frames on its bus."""
    import os
    from contextlib import suppress

    from clutch_hil.bench.can_log import WRITERS, CanLog, CanLogResult
    from clutch_hil.bench.progress import ActivityLine
    from clutch_hil.live.conversion import FORMATS
    from clutch_hil.live.recording.bench_recording import record as record_telemetry
    from clutch_hil.live.recording.recorder import RecordingResult
    from protocols.files.output_file import check_new_file
    from protocols.realtime.stopping import Stop

    if seconds is not None and not 0.0 <= seconds < float("inf"):
        raise InputError(f"--seconds {seconds:g} is not possible; allowed are 0 (of telemetry only the past) and more")
    path = file.with_suffix(".parquet") if file and not (file.suffix or os.path.isdir(file)) else file
    if path and path.suffix.lower() not in (*FORMATS, *WRITERS):
        raise InputError(
            f"{path} cannot be recorded as {path.suffix!r}; allowed are {join_names((*FORMATS, *WRITERS))}"
        )
    result: CanLogResult | RecordingResult
    with ActivityLine(f"waiting for {bus or 'a bus'}", json_output) as doing, Stop() as stop:
        if path and path.suffix.lower() in WRITERS:
            if router:
                raise InputError(f"frames on a bus do not come from the router {router}; leave --router out")
            if blind:
                raise InputError(f"frames on a bus contain no truth that {path} could reveal; leave --blind out")
            check_new_file(path, overwrite)
            with suppress(OSError):  # only root may set it
                os.sched_setscheduler(0, os.SCHED_RR, os.sched_param(_PRIORITY))
            result = CanLog(bus or "auto", path).record(stop, seconds, doing.update)
        else:
            result = record_telemetry(path, bus, router, seconds, stop, doing.update, blind, doing.note, overwrite)
    report(result.document, result.text, result.verdict, result.good, json_output)
