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


def own_courses(
    plant: "Scenario", bus: str, lockstep: bool, blind: bool, out: Path, overwrite: bool, rate: int | None, quiet: bool
) -> Iterator[Path]:
    """Courses on a bench that is started for each of them, with the plant of a scenario."""
    from clutch_hil.discrepancy.identification_set import play_courses
    from clutch_hil.discrepancy.laboratory import OwnBench
    from plant_sim.rigs import wet_clutch

    bench = OwnBench(uncalibrated(plant), bus, lockstep, blind)

    def play(experiment: "Experiment", number: int) -> Path:
        _tell(experiment, number, quiet)
        return bench.play(experiment, number, quiet)

    contact = wet_clutch.nominal()["piston.contact_pressure"].value
    folder = _new_folder(out, overwrite)
    return play_courses(folder, rate or 1000, play, plant.plant["motor.torque_limit"].value, contact)


def uncalibrated(plant: "Scenario") -> "Scenario":
    """The scenario with a controller that compares torques less strictly, as nobody has calibrated it yet."""
    from clutch_hil.discrepancy.identification_set import MISMATCH, UNCALIBRATED

    controller = {**plant.settings.controller, MISMATCH: UNCALIBRATED}
    return replace(plant, settings=replace(plant.settings, controller=controller))


def two_clutch_plant(scenario: str | None, changed: Path | None, seed: int, out: Path) -> "Scenario | None":
    """The plant under test where it is that of a scenario of two clutches; None where it has one. Raises InputError."""
    from clutch_hil.bench.scenario import load_scenario

    plant = load_scenario(scenario, {"plant_parameters": changed, "seed": seed, "out": out}) if scenario else None
    return plant if plant is not None and plant.rig.plant.clutches else None


def run_shift_set(
    plant: "Scenario", bus: str, lockstep: bool, out: Path, overwrite: bool, rate: int | None, json_output: bool
) -> None:
    """Play the set of a power-shift rig, and report: runs, the command that comes next."""
    from clutch_hil.bench.recording import make_writable
    from clutch_hil.discrepancy.laboratory import OwnBench
    from clutch_hil.discrepancy.shift_set import NAMES, play_shift_courses, shift_files
    from clutch_hil.live.catalogue import format_count
    from protocols.files.output_file import new_files

    new_files(out, shift_files(), overwrite)
    bench = OwnBench(uncalibrated(plant), bus, lockstep)

    def play(experiment: "Experiment", number: int) -> Path:
        _tell(experiment, number, json_output, len(NAMES))
        return bench.play(experiment, number, json_output)

    runs = list(play_shift_courses(make_writable(out), rate or 1000, play, plant.rig.plant.nominal(None)))
    command = shlex.join(["clutch-hil", "identify", *map(str, runs), "--out", str(out / "identified")])
    verdict = f"{format_count(len(runs), 'experiment')} recorded"
    lines = [f"{'wrote:' if not i else '':<9}{path}" for i, path in enumerate(runs)]
    document = {"runs": list(map(str, runs)), "next": command, "verdict": verdict}
    report(document, "\n".join([*lines, f"next:    {command}"]), verdict, True, json_output)


@contextmanager
def running_courses(bus: str, blind: bool, out: Path, overwrite: bool, quiet: bool) -> Iterator[Iterator[Path]]:
    """Courses on the bench that already runs. Its controller's comparison of torques is widened while entered."""
    from clutch_hil.discrepancy.identification_set import play_courses, widened_comparison
    from clutch_hil.discrepancy.laboratory import RunningBench
    from protocols.telemetry.publisher import HISTORY

    bench, folder = RunningBench(bus, out, blind), _new_folder(out, overwrite)
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


def _new_folder(out: Path, overwrite: bool) -> Path:
    """The folder, if no course in it is lost. Raises InputError."""
    from clutch_hil.bench.recording import make_writable
    from clutch_hil.discrepancy.identification_set import course_files
    from protocols.files.output_file import new_files

    new_files(out, course_files(), overwrite)
    return make_writable(out)


def _tell(experiment: "Experiment", number: int, quiet: bool, count: int = 6) -> None:
    if not quiet:
        typer.echo(
            f"{number + 1}/{count}  {experiment.name} ({experiment.seconds:.1f} s): {experiment.title}", err=True
        )
