"""Laboratory: play experiments on a live plant over CAN and record them, on a bench started for it or on a running one."""

from collections.abc import Iterable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, replace
from math import inf
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any, Protocol

from clutch_hil.bench.arguments import take_whole
from clutch_hil.bench.in_memory import Values, compose_scenario
from clutch_hil.bench.judgement.calibration_check import CONTACT
from clutch_hil.bench.recording import make_writable, reserve_run_path
from clutch_hil.bench.rig import DEFAULT_RIG, Rig, find_rig
from clutch_hil.bench.run_file import read_run
from clutch_hil.bench.scenario import Scenario, load_scenario
from clutch_hil.bench.settings import RunSettings
from clutch_hil.bench.up import Bench
from clutch_hil.command import check_rate
from clutch_hil.discrepancy.experiment_design import Experiment, Experimenting
from clutch_hil.discrepancy.experiments.blind import draw_plant
from clutch_hil.discrepancy.experiments.follow_up import read_proposal
from clutch_hil.discrepancy.models.wet_clutch_experiments import find
from clutch_hil.live.live_bench import LiveBench
from clutch_hil.live.tuning.tune import request_parameters
from plant_sim.rigs import wet_clutch
from protocols.buses.bus import resolve
from protocols.can.fault_text import watch_run
from protocols.errors import InputError, InterruptionError
from protocols.files.parameters import CONTROLLER
from protocols.files.run import Run
from protocols.realtime.stopping import Stop
from protocols.telemetry.feed import ask, find_bench
from protocols.telemetry.keys import Keys
from protocols.telemetry.message import check_description
from protocols.telemetry.session import open_consumer_session


class FaultError(InputError):
    """Raised when an experiment ended in a fault."""


class Laboratory(Protocol):
    """Interface of a bench that plays experiments."""

    def find_contact(self) -> float:
        """Return the contact pressure that its controller expects [bar]."""
        ...

    def play(self, experiment: Experiment, number: int, quiet: bool) -> Path:
        """Play an experiment as number `number`, and return its run file.

        quiet: without a progress bar. Raises InputError when the experiment was not played or ended in a fault, and
        InterruptionError after Ctrl-C.
        """
        ...


@dataclass(frozen=True)
class OwnBench:
    """Bench that starts plant and controller on `bus` for each experiment.

    scenario: the plant under test; its profile, length and limits are not used. blind: the truth is sealed.
    """

    scenario: Scenario
    bus: str
    lockstep: bool = False
    blind: bool = False

    def find_contact(self) -> float:
        """See `Laboratory`."""
        return find_contact(self.scenario)

    def play(self, experiment: Experiment, number: int, quiet: bool) -> Path:
        """See `Laboratory`; each number has a noise seed of its own."""
        with experiment.open_profile() as profile:
            played = _make_scenario(self.scenario, experiment, number, profile)
            document = Bench(played, self.bus, self.lockstep, telemetry=False, blind=self.blind).run(quiet).document
        return _require_sound(experiment, Path(document["run"]), document["interrupted"])


@dataclass(frozen=True)
class RunningBench:
    """A bench on `bus` that was started with `--profile manual`; runs are recorded to the folder `out`.

    Oil temperature and rate are those of the bench. A run starts up to 30 s before the profile, because telemetry keeps 30 s.
    Raises InputError where no bench publishes, or where its rig has no experiments, such as the rig with two clutches.
    """

    bus: str
    out: Path
    blind: bool = False

    def __post_init__(self) -> None:
        """Raise InputError if the bench cannot play experiments."""
        with open_consumer_session() as session:
            bench = find_bench(session, resolve(self.bus))
            about = ask(session, Keys(bench, "plant").describe, check_description, attempts=3)
        if about is None:
            raise InputError(
                f"the plant of bench {bench} does not publish its description; an experiment needs its telemetry"
            )
        _check_experiments(find_rig(about.get("rig", DEFAULT_RIG)))

    def find_contact(self) -> float:
        """See `Laboratory`."""
        with open_consumer_session() as session:
            parameters = request_parameters(session, find_bench(session, resolve(self.bus)), CONTROLLER)
        return next(float(one["value"]) for one in parameters if one["name"] == CONTACT)

    def play(self, experiment: Experiment, number: int, quiet: bool) -> Path:
        """See `Laboratory`."""
        from clutch_hil.live.driving.demand import Demand
        from clutch_hil.live.recording.bench_recording import record

        profile = experiment.load()
        path = reserve_run_path(make_writable(self.out), "blind" if self.blind else experiment.name)
        path.with_name(path.name + ".part").unlink(missing_ok=True)  # the recorder creates it again
        document, *_ = Demand(self.bus, profile).run(quiet)
        with Stop() as stop:
            recorded = record(path, resolve(self.bus), None, 0.0, stop, lambda text: None, self.blind)
        return _require_sound(experiment, next(iter(recorded.files)), document["interrupted"])


