"""`clutch-hil experiment`: play experiments on the live plant and record them; with --for, decide again on a report."""

import shlex
import sys
from collections.abc import Iterator, Sequence
from contextlib import AbstractContextManager, contextmanager
from dataclasses import dataclass
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
    from clutch_hil.bench.scenario import Scenario
    from clutch_hil.discrepancy.experiment_design import Experiment
    from clutch_hil.discrepancy.experiments.follow_up import Report
    from clutch_hil.discrepancy.experiments.laboratory import Laboratory

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
    from clutch_hil.command import check_rate

    if list_all:
        if given := [*(names or ()), *(["--standard"] if standard else []), *(["--for"] if for_report else [])]:
            raise InputError(f"--list and {given[0]} were both given; only one of them is allowed")
        _list_experiments(json_output)
        return
    if sum(map(bool, (names, for_report, standard))) != 1:
        raise InputError("experiment needs one of EXPERIMENT, --standard and --for; --list names the experiments")
    if holdout and not names:
        raise InputError(f"--holdout {holdout[0]} needs experiments given by name; leave it out")
    if rate is not None:
        check_rate(rate)
    bench = _Bench(
        bus, running, lockstep, rate, scenario, plant_parameters, controller_parameters, draw, seed, blind, out, overwrite,
        json_output,
    )  # fmt: skip
    if running:
        bench.check_running()
    if names and _IDENTIFY in names:
        if len(names) > 1:
            raise InputError(f"experiment {_IDENTIFY} is a whole set and is played alone; leave the others out")
        if holdout:
            raise InputError("experiment identify holds nothing out; leave --holdout out")
        _play_identification_set(bench, everything, design)
    elif everything or design:
        raise InputError(f"--{'all' if everything else 'design'} is only for the experiment identify; leave it out")
    elif for_report:
        _play_proposed(bench, for_report)
    else:
        _play_chosen(bench, *_choose_experiments(names or (), holdout))


@dataclass(frozen=True)
class _Bench:
    """Where experiments are played: the options for bench and plant under test, as given on the command line."""

    bus: str
    running: bool
    lockstep: bool
    rate: int | None
    scenario: str | None
    plant_parameters: Path | None
    controller_parameters: Path | None
    draw: int | None
    seed: int
    blind: bool
    out: Path
    overwrite: bool
    json_output: bool

    @property
    def is_hidden(self) -> bool:
        """Return whether the truth is kept out of the run files."""
        return self.blind or self.draw is not None

    def check_running(self) -> None:
        """Raise InputError for an option whose value is given by a bench that already runs."""
        given = {
            "--lockstep": self.lockstep, "--rate": self.rate, "--scenario": self.scenario,
            "--plant-parameters": self.plant_parameters, "--controller-parameters": self.controller_parameters,
            "--draw": self.draw,
        }  # fmt: skip
        if odd := [name for name, value in given.items() if value not in (None, False)]:
            raise InputError(
                f"--running and {odd[0]} cannot be combined; a running bench has its own plant, controller and clock"
            )

    def open_plant(self) -> "AbstractContextManager[Scenario]":
        """Return the plant under test, see `plant_under_test`."""
        from clutch_hil.discrepancy.experiments.laboratory import plant_under_test

        return plant_under_test(
            self.scenario, self.plant_parameters, self.draw, self.seed, self.out, self.controller_parameters
        )

    @contextmanager
    def open_laboratory(self) -> "Iterator[Laboratory]":
        """Yield the laboratory that plays single experiments. Raises InputError."""
        from clutch_hil.discrepancy.experiments.laboratory import OwnBench, RunningBench

        if self.running:
            yield RunningBench(self.bus, self.out, self.blind)
            return
        with self.open_plant() as plant:
            yield OwnBench(plant, self.bus, self.lockstep, self.is_hidden)


def _list_experiments(json_output: bool) -> None:
    from clutch_hil.bench.progress import format_table
    from clutch_hil.discrepancy.models.wet_clutch_experiments import LIBRARY

    rows = [(e.name, f"{e.seconds:.1f} s", e.title) for e in LIBRARY]
    text = format_table([("experiment", "length", "what"), *rows])
    verdict = f"{len(rows)} experiments; any other temperature is possible"
    report([vars(e) for e in LIBRARY], text, verdict, True, json_output)


