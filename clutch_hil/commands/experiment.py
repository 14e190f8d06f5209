"""`clutch-hil experiment`: play experiments on the live plant and record them; with --for, decide again on a report."""

import shlex
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import typer

from clutch_hil.command import report
from clutch_hil.commands.experiment_identify import (
    load_two_clutch_plant,
    play_own_courses,
    run_identify,
    run_shift_set,
    running_courses,
)
from clutch_hil.commands.options import BUS, CONTROLLER_PARAMETERS, JSON, LOCKSTEP, OUT, OVERWRITE
from protocols.errors import InputError, format_count

_IDENTIFY = "identify"  # name of the set that identifies a clutch

if TYPE_CHECKING:
    from clutch_hil.discrepancy.experiment_design import Experiment
    from clutch_hil.discrepancy.follow_up import Report
    from clutch_hil.discrepancy.laboratory import Laboratory

NAMES = typer.Argument(
    None,
    metavar="[EXPERIMENT]...",
    help="a profile, or PROFILE-TEMPERATURE such as crawl-45 (see --list); or identify: the set for `clutch-hil identify`",
)
HOLDOUT = typer.Option([], metavar="EXPERIMENT", help="experiment to hold out; may be given more than once")
FOR = typer.Option(None, "--for", help="report.json: play the experiment that it proposes, and run the search again")
MODEL = typer.Option(None, "--plant-parameters", help="TOML file that changes the plant under test")
DRAW = typer.Option(
    None,
    help="the plant under test has an effect drawn at random from the catalogue with this seed; implies --blind",
    min=0,
)


def register(app: typer.Typer) -> None:
    """Add the command."""
    app.command()(experiment)


def experiment(
    names: list[str] | None = NAMES,
    holdout: list[str] = HOLDOUT,
    for_report: Path | None = FOR,
    standard: bool = typer.Option(False, "--standard", help="the standard set: five experiments and two to hold out"),
    everything: bool = typer.Option(
        False, "--all", help="for identify: play every course, even if the goals are reached earlier"
    ),
    design: bool = typer.Option(
        False,
        "--design",
        help="for identify: after the first course, always design the shortest next one from what is known",
    ),
    list_all: bool = typer.Option(False, "--list", help="list the experiments"),
    bus: str = BUS,
    running: bool = typer.Option(
        False, "--running", help="play on the bench that already runs on the bus (started with --profile manual)"
    ),
    lockstep: bool = LOCKSTEP,
    rate: int | None = typer.Option(
        None, help="rate of samples and commands, in Hz; that of the experiment if not given"
    ),
    scenario: str | None = typer.Option(None, help="scenario whose plant, effects and injections are under test"),
    plant_parameters: Path | None = MODEL,
    controller_parameters: Path | None = CONTROLLER_PARAMETERS,
    draw: int | None = DRAW,
    seed: int = typer.Option(
        1, help="seed of the sensor noise of the first run; each further run uses the next number", min=0
    ),
    blind: bool = typer.Option(False, "--blind", help="keep the truth out of the run files, in separate sealed files"),
    out: Path = OUT,
    overwrite: bool = OVERWRITE,
    json_output: bool = JSON,
) -> None:
    """Play experiments on the live plant over CAN and record them; with --for, search again with the new run."""
    from clutch_hil.bench.progress import format_table
    from clutch_hil.command import check_rate
    from clutch_hil.discrepancy.laboratory import OwnBench, RunningBench, plant_under_test
    from clutch_hil.discrepancy.models.wet_clutch_experiments import HELD_OUT, LIBRARY, STANDARD, find

    if list_all:
        if given := [*(names or ()), *(["--standard"] if standard else []), *(["--for"] if for_report else [])]:
            raise InputError(f"--list and {given[0]} were both given; only one of them is allowed")
        rows = [(e.name, f"{e.seconds:.1f} s", e.title) for e in LIBRARY]
        text = format_table([("experiment", "length", "what"), *rows])
        report(
            [vars(e) for e in LIBRARY],
            text,
            f"{len(rows)} experiments; any other temperature is possible",
            True,
            json_output,
        )
        return
    if sum(map(bool, (names, for_report, standard))) != 1:
        raise InputError("experiment needs one of EXPERIMENT, --standard and --for; --list names the experiments")
    if holdout and not names:
        raise InputError(f"--holdout {holdout[0]} needs experiments given by name; leave it out")
    if rate is not None:
        check_rate(rate)
    if names and len(names) > 1 and _IDENTIFY in names:
        raise InputError(f"experiment {_IDENTIFY} is a whole set and is played alone; leave the others out")
    if names == [_IDENTIFY]:
        if holdout:
            raise InputError("experiment identify holds nothing out; leave --holdout out")
        if everything and design:
            raise InputError("--all plays the fixed set, --design a shorter one; only one of them is allowed")
        if running:
            _check_running(lockstep, rate, scenario, plant_parameters, controller_parameters, draw)
            with running_courses(bus, blind, out, overwrite, design, json_output) as courses:
                run_identify(courses, everything, design, out, json_output)
            return
        if draw is None and (
            of_two := load_two_clutch_plant(scenario, plant_parameters, seed, out, controller_parameters)
        ):
            of_two.rig.plant.check_blind(blind)
            if everything or design:
                option = "--all" if everything else "--design"
                raise InputError(
                    f"{option} is only for a rig with one clutch; the set for two clutches is always played completely"
                )
            run_shift_set(of_two, bus, lockstep, out, overwrite, rate, json_output)
            return
        with plant_under_test(scenario, plant_parameters, draw, seed, out, controller_parameters) as plant:
            hidden = blind or draw is not None
            courses = play_own_courses(plant, bus, lockstep, hidden, out, overwrite, rate, design, json_output)
            run_identify(courses, everything, design, out, json_output)
        return
    if everything or design:
        raise InputError(f"--{'all' if everything else 'design'} is only for the experiment identify; leave it out")
    follow_up: Report | None = None
    wanted: list[Experiment] = []
    held_out: list[Experiment] = []
    first = 0
    if for_report:
        from clutch_hil.discrepancy import follow_up as follow
        from clutch_hil.discrepancy.outcome import FILES
        from protocols.files.output_file import check_new_files

        follow_up = follow.Report.read(for_report)
        check_new_files(out, FILES, overwrite, [for_report, *follow_up.runs, *follow_up.held_out])
        wanted, first = [follow_up.experiment], len(follow_up.runs) + len(follow_up.held_out)
    elif standard:
        wanted, held_out = list(STANDARD.values()), list(HELD_OUT.values())
    else:
        wanted, held_out = [find(name, (_IDENTIFY,)) for name in names or ()], [find(name) for name in holdout]
    if running:
        _check_running(lockstep, rate, scenario, plant_parameters, controller_parameters, draw)
        laboratory = RunningBench(bus, out, blind)
        fitted = wanted + held_out if follow_up else _fit_all(laboratory, wanted + held_out)
        played = _play_all(laboratory, fitted, json_output, first)
    else:
        with plant_under_test(scenario, plant_parameters, draw, seed, out, controller_parameters) as plant:
            bench = OwnBench(plant, bus, lockstep, blind or draw is not None)
            fitted = wanted + held_out if follow_up else _fit_all(bench, wanted + held_out)
            played = _play_all(bench, [e.with_rate(rate) for e in fitted], json_output, first)
    if follow_up:
        _decide(follow_up, played[0], out, json_output)
        return
    runs, rest = played[: len(wanted)], played[len(wanted) :]
    words = ["clutch-hil", "discrepancy", *map(str, runs), *(["--holdout", *map(str, rest)] if rest else [])]
    command = shlex.join([*words, "--out", str(out / "report")])
    lines = [f"read:    {format_count(len(played), 'experiment')}: {', '.join(e.name for e in wanted + held_out)}"]
    lines += [f"{'wrote:' if not i else '':<9}{path}" for i, path in enumerate(played)]
    if shift := fitted[0].shift:
        lines.append(
            f"note:    each pressure is {shift:+.2f} bar from that of the experiment, because the controller expects"
            " another contact pressure"
        )
    lines += [f"next:    {command}"]
    verdict = f"{format_count(len(played), 'experiment')} recorded" + (
        f", {len(rest)} of them to hold out" if rest else ""
    )
    document = {
        "pressure_shift_bar": shift,
        "runs": list(map(str, runs)),
        "holdout": list(map(str, rest)),
        "next": command,
        "verdict": verdict,
    }
    report(document, "\n".join(lines), verdict, True, json_output)


