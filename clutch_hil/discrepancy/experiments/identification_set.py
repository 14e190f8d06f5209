"""Identification set: the courses that identify a clutch, played one after the other until the goals are reached."""

from collections.abc import Callable, Generator, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Protocol

from clutch_hil.bench.experiments import Course
from clutch_hil.bench.judgement.calibration_check import EXPECTED, SLOW_VALVE
from clutch_hil.bench.run_file import read_run
from clutch_hil.discrepancy.experiment_design import Experiment
from clutch_hil.discrepancy.experiments.identification_design import design_experiment
from clutch_hil.discrepancy.experiments.laboratory import FaultError
from clutch_hil.fitting.model import Values
from clutch_hil.identify.clutch_effects import estimate_line
from clutch_hil.identify.controller_values import derive_pressures
from clutch_hil.identify.courses.clutch_courses import COURSES, SCALE, TORQUE_SHARE, Span, write_course
from clutch_hil.identify.goals import Progress, Standing
from clutch_hil.identify.identification import Identification, identify_clutch
from clutch_hil.identify.stepwise import estimate_valve_gain, take_samples
from clutch_hil.live.tuning.tune import request_parameters, set_parameters
from plant_sim.rigs import wet_clutch
from protocols.buses.bus import resolve
from protocols.errors import InputError, InterruptionError, join_names
from protocols.files.parameters import CONTROLLER
from protocols.node import load_node
from protocols.telemetry.feed import find_bench
from protocols.telemetry.session import open_consumer_session

# The two most informative courses come first, for an early end: together they excite all goals but the heat balance
ORDER = ("stribeck", "dynamics", "fills", "staircase", "heating")
MISMATCH = "phases.torque_mismatch"  # the controller's check of the motor's torque against its estimate, ...
MOST_DESIGNED = 6  # largest number of designed experiments: 2 or 3 are usual
UNCALIBRATED = 60.0  # Nm: ... widened because the controller is not calibrated yet. The guard's limits stay


@dataclass(frozen=True)
class CourseExperiment(Experiment):
    """An experiment whose profile is a file."""

    @property
    def name(self) -> str:
        """Return the name of the file."""
        return Path(self.profile).stem

    @property
    def title(self) -> str:
        """Return the first line of the file."""
        return Path(self.profile).read_text(encoding="utf-8").partition("\n")[0].lstrip("# ").rstrip(".")


def list_course_files() -> tuple[str, ...]:
    """Return the names of the profile files that may be written."""
    return tuple(map(_name_course_file, ("scale", *ORDER, *(f"design_{k}" for k in range(1, MOST_DESIGNED + 1)))))


def _name_course_file(name: str) -> str:
    return f"identify_{name}.csv"


# Generator of run files; it receives the identification of the runs so far, or None without one
Courses = Generator[Path, Identification | None, None]


class CourseBench(Protocol):
    """Interface of a bench that plays courses, with a clutch that is not calibrated."""

    @property
    def motor_torque(self) -> float:
        """Return the limit of the motor's torque [Nm]."""
        ...

    @property
    def contact(self) -> float:
        """Return the approximate contact pressure [bar]."""
        ...

    @property
    def other_rig(self) -> str:
        """Return a sentence if the controller was told another rig than a simulated one; "" otherwise, and if it is unknown."""
        ...

    @property
    def rate(self) -> int:
        """Return the rate of samples and commands [Hz]."""
        ...

    def play(self, experiment: Experiment, number: int) -> Path:
        """Play an experiment as number `number`, and return its run file. Raises InputError or InterruptionError."""
        ...

    def tell_controller(self, values: Values) -> None:
        """Set controller parameters by dotted name, as `clutch-hil tune` does. Raises InputError."""
        ...


@dataclass(frozen=True)
class _Scale:
    """The first run and its result: the `span` of pressures, and parameters of the `controller` by dotted name."""

    run: Path
    span: Span
    controller: Values


def _play_scale(folder: Path, bench: CourseBench) -> _Scale:
    """Play the staircase and set the controller's contact pressure from it. Raises InputError where it shows no contact."""
    course = _write_course(folder, "scale", SCALE[0](Span(bench.contact)), SCALE[1], bench.rate, SCALE[0].__doc__)
    try:
        run = bench.play(course, 0)
    except FaultError as error:
        raise InputError(f"{error}; {_describe_expected(bench)}") from None
    columns = [read_run(run).columns]
    line = estimate_line(columns)
    if line is None:
        raise InputError(
            f"run {run} shows no torque that rises with the pressure: no contact pressure was found;"
            f" {_describe_expected(bench)}"
        )
    nominal = {name: p.value for name, p in wet_clutch.load_nominal().items()}
    gain = estimate_valve_gain(take_samples(columns)) or nominal["valve.gain"]
    span = Span.of_line(line[0], line[1], TORQUE_SHARE * bench.motor_torque)
    values = derive_pressures(span.contact, gain, nominal, load_node("controller")().parameters)
    bench.tell_controller(values)
    return _Scale(run, span, values)


def _describe_expected(bench: CourseBench) -> str:
    return bench.other_rig or (
        f"the controller expects contact at {bench.contact:g} bar: give it {', '.join(EXPECTED)} of your clutch,"
        " with --controller-parameters FILE or, on a running bench, with clutch-hil tune; of a slow valve also"
        f" {join_names(SLOW_VALVE)}, with --controller-parameters"
    )