def _play_identification_set(bench: _Bench, everything: bool, design: bool) -> None:
    """Play the set that identifies a clutch, or the two clutches of a scenario. Raises InputError."""
    if everything and design:
        raise InputError("--all plays the fixed set, --design a shorter one; only one of them is allowed")
    b = bench
    if b.running:
        with running_courses(b.bus, b.blind, b.out, b.overwrite, design, b.json_output) as courses:
            run_identify(courses, everything, design, b.out, b.json_output)
        return
    if b.draw is None and (
        of_two := load_two_clutch_plant(b.scenario, b.plant_parameters, b.seed, b.out, b.controller_parameters)
    ):
        of_two.rig.plant.check_blind(b.blind)
        if everything or design:
            option = "--all" if everything else "--design"
            raise InputError(
                f"{option} is only for a rig with one clutch; the set for two clutches is always played completely"
            )
        run_shift_set(of_two, b.bus, b.lockstep, b.out, b.overwrite, b.rate, b.json_output)
        return
    with b.open_plant() as plant:
        courses = play_own_courses(
            plant, b.bus, b.lockstep, b.is_hidden, b.out, b.overwrite, b.rate, design, b.json_output
        )
        run_identify(courses, everything, design, b.out, b.json_output)


def _choose_experiments(names: Sequence[str], holdout: Sequence[str]) -> "tuple[list[Experiment], list[Experiment]]":
    """Return the named experiments and those to hold out; without names, the standard set. Raises InputError."""
    from clutch_hil.discrepancy.models.wet_clutch_experiments import HELD_OUT, STANDARD, find

    if not names:
        return list(STANDARD.values()), list(HELD_OUT.values())
    return [find(name, (_IDENTIFY,)) for name in names], [find(name) for name in holdout]


def _play_proposed(bench: _Bench, for_report: Path) -> None:
    """Play the experiment that a report proposes, and search again with it. Raises InputError."""
    from clutch_hil.discrepancy.experiments.follow_up import Report
    from clutch_hil.discrepancy.outcome import FILES
    from protocols.files.output_file import check_new_files

    before = Report.read(for_report)
    check_new_files(bench.out, FILES, bench.overwrite, [for_report, *before.runs, *before.held_out])
    with bench.open_laboratory() as laboratory:
        experiment = before.experiment.with_rate(bench.rate)
        number = len(before.runs) + len(before.held_out)
        (run,) = _play_all(laboratory, [experiment], bench.json_output, number)
    _decide(before, run, bench.out, bench.json_output)


def _play_chosen(bench: _Bench, wanted: "Sequence[Experiment]", held_out: "Sequence[Experiment]") -> None:
    """Play experiments, and report the runs and the next command. Raises InputError."""
    with bench.open_laboratory() as laboratory:
        fitted = _fit_all(laboratory, [*wanted, *held_out])
        played = _play_all(laboratory, [e.with_rate(bench.rate) for e in fitted], bench.json_output, 0)
    runs, rest = played[: len(wanted)], played[len(wanted) :]
    words = ["clutch-hil", "discrepancy", *map(str, runs), *(["--holdout", *map(str, rest)] if rest else [])]
    command = shlex.join([*words, "--out", str(bench.out / "report")])
    lines = [f"read:    {format_count(len(played), 'experiment')}: {', '.join(e.name for e in fitted)}"]
    lines += [f"{'wrote:' if not i else '':<9}{path}" for i, path in enumerate(played)]
    if shift := fitted[0].shift:
        lines.append(
            f"note:    each pressure is {shift:+.2f} bar from that of the experiment, because the controller expects"
            " another contact pressure"
        )
    lines += [f"next:    {command}"]
    verdict = f"{format_count(len(played), 'experiment')} recorded"
    verdict += f", {len(rest)} of them to hold out" if rest else ""
    document = {
        "pressure_shift_bar": shift, "runs": list(map(str, runs)), "holdout": list(map(str, rest)), "next": command,
        "verdict": verdict,
    }  # fmt: skip
    report(document, "\n".join(lines), verdict, True, bench.json_output)


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
    from clutch_hil.discrepancy.experiments.follow_up import decide_again

    with progress_bar("decide again", json_output) as progress:
        decision, files = decide_again(before, run, out, progress, shlex.join(["clutch-hil", *sys.argv[1:]]))
    verdict = f"{decision}; before: {before.verdict}"
    lines = [
        f"read:    {before.path}, {len(before.runs) + len(before.held_out)} runs, experiment {before.experiment.name}"
    ]
    lines += [f"{'wrote:' if not i else '':<9}{path}" for i, path in enumerate((run, *files))]
    document = decision.result.as_json() | {"run": str(run), "wrote": list(map(str, files)), "before": before.verdict}
    report(document, "\n".join(lines), verdict, True, json_output)
