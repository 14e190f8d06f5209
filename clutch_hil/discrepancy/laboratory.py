"""Laboratory: plays experiments on a live plant over CAN and records them, on a bench that it starts or on one that runs."""

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, replace
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any, Protocol

from clutch_hil.bench.measures import MEASURES
from clutch_hil.bench.recording import run_path, writable
from clutch_hil.bench.scenario import Scenario, load_scenario
from clutch_hil.bench.settings import RunSettings
from clutch_hil.bench.up import Bench
from clutch_hil.discrepancy.blind import draw_plant
from clutch_hil.discrepancy.experiment_design import Experiment
from plant_sim.profiles.profile import load_profile
from plant_sim.rigs import wet_clutch
from protocols.errors import InputError
from protocols.files.runs import read_run
from protocols.realtime.stopping import Stop


class Laboratory(Protocol):
    """A place where experiments are played."""

    def play(self, experiment: Experiment, number: int, quiet: bool) -> Path:
        """Play an experiment as number `number`, and return its run file.

        quiet: without a progress bar. Raises InputError when it was not played, or ended in a fault.
        """
        ...


@dataclass(frozen=True)
class OwnBench:
    """Starts plant and controller on `bus` for each experiment.

    scenario: the plant under test; its profile, length and limits are not used. blind: the truth is sealed.
    """

    scenario: Scenario
    bus: str
    lockstep: bool = False
    blind: bool = False

    def play(self, experiment: Experiment, number: int, quiet: bool) -> Path:
        """See `Laboratory`. The noise depends on the number."""
        given = self.scenario.settings
        settings = replace(
            given, seed=given.seed + number, profile=experiment.profile, seconds=None, rate=experiment.rate,
            temperature=experiment.temperature,
        )  # fmt: skip
        played = replace(self.scenario, name=experiment.name, settings=settings, limits=())
        document = Bench(played, self.bus, self.lockstep, telemetry=False, blind=self.blind).run(quiet).document
        return _require_sound(experiment, Path(document["run"]), document["interrupted"])


@dataclass(frozen=True)
class RunningBench:
    """A bench that runs already, started with `--profile manual`, on `bus`; runs are recorded into the folder `out`.

    Oil temperature and rate are those of the bench. A run begins up to 30 s before the profile, as telemetry keeps 30 s.
    """

    bus: str
    out: Path
    blind: bool = False

    def play(self, experiment: Experiment, number: int, quiet: bool) -> Path:
        """See `Laboratory`."""
        from clutch_hil.live.bench_recording import record
        from clutch_hil.live.demand import Demand

        profile = load_profile(experiment.profile)
        path = run_path(writable(self.out), "blind" if self.blind else experiment.name)
        path.with_name(path.name + ".part").unlink(missing_ok=True)  # the recorder creates it anew
        document, *_ = Demand(self.bus, profile).run(quiet)
        with Stop() as stop:
            recorded = record(path, self.bus, None, 0.0, stop, lambda text: None, self.blind)
        return _require_sound(experiment, next(iter(recorded.files)), document["interrupted"])


@contextmanager
def plant_under_test(
    scenario: str | None, changed: Path | None, draw: int | None, seed: int, out: Path
) -> Iterator[Scenario]:
    """The plant under test: of a `scenario`, changed by a parameter file, or with a hidden effect drawn by the seed `draw`.

    seed: of the noise of the first run. out: folder of the run files. Raises InputError where `draw` and another are given.
    """
    if draw is None:
        given: dict[str, Any] = {"plant_parameters": changed, "seed": seed, "out": out}
        yield load_scenario(scenario, given) if scenario else Scenario.of(RunSettings(**given))
        return
    if scenario or changed:
        raise InputError(
            f"--draw was given and {'--scenario' if scenario else '--plant-parameters'}; allowed is one of them"
        )
    plant, shipped = draw_plant(draw), wet_clutch.nominal()
    values = {name: p.value for name, p in plant.items() if p.value != shipped[name].value}
    with (
        TemporaryDirectory() as folder
    ):  # removed once the services have read it: the truth is in the sealed files only
        path = Path(folder) / f"drawn-{draw}.toml"
        path.write_text("".join(f"{name} = {value!r}\n" for name, value in values.items()), encoding="utf-8")
        yield Scenario.of(RunSettings(plant_parameters=path, seed=seed, out=out))


def _require_sound(experiment: Experiment, path: Path, interrupted: bool) -> Path:
    """`path` of a run that may be fitted: complete, and without a fault, as the controller stops the motor in a fault."""
    if interrupted:
        raise InputError(f"experiment {experiment.name} was interrupted; {path} holds a part of it")
    if (fault := MEASURES["fault"].of(read_run(path).columns)) != "none":
        raise InputError(f"experiment {experiment.name} ended in a fault ({fault}); {path} is no evidence")
    return path
