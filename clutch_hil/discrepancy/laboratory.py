"""Laboratory: plays experiments on a live plant over CAN and records them, on a bench of its own or on one that runs."""

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, replace
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any, Protocol

from clutch_hil.bench.recording import run_path, writable
from clutch_hil.bench.rig import rig_named
from clutch_hil.bench.run_file import read_run
from clutch_hil.bench.scenario import Scenario, load_scenario
from clutch_hil.bench.settings import RunSettings
from clutch_hil.bench.up import Bench
from clutch_hil.discrepancy.blind import drawn
from clutch_hil.discrepancy.experiment import Experiment, Experimenting
from plant_sim.profiles.profile import load_profile
from plant_sim.rigs import wet_clutch
from protocols.errors import InputError
from protocols.realtime.stopping import Stop


class Laboratory(Protocol):
    """Where experiments are played."""

    def play(self, experiment: Experiment, number: int, quiet: bool) -> Path:
        """The run file of an experiment, of this `number`. Raises InputError when it was not played, or ended in a fault."""
        ...


@dataclass(frozen=True)
class OwnBench:
    """Starts plant and controller on `bus` for each experiment. `scenario` is the plant under test; its own profile, length and
    limits do not matter. `blind` seals the truth away."""

    scenario: Scenario
    bus: str
    lockstep: bool = False
    blind: bool = False

    def play(self, experiment: Experiment, number: int, quiet: bool) -> Path:
        """See `Laboratory`; each number has noise of its own."""
        given = self.scenario.settings
        settings = replace(
            given, seed=given.seed + number, profile=experiment.profile, seconds=None, rate=experiment.rate,
            temperature=experiment.temperature,
        )  # fmt: skip
        played = replace(self.scenario, name=experiment.name, settings=settings, limits=())
        document = Bench(played, self.bus, self.lockstep, telemetry=False, blind=self.blind).run(quiet).document
        return _sound(experiment, Path(document["run"]), document["interrupted"])


@dataclass(frozen=True)
class RunningBench:
    """A bench that runs by itself, started with `--profile manual`, on `bus`: asked for the profile, recorded into `out`.

    Oil temperature and rate are those it has. A run begins up to 30 s before the profile: telemetry keeps as much.
    """

    bus: str
    out: Path
    blind: bool = False

    def play(self, experiment: Experiment, number: int, quiet: bool) -> Path:
        """See `Laboratory`."""
        from clutch_hil.live.demand import Demand
        from clutch_hil.live.record import record

        profile = load_profile(experiment.profile)
        path = run_path(writable(self.out), "blind" if self.blind else experiment.name)
        path.with_name(path.name + ".part").unlink(missing_ok=True)  # the recorder makes its own
        document, *_ = Demand(self.bus, profile).run(quiet)
        with Stop() as stop:
            recorded = record(path, self.bus, None, 0.0, stop, lambda text: None, self.blind)
        return _sound(experiment, next(iter(recorded.files)), document["interrupted"])


@contextmanager
def plant_under_test(
    scenario: str | None, changed: Path | None, draw: int | None, seed: int, out: Path
) -> Iterator[Scenario]:
    """The plant under test: of a `scenario`, changed by a parameter file, or with an effect that the seed `draw` hides in it.

    `seed` is of the noise of the first run, `out` the folder for what is written. Raises InputError.
    """
    if draw is None:
        given: dict[str, Any] = {"plant_parameters": changed, "seed": seed, "out": out}
        plant = load_scenario(scenario, given) if scenario else Scenario.of(RunSettings(**given))
        if not isinstance(plant.rig.model(), Experimenting):
            raise InputError(f"rig {plant.rig.name} has no bench that could play an experiment")
        yield plant
        return
    if scenario or changed:
        raise InputError(
            f"--draw was given and {'--scenario' if scenario else '--plant-parameters'}; allowed is one of them"
        )
    drawn_plant, shipped = drawn(draw), wet_clutch.nominal()
    values = {name: p.value for name, p in drawn_plant.items() if p.value != shipped[name].value}
    with TemporaryDirectory() as folder:  # gone when the services have read it: only the sealed files tell
        path = Path(folder) / f"drawn-{draw}.toml"
        path.write_text("".join(f"{name} = {value!r}\n" for name, value in values.items()), encoding="utf-8")
        yield Scenario.of(RunSettings(plant_parameters=path, seed=seed, out=out))


def _sound(experiment: Experiment, path: Path, interrupted: bool) -> Path:
    """`path` of a run that is evidence: whole, and without a fault, in which the controller stops the motor."""
    if interrupted:
        raise InputError(f"experiment {experiment.name} was interrupted; {path} holds a part of it")
    run = read_run(path)
    if (fault := rig_named(run.metadata["rig"]).measure("fault").of(run.columns)) != "none":
        raise InputError(f"experiment {experiment.name} ended in a fault ({fault}); {path} is no evidence")
    return path
