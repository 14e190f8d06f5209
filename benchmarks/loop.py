"""`python -m benchmarks loop`: speed of the plant kernel, the controller and the closed loop on this machine, in one run.

Ratios to real time and medians are comparable. Single maxima may come from other programs on the machine.
"""

import time
from dataclasses import dataclass
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any, ClassVar

import numpy as np

from clutch_hil.bench.scenario import Scenario
from clutch_hil.bench.settings import RunSettings
from clutch_hil.bench.up import Bench
from plant_sim.effects.catalogue import find_effect
from plant_sim.node.plant_node import PlantNode
from plant_sim.profiles.profile import load_profile
from plant_sim.rigs import wet_clutch
from protocols.buses.bus import open_bus
from protocols.node import load_node

TEN_EFFECTS = (  # chosen: of all blocks, and at all hooks of the kernel except RIG
    "valve_hysteresis", "supply_sag", "entrapped_air", "piston_seal_friction", "plate_waviness", "coulomb_temperature",
    "squeeze_film", "shaft_compliance", "pressure_time_offset", "torque_sensor_leakage",
)  # fmt: skip
_KERNEL_SECONDS = 1.0  # s, simulated time per call; chosen: a call takes 1 to 3 ms
# calls, of which the fastest counts; chosen: other programs use the machine, but seldom during all calls of 1 to 3 ms
_REPEATS = 200


@dataclass(frozen=True)
class Target:
    """A measured value, its unit, and its bound; `relation` is `at least` or `at most`."""

    name: str
    value: float
    unit: str
    relation: str
    bound: float
    HEAD: ClassVar = ("what", "measured", "asked for", "met")

    @property
    def is_met(self) -> bool:
        """Whether the bound is kept."""
        return self.value >= self.bound if self.relation == "at least" else self.value <= self.bound

    def format_row(self) -> tuple[str, ...]:
        """Format the cells of the table, under HEAD."""
        shown = f"{self.value:.4g} {self.unit}", f"{self.relation} {self.bound:g} {self.unit}"
        return (self.name, *shown, "yes" if self.is_met else "no")


def measure_kernel_speeds(repeats: int = _REPEATS) -> tuple[float, float]:
    """Measure simulated over elapsed time [-] of the plant kernel at 10 kHz: effects off, and TEN_EFFECTS on."""
    wet_clutch.warm()
    nominal = wet_clutch.load_nominal()
    typical = {name: value for one in TEN_EFFECTS for name, value in find_effect(one).list_typical_values().items()}
    voltage = 1.36  # V: 3.4 bar
    steps = round(_KERNEL_SECONDS / wet_clutch.STEP_LIMIT)
    best = [float("inf")] * 2
    rigs = [wet_clutch.Rig(nominal), wet_clutch.Rig(nominal.with_values(typical))]
    states = [rig.fill(20.0, 343.15) for rig in rigs]
    for _ in range(repeats):
        for i, (rig, state) in enumerate(zip(rigs, states, strict=True)):
            start = time.perf_counter()
            rig.advance(state, voltage, 20.0, 40.0, _KERNEL_SECONDS, steps)
            best[i] = min(best[i], time.perf_counter() - start)
    return _KERNEL_SECONDS / best[0], _KERNEL_SECONDS / best[1]


def measure_step_times(rate: int) -> np.ndarray:
    """Measure the durations (n,) [us] of the controller's steps, decode to encode, against the plant at `rate` [Hz]."""
    plant = PlantNode(rate=rate, profile=load_profile("engagement"))
    controller = load_node("controller")(rate=rate)
    durations: list[int] = []
    commands = 0
    while not plant.finished:
        plant.take(controller.outbox, commands)
        frames = plant.show()
        plant.advance()
        start = time.perf_counter_ns()
        commands = controller.run_cycle(plant.outbox, frames)
        durations.append(time.perf_counter_ns() - start)
    return np.array(durations) / 1e3


def measure_loop(bus: str, seconds: float, quiet: bool) -> tuple[list[Target], dict[str, Any]]:
    """Measure kernel, controller and closed loop; return targets and a document. Raises InputError.

    seconds: length of the closed loop in real time on `bus` [s].
    """
    open_bus(bus).close()  # a wrong bus or length is refused before the measurement
    Scenario.of(RunSettings(seconds=seconds)).load_profile()
    off, ten_on = measure_kernel_speeds()
    steps = measure_step_times(1000)
    with TemporaryDirectory() as folder:
        loop = _run_closed_loop(bus, seconds, False, Path(folder), quiet)
        lockstep = _run_closed_loop(bus, min(seconds, 24.0), True, Path(folder), quiet)
    late = max(loop[name]["timing"]["late"] / loop[name]["timing"]["cycles"] for name in ("plant", "controller"))
    targets = [
        Target("plant kernel, 10 kHz sub-steps, all effects off", off, "x real time", "at least", 1000.0),
        Target("plant kernel, ten effects on", ten_on, "x real time", "at least", 200.0),
        Target("controller step, decode to encode, median", float(np.median(steps)), "us", "at most", 100.0),
        Target(f"late cycles, 1 kHz closed loop for {seconds:g} s", 100.0 * late, "%", "at most", 0.1),
        Target("lock-step, two processes", lockstep["speed"], "x real time", "at least", 5.0),
    ]
    percentiles = {f"p{p:g}_us": float(np.percentile(steps, p)) for p in (50, 99, 99.9)}
    document = {
        "effects_on": TEN_EFFECTS,
        "targets": [vars(target) | {"met": target.is_met} for target in targets],
        "step": percentiles,
        "loop": {name: loop[name]["timing"] for name in ("plant", "controller")},
    }
    return targets, document


def _run_closed_loop(bus: str, seconds: float, lockstep: bool, out: Path, quiet: bool) -> dict[str, Any]:
    return Bench(Scenario.of(RunSettings(seconds=seconds, out=out)), bus, lockstep).run(quiet).document


def format_loop(document: dict[str, Any]) -> str:
    """Format step time and wake-up time of the controller in the measured loop."""
    step, wake = document["step"], document["loop"]["controller"]["wake"]
    return (
        f"controller step: p50 {step['p50_us']:.0f}, p99 {step['p99_us']:.0f}, p99.9 {step['p99.9_us']:.0f} us\n"
        f"controller wake-up: p50 {wake['p50_us']:.0f}, p99 {wake['p99_us']:.0f}, p99.9 {wake['p99.9_us']:.0f}, "
        f"max {wake['max_us']:.0f} us\n"
        f"ten effects: {', '.join(document['effects_on'])}"
    )
