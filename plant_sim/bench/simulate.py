"""`clutch-hil simulate`: plant and controller in one process, once with a run file, or many times as a sweep."""

import csv
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from plant_sim.bench.in_process import Played, play
from plant_sim.bench.metadata import run_metadata
from plant_sim.bench.recording import Recording, run_path, writable
from plant_sim.bench.result import Result, judge_run
from plant_sim.bench.settings import RunSettings
from plant_sim.node import PlantNode
from plant_sim.profile import Profile
from protocols.errors import InputError
from protocols.parameters import ParameterSet


@dataclass(frozen=True)
class Simulation:
    """Runs of plant and controller in one process."""

    settings: RunSettings

    def run(self, progress: Callable[[int, int], None]) -> Result:
        """Simulate once; write the run file and its picture."""
        profile = self.settings.loaded_profile()
        writable(self.settings.out)
        cycles = round(profile.duration * self.settings.rate)
        parameters = self.settings.loaded_plant_parameters()
        controller = self.settings.new_controller()
        played = self._play(parameters, controller, profile, self.settings.seed, lambda cycle: progress(cycle, cycles))
        path = run_path(self.settings.out, f"{profile.name}-simulated")
        with Recording(path, played.plant_columns, played.controller_columns, self.settings.rate) as recording:
            recording.add(played.plant, played.controller)
            recording.finish(
                run_metadata(self.settings.rate, parameters, controller.parameters.as_values())
                | {"settings": self.settings.as_text() | {"mode": "in process"}}
            )
        return judge_run(
            path, f"profile {profile.name} ({profile.duration:g} s), in one process, {self.settings.rate} Hz"
        )

    def sweep(self, vary: str | None, seeds: int, progress: Callable[[int, int], None]) -> Result:
        """Simulate for every value of `vary` (`NAME=LOW:HIGH:COUNT`, a plant parameter) and `seeds` seeds; write a CSV."""
        profile = self.settings.loaded_profile()
        parameters = self.settings.loaded_plant_parameters()
        writable(self.settings.out)
        name, values = parsed_range(vary, parameters) if vary else ("seed", [float("nan")])
        rows = []
        for i, value in enumerate(values):
            changed = parameters.with_values({name: value}) if vary else parameters
            for k in range(seeds):
                played = self._play(changed, self.settings.new_controller(), profile, self.settings.seed + k, None)
                rows.append((value, self.settings.seed + k, *played.following()))
                progress(i * seeds + k + 1, len(values) * seeds)
        path = run_path(self.settings.out, f"{profile.name}-sweep", ".csv")
        part = path.with_name(path.name + ".part")
        with part.open("w", newline="", encoding="utf-8") as file:
            csv.writer(file).writerows([(name if vary else "-", "seed", "regime_error_nm", "rise_time_s"), *rows])
        part.rename(path)
        lines = [f"read:  profile {profile.name}, {len(rows)} runs in one process", f"wrote: {path}"]
        table = np.array(rows)
        for value in values:
            part = table[np.isnan(table[:, 0]) if np.isnan(value) else table[:, 0] == value]
            error, rise = part[:, 2], part[:, 3]
            label = f"{name} = {value:<10.5g}" if vary else "all seeds"
            lines.append(f"{label}  regime error {_spread(error)} Nm, rise time {_spread(rise)} s")
        missed = int(np.isnan(table[:, 2]).sum())
        verdict = f"{len(rows)} runs, {missed} never reached 90 % of the demand"
        document = {"sweep": str(path), "runs": [list(map(float, row)) for row in rows], "verdict": verdict}
        return Result(document, "\n".join(lines), verdict, missed == 0)

    def _play(
        self,
        parameters: ParameterSet,
        controller: Any,
        profile: Profile,
        seed: int,
        progress: Callable[[int], None] | None,
    ) -> Played:
        plant = PlantNode(self.settings.rate, parameters, profile, seed, self.settings.temperature)
        return play(plant, controller, progress)


def parsed_range(text: str, parameters: ParameterSet) -> tuple[str, Sequence[float]]:
    """Parameter name and values of `NAME=LOW:HIGH:COUNT`. Raises InputError."""
    name, _, span = text.partition("=")
    try:
        low, high, count = span.split(":")
        values = np.linspace(float(low), float(high), int(count)).tolist()
    except ValueError:
        raise InputError(f"range {text!r} is not of the form NAME=LOW:HIGH:COUNT") from None
    if not values:
        raise InputError(f"range {text!r} has no values; COUNT must be 1 or more")
    for value in values:
        parameters.with_values({name: value})
    return name, values


def _spread(values: np.ndarray) -> str:
    known = values[~np.isnan(values)]
    return f"{known.mean():.3f} +- {known.std():.3f}" if len(known) else "never"
