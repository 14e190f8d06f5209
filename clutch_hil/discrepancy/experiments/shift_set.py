"""Shift set: play the courses that identify a power-shift rig that is not calibrated, one after the other."""

from collections.abc import Callable, Iterator
from pathlib import Path

from clutch_hil.bench.run_file import read_run
from clutch_hil.discrepancy.experiment_design import Experiment
from clutch_hil.discrepancy.experiments.identification_set import CourseExperiment
from clutch_hil.identify.courses.clutch_courses import TORQUE_SHARE, Span
from clutch_hil.identify.courses.shift_courses import COURSES, SCALE, ShiftCourse, Spans, format_course
from clutch_hil.identify.two_clutches.power_shift import NEEDED, estimate_clutch_line
from plant_sim.profiles.shift_profile import load_shift_profile
from protocols.can.two_clutches import CLUTCHES
from protocols.files.parameters import ParameterSet

NAMES = ("scale", *COURSES)


class ShiftExperiment(CourseExperiment):
    """An experiment whose shift profile is a file."""

    @property
    def seconds(self) -> float:
        """Return the length of the experiment [s]."""
        return load_shift_profile(self.profile).duration


def list_shift_files() -> tuple[str, ...]:
    """Return the names of the profile files."""
    return tuple(f"identify_shift_{name}.csv" for name in NAMES)


def play_shift_courses(
    folder: Path, rate: int, play: Callable[[Experiment, int], Path], plant: ParameterSet
) -> Iterator[Path]:
    """Play the set, starting with the pressure scale of both clutches; yield each run file. Courses are written to `folder`.

    play(experiment, number) plays one experiment. plant: as declared; it gives the gears, the motor's limit, and the
    approximate contact pressures. Raises InputError where the first run shows no contact pressure.
    """
    one, two = (plant[f"driveline.ratio_{clutch}"].value for clutch in CLUTCHES)

    def course(name: str, make: Callable[[Spans], ShiftCourse], spans: Spans, temperature: float) -> Experiment:
        path, made = folder / f"identify_shift_{name}.csv", make(spans)
        path.write_text(format_course(made.title, made.rows), encoding="utf-8")
        return ShiftExperiment(str(path), temperature, rate)

    begin = Spans({c: Span(plant[f"{c}.piston.contact_pressure"].value) for c in CLUTCHES}, (one, two))
    first = play(course("scale", SCALE[0], begin, SCALE[1]), 0)
    yield first
    columns = read_run(first, NEEDED).columns
    limit = TORQUE_SHARE * plant["motor.torque_limit"].value
    spans = Spans({c: Span.of_line(*estimate_clutch_line(columns, c), limit) for c in CLUTCHES}, (one, two))
    for number, (name, (make, temperature)) in enumerate(COURSES.items(), 1):
        yield play(course(name, make, spans, temperature), number)
