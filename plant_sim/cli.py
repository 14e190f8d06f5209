"""Commands of the plant and the bench."""

from pathlib import Path

import typer

from protocols.command import checked_rate, emit, report, verdict, write_summary
from protocols.errors import InputError

BUS = typer.Option("auto", help="vcan0, can0, local:NAME or auto")
RATE = typer.Option(1000, help="rate of samples and commands, in Hz")
PROFILE = typer.Option("engagement", help="name of a profile, or a CSV file")
PROFILE_OR_MANUAL = typer.Option(
    "engagement", help="name of a profile, a CSV file, or manual: the demand comes from `clutch-hil demand` or `panel`"
)
PLANT_PARAMETERS = typer.Option(None, "--plant-parameters", help="TOML file that changes plant parameters")
CONTROLLER_PARAMETERS = typer.Option(
    None, "--controller-parameters", help="TOML file that changes controller parameters"
)
SECONDS = typer.Option(None, help="repeat or cut the profile to this length, in s")
SEED = typer.Option(1, help="seed of the sensor noise")
TEMPERATURE = typer.Option(None, help="oil temperature at the start, in degC; the reference temperature if not given")
LAW = typer.Option("both", help="both, feedforward or feedback")
ADAPTATION = typer.Option(True, help="adapt the friction level on-line")
OUT = typer.Option(Path("runs"), help="folder for what is written")
JSON = typer.Option(False, "--json", help="print the result as JSON")


def register(app: typer.Typer) -> None:
    """Add the commands of plant and bench."""
    for command in (plant, up, simulate, reproduce, frames, benchmark):
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
    telemetry: bool = typer.Option(True, help="publish every cycle over zenoh, from a process of its own"),
    router: str | None = typer.Option(None, help="zenoh router to publish to, such as tcp/192.168.1.5:7447"),
    cpu: int | None = typer.Option(None, help="CPU to run on"),
    json_output: bool = JSON,
) -> None:
    """Simulate the rig on a bus until it is stopped; in lock-step until its profile ends."""
    from plant_sim.profile import load_profile
    from plant_sim.rigs import wet_clutch
    from plant_sim.service import PlantService
    from protocols.stopping import Stop

    service = PlantService(
        bus=bus,
        rate=checked_rate(rate),
        lockstep=lockstep,
        parameters=wet_clutch.nominal(parameters),
        profile=load_profile(profile, seconds) if profile else None,
        seed=seed,
        temperature=temperature,
        ring=ring,
        telemetry=telemetry,
        router=router,
        cpu=cpu,
    )
    with Stop():  # a second signal does not interrupt the ending
        result = service.run(lambda text: typer.echo(text, err=True))
        write_summary(summary, result)
    if json_output:
        emit(result)
    else:
        verdict(f"plant stopped after {result['samples']} samples")


def up(
    bus: str = BUS,
    rate: int = RATE,
    profile: str = PROFILE_OR_MANUAL,
    seconds: float | None = SECONDS,
    lockstep: bool = typer.Option(False, help="deterministic, as fast as the machine allows"),
    plant_parameters: Path | None = PLANT_PARAMETERS,
    controller_parameters: Path | None = CONTROLLER_PARAMETERS,
    seed: int = SEED,
    temperature: float | None = TEMPERATURE,
    law: str = LAW,
    adaptation: bool = ADAPTATION,
    view: bool = typer.Option(False, "--view", help="watch it in rerun's viewer; `clutch-hil view` does it any time"),
    web: bool = typer.Option(False, "--web", help="watch it in a browser"),
    telemetry: bool = typer.Option(True, help="publish every cycle over zenoh"),
    router: str | None = typer.Option(None, help="zenoh router to publish to, such as tcp/192.168.1.5:7447"),
    out: Path = OUT,
    json_output: bool = JSON,
) -> None:
    """Start plant and controller, play a profile, record, judge, draw."""
    from plant_sim.bench.settings import RunSettings
    from plant_sim.bench.up import Bench

    settings = RunSettings(
        checked_rate(rate),
        profile,
        seconds,
        plant_parameters,
        controller_parameters,
        seed,
        temperature,
        law,
        adaptation,
        out,
    )
    if (view or web) and not telemetry:
        raise InputError("a viewer was asked for and --no-telemetry; allowed is one of them")
    viewer = ["--web"] if web else [] if view else None
    result = Bench(settings, bus, lockstep, telemetry, router, viewer).run(quiet=json_output)
    report(result.document, result.text, result.verdict, result.good, json_output)


def simulate(
    rate: int = RATE,
    profile: str = PROFILE,
    seconds: float | None = SECONDS,
    plant_parameters: Path | None = PLANT_PARAMETERS,
    controller_parameters: Path | None = CONTROLLER_PARAMETERS,
    seed: int = SEED,
    seeds: int = typer.Option(1, help="number of seeds; more than one is a sweep", min=1),
    vary: str | None = typer.Option(None, help="plant parameter to sweep, NAME=LOW:HIGH:COUNT"),
    temperature: float | None = TEMPERATURE,
    law: str = LAW,
    adaptation: bool = ADAPTATION,
    out: Path = OUT,
    json_output: bool = JSON,
) -> None:
    """Run plant and controller in one process, once or as a sweep."""
    from plant_sim.bench.progress import progress_bar
    from plant_sim.bench.settings import RunSettings
    from plant_sim.bench.simulate import Simulation

    settings = RunSettings(
        checked_rate(rate),
        profile,
        seconds,
        plant_parameters,
        controller_parameters,
        seed,
        temperature,
        law,
        adaptation,
        out,
    )
    simulation = Simulation(settings)
    with progress_bar("simulate", json_output) as progress:
        sweep = seeds > 1 or vary is not None
        result = simulation.sweep(vary, seeds, progress) if sweep else simulation.run(progress)
    report(result.document, result.text, result.verdict, result.good, json_output)


