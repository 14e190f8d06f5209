"""Commands of the plant and the bench."""

from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

import typer

from protocols.command import checked_rate, emit, report, verdict, write_summary
from protocols.errors import InputError

if TYPE_CHECKING:
    from plant_sim.scenario import Scenario

BUS = typer.Option("auto", help="vcan0, can0, local:NAME or auto")
# What a scenario sets is None where it is not given: then the scenario's value stands, without one the default of RunSettings.
RATE = typer.Option(None, help="rate of samples and commands, in Hz; 1000 if not given")
PROFILE = typer.Option(None, help="name of a profile, or a CSV file; engagement if not given")
PROFILE_OR_MANUAL = typer.Option(
    None,
    help="name of a profile, a CSV file, or manual: the demand comes from `clutch-hil demand` or `panel`;"
    " engagement if not given",
)
# a model that `clutch-hil discrepancy` extended is such a file
PLANT_PARAMETERS = typer.Option(
    None,
    "--model",
    "--plant-parameters",
    help="TOML file that changes plant parameters: a rig of yours, or a model.toml",
)
CONTROLLER_PARAMETERS = typer.Option(
    None, "--controller-parameters", help="TOML file that changes controller parameters"
)
SECONDS = typer.Option(None, help="repeat or cut the profile to this length, in s")
SEED = typer.Option(None, help="seed of the sensor noise; 1 if not given", min=0)
TEMPERATURE = typer.Option(None, help="oil temperature at the start, in degC; the reference temperature if not given")
LAW = typer.Option(None, help="both, feedforward or feedback; both if not given")
ADAPTATION = typer.Option(None, help="adapt the friction level on-line, which is done if not given")
BLIND = typer.Option(False, "--blind", help="keep the truth out of the run file, in a sealed file beside it")
JUNIT = typer.Option(None, help="XML file for the verdicts, as test benches read them")
OUT = typer.Option(Path("runs"), help="folder for what is written")
JSON = typer.Option(False, "--json", help="print the result as JSON")


def register(app: typer.Typer) -> None:
    """Add the commands of plant and bench."""
    for command in (plant, up, simulate, scenarios, reproduce, frames, benchmark):
        app.command()(command)


def _scenario(name: str | None, given: Mapping[str, Any], rig: str | None = None) -> "Scenario":
    """The scenario `name`, or without one a run of `rig`, with the settings that were `given`. Raises InputError."""
    from plant_sim.bench.settings import RunSettings
    from plant_sim.scenario import Scenario, load_scenario

    said = {key: value for key, value in given.items() if value is not None}
    checked_rate(said.get("rate", RunSettings.rate))
    if name is None:
        return Scenario.of(RunSettings(**said), rig or "wet_clutch")
    loaded = load_scenario(name, said)
    if rig not in (None, loaded.rig):
        raise InputError(
            f"scenario {name} is of the rig {loaded.rig}, and --rig {rig} was given; allowed is one of them"
        )
    return loaded


def plant(
    bus: str = BUS,
    rate: int | None = RATE,
    lockstep: bool = typer.Option(False, help="wait for the controller's answer to every sample"),
    scenario: str | None = typer.Option(
        None, help="scenario: its rig, profile, effects, injections; options override it"
    ),
    rig: str | None = typer.Option(None, help="wet_clutch or power_shift; the scenario's, or wet_clutch, if not given"),
    parameters: Path | None = typer.Option(
        None, "--model", "--parameters", help="TOML file that changes plant parameters: a rig of yours, or a model.toml"
    ),
    profile: str | None = typer.Option(None, help="profile to play, or manual; of the scenario, or none, if not given"),
    seconds: float | None = SECONDS,
    seed: int | None = SEED,
    temperature: float | None = TEMPERATURE,
    blind: bool = BLIND,
    ring: Path | None = typer.Option(None, help="shared-memory file for the record of every sample"),
    summary: Path | None = typer.Option(None, help="JSON file for the summary"),
    telemetry: bool = typer.Option(True, help="publish every cycle over zenoh, from a process of its own"),
    router: str | None = typer.Option(None, help="zenoh router to publish to, such as tcp/192.168.1.5:7447"),
    cpu: int | None = typer.Option(None, help="CPU to run on"),
    json_output: bool = JSON,
) -> None:
    """Simulate the rig on a bus until it is stopped; in lock-step until its profile ends."""
    from plant_sim.bench.settings import MANUAL
    from plant_sim.scenario import naming
    from plant_sim.service import PlantService
    from protocols.service_text import service_lines
    from protocols.starting import compile_first
    from protocols.stopping import Stop

    given = {
        "rate": rate, "profile": profile or (None if scenario else MANUAL), "seconds": seconds, "seed": seed,
        "temperature": temperature, "plant_parameters": parameters,
    }  # fmt: skip
    played = _scenario(scenario, given, rig)
    settings = played.settings
    with naming(played.path):
        service = PlantService(
            bus=bus,
            rate=settings.rate,
            lockstep=lockstep,
            parameters=played.plant,
            profile=None if settings.profile == MANUAL else played.loaded_profile(),
            seed=settings.seed,
            temperature=settings.temperature,
            injections=played.injections,
            blind=blind,
            ring=ring,
            telemetry=telemetry,
            router=router,
            cpu=cpu,
            rig=played.rig,
        )
    compile_first(service.warm)
    with Stop():  # a second signal does not interrupt the ending
        result = service.run(lambda text: typer.echo(text, err=True))
        write_summary(summary, result)
    if json_output:
        emit(result)
    else:
        typer.echo("\n".join(service_lines("plant", result)))
        verdict(f"plant stopped after {result['samples']} samples")


