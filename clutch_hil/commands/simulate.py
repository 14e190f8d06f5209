"""`clutch-hil simulate`: simulate plant and controller in one process: a run, several scenarios, or a sweep."""

from pathlib import Path

import typer

from clutch_hil.command import report
from clutch_hil.commands.options import (
    ADAPTATION,
    BLIND,
    CALIBRATION,
    CONTROLLER_PARAMETERS,
    JSON,
    JUNIT,
    LAW,
    OUT,
    OVERWRITE,
    PLANT_PARAMETERS,
    RATE,
    SECONDS,
    SEED,
    TEMPERATURE,
    take_calibration,
)
from protocols.errors import InputError

PROFILE = typer.Option(None, help="name of a profile, or a CSV file; engagement if not given")


def register(app: typer.Typer) -> None:
    """Add the command."""
    app.command()(simulate)


def simulate(
    names: list[str] | None = typer.Argument(
        None, metavar="[SCENARIO]...", help="names of scenarios, or their files; options override them"
    ),
    every: bool = typer.Option(False, "--all", help="simulate every scenario that is shipped with the bench"),
    rate: int | None = RATE,
    profile: str | None = PROFILE,
    seconds: float | None = SECONDS,
    calibration: Path | None = CALIBRATION,
    plant_parameters: Path | None = PLANT_PARAMETERS,
    controller_parameters: Path | None = CONTROLLER_PARAMETERS,
    seed: int | None = SEED,
    seeds: int = typer.Option(1, help="number of seeds; more than one is a sweep"),
    vary: str | None = typer.Option(None, help="plant parameter to sweep, NAME=LOW:HIGH:COUNT"),
    workers: int | None = typer.Option(None, help="processes of a sweep; one per CPU if not given"),
    dask: str | None = typer.Option(None, help="Dask scheduler for a sweep, such as tcp://host:8786"),
    temperature: float | None = TEMPERATURE,
    law: str | None = LAW,
    adaptation: bool | None = ADAPTATION,
    blind: bool = BLIND,
    junit: Path | None = JUNIT,
    overwrite: bool = OVERWRITE,
    out: Path = OUT,
    json_output: bool = JSON,
) -> None:
    """Run plant and controller in one process: a scenario or a profile, several scenarios, or a sweep."""
    from clutch_hil.bench.arguments import take_whole
    from clutch_hil.bench.junit import check_junit
    from clutch_hil.bench.progress import progress_bar
    from clutch_hil.bench.recording import writable_folder
    from clutch_hil.bench.scenario import choose_scenario, find_shipped_scenarios
    from clutch_hil.bench.settings import select_settings
    from clutch_hil.bench.simulate import Simulation
    from clutch_hil.bench.suite import run_one, run_suite
    from clutch_hil.bench.sweeps.sampling import MOST_SAMPLES
    from clutch_hil.bench.sweeps.sweep import sweep_to_csv

    plant_parameters, controller_parameters = take_calibration(calibration, plant_parameters, controller_parameters)
    if every and names:
        raise InputError(f"{names[0]!r} and --all were both given; only one of them is allowed")
    given = select_settings(locals())
    wanted = find_shipped_scenarios() if every else names or ()
    chosen = [choose_scenario(name, given) for name in wanted] or [choose_scenario(None, given)]
    swept = take_whole("--seeds", seeds, 1, MOST_SAMPLES) > 1 or vary is not None
    if swept and (len(chosen) > 1 or blind or junit):
        other = "--blind" if blind else "--junit" if junit else f"{len(chosen)} scenarios"
        raise InputError(f"a sweep (--seeds, --vary) cannot be combined with {other}")
    if not swept and (workers is not None or dask):
        raise InputError(
            f"{'--dask' if workers is None else '--workers'} is only for a sweep; --seeds or --vary starts one"
        )
    check_junit(junit, overwrite, chosen)
    with writable_folder(out), progress_bar("simulate", json_output) as progress:
        if swept:
            result = sweep_to_csv(chosen[0], given, vary, seeds, progress, workers, dask)
        elif len(chosen) == 1:
            single = Simulation(chosen[0], blind)
            result = run_one(single.label, lambda: single.run(progress), junit)
        else:
            result = run_suite([Simulation(scenario, blind) for scenario in chosen], progress, junit)
    report(result.document, result.text, result.verdict, result.good, json_output)