def reproduce(
    name: str | None = typer.Argument(None, help="name of a reproduction, or a figure's number"),
    list_all: bool = typer.Option(False, "--list", help="list what can be reproduced"),
    every: bool = typer.Option(False, "--all", help="reproduce everything and write one page with all pictures"),
    out: Path = OUT,
    json_output: bool = JSON,
) -> None:
    """Check a result of the thesis by running it."""
    from plant_sim.bench.progress import progress_bar, table_text
    from plant_sim.bench.recording import writable
    from plant_sim.compiled import is_compiled

    if not is_compiled(Path(__file__).parent):
        typer.echo("compiling the kernels, once: about half a minute", err=True)
    from plant_sim.reproduce import entries, entry
    from plant_sim.reproduce.result import checks_text, run, run_all

    if list_all or not (name or every):
        rows = [("name", "what"), *((e.name, e.title) for e in entries().values())]
        report(dict(rows[1:]), table_text(rows), f"{len(rows) - 1} entries", True, json_output)
        return
    if every and name:
        raise InputError(f"reproduce was given {name!r} and --all; allowed is one of them")
    chosen = entry(name) if name else None
    writable(out)
    with progress_bar(name or "reproduce", json_output) as progress:
        if chosen is None:
            report(*run_all(out, progress), json_output)
            return
        result = run(chosen, out, progress)
    text = "\n".join([f"{chosen.name}: {chosen.title}", checks_text(result), f"wrote:   {result.picture}"])
    report(result.document(), text, result.verdict, result.holds, json_output)


def frames(
    rate: int = RATE,
    dbc: Path | None = typer.Option(None, help="another DBC to check and list"),
    json_output: bool = JSON,
) -> None:
    """List the frames of the bus and its worst-case load."""
    from plant_sim.bench.progress import table_text
    from protocols.bus_load import BITRATES, bus_load, frame_rate, highest_rate, worst_bits
    from protocols.frames import DBC, load_frames

    checked_rate(rate)
    path = dbc or DBC
    codecs = load_frames(path).values()
    rows: list[tuple[str, ...]] = [("frame", "id", "bytes", "sender", "frames/s", "worst bits", "signals")]
    for codec in codecs:
        cells = (codec.name, f"0x{codec.can_id:03X}", codec.length, codec.sender, f"{frame_rate(codec, rate):g}")
        rows.append((*map(str, cells), str(worst_bits(codec.length)), " ".join(codec.signals)))
    loads = {bitrate: bus_load(codecs, rate, bitrate) for bitrate in BITRATES}
    lines = [f"read:    {path}", table_text(rows)]
    for bitrate, load in loads.items():
        most = highest_rate(codecs, bitrate)
        lines.append(
            f"{bitrate // 1000} kbit/s: {100 * load:.0f} % of the wire at {rate} Hz; below 80 % up to {most} Hz"
        )
    fits = [f"{bitrate // 1000} kbit/s" for bitrate, load in loads.items() if load < 1.0]
    verdict_text = f"{rate} Hz fits {' and '.join(fits) or 'no classic CAN bus'}"
    report({"frames": rows[1:], "load": loads, "fits": fits}, "\n".join(lines), verdict_text, True, json_output)


def benchmark(
    what: str = typer.Argument("loop", help="loop: kernel, controller and closed loop; friction: friction models"),
    bus: str = BUS,
    seconds: float = typer.Option(60.0, help="length of the closed loop in real time, in s"),
    json_output: bool = JSON,
) -> None:
    """Measure the loop, or our friction models beside those of other packages, on this machine."""
    import platform

    from plant_sim.bench.benchmark import Target, loop_text
    from plant_sim.bench.benchmark import benchmark as measure
    from plant_sim.bench.progress import progress_bar, table_text

    if what == "loop":
        targets, document = measure(bus, seconds, json_output)
        extra = loop_text(document)
    elif what == "friction":
        from plant_sim.bench.friction_benchmark import friction_benchmark

        with progress_bar("friction models", json_output) as progress:
            models, targets, document = friction_benchmark(progress)
        extra = table_text(models)
    else:
        raise InputError(f"benchmark {what!r} does not exist; known are friction, loop")
    rows = [Target.HEAD, *(target.row() for target in targets)]
    machine = f"machine: {platform.machine()}, Linux {platform.release()}, Python {platform.python_version()}"
    missed = [target.name for target in targets if not target.met]
    verdict_text = "all met" if not missed else f"not met: {', '.join(missed)}"
    if without := document.get("not_installed"):
        verdict_text += f"; not measured: {', '.join(without)}, not installed"
    report(document, "\n".join([machine, extra, "", table_text(rows)]), verdict_text, not missed, json_output)