def _check_running(
    lockstep: bool, rate: int | None, scenario: str | None, plant_parameters: Path | None,
    controller_parameters: Path | None, draw: int | None,
) -> None:  # fmt: skip
    """Raise InputError for an option whose value is given by a bench that already runs."""
    given = {
        "--lockstep": lockstep, "--rate": rate, "--scenario": scenario, "--plant-parameters": plant_parameters,
        "--controller-parameters": controller_parameters, "--draw": draw,
    }  # fmt: skip
    if odd := [name for name, value in given.items() if value not in (None, False)]:
        raise InputError(
            f"--running and {odd[0]} cannot be combined; a running bench has its own plant, controller and clock"
        )


def _fit_all(laboratory: "Laboratory", experiments: "Sequence[Experiment]") -> "list[Experiment]":
    """Return the experiments shifted to the contact pressure that the laboratory's controller expects. Raises InputError."""
    contact = laboratory.find_contact()
    fitted = [experiment.fit_to_contact(contact) for experiment in experiments]
    for experiment in fitted:
        experiment.load()  # check all before the first is played
    return fitted


def _play_all(laboratory: "Laboratory", experiments: "Sequence[Experiment]", quiet: bool, first: int) -> list[Path]:
    """Play `experiments`, numbered from `first` on; each number has its own noise. Return the run files."""
    paths: list[Path] = []
    for number, experiment in enumerate(experiments, first):
        if not quiet:
            line = f"{len(paths) + 1}/{len(experiments)}  {experiment.name} ({experiment.seconds:.1f} s): {experiment.title}"
            typer.echo(line, err=True)
        paths.append(laboratory.play(experiment, number, quiet))
    return paths


def _decide(before: "Report", run: Path, out: Path, json_output: bool) -> None:
    """Decide again with `run`, and report."""
    from clutch_hil.bench.progress import progress_bar
    from clutch_hil.discrepancy.follow_up import decide_again

    with progress_bar("decide again", json_output) as progress:
        decision, files = decide_again(before, run, out, progress, shlex.join(["clutch-hil", *sys.argv[1:]]))
    verdict = f"{decision}; before: {before.verdict}"
    lines = [
        f"read:    {before.path}, {len(before.runs) + len(before.held_out)} runs, experiment {before.experiment.name}"
    ]
    lines += [f"{'wrote:' if not i else '':<9}{path}" for i, path in enumerate((run, *files))]
    document = decision.result.as_json() | {"run": str(run), "wrote": list(map(str, files)), "before": before.verdict}
    report(document, "\n".join(lines), verdict, True, json_output)
