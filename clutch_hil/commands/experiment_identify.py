"""`clutch-hil experiment identify`: play the experiments that identify a clutch, until the goals are reached."""

import shlex
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

import typer

from clutch_hil.command import report
from protocols.errors import InputError
from protocols.files.parameters import CONTROLLER, list_changed

if TYPE_CHECKING:
    from clutch_hil.bench.scenario import Scenario
    from clutch_hil.bench.settings import RunSettings
    from clutch_hil.discrepancy.experiment_design import Experiment
    from clutch_hil.discrepancy.experiments.identification_set import BorrowedController, CourseBench, Courses
    from clutch_hil.fitting.model import Values

_MARGIN = 1.0  # s between the last row of the previous course that telemetry keeps and the next course


def run_identify(courses: "Courses", everything: bool, design: bool, out: Path, json_output: bool) -> None:
    """Play `courses` and report the runs, the reached goals, and the next command."""
    from clutch_hil.discrepancy.experiments.identification_set import play_until_reached
    from protocols.errors import format_count

    played = play_until_reached(courses, everything, _make_printer(json_output))
    command = shlex.join(["clutch-hil", "identify", *map(str, played.runs), "--out", str(out / "identified")])
    verdict = f"{format_count(len(played.runs), 'experiment')} recorded"
    if played.standings or played.open:
        if played.open:
            verdict += f"; not reached: {'; '.join(played.open)}"
        else:
            verdict += "; every goal is reached"
            verdict += "" if design else f", left out: {', '.join(played.left_out) or 'nothing'}"
    lines = [f"{'wrote:' if not i else '':<9}{path}" for i, path in enumerate(played.runs)]
    lines += [f"{'goals:' if not i else '':<9}{one}" for i, one in enumerate(played.standings)]
    document = {
        "runs": list(map(str, played.runs)), "left_out": [] if design else list(played.left_out), "open": list(played.open),
        "goals": [
            {"name": s.goal.name, "limit": s.goal.limit, "unit": s.goal.unit, "half_width": s.worst, "reached": s.is_reached}
            for s in played.standings
        ],
        "next": command, "verdict": verdict,
    }  # fmt: skip
    report(document, "\n".join([*lines, f"next:    {command}"]), verdict, True, json_output)


class _OwnBench:
    """Bench that is started for each course, with the plant of a scenario; see `CourseBench`."""

    def __init__(self, plant: "Scenario", bus: str, lockstep: bool, blind: bool, rate: int | None, quiet: bool) -> None:
        from clutch_hil.bench.judgement.calibration_check import CONTACT
        from clutch_hil.bench.judgement.other_rig import describe_other_rig
        from clutch_hil.discrepancy.experiments.identification_set import MISMATCH, UNCALIBRATED
        from clutch_hil.discrepancy.experiments.laboratory import OwnBench

        given = plant.settings.make_controller().parameters
        plant = replace(plant, settings=_take_controller_file(plant.settings))
        self._bench, self._quiet = OwnBench(plant, bus, lockstep, blind), quiet
        self.rate = rate or 1000
        self.motor_torque = plant.plant["motor.torque_limit"].value
        self.contact = given[CONTACT].value
        self.other_rig = describe_other_rig(given.as_values(), plant.plant.as_values()) or ""
        self.tell_controller({MISMATCH: UNCALIBRATED})

    def play(self, experiment: "Experiment", number: int) -> Path:
        """See `CourseBench`."""
        _tell(experiment, number, self._quiet)
        return self._bench.play(experiment, number, self._quiet)

    def tell_controller(self, values: "Values") -> None:
        """See `CourseBench`: controllers started from now on have these parameters."""
        scenario = self._bench.scenario
        settings = replace(scenario.settings, controller={**scenario.settings.controller, **values})
        self._bench = replace(self._bench, scenario=replace(scenario, settings=settings))


def _take_controller_file(settings: "RunSettings") -> "RunSettings":
    """Return settings with the parameters of the controller's file as values that later ones override. Raises InputError."""
    path = settings.controller_parameters
    if not path:
        return settings
    parameters = settings.make_controller().parameters
    in_file = {name: parameters[name].value for name in list_changed(path, CONTROLLER)}
    return replace(settings, controller={**settings.controller, **in_file}, controller_parameters=None)


class _RunningBench:
    """The bench that runs on a bus, and its borrowed controller; see `CourseBench`."""

    rate = 1000
    other_rig = ""  # the rig may be a real one

    def __init__(self, bus: str, blind: bool, out: Path, controller: "BorrowedController", quiet: bool) -> None:
        from clutch_hil.discrepancy.experiments.laboratory import RunningBench
        from protocols.telemetry.publisher import HISTORY

        self._bench, self._quiet, self._history = RunningBench(bus, out, blind), quiet, HISTORY
        self.motor_torque = controller.values["phases.motor_torque_limit"]
        self.contact = controller.values["model.contact_pressure"]
        self.tell_controller = controller.set
        self._ended = -HISTORY

    def play(self, experiment: "Experiment", number: int) -> Path:
        """See `CourseBench`."""
        _tell(experiment, number, self._quiet)
        # a run has all rows that telemetry keeps: those of the previous course must have expired: the model begins at rest
        time.sleep(max(0.0, self._ended + self._history + _MARGIN - experiment.seconds - time.monotonic()))
        path = self._bench.play(experiment, number, self._quiet)
        self._ended = time.monotonic()
        return path


