"""A hand-over of torque on the power-shift rig: in one process, or as three processes on a bus; recorded, drawn, judged."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from clutch_hil.bench.label import Label
from clutch_hil.bench.limits import Limit, judged
from clutch_hil.bench.metadata import run_metadata
from clutch_hil.bench.power_shift_measures import MEASURES, handover
from clutch_hil.bench.recording import Recording, run_path, writable
from clutch_hil.bench.result import Result, fault_lines, timing_lines, title
from clutch_hil.bench.scenario import Scenario, naming
from clutch_hil.bench.shift_picture import draw_shift
from clutch_hil.bench.status import StatusLine
from clutch_hil.bench.up import Bench
from plant_sim.node.power_shift_node import COLUMNS, PowerShiftNode
from plant_sim.profiles.shift_profile import load_shift_profile
from protocols.can.bus_load import BITRATES, bus_load
from protocols.can.fault_text import faults_of
from protocols.can.frames import bus_frames
from protocols.can.two_clutches import CLUTCHES
from protocols.files.runs import read_run
from protocols.realtime.ring import RingReader

_TOLD_EVERY = 500  # cycles between two calls of `progress`


class ShiftSimulation:
    """A hand-over in one process, frame by frame as on a bus. Raises InputError when it cannot be: nothing has run then."""

    def __init__(self, scenario: Scenario) -> None:
        self.scenario, self.label = scenario, Label.of(scenario)
        settings = scenario.settings
        with naming(scenario.path):
            self.profile = load_shift_profile(settings.profile, settings.seconds)
            self._plant = PowerShiftNode(
                settings.rate, scenario.plant, self.profile, settings.seed, settings.temperature,
                injections=scenario.injections,
            )  # fmt: skip
            self._controllers = [settings.new_controller(clutch) for clutch in CLUTCHES]

    def run(self, progress: Callable[[int, int], None]) -> Result:
        """Simulate; write the run file and its picture."""
        scenario, settings = self.scenario, self.scenario.settings
        writable(settings.out)
        cycles = round(self.profile.duration * settings.rate)
        rows = self.play(lambda cycle: progress(cycle, cycles))
        path = run_path(settings.out, f"{self.label.name}-simulated")
        columns = [controller.columns for controller in self._controllers]
        with Recording(path, COLUMNS, columns[0], settings.rate, columns[1]) as recording:
            recording.add(*rows)
            parameters = [controller.parameters.as_values() for controller in self._controllers]
            recording.finish(
                _metadata(scenario, parameters, self._plant.injected)
                | {"settings": settings.as_text() | {"mode": "in process"}, "scenario": scenario.name}
            )
        return judge_shift(
            path, f"{self.label.read(self.profile.duration)}, in one process, {settings.rate} Hz", scenario.limits
        )

    def play(self, progress: Callable[[int], None] | None = None) -> list[np.ndarray]:
        """Play the profile to its end, once; the records of plant, controller a and controller b, (cycles, columns)."""
        nodes: list[Any] = [self._plant, *self._controllers]
        rows: list[list[np.ndarray]] = [[] for _ in nodes]
        commands = [0] * len(self._controllers)
        while not self._plant.finished:
            for controller, count in zip(self._controllers, commands, strict=True):
                self._plant.take(controller.outbox, count)
            sensors = self._plant.show()
            self._plant.advance()
            # what the other has said since the sample before comes first, as on a bus
            heard = [
                np.concatenate([other.outbox[:count], self._plant.outbox[:sensors]])
                for other, count in zip(reversed(self._controllers), reversed(commands), strict=True)
            ]
            commands = [
                controller.cycle(inbox, len(inbox)) for controller, inbox in zip(self._controllers, heard, strict=True)
            ]
            for record, node in zip(rows, nodes, strict=True):
                record.append(node.record.copy())
            if progress and self._plant.tick % _TOLD_EVERY == 0:
                progress(self._plant.tick)
        return [np.array(record) for record in rows]


@dataclass(frozen=True)
class ShiftBench(Bench):
    """A hand-over by three processes: the plant and a controller for each clutch; arguments as of `Bench`."""

    def _commands(self, bus: str, cpus: list[int], folder: Path) -> dict[str, list[str]]:
        commands = super()._commands(bus, cpus, folder)
        controller = commands["controller"]
        return {
            "plant": [*commands["plant"], "--rig", self.scenario.rig],
            "controller": [*controller, "--clutch", "a"],
            "controller_b": [*controller, "--clutch", "b"],
        }

    def _recording(self, path: Path, rings: Sequence[RingReader]) -> Recording:
        plant, a, b = (ring.columns for ring in rings)
        return Recording(path, plant, a, self.scenario.settings.rate, b)

    def _metadata(self, timing: dict[str, Any]) -> dict[str, Any]:
        controllers = [timing["controller"], timing["controller_b"]]
        for summary in controllers:
            summary.pop("injections")
        parameters = [summary.pop("parameters") for summary in controllers]
        return _metadata(self.scenario, parameters, timing["plant"].pop("injections"))

    def _judged(self, path: Path, read: str, timing: dict[str, Any]) -> Result:
        return judge_shift(path, read, self.scenario.limits, timing)

    def _status(self, rings: Sequence[RingReader], duration: float, quiet: bool) -> StatusLine:
        return _ShiftStatus(rings[0].columns, rings[1].columns, duration, quiet)


class _ShiftStatus(StatusLine):
    """Input and vehicle speed, both torques, output torque."""

    def _text(self, plant: np.ndarray, controller: np.ndarray) -> str:
        p = {name: plant[i] for name, i in self._plant.items()}
        return (
            f"{p['time_s']:6.1f}{self._of} s  {self._rate:5.0f} Hz  input {p['truth_input_speed_rad_s']:5.2f} rad/s"
            f"  vehicle {p['truth_vehicle_speed_m_s']:5.2f} m/s  torque a {p['truth_clutch_torque_a_nm']:5.2f}"
            f"  b {p['truth_clutch_torque_b_nm']:5.2f}  output {p['truth_output_torque_nm']:5.2f} Nm"
        )


def judge_shift(path: Path, read: str, limits: Sequence[Limit] = (), timing: dict[str, Any] | None = None) -> Result:
    """Judge the run file at `path`, draw its picture beside it; `timing` comes from services in real time."""
    run = read_run(path, [column.name for column in COLUMNS])
    columns = dict(run.columns)
    measured = {name: measure.of(columns) for name, measure in MEASURES.items()}
    shift, fault = handover(columns), str(measured["fault"])
    good = fault == "none" and shift is not None and shift.shift_end is not None
    figures = (
        f"torque gap {100 * measured['torque_gap']:.1f} %, peak {100 * measured['torque_peak']:.1f} %,"
        f" shift time {measured['shift_time_s']:.2f} s"
    )
    faults = [
        faults_of(columns, run.metadata["sample_rate_hz"], run.metadata.get(parameters, {}), clutch)
        for clutch, parameters in zip(CLUTCHES, ("controller_parameters", "controller_b_parameters"), strict=True)
    ]
    if fault != "none":
        verdict = "; ".join(watch.verdict for watch in faults if watch.count)
    elif shift is None:
        verdict = "no torque was handed over"
    elif shift.shift_end is None:
        verdict = f"the shift did not end: torque gap {100 * measured['torque_gap']:.1f} %"
    else:
        verdict = f"torque handed over, {figures}, heat {measured['heat_a_j']:.0f} J in a and {measured['heat_b_j']:.0f} J in b"
    picture = path.with_suffix(".png")
    document = {
        "run": str(path),
        "picture": str(picture),
        "samples": len(columns["time_s"]),
        **measured,
        "effects": run.metadata.get("effects", []),
        "verdict": verdict,
        "good": good,
    } | (timing or {})
    lines = [f"read:    {read}", f"wrote:   {path}  ({len(columns['time_s'])} samples, {len(columns)} columns)"]
    lines += [f"         {picture}", *timing_lines(timing or {})]
    if on := run.metadata.get("effects"):
        lines.append(f"effects: {', '.join(on)}")
    lines += _load_lines(run.metadata["sample_rate_hz"])
    lines += [f"{'shift:' if not i else '':<9}{text}" for i, text in enumerate(_shift_lines(measured))]
    lines += fault_lines(faults) if limits else []
    result = Result(document, "\n".join(lines), verdict, good).limited(judged(limits, columns))
    draw_shift(picture, columns, title(path, verdict.partition(", heat")[0], result))
    return result.interrupted(columns["time_s"][-1]) if timing and timing["interrupted"] else result


def _shift_lines(measured: dict[str, Any]) -> list[str]:
    rows = []
    for name, value in measured.items():
        measure = MEASURES[name]
        said = value if measure.words else f"{value:.4g} {'' if measure.unit == '1' else measure.unit}"
        rows.append(f"{name:<{max(map(len, MEASURES))}}  {said:<12}  {measure.what}")
    return rows


def _load_lines(rate: int) -> list[str]:
    """What a real bus would say, where it would not bear this."""
    load = bus_load(bus_frames(clutches=len(CLUTCHES)), rate, max(BITRATES))
    if load <= 1.0:
        return []
    return [f"note:    two clutches at {rate} Hz fill {100 * load:.0f} % of a bus of {max(BITRATES) // 1000} kbit/s"]


def _metadata(scenario: Scenario, controllers: Sequence[dict[str, float]], injections: Any) -> dict[str, Any]:
    a, b = controllers
    told = run_metadata(scenario.settings.rate, scenario.plant, a, injections, scenario.rig)
    return told | {"controller_b_parameters": b}
