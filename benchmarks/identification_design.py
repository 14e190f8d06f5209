"""Rig time of designed experiments beside that of the fixed set. `python -m benchmarks.identification_design`.

Each rig of benchmarks/identification.py is identified twice, until every goal is reached in two identifications that agree: as
`clutch-hil experiment identify` plays it, and with `--design`. The truth is that of benchmarks/identification.py.
"""

import argparse
import sys
from dataclasses import dataclass
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np

from benchmarks.identification import REGULATOR_GAIN, Hidden, draw, list_true_values, record_course
from clutch_hil.bench.run_file import read_run
from clutch_hil.discrepancy.experiment_design import Experiment
from clutch_hil.discrepancy.experiments.identification_set import (
    Courses,
    Played,
    play_courses,
    play_designed,
    play_until_reached,
)
from clutch_hil.fitting.model import Values
from clutch_hil.identify.goals import Standing
from clutch_hil.identify.identification import identify_clutch
from plant_sim.profiles.profile import load_profile
from plant_sim.rigs import wet_clutch
from protocols.errors import InterruptionError
from protocols.files.runs import write_run


class TruthBench:
    """A rig of the independent truth that plays courses; see `CourseBench`. folder: for its runs."""

    rate = 1000

    def __init__(self, rig: np.ndarray, seed: int, folder: Path) -> None:
        self._rig, self._seed, self._folder = rig, seed, folder
        self.motor_torque = float(rig["motor_torque_limit"][0])
        self.contact = wet_clutch.load_nominal()["piston.contact_pressure"].value
        self._believed, self._gain = self.contact, REGULATOR_GAIN

    def play(self, experiment: Experiment, number: int) -> Path:
        """Play an experiment; see `CourseBench`."""
        profile = load_profile(experiment.profile)
        rows = np.column_stack([profile.time, profile.torque, profile.speed, profile.pressure])
        seed = [self._seed, number, 77]
        run = record_course(self._rig, rows, experiment.temperature, self._believed, seed, Hidden(), self._gain)
        path = self._folder / f"run{number}.parquet"
        write_run(run, path)
        return path

    def tell_controller(self, values: Values) -> None:
        """Set the contact pressure and valve gain of the truth's regulator; see `CourseBench`."""
        self._believed, self._gain = values["model.contact_pressure"], values["pressure.valve_gain"]


@dataclass(frozen=True)
class Result:
    """Rig time [s]; whether every goal was reached and confirmed; largest ratio of error to allowed error; number of runs."""

    seconds: float
    reached: bool
    error: float
    runs: int

    def __str__(self) -> str:
        return (
            f"{self.seconds:.1f} s in {self.runs} runs{'' if self.reached else ', not confirmed'}, largest error"
            f" {self.error:.2f} times its goal"
        )


def identify(rig: np.ndarray, seed: int, design: bool) -> Result:
    """Play and identify a rig until every goal is reached."""
    with TemporaryDirectory() as name:
        folder = Path(name)
        bench = TruthBench(rig, seed, folder)
        courses: Courses = (
            play_designed(folder, bench, lambda runs: identify_clutch(runs), print)
            if design
            else play_courses(folder, bench)
        )
        played: Played = play_until_reached(courses, False, lambda line: print(line, flush=True))
        seconds = sum(float(read_run(path)["time_s"][-1]) for path in played.runs)
    true = list_true_values(rig)
    error = max(compute_share(one, true) for one in played.standings)
    result = Result(seconds, not played.open, error, len(played.runs))
    print(f"  rig {seed}, {'designed' if design else 'fixed set'}: {result}", flush=True)
    return result


def compute_share(standing: Standing, true: dict[str, float]) -> float:
    """Return the largest ratio of an error to the error that the goal allows."""
    exact = standing.goal.of(true)
    allowed = standing.goal.limit / 100.0 * np.abs(exact) if standing.goal.unit == "%" else standing.goal.limit
    return float(np.max(np.abs(standing.values - exact) / allowed))


def main(options: list[str]) -> int:
    """Identify rigs both ways; print a line for each, and a summary."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.identification_design")
    parser.add_argument("--rigs", type=int, default=10, help="number of rigs, 1 or more")
    parser.add_argument("--first", type=int, default=1, help="seed of the first one")
    given = parser.parse_args(options)
    if given.rigs < 1 or given.first < 0:
        parser.error(f"--rigs {given.rigs} and --first {given.first}: allowed are 1 or more, and 0 or more")
    pairs = list[tuple[Result, Result]]()
    try:
        for seed in range(given.first, given.first + given.rigs):
            rig = draw(seed)
            fixed, designed = pairs_of = identify(rig, seed, False), identify(rig, seed, True)
            pairs.append(pairs_of)
            ratio = designed.seconds / fixed.seconds
            print(f"rig {seed}: fixed set {fixed}; designed {designed}: {ratio:.2f} times the time", flush=True)
    except (KeyboardInterrupt, InterruptionError):
        print(f"interrupted after {len(pairs)} of {given.rigs} rigs", flush=True)
    if not pairs:
        return 1
    ratios = [designed.seconds / fixed.seconds for fixed, designed in pairs]
    print(f"designed over fixed: median {np.median(ratios):.2f}, worst {max(ratios):.2f}, of {len(ratios)} rigs")
    for name, results in zip(("fixed set", "designed"), zip(*pairs, strict=True), strict=True):
        reached, error = sum(one.reached for one in results), max(one.error for one in results)
        print(f"{name}: goals confirmed on {reached} of {len(results)}, largest error {error:.2f} times its goal")
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
