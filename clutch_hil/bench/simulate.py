"""`clutch-hil simulate`: plant and controller of the wet-clutch rig in one process, as fast as it goes."""

from collections.abc import Callable
from typing import Any, Protocol

from clutch_hil.bench.in_process import Played, play
from clutch_hil.bench.label import Label
from clutch_hil.bench.metadata import run_metadata
from clutch_hil.bench.recording import Recording, run_path, writable
from clutch_hil.bench.result import Result, judge_run
from clutch_hil.bench.scenario import Scenario, naming
from clutch_hil.bench.sealed import SealedRecording
from plant_sim.node.plant_node import PlantNode
from plant_sim.profiles.profile import Profile
from protocols.errors import InputError
from protocols.files.parameters import ParameterSet

_MOST_SAMPLES = 1_000_000  # of a run in one process, which is held in memory until it ends: some 4 kB each


class Simulated(Protocol):
    """A scenario that is ready to be simulated, whatever its rig, and what its result says of it."""

    scenario: Scenario
    label: Label

    def run(self, progress: Callable[[int, int], None]) -> Result:
        """Simulate; write the run file and its picture."""


def simulation(scenario: Scenario, blind: bool = False) -> Simulated:
    """The simulation of a scenario's rig. Raises InputError when it cannot be: nothing has run then."""
    if scenario.rig == "wet_clutch":
        return Simulation(scenario, blind)
    from clutch_hil.bench.shift import ShiftSimulation

    if blind:
        raise InputError(f"scenario {scenario.name} of the rig {scenario.rig} cannot be blind; allowed is wet_clutch")
    with naming(scenario.path):
        _must_fit(scenario.duration, scenario.settings.rate)
    return ShiftSimulation(scenario)


def _must_fit(duration: float, rate: int) -> None:
    """Raise InputError when a run of `duration` [s] at `rate` [Hz] has too many samples to be held in memory."""
    if (samples := round(duration * rate)) > _MOST_SAMPLES:
        raise InputError(
            f"a simulation of {duration:g} s, {samples} samples, does not fit into memory; allowed are {_MOST_SAMPLES};"
            " clutch-hil up --lockstep writes while it runs"
        )


class Simulation:
    """Runs of a scenario; `blind` seals the truth away. Raises InputError when they cannot be: nothing has run then."""

    def __init__(self, scenario: Scenario, blind: bool = False) -> None:
        self.scenario, self._blind = scenario, blind
        self.label = Label.of(scenario, blind)
        with naming(scenario.path):
            profile = scenario.loaded_profile()
            if not isinstance(profile, Profile):
                raise InputError(f"rig {scenario.rig} has no sweeps; allowed is wet_clutch")
            _must_fit(profile.duration, scenario.settings.rate)
            self.profile = profile
            self._new_nodes(scenario.plant, scenario.settings.seed)

    def run(self, progress: Callable[[int, int], None]) -> Result:
        """Simulate; write the run file and its picture."""
        scenario, settings = self.scenario, self.scenario.settings
        writable(settings.out)
        played, metadata = self.play_described(progress)
        path = run_path(settings.out, f"{self.label.name}-simulated")
        recorder = SealedRecording if self._blind else Recording
        with recorder(path, played.plant_columns, played.controller_columns, settings.rate) as recording:
            recording.add(played.plant, played.controller)
            recording.finish(metadata)
        return judge_run(path, f"{self}, in one process, {settings.rate} Hz", scenario.limits)

    def play_described(self, progress: Callable[[int, int], None] | None = None) -> tuple[Played, dict[str, Any]]:
        """Simulate; return the records and the metadata of their run file. Nothing is written."""
        scenario, settings = self.scenario, self.scenario.settings
        plant, controller = self._new_nodes(scenario.plant, settings.seed)
        cycles = round(self.profile.duration * settings.rate)
        played = play(plant, controller, (lambda cycle: progress(cycle, cycles)) if progress else None)
        metadata = run_metadata(settings.rate, scenario.plant, controller.parameters.as_values(), plant.injected)
        metadata |= {"settings": settings.as_text() | {"mode": "in process"}, "scenario": scenario.name}
        return played, metadata

    def play(self, plant: ParameterSet, seed: int) -> Played:
        """Simulate with other parameters of the plant and another seed; write nothing. Raises InputError."""
        return play(*self._new_nodes(plant, seed))

    def __str__(self) -> str:
        """What is read."""
        return self.label.read(self.profile.duration)

    def _new_nodes(self, plant: ParameterSet, seed: int) -> tuple[PlantNode, Any]:
        settings = self.scenario.settings
        node = PlantNode(
            settings.rate, plant, self.profile, seed, settings.temperature,
            injections=self.scenario.injections, blind=self._blind,
        )  # fmt: skip
        return node, settings.new_controller()
