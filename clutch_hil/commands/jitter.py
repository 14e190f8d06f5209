"""`clutch-hil jitter`: measure the loop's timing beside cyclictest, a witness and echoes; write table, picture and JSON."""

from pathlib import Path

import typer

from clutch_hil.command import check_rate, report
from clutch_hil.commands.options import BUS, JSON, OVERWRITE
from protocols.errors import InputError, format_count

_DIGITS = 10  # a rate has fewer digits; Python refuses to convert thousands of digits


def register(app: typer.Typer) -> None:
    """Add the command."""
    app.command()(jitter)


def jitter(
    bus: str = BUS,
    rate: int = typer.Option(1000, help="rate of samples and commands, in Hz"),
    seconds: float = typer.Option(30.0, help="total length of each phase, in s"),
    rounds: int = typer.Option(3, min=1, help="number of rounds; each round measures all phases in turn"),
    cpu: int | None = typer.Option(None, help="CPU of the loops; the last if not given"),
    spin_us: float = typer.Option(100.0, help="longest busy wait before a cycle, in us"),
    rates: str | None = typer.Option(
        None, help="measure only the closed loop, started by clock and by bus, at these rates in Hz, such as 250,4000"
    ),
    load: list[str] = typer.Option(
        [], help="cpu, memory, disk, bus, viewer, restarts or full; may be given more than once"
    ),
    telemetry: bool = typer.Option(True, help="publish every cycle during the measurement, as a bench does"),
    out: Path = typer.Option(Path("runs"), help="folder for jitter.png and jitter.json"),
    overwrite: bool = OVERWRITE,
    json_output: bool = JSON,
) -> None:
    """Measure the jitter of the loop beside what the machine allows."""
    import os

    from clutch_hil.bench.progress import progress_bar
    from clutch_hil.bench.recording import make_writable
    from clutch_hil.bench.timing import jitter_report
    from clutch_hil.bench.timing.jitter import measure, sweep
    from clutch_hil.bench.timing.loads import find_loads
    from clutch_hil.bench.timing.measurements import Setting
    from clutch_hil.command import write_summary
    from protocols.buses.bus import open_bus, resolve
    from protocols.files.output_file import check_new_files, whole_files
    from protocols.realtime.waiting import check_spin

    cpus = sorted(os.sched_getaffinity(0))
    setting = jitter_report.check_setting(
        Setting(
            resolve(bus), check_rate(rate), seconds, rounds, cpus[-1] if cpu is None else cpu,
            check_spin(spin_us), telemetry,
        ),
        cpus,
    )  # fmt: skip
    loads = find_loads(load)
    wanted = _parse_rates(rates) if rates is not None else []
    open_bus(setting.bus).close()
    summary, picture = make_writable(out) / "jitter.json", out / "jitter.png"
    check_new_files(out, [summary.name] if wanted else [summary.name, picture.name], overwrite)
    if wanted:
        with progress_bar("jitter by rate", json_output) as progress:
            measurement = jitter_report.sweep_document(setting, loads, *sweep(setting, wanted, loads, progress))
        verdict, good = jitter_report.judge_sweep(measurement)
        measurement["verdict"] = verdict
        write_summary(summary, measurement)
        lines = [jitter_report.sweep_text(measurement), "", f"wrote:   {summary}"]
        report(measurement, "\n".join(lines), verdict, good, json_output)
        return
    with progress_bar("jitter", json_output) as progress:
        measured, interrupted = measure(setting, loads, progress)
    measurement = jitter_report.make_document(setting, loads, measured, interrupted)
    verdict, good = jitter_report.judge(measurement)
    measurement["verdict"] = verdict
    with whole_files(out) as parts:
        jitter_report.draw(setting, measured, parts / picture.name)
        write_summary(parts / summary.name, measurement)
    where = f"on {setting.bus} at {rate} Hz, CPU {setting.cpu}"
    read = f"read:    {len(measured)} phases of {seconds:g} s in {format_count(rounds, 'round')} {where}"
    report(
        measurement,
        "\n".join([jitter_report.format_text(measurement), "", read, f"wrote:   {picture}", f"wrote:   {summary}"]),
        verdict,
        good,
        json_output,
    )


def _parse_rates(text: str) -> list[int]:
    """Return the rates [Hz] in a comma-separated list. Raises InputError."""
    parts = [part.strip() for part in text.split(",")]
    if odd := [part for part in parts if not (part.isdecimal() and len(part) < _DIGITS)]:
        raise InputError(f"rates {text!r} has {odd[0]!r}; allowed are whole numbers in Hz, separated by commas")
    return [check_rate(int(part)) for part in parts]
