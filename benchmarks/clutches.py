"""`python -m benchmarks clutches`: what each further controlled clutch costs a cycle.

Method          one plant; its frames are answered by groups of one to MOST controllers, each group timed as a whole, one after
                the other, so that all are measured in one run
Assumptions     controllers do not share anything; one thread steps them one after the other
"""

import time
from collections.abc import Callable
from typing import Any

import numpy as np

from benchmarks.loop import Target
from plant_sim.node.plant_node import PlantNode
from plant_sim.profiles.profile import load_profile
from protocols.node import node_factory

MOST = 8
RATE = 1000  # Hz
_LINEAR = 1.25  # times a clutch's share of what MOST cost: beyond that they would disturb each other


def clutch_costs(seconds: float, progress: Callable[[float, int], None]) -> tuple[list[Target], dict[str, Any]]:
    """Durations of the steps of 1 to MOST controllers, decode to encode [us]; `seconds` [s] are simulated."""
    new_controller = node_factory("controller")
    groups = [[new_controller(rate=RATE) for _ in range(count)] for count in range(1, MOST + 1)]
    plant = PlantNode(rate=RATE, profile=load_profile("engagement", seconds))
    cycles = round(seconds * RATE)
    durations = np.zeros((MOST, cycles))
    commands = 0
    for cycle in range(cycles):
        plant.take(groups[0][0].outbox, commands)
        frames = plant.show()
        plant.advance()
        for k, group in enumerate(groups):
            began = time.perf_counter_ns()
            for controller in group:
                commands = controller.cycle(plant.outbox, frames)
            durations[k, cycle] = time.perf_counter_ns() - began
        if cycle % 100 == 0:
            progress(cycle, cycles)
    durations /= 1e3
    rows = [
        {"clutches": k + 1, "p50_us": float(np.median(own)), "p99_us": float(np.percentile(own, 99.0))}
        for k, own in enumerate(durations)
    ]
    each = rows[-1]["p50_us"] / MOST
    targets = [
        Target("a clutch of eight, beside one alone", each / rows[0]["p50_us"], "", "at most", _LINEAR),
        Target("eight clutches, median step at 1 kHz", rows[-1]["p50_us"], "us", "at most", 1e6 / RATE),
    ]
    document = {"clutches": rows, "targets": [vars(target) | {"met": target.met} for target in targets]}
    return targets, document


def table(document: dict[str, Any]) -> list[tuple[str, ...]]:
    """The rows, header first."""
    head = ("clutches", "step p50 us", "p99 us", "a clutch us", "of a period at 1 kHz")
    rows = [
        (
            str(one["clutches"]), f"{one['p50_us']:.1f}", f"{one['p99_us']:.1f}",
            f"{one['p50_us'] / one['clutches']:.1f}", f"{100.0 * one['p50_us'] * RATE / 1e6:.1f} %",
        )
        for one in document["clutches"]
    ]  # fmt: skip
    return [head, *rows]
