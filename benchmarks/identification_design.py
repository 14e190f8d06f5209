"""Rig time of designed experiments beside that of the fixed set. `python -m benchmarks.identification_design`.

Each rig of benchmarks/identification.py plays the staircase and the Stribeck sweeps. Then experiments are designed, played and
identified until every goal is reached. The fixed set is all courses of `clutch-hil experiment identify`.
"""

import argparse
import sys

import numpy as np

from benchmarks.battery.truth_simulation import COLUMNS, PERIOD, PRESSURE, Inputs, simulate
from benchmarks.identification import NOISE, draw, true_values
from clutch_hil.bench.experiments import Course
from clutch_hil.discrepancy.identification_design import design_experiment
from clutch_hil.identify.course_pieces import compose
from clutch_hil.identify.courses import COURSES, SCALE, TORQUE_SHARE, Span
from clutch_hil.identify.goals import Progress, Standing
from clutch_hil.identify.identification import identify_clutch
from clutch_hil.identify.stepwise import estimate_contact, take_samples
from plant_sim.rigs import wet_clutch
from protocols.files.run import Run

_ROUNDS = 4  # designs, at most
_CELSIUS = 70.0  # of the oil at the start of a designed experiment


def play_course(rig: np.ndarray, seed: int, number: int, course: Course, celsius: float) -> Run:
    """A run of the independent truth, 1 kHz, with its own noise."""
    rows = np.array(course.rows)
    time = PERIOD * np.arange(int(rows[-1, 0] / PERIOD))
    pressure, speed = (np.interp(time, rows[:, 0], rows[:, k]) for k in (3, 2))
    noise = NOISE * np.random.default_rng([seed, number, 77]).standard_normal((len(time), 4))
    shown = simulate(Inputs("", PRESSURE, pressure, speed, celsius, np.zeros(len(time))), plant=rig, noise=noise)
    columns = {
        "time_s": time, "valve_voltage_v": shown.voltage, "motor_speed_demand_rad_s": speed,
        **{name: shown[name].copy() for name in COLUMNS},
    }  # fmt: skip
    return Run(columns, {"rig": "wet_clutch"}, {})


def seconds_of(runs: list[Run]) -> float:
    """Rig time [s]."""
    return float(sum(run["time_s"][-1] for run in runs))


def largest_error(standing: Standing, true: dict[str, float]) -> float:
    """Largest error of a goal's quantity, as the goal is given: in percent, or in its unit."""
    exact = standing.goal.of(true)
    off = np.abs(standing.values - exact)
    return float(np.max(off / np.abs(exact) * 100.0 if standing.goal.unit == "%" else off))


def main(options: list[str]) -> int:
    """Design for rigs, a line each."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.identification_design")
    parser.add_argument("--rigs", type=int, nargs="+", default=[2, 4, 9], help="seeds of the rigs")
    for seed in parser.parse_args(options).rigs:
        rig = draw(seed)
        true = true_values(rig)
        scale = SCALE[0](Span(wet_clutch.nominal()["piston.contact_pressure"].value))
        runs = [play_course(rig, seed, 0, scale, SCALE[1])]
        line = estimate_contact(take_samples([runs[0].columns]))
        assert line is not None
        span = Span.of_line(line[0], line[1], TORQUE_SHARE * float(rig["motor_torque_limit"][0]))
        fixed = seconds_of(runs) + sum(float(make(span).rows[-1][0]) for make, _ in COURSES.values())
        make, celsius = COURSES["stribeck"]
        runs.append(play_course(rig, seed, 1, make(span), celsius))
        played = []
        for number in range(2, 2 + _ROUNDS):
            found = identify_clutch(runs)
            _, standings, missing = Progress().add(found)
            if missing == ["one more run is to confirm it"]:
                break
            design = design_experiment(found)
            if not design.pieces:
                break
            played.append(f"{design.seconds:.1f} s ({', '.join(design.pieces)})")
            runs.append(play_course(rig, seed, number, compose(design.pieces, span), _CELSIUS))
        reached = sum(one.is_reached for one in standings)
        worst = ", ".join(f"{s.goal.name} {largest_error(s, true):.2g} {s.goal.unit}" for s in standings)
        print(
            f"rig {seed}: fixed set {fixed:.0f} s, designed {seconds_of(runs):.0f} s: {'; '.join(played) or 'nothing'};"
            f" {reached} of {len(standings)} goals reached; errors: {worst}",
            flush=True,
        )
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
