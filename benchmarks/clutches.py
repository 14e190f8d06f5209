"""`python -m benchmarks clutches`: computing time of each further controlled clutch in a cycle.

Method          one plant; groups of one to MOST_CLUTCHES controllers take its frames, one group after the other. Each
                group is timed as a whole, and all in the same run
Assumptions     controllers share nothing; one thread steps them one after the other
"""

import time
from collections.abc import Callable
from typing import Any

import numpy as np

from benchmarks.loop import Target
from plant_sim.node.plant_node import PlantNode
from plant_sim.profiles.profile import load_profile
from protocols.node import load_node

MOST_CLUTCHES = 8  # controlled in one run; chosen by judgement
RATE = 1000  # Hz, the default rate of the controllers
# time per clutch of eight over that of a single one; chosen: a higher ratio would show mutual disturbance
_LINEAR_LIMIT = 1.25


def measure_clutch_costs(seconds: float, progress: Callable[[float, int], None]) -> tuple[list[Target], dict[str, Any]]:
    """Measure the duration [us] of a step, decode to encode, with 1 to MOST_CLUTCHES controllers over `seconds` [s] simulated.

    Returns targets, and a document with a row per number of clutches. `progress(done, total)` is called every 100 cycles.
    """
    new_controller = load_node("controller")
    groups = [[new_controller(rate=RATE) for _ in range(count)] for count in range(1, MOST_CLUTCHES + 1)]
    plant = PlantNode(rate=RATE, profile=load_profile("engagement", seconds))
    cycles = round(seconds * RATE)
    durations = np.zeros((MOST_CLUTCHES, cycles))
    commands = 0
    for cycle in range(cycles):
        plant.take(groups[0][0].outbox, commands)
        frames = plant.show()
        plant.advance()
        for k, group in enumerate(groups):
            start = time.perf_counter_ns()
            for controller in group:
                commands = controller.run_cycle(plant.outbox, frames)
            durations[k, cycle] = time.perf_counter_ns() - start
        if cycle % 100 == 0:
            progress(cycle, cycles)
    durations /= 1e3
    rows = [
        {
            "clutches": k + 1,
            "p50_us": float(np.median(durations_us)),
            "p99_us": float(np.percentile(durations_us, 99.0)),
        }
        for k, durations_us in enumerate(durations)
    ]
    median_per_clutch = rows[-1]["p50_us"] / MOST_CLUTCHES
    targets = [
        Target(
            "a clutch of eight, beside one alone", median_per_clutch / rows[0]["p50_us"], "", "at most", _LINEAR_LIMIT
        ),
        Target("eight clutches, median step at 1 kHz", rows[-1]["p50_us"], "us", "at most", 1e6 / RATE),
    ]
    document = {"clutches": rows, "targets": [vars(target) | {"met": target.is_met} for target in targets]}
    return targets, document


def tabulate_costs(document: dict[str, Any]) -> list[tuple[str, ...]]:
    """Tabulate the rows of a document, header first."""
    head = ("clutches", "step p50 us", "p99 us", "a clutch us", "of a period at 1 kHz")
    rows = [
        (
            str(one["clutches"]), f"{one['p50_us']:.1f}", f"{one['p99_us']:.1f}",
            f"{one['p50_us'] / one['clutches']:.1f}", f"{100.0 * one['p50_us'] * RATE / 1e6:.1f} %",
        )
        for one in document["clutches"]
    ]  # fmt: skip
    return [head, *rows]
