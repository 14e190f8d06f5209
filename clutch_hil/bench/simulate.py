"""`clutch-hil simulate`: plant and controllers of a rig in one process, as fast as the machine allows."""

from collections.abc import Callable
from typing import Any

from clutch_hil.bench.in_process import Played, play
from clutch_hil.bench.label import Label
from clutch_hil.bench.metadata import make_run_metadata
from clutch_hil.bench.recording import Recording, make_writable, reserve_run_path
from clutch_hil.bench.result import Result
from clutch_hil.bench.scenario import Scenario
from clutch_hil.bench.sealed import SealedRecording
from protocols.errors import InputError, name_file_in_errors
from protocols.files.parameters import ParameterSet

_MOST_SAMPLES = 1_000_000  # of a run in one process, which needs about 4 kB of memory per sample until it ends


class Simulation:
    """Simulations of a scenario. `blind` keeps the truth out of run files. Raises InputError if the scenario cannot be run."""

    def __init__(self, scenario: Scenario, blind: bool = False) -> None:
        self.scenario, self._blind = scenario, blind
        self.label = Label.of(scenario, blind)
        with name_file_in_errors("scenario", scenario.path):
            scenario.rig.plant.check_blind(blind)
            self.profile = scenario.load_profile()
            _check_size(self.profile.duration, scenario.settings.rate)
            self._make_nodes(scenario.plant, scenario.settings.seed)

    def run(self, progress: Callable[[int, int], None]) -> Result:
        """Simulate, write the run file and its picture, and return its judgement. Raises InputError."""
        scenario, settings = self.scenario, self.scenario.settings
        make_writable(settings.out)
        scenario.rig.check_parts()
        played, metadata = self.play_with_metadata(progress)
        path = reserve_run_path(settings.out, f"{self.label.name}-simulated")
        recorder = SealedRecording if self._blind else Recording
        with recorder(path, played.plant_columns, played.controller_columns, settings.rate) as recording:
            recording.add(played.plant, *played.controllers)
            recording.finish(metadata)
        result: Result = scenario.rig.judge(path, f"{self}, in one process, {settings.rate} Hz", scenario.limits)
        return result

    def play_with_metadata(self, progress: Callable[[int, int], None] | None = None) -> tuple[Played, dict[str, Any]]:
        """Simulate; return the records and the metadata of their run file. No file is written."""
        scenario, settings = self.scenario, self.scenario.settings
        plant, controllers = self._make_nodes(scenario.plant, settings.seed)
        cycles = round(self.profile.duration * settings.rate)
        report_cycle = (lambda cycle: progress(cycle, cycles)) if progress else None
        played = play(plant, *controllers.values(), progress=report_cycle)
        parameters = {name: controller.parameters.as_values() for name, controller in controllers.items()}
        return played, make_run_metadata(scenario, parameters, plant.injected_changes, "in process")

    def play(self, plant: ParameterSet, seed: int) -> Played:
        """Simulate with other plant parameters and another seed; write no file. Raises InputError."""
        node, controllers = self._make_nodes(plant, seed)
        return play(node, *controllers.values())

    def __str__(self) -> str:
        """Return a description of the input."""
        return self.label.read(self.profile.duration)

    def _make_nodes(self, plant: ParameterSet, seed: int) -> tuple[Any, dict[str, Any]]:
        """Make a plant, and its controllers by name. Raises InputError."""
        settings, rig = self.scenario.settings, self.scenario.rig.plant
        if faults := self.scenario.bench_faults:
            raise InputError(
                f"the scenario {self.scenario.name} has the fault {faults[0].what!r}, but a simulation has one process and no"
                " network; use clutch-hil up"
            )
        node = rig.make_node(
            settings.rate, plant, self.profile, seed, settings.temperature,
            injections=self.scenario.injections, blind=self._blind,
        )  # fmt: skip
        return node, self.scenario.make_controllers(self.profile)


def _check_size(duration: float, rate: int) -> None:
    """Raise InputError when a run of `duration` [s] at `rate` [Hz] has too many samples for the memory."""
    if (samples := round(duration * rate)) > _MOST_SAMPLES:
        raise InputError(
            f"a simulation of {duration:g} s, {samples} samples, does not fit into memory; allowed are {_MOST_SAMPLES};"
            " clutch-hil up --lockstep writes longer runs to the file while it runs"
        )
