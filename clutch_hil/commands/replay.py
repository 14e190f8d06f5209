"""`clutch-hil replay`: play a recorded bus log to the controller again."""

from pathlib import Path

import typer

from clutch_hil.command import report
from clutch_hil.commands.options import CONTROLLER_ADAPTATION, CONTROLLER_LAW, JSON, PARAMETERS


def register(app: typer.Typer) -> None:
    """Add the command."""
    app.command()(replay)


def replay(
    log: Path = typer.Argument(help="log of a bus: BLF, ASC, candump, TRC or MF4; recognised by its content"),
    channel: str | None = typer.Option(None, help="channel of the log, if more than one has frames of a bench"),
    bus: str | None = typer.Option(
        None, help="play it to a controller on this bus; to one in this process if not given"
    ),
    parameters: Path | None = PARAMETERS,
    law: str = CONTROLLER_LAW,
    adaptation: bool = CONTROLLER_ADAPTATION,
    json_output: bool = JSON,
) -> None:
    """Play the samples of a bus log to the controller, as fast as possible, and print the checksum of all answers.

    Exit code 1 where frames are lost, corrupt or cut, so that answers can differ.
    """
    import time

    from protocols.buses.bus import resolve
    from protocols.kernels.progress_notice import compile_first
    from rt_controller.loop.bench_log import Log
    from rt_controller.loop.node import ControllerNode
    from rt_controller.loop.replay import answer_log, answer_log_on_bus
    from rt_controller.loop.service import ControllerService

    began = time.perf_counter()
    read = Log(log, channel, exact=bus is None)
    node = ControllerNode(read.rate, parameters, law, adaptation)
    if bus is None:
        answers = answer_log(read, node)
    else:
        compile_first(ControllerService.warm)  # the process that is started then finds all compiled kernels
        options = ["--law", law, "--adaptation" if adaptation else "--no-adaptation"]
        options += ["--parameters", str(parameters)] if parameters else []
        answers = answer_log_on_bus(resolve(bus), read, options)
    whole = time.perf_counter() - began
    document = {
        "log": str(log), "bus": bus and resolve(bus), "rate_hz": read.rate, "log_seconds": read.seconds,
        "cycles": answers.cycles, "logged": answers.logged, "equal": answers.equal, "sha256": answers.digest,
        "seconds": whole, "controller_seconds": answers.seconds, **read.document,
    }  # fmt: skip
    channel_text = f"channel {read.channel}, " if read.channel else ""
    lines = [
        f"read:    {log}, {channel_text}{len(read.samples)} samples at {read.rate} Hz, {read.seconds:.1f} s",
        *(f"note:    {note}" for note in read.notes),
        f"sha256:  {answers.digest}",
        f"took:    {whole:.2f} s, the controller's share {answers.seconds:.2f} s",
    ]
    differs = answers.equal < answers.logged
    if differs and read.begins_late:
        lines.append(
            "note:    answers differ: the log begins after the start of its controller, whose state then is unknown; a new one"
            " follows a demand only after a request for idle"
        )
    elif differs:
        lines.append(
            "note:    answers differ: in real time a cycle uses the frames received by then, here all frames up to its sample"
        )
    verdict = (
        f"{answers.cycles} samples answered, {answers.equal} of {answers.logged} logged valve commands are the same"
    )
    if read.defects:
        verdict += f"; {read.defects}"
    # If the log is incomplete, a difference is no statement about the controller
    good = not read.defects or (answers.logged > 0 and not differs)
    report(document, "\n".join(lines), verdict, good, json_output)