def play_own_courses(
    plant: "Scenario", bus: str, lockstep: bool, blind: bool, out: Path, overwrite: bool, rate: int | None, design: bool,
    quiet: bool,
) -> "Courses":  # fmt: skip
    """Return courses on a bench started for each of them, with the plant of a scenario; with `design`, designed courses."""
    bench = _OwnBench(plant, bus, lockstep, blind, rate, quiet)
    return _play_courses(_make_folder(out, overwrite), bench, design, quiet)


def load_two_clutch_plant(
    scenario: str | None, changed: Path | None, seed: int, out: Path, controller: Path | None
) -> "Scenario | None":
    """Return the plant under test if it belongs to a scenario with two clutches; None for one clutch. Raises InputError."""
    from clutch_hil.bench.scenario import load_scenario

    given = {"plant_parameters": changed, "seed": seed, "out": out, "controller_parameters": controller}
    plant = load_scenario(scenario, given) if scenario else None
    return plant if plant is not None and plant.rig.plant.clutches else None


def run_shift_set(
    plant: "Scenario", bus: str, lockstep: bool, out: Path, overwrite: bool, rate: int | None, json_output: bool
) -> None:
    """Play the set of a power-shift rig, and report the runs and the next command."""
    from clutch_hil.bench.recording import make_writable
    from clutch_hil.discrepancy.experiments.identification_set import MISMATCH, UNCALIBRATED
    from clutch_hil.discrepancy.experiments.laboratory import OwnBench
    from clutch_hil.discrepancy.experiments.shift_set import NAMES, list_shift_files, play_shift_courses
    from protocols.errors import format_count
    from protocols.files.output_file import check_new_files

    check_new_files(out, list_shift_files(), overwrite)
    controller = {**plant.settings.controller, MISMATCH: UNCALIBRATED}
    settings = replace(plant.settings, controller=controller)
    bench = OwnBench(replace(plant, settings=settings), bus, lockstep)

    def play(experiment: "Experiment", number: int) -> Path:
        _tell(experiment, number, json_output, f"/{len(NAMES)}")
        return bench.play(experiment, number, json_output)

    runs = list(play_shift_courses(make_writable(out), rate or 1000, play, plant.rig.plant.load_parameters()))
    command = shlex.join(["clutch-hil", "identify", *map(str, runs), "--out", str(out / "identified")])
    verdict = f"{format_count(len(runs), 'experiment')} recorded"
    lines = [f"{'wrote:' if not i else '':<9}{path}" for i, path in enumerate(runs)]
    document = {"runs": list(map(str, runs)), "next": command, "verdict": verdict}
    report(document, "\n".join([*lines, f"next:    {command}"]), verdict, True, json_output)


@contextmanager
def running_courses(
    bus: str, blind: bool, out: Path, overwrite: bool, design: bool, quiet: bool
) -> Iterator["Courses"]:
    """Yield courses on the bench that already runs. The parameters of its controller are restored at the end."""
    from clutch_hil.discrepancy.experiments.identification_set import MISMATCH, UNCALIBRATED, borrowed_controller

    with borrowed_controller(bus) as controller:
        bench = _RunningBench(bus, blind, out, controller, quiet)
        courses = _play_courses(_make_folder(out, overwrite), bench, design, quiet)
        controller.set({MISMATCH: max(UNCALIBRATED, controller.values[MISMATCH])})
        yield courses


def _play_courses(folder: Path, bench: "CourseBench", design: bool, quiet: bool) -> "Courses":
    from clutch_hil.discrepancy.experiments.identification_set import play_courses, play_designed
    from clutch_hil.identify.identification import identify_clutch

    if not design:
        return play_courses(folder, bench)
    return play_designed(folder, bench, lambda runs: identify_clutch(runs), _make_printer(quiet))


def _make_printer(quiet: bool) -> "Callable[[str], None]":
    return lambda line: None if quiet else typer.echo(line, err=True)


def _make_folder(out: Path, overwrite: bool) -> Path:
    """Return the folder if no course in it would be lost. Raises InputError."""
    from clutch_hil.bench.recording import make_writable
    from clutch_hil.discrepancy.experiments.identification_set import list_course_files
    from protocols.files.output_file import check_new_files

    earlier = [name for name in list_course_files() if (out / name).exists()]
    if earlier and not overwrite:
        raise InputError(
            f"{out} has profiles of an earlier set: {earlier[0]} exists already; give another folder by --out, or --overwrite"
            " to replace the profiles; the runs recorded with them stay"
        )
    check_new_files(out, list_course_files(), overwrite)
    return make_writable(out)


def _tell(experiment: "Experiment", number: int, quiet: bool, of: str = "") -> None:
    if not quiet:
        typer.echo(f"{number + 1}{of}  {experiment.name} ({experiment.seconds:.1f} s): {experiment.title}", err=True)