def up(
    scenario: str | None = typer.Argument(None, help="name of a scenario, or its file; options override it"),
    bus: str = BUS,
    rate: int | None = RATE,
    profile: str | None = PROFILE_OR_MANUAL,
    seconds: float | None = SECONDS,
    lockstep: bool = typer.Option(False, help="deterministic, as fast as the machine allows"),
    plant_parameters: Path | None = PLANT_PARAMETERS,
    controller_parameters: Path | None = CONTROLLER_PARAMETERS,
    seed: int | None = SEED,
    temperature: float | None = TEMPERATURE,
    law: str | None = LAW,
    adaptation: bool | None = ADAPTATION,
    view: bool = typer.Option(False, "--view", help="watch it in rerun's viewer; `clutch-hil view` does it any time"),
    web: bool = typer.Option(False, "--web", help="watch it in a browser"),
    telemetry: bool = typer.Option(True, help="publish every cycle over zenoh"),
    router: str | None = typer.Option(None, help="zenoh router to publish to, such as tcp/192.168.1.5:7447"),
    trigger: str | None = typer.Option(None, help="what begins a control cycle: clock (if not given), bus or pll"),
    spin_us: float | None = typer.Option(None, help="the controller spins at most so long before a slot, in us"),
    blind: bool = BLIND,
    junit: Path | None = JUNIT,
    out: Path = OUT,
    json_output: bool = JSON,
) -> None:
    """Start plant and controller, play a scenario or a profile, record, judge, draw."""
    from plant_sim.bench.suite import run_one
    from plant_sim.bench.up import bench

    given = {
        "rate": rate, "profile": profile, "seconds": seconds, "plant_parameters": plant_parameters,
        "controller_parameters": controller_parameters, "seed": seed, "temperature": temperature, "law": law,
        "adaptation": adaptation, "out": out,
    }  # fmt: skip
    chosen = _scenario(scenario, given)
    if (view or web) and not telemetry:
        raise InputError("a viewer was asked for and --no-telemetry; allowed is one of them")
    viewer = ["--web"] if web else [] if view else None
    pace = ["--trigger", trigger] if trigger else []
    pace += ["--spin-us", str(spin_us)] if spin_us is not None else []
    live = bench(chosen, bus, lockstep, telemetry, router, viewer, blind, pace)
    result = run_one(live.label, lambda: live.run(quiet=json_output), junit)
    report(result.document, result.text, result.verdict, result.good, json_output)


