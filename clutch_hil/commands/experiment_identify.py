"""`clutch-hil experiment identify`: plays what identifies a clutch, until all is known that is wanted."""

import shlex
import time
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

import typer

from clutch_hil.command import report

if TYPE_CHECKING:
    from clutch_hil.bench.scenario import Scenario
    from clutch_hil.discrepancy.experiment_design import Experiment

_MARGIN = 1.0  # s between what telemetry keeps of the course before and the next one


def run_identify(courses: Iterator[Path], everything: bool, out: Path, json_output: bool) -> None:
    """Play `courses` and report: runs, what is reached, the command that comes next."""
    from clutch_hil.discrepancy.identification_set import play_until_reached
    from clutch_hil.live.catalogue import format_count

    played = play_until_reached(courses, everything, lambda line: None if json_output else typer.echo(line, err=True))
    command = shlex.join(["clutch-hil", "identify", *map(str, played.runs), "--out", str(out / "identified")])
    verdict = f"{format_count(len(played.runs), 'experiment')} recorded"
    if played.standings or played.open:
        if played.open:
            verdict += f"; not reached: {'; '.join(played.open)}"
        else:
            verdict += f"; every goal is reached, left out: {', '.join(played.left_out) or 'nothing'}"
    lines = [f"{'wrote:' if not i else '':<9}{path}" for i, path in enumerate(played.runs)]
    lines += [f"{'goals:' if not i else '':<9}{one}" for i, one in enumerate(played.standings)]
    document = {
        "runs": list(map(str, played.runs)), "left_out": list(played.left_out), "open": list(played.open),
        "goals": [
            {"name": s.goal.name, "limit": s.goal.limit, "unit": s.goal.unit, "half_width": s.worst, "reached": s.is_reached}
            for s in played.standings
        ],
        "next": command, "verdict": verdict,
    }  # fmt: skip
    report(document, "\n".join([*lines, f"next:    {command}"]), verdict, True, json_output)


def play_own_courses(
    plant: "Scenario", bus: str, lockstep: bool, blind: bool, out: Path, overwrite: bool, rate: int | None, quiet: bool
) -> Iterator[Path]:
    """Courses on a bench that is started for each of them, with the plant of a scenario."""
    from clutch_hil.discrepancy.identification_set import play_courses
    from clutch_hil.discrepancy.laboratory import OwnBench
    from plant_sim.rigs import wet_clutch

    bench = OwnBench(make_uncalibrated_scenario(plant), bus, lockstep, blind)

    def play(experiment: "Experiment", number: int) -> Path:
        _tell(experiment, number, quiet)
        return bench.play(experiment, number, quiet)

    contact = wet_clutch.load_nominal()["piston.contact_pressure"].value
    folder = _make_folder(out, overwrite)
    return play_courses(folder, rate or 1000, play, plant.plant["motor.torque_limit"].value, contact)


def make_uncalibrated_scenario(plant: "Scenario") -> "Scenario":
    """The scenario with a controller that compares torques less strictly, as nobody has calibrated it yet."""
    from clutch_hil.discrepancy.identification_set import MISMATCH, UNCALIBRATED

    controller = {**plant.settings.controller, MISMATCH: UNCALIBRATED}
    return replace(plant, settings=replace(plant.settings, controller=controller))


@contextmanager
def running_courses(bus: str, blind: bool, out: Path, overwrite: bool, quiet: bool) -> Iterator[Iterator[Path]]:
    """Courses on the bench that already runs. Its controller's comparison of torques is widened while entered."""
    from clutch_hil.discrepancy.identification_set import play_courses, widened_comparison
    from clutch_hil.discrepancy.laboratory import RunningBench
    from protocols.telemetry.publisher import HISTORY

    bench, folder = RunningBench(bus, out, blind), _make_folder(out, overwrite)
    ended = -HISTORY

    def play(experiment: "Experiment", number: int) -> Path:
        nonlocal ended
        _tell(experiment, number, quiet)
        # a run has all rows that telemetry keeps: those of the course before must be gone, as its model begins at rest
        time.sleep(max(0.0, ended + HISTORY + _MARGIN - experiment.seconds - time.monotonic()))
        path = bench.play(experiment, number, quiet)
        ended = time.monotonic()
        return path

    with widened_comparison(bus) as controller:
        yield play_courses(
            folder, 1000, play, controller["phases.motor_torque_limit"], controller["model.contact_pressure"]
        )


def _make_folder(out: Path, overwrite: bool) -> Path:
    """The folder, if no course in it is lost. Raises InputError."""
    from clutch_hil.bench.recording import make_writable
    from clutch_hil.discrepancy.identification_set import list_course_files
    from protocols.files.output_file import check_new_files

    check_new_files(out, list_course_files(), overwrite)
    return make_writable(out)


def _tell(experiment: "Experiment", number: int, quiet: bool) -> None:
    if not quiet:
        typer.echo(f"{number + 1}/6  {experiment.name} ({experiment.seconds:.1f} s): {experiment.title}", err=True)
