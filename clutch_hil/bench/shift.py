"""Runs of the power-shift rig, hand-overs of torque: their status line, judgement and picture."""

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from clutch_hil.bench.judgement.calibration_check import (
    describe_failed_fill,
    describe_shift_mismatch,
    describe_slow_valve,
)
from clutch_hil.bench.judgement.declared_clutch import list_contradictions
from clutch_hil.bench.judgement.other_rig import describe_other_rig
from clutch_hil.bench.judgement.power_shift_measures import MEASURES, find_handover
from clutch_hil.bench.limits import Limit, judge_limits
from clutch_hil.bench.pictures.shift_picture import draw_shift
from clutch_hil.bench.result import (
    Result,
    format_bench_faults,
    format_faults,
    format_timing,
    had_process_fault,
    make_title,
)
from clutch_hil.bench.status import StatusLine
from plant_sim.node.power_shift_node import COLUMNS
from protocols.can.bus_load import BITRATES, compute_bus_load
from protocols.can.fault_text import watch_run
from protocols.can.frames import list_bus_frames
from protocols.can.two_clutches import CLUTCHES, CONTROLLERS
from protocols.files.long_run import open_run
from protocols.files.units import space_unit


class ShiftStatus(StatusLine):
    """Status line with input and vehicle speed, both clutch torques and output torque."""

    def _format(self, plant: np.ndarray, controller: np.ndarray) -> str:
        p = {name: plant[i] for name, i in self._plant.items()}
        return (
            f"{p['time_s']:6.1f}{self._of_duration} s  {self._rate:5.0f} Hz  input {p['truth_input_speed_rad_s']:5.2f} rad/s"
            f"  vehicle {p['truth_vehicle_speed_m_s']:5.2f} m/s  torque a {p['truth_clutch_torque_a_nm']:5.2f}"
            f"  b {p['truth_clutch_torque_b_nm']:5.2f}  output {p['truth_output_torque_nm']:5.2f} Nm"
        )


def judge_shift(path: Path, read: str, limits: Sequence[Limit] = (), timing: dict[str, Any] | None = None) -> Result:
    """Judge the run file at `path`, draw its picture beside it; `timing` comes from services in real time."""
    run = open_run(path, [column.name for column in COLUMNS])
    columns = run.columns
    measured = {name: measure.of(columns) for name, measure in MEASURES.items()}
    shift, fault = find_handover(columns), str(measured["fault"])
    good = fault == "none" and shift is not None and shift.shift_end is not None
    figures = (
        f"torque gap {100 * measured['torque_gap']:.1f} %, peak {100 * measured['torque_peak']:.1f} %,"
        f" shift time {measured['shift_time_s']:.2f} s"
    )
    parameters = [run.metadata.get(f"{controller}_parameters", {}) for controller in CONTROLLERS]
    faults = [
        watch_run(columns, run.metadata["sample_rate_hz"], values, clutch)
        for clutch, values in zip(CLUTCHES, parameters, strict=True)
    ]
    # a controller that was killed or stopped no longer estimates
    mismatch = None if had_process_fault(run.metadata) else describe_shift_mismatch(columns, parameters[0])
    plant = run.metadata.get("plant_parameters", {})
    failed = [
        describe_other_rig(values, plant, f"{clutch}.")
        or describe_slow_valve(fault, values, plant, f"{clutch}.")
        or describe_failed_fill(fault, values)
        for clutch, watch, values in zip(CLUTCHES, faults, parameters, strict=True)
        if watch.count
    ]
    mismatch = next(filter(None, failed), None) or mismatch
    warnings = [
        *filter(None, [mismatch]),
        *(text for clutch in CLUTCHES for text in list_contradictions(plant, f"{clutch}.")),
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
        "calibration": mismatch,
        "warnings": warnings,
        "verdict": verdict,
        "good": good,
    } | (timing or {})
    lines = [f"read:    {read}", f"wrote:   {path}  ({len(columns['time_s'])} samples, {len(columns)} columns)"]
    lines += [f"         {picture}", *format_timing(timing or {})]
    if on := run.metadata.get("effects"):
        lines.append(f"effects: {', '.join(on)}")
    lines += format_bench_faults(run.metadata)
    lines += _load_lines(run.metadata["sample_rate_hz"])
    lines += [f"{'shift:' if not i else '':<9}{text}" for i, text in enumerate(_describe_shift(measured))]
    lines += format_faults(faults) if limits else []
    lines += [f"warning: {text}" for text in warnings]
    result = Result(document, "\n".join(lines), verdict, good).with_limits(judge_limits(limits, columns))
    draw_shift(picture, columns, make_title(path, verdict.partition(", heat")[0], result))
    return result.mark_end(columns["time_s"][-1], run.metadata, timing)


def _describe_shift(measured: dict[str, Any]) -> list[str]:
    rows = []
    for name, value in measured.items():
        measure = MEASURES[name]
        text = value if measure.words else f"{value:.4g}{space_unit(measure.unit)}"
        rows.append(f"{name:<{max(map(len, MEASURES))}}  {text:<12}  {measure.what}")
    return rows


def _load_lines(rate: int) -> list[str]:
    """Return a note where a real bus is too slow for these frames."""
    load = compute_bus_load(list_bus_frames(clutches=len(CLUTCHES)), rate, max(BITRATES))
    if load <= 1.0:
        return []
    return [f"note:    two clutches at {rate} Hz fill {100 * load:.0f} % of a bus of {max(BITRATES) // 1000} kbit/s"]
