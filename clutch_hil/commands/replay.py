"""`clutch-hil replay`: a recorded bus log through the controller again."""

from pathlib import Path

import typer

from clutch_hil.command import report
from clutch_hil.commands.options import CONTROLLER_ADAPTATION, CONTROLLER_LAW, JSON, PARAMETERS


def register(app: typer.Typer) -> None:
    """Add the command."""
    app.command()(replay)


def replay(
    log: Path = typer.Argument(help="log of a bus: .blf, .asc, .log (candump) or .trc, as `record` writes them"),
    bus: str | None = typer.Option(None, help="play it to a controller on this bus; in this process if not given"),
    parameters: Path | None = PARAMETERS,
    law: str = CONTROLLER_LAW,
    adaptation: bool = CONTROLLER_ADAPTATION,
    json_output: bool = JSON,
) -> None:
    """Play the samples of a bus log to the controller, as fast as possible, and print the checksum of all answers."""
    import time

    from protocols.buses.bus import resolve
    from rt_controller.loop.node import ControllerNode
    from rt_controller.loop.replay import Log, answer_log, answer_log_on_bus

    began = time.perf_counter()
    read = Log(log)
    node = ControllerNode(read.rate, parameters, law, adaptation)
    if bus is None:
        answers = answer_log(read, node)
    else:
        options = ["--law", law, "--adaptation" if adaptation else "--no-adaptation"]
        options += ["--parameters", str(parameters)] if parameters else []
        answers = answer_log_on_bus(resolve(bus), read, options)
    whole = time.perf_counter() - began
    document = {
        "log": str(log), "bus": bus and resolve(bus), "rate_hz": read.rate, "log_seconds": read.seconds,
        "cycles": answers.cycles, "logged": answers.logged, "equal": answers.equal, "sha256": answers.digest,
        "seconds": whole, "controller_seconds": answers.seconds,
    }  # fmt: skip
    lines = [
        f"read:    {log}, {len(read.samples)} samples at {read.rate} Hz, {read.seconds:.1f} s",
        f"sha256:  {answers.digest}",
        f"took:    {whole:.2f} s, of which the controller {answers.seconds:.2f} s",
    ]
    if answers.equal < answers.logged:
        lines.append(
            "note:    in real time a cycle takes what has come by its slot, here all up to its sample: answers differ"
        )
    same = f"{answers.equal} of {answers.logged} logged valve commands are the same"
    report(document, "\n".join(lines), f"{answers.cycles} samples answered, {same}", True, json_output)