def simulate(
    names: list[str] | None = typer.Argument(
        None, metavar="[SCENARIO]...", help="names of scenarios, or their files; options override them"
    ),
    every: bool = typer.Option(False, "--all", help="simulate every scenario that comes with the bench"),
    rate: int | None = RATE,
    profile: str | None = PROFILE,
    seconds: float | None = SECONDS,
    plant_parameters: Path | None = PLANT_PARAMETERS,
    controller_parameters: Path | None = CONTROLLER_PARAMETERS,
    seed: int | None = SEED,
    seeds: int = typer.Option(1, help="number of seeds; more than one is a sweep", min=1),
    vary: str | None = typer.Option(None, help="plant parameter to sweep, NAME=LOW:HIGH:COUNT"),
    temperature: float | None = TEMPERATURE,
    law: str | None = LAW,
    adaptation: bool | None = ADAPTATION,
    blind: bool = BLIND,
    junit: Path | None = JUNIT,
    out: Path = OUT,
    json_output: bool = JSON,
) -> None:
    """Run plant and controller in one process: a scenario or a profile, several scenarios, or a sweep."""
    from plant_sim.bench.progress import progress_bar
    from plant_sim.bench.simulate import Simulation, simulation
    from plant_sim.bench.suite import run_one, run_suite
    from plant_sim.bench.sweep import sweep
    from plant_sim.scenario import shipped

    if every and names:
        raise InputError(f"simulate was given {names[0]!r} and --all; allowed is one of them")
    given = {
        "rate": rate, "profile": profile, "seconds": seconds, "plant_parameters": plant_parameters,
        "controller_parameters": controller_parameters, "seed": seed, "temperature": temperature, "law": law,
        "adaptation": adaptation, "out": out,
    }  # fmt: skip
    wanted = shipped() if every else names or ()
    chosen = [_scenario(name, given) for name in wanted] or [_scenario(None, given)]
    swept = seeds > 1 or vary is not None
    if swept and (len(chosen) > 1 or blind or junit):
        other = "--blind" if blind else "--junit" if junit else f"{len(chosen)} scenarios"
        raise InputError(f"a sweep was asked for and {other}; allowed is one of them")
    with progress_bar("simulate", json_output) as progress:
        if swept:
            result = sweep(Simulation(chosen[0]), vary, seeds, progress)
        elif len(chosen) == 1:
            single = simulation(chosen[0], blind)
            result = run_one(single.label, lambda: single.run(progress), junit)
        else:
            result = run_suite([simulation(scenario, blind) for scenario in chosen], progress, junit)
    report(result.document, result.text, result.verdict, result.good, json_output)


def scenarios(json_output: bool = JSON) -> None:
    """List the scenarios that come with the bench, with their limits."""
    from plant_sim.scenario import FOLDER, load_scenario, shipped

    lines, document = [f"read:    {FOLDER}"], []
    for found in map(load_scenario, shipped()):
        limits = list(map(str, found.limits))
        lines += [
            f"{found.name} ({found.rig}, {found.duration:.1f} s): {found.title}",
            f"    {', '.join(limits) or '-'}",
        ]
        said = {"name": found.name, "title": found.title, "about": found.about, "rig": found.rig}
        document.append(said | {"seconds": found.duration, "limits": limits, "file": str(found.path)})
    told = f"{len(document)} scenarios; run them with clutch-hil simulate NAME or clutch-hil up NAME"
    report(document, "\n".join(lines), told, True, json_output)


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
    rate: int = typer.Option(1000, help="rate of samples and commands, in Hz"),
    dbc: Path | None = typer.Option(None, help="another DBC to check and list"),
    clutches: int = typer.Option(1, help="2: the bus of the power-shift rig", min=1, max=2),
    write: Path | None = typer.Option(None, help="DBC file to write for other tools, as for cantools or candump"),
    json_output: bool = JSON,
) -> None:
    """List the frames of the bus and its worst-case load."""
    from plant_sim.bench.progress import table_text
    from protocols.bus_load import BITRATES, bus_load, frame_rate, highest_rate, worst_bits
    from protocols.frames import DBC, bus_frames
    from protocols.two_clutches import write_dbc

    checked_rate(rate)
    path = dbc or DBC
    codecs = bus_frames(path, clutches)
    if write:
        write_dbc(path, clutches, write)
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
    if write:
        lines.append(f"wrote:   {write}")
    fits = [f"{bitrate // 1000} kbit/s" for bitrate, load in loads.items() if load < 1.0]
    verdict_text = f"{rate} Hz fits {' and '.join(fits) or 'no classic CAN bus'}"
    document = {"frames": rows[1:], "load": loads, "fits": fits, "wrote": str(write) if write else None}
    report(document, "\n".join(lines), verdict_text, True, json_output)


def benchmark(
    what: str = typer.Argument(
        "loop", help="loop: kernel, controller and closed loop; clutches: cost of 1 to 8; friction: friction models"
    ),
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
    elif what == "clutches":
        from plant_sim.bench.clutch_costs import clutch_costs, table

        with progress_bar("clutches", json_output) as progress:
            targets, document = clutch_costs(min(seconds, 24.0), progress)
        extra = table_text(table(document))
    else:
        raise InputError(f"benchmark {what!r} does not exist; known are clutches, friction, loop")
    rows = [Target.HEAD, *(target.row() for target in targets)]
    machine = f"machine: {platform.machine()}, Linux {platform.release()}, Python {platform.python_version()}"
    missed = [target.name for target in targets if not target.met]
    verdict_text = "all met" if not missed else f"not met: {', '.join(missed)}"
    if without := document.get("not_installed"):
        verdict_text += f"; not measured: {', '.join(without)}, not installed"
    report(document, "\n".join([machine, extra, "", table_text(rows)]), verdict_text, not missed, json_output)