def _write_course(
    folder: Path, name: str, course: Course, temperature: float, rate: int, title: str | None
) -> CourseExperiment:
    path = folder / _name_course_file(name)
    path.write_text(write_course(course, str(title)), encoding="utf-8")
    return CourseExperiment(str(path), temperature, rate)


def play_courses(folder: Path, bench: CourseBench) -> Courses:
    """Play the fixed set on a clutch that is not calibrated, starting with its pressure scale; yield each run file.

    The courses are written to `folder`. Raises InputError where the first run shows no contact pressure.
    """
    scale = _play_scale(folder, bench)
    yield scale.run
    for number, name in enumerate(ORDER, 1):
        make, temperature = COURSES[name]
        course = _write_course(folder, name, make(scale.span), temperature, bench.rate, make.__doc__)
        yield bench.play(course, number)


def play_designed(
    folder: Path, bench: CourseBench, identify: Callable[[Sequence[Path]], Identification], tell: Callable[[str], None]
) -> Courses:
    """Play the pressure scale, then repeatedly the shortest next experiment for the identification so far (--design).

    identify: called with the runs whenever no identification is sent. Other arguments and errors as in `play_courses`.
    """
    scale = _play_scale(folder, bench)
    runs = [scale.run]
    for number in range(1, MOST_DESIGNED + 1):
        identification = yield runs[-1]
        design = design_experiment(identification or identify(runs), scale.span, scale.controller, bench.rate)
        tell(f"  designed: {design}")
        path = folder / _name_course_file(f"design_{number}")
        path.write_text(design.profile, encoding="utf-8")
        runs.append(bench.play(CourseExperiment(str(path), design.celsius, bench.rate), number))
    yield runs[-1]


@dataclass(frozen=True)
class Played:
    """Run files, standings of the goals after the last identification, and open needs; both are empty where all was played.

    left_out: courses of the fixed set that were not needed.
    """

    runs: Sequence[Path]
    standings: Sequence[Standing] = ()
    open: Sequence[str] = ()
    left_out: Sequence[str] = ()


def play_until_reached(
    courses: Courses, everything: bool, tell: Callable[[str], None],
    identify: Callable[[Sequence[Path]], Identification] = lambda runs: identify_clutch(runs),
) -> Played:  # fmt: skip
    """Play `courses` until the goals are reached in two identifications that agree; with `everything`, play all courses.

    tell: called with lines of text for the user. Raises InputError or InterruptionError, which names the complete runs.
    """
    runs: list[Path] = []
    progress, standings, missing = Progress(), list[Standing](), list[str]()
    identification: Identification | None = None
    try:
        while True:
            try:
                runs.append(courses.send(identification))
            except StopIteration:
                return Played(runs, standings, missing)
            identification = None
            if everything or len(runs) < 2:  # the staircase alone shows neither beta nor V_S
                continue
            tell(f"identifying {len(runs)} runs")
            try:
                identification = identify(runs)
                done, standings, missing = progress.add(identification)
            except InputError as error:
                missing = [str(error)]
                tell(f"  not yet: {error}")
                continue
            tell(f"  reached: {', '.join(one.goal.name for one in standings if one.is_reached) or 'nothing'}")
            if done:
                return Played(runs, standings, [], ORDER[len(runs) - 1 :])
            tell(f"  open: {'; '.join(missing)}")
    except InputError as error:
        raise InputError(f"{error}{_describe_kept(runs)}") from None
    except InterruptionError as interruption:
        raise InterruptionError(f"{interruption}{_describe_kept(runs)}") from None
    except KeyboardInterrupt:
        raise InterruptionError(f"the goals are not reached{_describe_kept(runs)}") from None
    except BaseException:  # a compiler or a library may turn an interruption into another exception
        tell(f"interrupted{_describe_kept(runs)}")
        raise


def _describe_kept(runs: Sequence[Path]) -> str:
    """Return a clause that names the complete runs."""
    return (
        f"; these runs are complete, for clutch-hil identify: {', '.join(map(str, runs))}"
        if runs
        else "; no run is complete"
    )


class BorrowedController:
    """The controller of a running bench, with parameters to restore at the end. values: initial values by dotted name."""

    def __init__(self, bus: str) -> None:
        """Read the parameters. Raises InputError where the controller does not answer."""
        with open_consumer_session() as session:
            self._bench = find_bench(session, resolve(bus))
            self.values = {
                one["name"]: float(one["value"]) for one in request_parameters(session, self._bench, CONTROLLER)
            }
        self._changed: dict[str, float] = {}

    def set(self, values: Values) -> None:
        """Set parameters by dotted name, all or none. Raises InputError where the controller refuses."""
        with open_consumer_session() as session:
            set_parameters(session, self._bench, CONTROLLER, values)
        self._changed |= {name: self.values[name] for name in values}

    def restore(self) -> None:
        """Restore the changed parameters. Raises InputError where the controller refuses."""
        if self._changed:
            self.set(self._changed)


@contextmanager
def borrowed_controller(bus: str) -> Iterator[BorrowedController]:
    """Yield the controller of a running bench, and restore its parameters afterwards. Raises InputError."""
    controller = BorrowedController(bus)
    try:
        yield controller
    finally:
        controller.restore()