def play_experiment(
    experiment: str | Mapping[str, Any] | None,
    scenario: str | Path | None = None,
    *,
    bus: str = "auto",
    lockstep: bool = True,
    rate: int | None = None,
    seed: int | None = None,
    plant_parameters: str | Path | None = None,
    plant: Values | None = None,
    effects: Iterable[str] | Mapping[str, Values] = (),
) -> Run:
    """Play an experiment on the wet-clutch bench over CAN, as `clutch-hil experiment` does, and return its run.

    `experiment` is a name, such as crawl-45 (listed by `clutch-hil experiment --list`), or the proposal of a result,
    `find_discrepancy(...).result.experiment`. The plant under test is that of a `scenario`, with the changes that `simulate`
    takes. `rate` [Hz] replaces the experiment's own rate; `lockstep` plays as fast as the machine allows, else in real time.

    Columns have shape (samples,); no file is written. Raises InputError, also for a run that ended in a fault, which is no
    evidence.
    """
    if experiment is not None and not isinstance(experiment, (str, Mapping)):
        raise InputError(f"experiment is {experiment!r}; allowed is a name, or the experiment that a result proposes")
    named = find(experiment) if isinstance(experiment, str) else read_proposal("the result", experiment)
    settings = {"plant_parameters": plant_parameters, "seed": seed}
    under_test = compose_scenario(scenario, settings, plant, effects=effects)
    played = named.with_rate(None if rate is None else check_rate(take_whole("rate", rate, -inf)))
    if isinstance(experiment, str):
        played = played.fit_to_contact(find_contact(under_test))
    with (
        played.open_profile() as profile,
        LiveBench(_make_scenario(under_test, played, 0, profile), bus, lockstep) as bench,
    ):
        bench.wait()
        run = bench.stop()
    if (fault := under_test.rig.compute_measure("fault", run.columns)) != "none":
        raise InputError(f"experiment {played.name} ended in a fault ({fault}); its run cannot be used")
    return run


def find_contact(under_test: Scenario) -> float:
    """Return the contact pressure that the controller of a scenario expects [bar]."""
    return float(under_test.settings.make_controller().parameters[CONTACT].value)


def _make_scenario(under_test: Scenario, experiment: Experiment, number: int, profile: str) -> Scenario:
    """Return a scenario with the same plant for an experiment, with noise by its `number`. profile: its name or file."""
    given = under_test.settings
    settings = replace(
        given, seed=given.seed + number, profile=profile, seconds=None, rate=experiment.rate,
        temperature=experiment.temperature,
    )  # fmt: skip
    return replace(under_test, name=experiment.name, settings=settings, limits=())


@contextmanager
def plant_under_test(
    scenario: str | None, changed: Path | None, draw: int | None, seed: int, out: Path, controller: Path | None = None
) -> Iterator[Scenario]:
    """Yield the plant under test: from a `scenario`, changed by a parameter file, or with a hidden effect drawn by seed `draw`.

    seed: of the noise of the first run. out: folder of the run files. controller: file with its parameters. Raises InputError
    where `draw` is given together with another plant.
    """
    given: dict[str, Any] = {"plant_parameters": changed, "seed": seed, "out": out, "controller_parameters": controller}
    if draw is None:
        plant = load_scenario(scenario, given) if scenario else Scenario.of(RunSettings(**given))
        _check_experiments(plant.rig)
        yield plant
        return
    if scenario or changed:
        raise InputError(
            f"--draw and {'--scenario' if scenario else '--plant-parameters'} were both given; only one of them is allowed"
        )
    drawn_plant, shipped = draw_plant(draw), wet_clutch.load_nominal()
    values = {name: p.value for name, p in drawn_plant.items() if p.value != shipped[name].value}
    with TemporaryDirectory() as folder:  # deleted when the services have read it: only the sealed files have the truth
        path = Path(folder) / f"drawn-{draw}.toml"
        path.write_text("".join(f"{name} = {value!r}\n" for name, value in values.items()), encoding="utf-8")
        yield Scenario.of(RunSettings(**{**given, "plant_parameters": path}))


def _check_experiments(rig: Rig) -> None:
    """Raise InputError where the benches of a rig cannot play experiments."""
    if not isinstance(rig.model(), Experimenting):
        raise InputError(f"rig {rig.name} has no bench that can play an experiment")


def _require_sound(experiment: Experiment, path: Path, interrupted: bool) -> Path:
    """Return `path` if the run may be fitted: complete and without a fault, in which the controller stops the motor."""
    if interrupted:
        raise InterruptionError(f"experiment {experiment.name} was not played to its end; {path} contains a part of it")
    run = read_run(path)
    rig = find_rig(run.metadata["rig"])
    if rig.compute_measure("fault", run.columns) != "none":
        rate, parameters = run.metadata["sample_rate_hz"], (f"{name}_parameters" for name in rig.plant.controllers)
        watches = [
            watch_run(run.columns, rate, run.metadata.get(name, {}), clutch)
            for name, clutch in zip(parameters, rig.plant.controllers.values(), strict=True)
        ]
        faults = "; ".join(watch.first.line for watch in watches if watch.first)
        raise FaultError(f"experiment {experiment.name} ended in a {faults}; {path} cannot be used")
    return path
