"""Identification set: the courses that identify a clutch, played one after the other until all is known that is wanted."""

from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

from clutch_hil.bench.experiments import Course
from clutch_hil.bench.run_file import read_run
from clutch_hil.discrepancy.experiment_design import Experiment
from clutch_hil.identify.courses import COURSES, SCALE, TORQUE_SHARE, Span, write_course
from clutch_hil.identify.goals import Progress, Standing
from clutch_hil.identify.identification import Identification, identify_clutch
from clutch_hil.identify.stepwise import estimate_contact, take_samples
from clutch_hil.live.tune import request_parameters, set_parameters
from protocols.buses.bus import resolve
from protocols.errors import InputError, InterruptionError
from protocols.files.parameters import CONTROLLER
from protocols.telemetry.feed import find_bench
from protocols.telemetry.session import open_consumer_session

# The two that tell most come first, so that an early end comes early: together they excite all goals but the heat balance
ORDER = ("stribeck", "dynamics", "fills", "staircase", "heating")
MISMATCH = "phases.torque_mismatch"  # the controller's comparison of the motor's torque with its estimate, ...
UNCALIBRATED = 60.0  # Nm: ... widened, as nobody has calibrated the controller yet. The guard's limits stay


@dataclass(frozen=True)
class CourseExperiment(Experiment):
    """An experiment of which the profile is a file."""

    @property
    def name(self) -> str:
        """Name of the file."""
        return Path(self.profile).stem

    @property
    def title(self) -> str:
        """First line of the file."""
        return Path(self.profile).read_text(encoding="utf-8").partition("\n")[0].lstrip("# ").rstrip(".")


def list_course_files() -> tuple[str, ...]:
    """Names of the profile files that are written."""
    return tuple(f"identify_{name}.csv" for name in ("scale", *ORDER))


def play_courses(
    folder: Path, rate: int, play: Callable[[Experiment, int], Path], motor_torque: float, contact: float
) -> Iterator[Path]:
    """Play what identifies a clutch that nobody has calibrated, its pressure scale first; yield each run file.

    The courses are written into `folder`. play(experiment, number) plays one. motor_torque: limit of the motor [Nm].
    contact: where the contact pressure may be [bar]. Raises InputError where the first run shows no contact pressure.
    """

    def play_course(name: str, make: Callable[[Span], Course], span: Span, temperature: float) -> Experiment:
        path = folder / f"identify_{name}.csv"
        path.write_text(write_course(make, span), encoding="utf-8")
        return CourseExperiment(str(path), temperature, rate)

    first = play(play_course("scale", SCALE[0], Span(contact), SCALE[1]), 0)
    yield first
    line = estimate_contact(take_samples([read_run(first).columns]))
    if line is None:
        raise InputError(f"run {first} shows no torque that rises with the pressure: no contact pressure is found")
    span = Span.of_line(line[0], line[1], TORQUE_SHARE * motor_torque)
    for number, name in enumerate(ORDER, 1):
        make, temperature = COURSES[name]
        yield play(play_course(name, make, span, temperature), number)


@dataclass(frozen=True)
class Played:
    """Run files; how the goals stand after the last identification, and what is open, both empty where all was played."""

    runs: Sequence[Path]
    standings: Sequence[Standing] = ()
    open: Sequence[str] = ()
    left_out: Sequence[str] = ()


def play_until_reached(
    courses: Iterator[Path], everything: bool, tell: Callable[[str], None],
    identify: Callable[[Sequence[Path]], Identification] = lambda runs: identify_clutch(runs),
) -> Played:  # fmt: skip
    """Play `courses` until the goals are reached in two identifications that agree; with `everything` all of them.

    tell: takes lines for people. Raises InputError or InterruptionError, which names the runs that are whole.
    """
    runs: list[Path] = []
    progress, standings, missing = Progress(), list[Standing](), list[str]()
    try:
        for path in courses:
            runs.append(path)
            if everything or len(runs) < 2:  # the staircase alone shows neither beta nor V_S
                continue
            tell(f"identifying {len(runs)} runs")
            try:
                done, standings, missing = progress.add(identify(runs))
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
        tell(f"broken off{_describe_kept(runs)}")
        raise
    return Played(runs, standings, missing)


def _describe_kept(runs: Sequence[Path]) -> str:
    """A clause that names the runs that are whole."""
    return f"; whole are {', '.join(map(str, runs))}: clutch-hil identify takes them" if runs else "; no run is whole"


@contextmanager
def widened_comparison(bus: str) -> Iterator[Mapping[str, float]]:
    """Widen the controller's comparison of torques on a running bench while entered; yields its parameters by name.

    Raises InputError where it does not answer or refuses.
    """
    with open_consumer_session() as session:
        bench = find_bench(session, resolve(bus))
        values = {one["name"]: float(one["value"]) for one in request_parameters(session, bench, CONTROLLER)}
        set_parameters(session, bench, CONTROLLER, {MISMATCH: max(UNCALIBRATED, values[MISMATCH])})
    try:
        yield values
    finally:
        with open_consumer_session() as session:
            set_parameters(session, bench, CONTROLLER, {MISMATCH: values[MISMATCH]})
