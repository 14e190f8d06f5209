"""`clutch-hil up`: start a bench, play a scenario or a profile on it, and record, judge and draw the run."""

from pathlib import Path

import typer

from clutch_hil.command import report
from clutch_hil.commands.options import (
    ADAPTATION,
    BLIND,
    BUS,
    CALIBRATION,
    CONTROLLER_PARAMETERS,
    JSON,
    JUNIT,
    LAW,
    LOCKSTEP,
    OUT,
    OVERWRITE,
    PLANT_PARAMETERS,
    PUBLISH_ROUTER,
    RATE,
    SECONDS,
    SEED,
    TEMPERATURE,
    take_calibration,
)
from protocols.errors import InputError

PROFILE_OR_MANUAL = typer.Option(
    None,
    help="name of a profile, a CSV file, or manual: the demand comes from `clutch-hil demand` or `panel`;"
    " engagement if not given",
)


def register(app: typer.Typer) -> None:
    """Add the command."""
    app.command()(up)


def up(
    scenario: str | None = typer.Argument(None, help="name of a scenario, or its file; options override it"),
    bus: str = BUS,
    rate: int | None = RATE,
    profile: str | None = PROFILE_OR_MANUAL,
    seconds: float | None = SECONDS,
    lockstep: bool = LOCKSTEP,
    plant_parameters: Path | None = PLANT_PARAMETERS,
    controller_parameters: Path | None = CONTROLLER_PARAMETERS,
    calibration: Path | None = CALIBRATION,
    seed: int | None = SEED,
    temperature: float | None = TEMPERATURE,
    law: str | None = LAW,
    adaptation: bool | None = ADAPTATION,
    view: bool = typer.Option(False, "--view", help="show it in rerun's viewer, as `clutch-hil view` does"),
    web: bool = typer.Option(False, "--web", help="show it in a browser"),
    telemetry: bool = typer.Option(True, help="publish every cycle over zenoh"),
    router: str | None = PUBLISH_ROUTER,
    trigger: str | None = typer.Option(None, help="what starts a control cycle: clock (if not given), bus or pll"),
    spin_us: float | None = typer.Option(None, help="longest busy wait of the controller before a cycle, in us"),
    blind: bool = BLIND,
    junit: Path | None = JUNIT,
    overwrite: bool = OVERWRITE,
    out: Path = OUT,
    json_output: bool = JSON,
) -> None:
    """Start plant and controller, play a scenario or a profile, record, judge, draw."""
    from clutch_hil.bench.junit import check_junit
    from clutch_hil.bench.recording import writable_folder
    from clutch_hil.bench.scenario import choose_scenario
    from clutch_hil.bench.settings import select_settings
    from clutch_hil.bench.suite import run_one
    from clutch_hil.bench.up import Bench
    from protocols.realtime.waiting import check_spin
    from rt_controller.loop.trigger import find_trigger

    plant_parameters, controller_parameters = take_calibration(calibration, plant_parameters, controller_parameters)
    given = select_settings(locals())
    chosen = choose_scenario(scenario, given)
    check_junit(junit, overwrite, [chosen])
    if (view or web) and not telemetry:
        raise InputError("a viewer and --no-telemetry were both given; only one of them is allowed")
    find_trigger(trigger or "clock")
    check_spin(spin_us or 0.0)
    viewer = ["--web"] if web else [] if view else None
    pace = ["--trigger", trigger] if trigger else []
    pace += ["--spin-us", str(spin_us)] if spin_us is not None else []
    live = Bench(chosen, bus, lockstep, telemetry, router, viewer, blind, pace)
    with writable_folder(out):
        result = run_one(live.label, lambda: live.run(quiet=json_output), junit)
    report(result.document, result.text, result.verdict, result.good, json_output)
