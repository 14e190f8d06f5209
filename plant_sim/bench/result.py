"""Result of a run: what was read and written, how well the torque followed, one verdict."""

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from plant_sim.bench.following import following
from plant_sim.bench.picture import draw_run
from protocols.frames import load_frames
from protocols.runs import read_run

_LATE_NOTED = 1e-3  # share of late cycles above which a run in real time is told to be no measure of the controller


@dataclass(frozen=True)
class Result:
    """`document` for machines, `text` for people, `verdict` and whether it is `good`."""

    document: dict[str, Any]
    text: str
    verdict: str
    good: bool


def judge_run(path: Path, read: str, timing: dict[str, Any] | None = None) -> Result:
    """Judge the run file at `path`, draw its picture beside it; `timing` comes from services in real time."""
    run = read_run(path)
    columns = dict(run.columns)
    demand = np.nan_to_num(columns["torque_demand_nm"])
    followed = following(columns["time_s"], demand, columns["truth_clutch_torque_nm"])
    faults = load_frames()["CONTROLLER_STATUS"].choices("fault")
    fault = int(np.max(np.nan_to_num(columns["controller_fault"])))
    asked, reached = bool(np.any(demand > 0.0)), bool(np.isfinite(followed.regime_error))
    good = fault == 0 and (reached or not asked)
    picture = path.with_suffix(".png")
    figures = f"regime error {followed.regime_error:.2f} Nm, rise time {followed.rise_time:.2f} s"
    draw_run(picture, columns, f"{path.stem}: {figures if reached else 'no regime'}")
    if fault:
        verdict = f"fault: {faults[fault]}"
    elif reached:
        verdict = f"torque followed, {figures}"
    else:
        verdict = "torque never reached 90 % of the demand" if asked else "no torque was asked for"
    if timing and timing["interrupted"]:
        verdict = f"interrupted after {columns['time_s'][-1]:.1f} s; {verdict}"
    document = {
        "run": str(path),
        "picture": str(picture),
        "samples": len(columns["time_s"]),
        "regime_error_nm": followed.regime_error,
        "rise_time_s": followed.rise_time,
        "fault": faults[fault],
        "verdict": verdict,
        "good": good,
    } | (timing or {})
    lines = [f"read:    {read}", f"wrote:   {path}  ({len(columns['time_s'])} samples, {len(columns)} columns)"]
    lines += [f"         {picture}", *_timing_lines(timing or {})]
    return Result(document, "\n".join(lines), verdict, good)


def _timing_lines(timing: dict[str, Any]) -> list[str]:
    lines = []
    for name in ("plant", "controller"):
        service = timing.get(name)
        if not service:
            continue
        port = service["port"]
        gated = service["frames"].values()
        lost, bad = (
            sum(sum(frame[key] for key in keys) for frame in gated) for keys in (("lost",), ("corrupt", "repeated"))
        )
        clock = service["timing"]
        if clock:
            wake, work = clock["wake"], clock["work"]
            share = 100.0 * clock["late"] / max(clock["cycles"], 1)
            lines.append(
                f"{name + ':':<12} {clock['cycles']} cycles, late {clock['late']} ({share:.3f} %), skipped {clock['skipped']};"
                f" wake-up p50 {wake['p50_us']:.0f} p99 {wake['p99_us']:.0f} max {wake['max_us']:.0f} us;"
                f" work p50 {work['p50_us']:.0f} p99 {work['p99_us']:.0f} max {work['max_us']:.0f} us"
            )
        lines.append(
            f"{'' if clock else name + ':':<12} frames sent {port['sent']}, received {port['received']}, lost {lost},"
            f" rejected {bad}, refused by full queues {port['refused']}, not sent while the bus was down {port['down']}"
        )
        if clock and clock["late"] > _LATE_NOTED * clock["cycles"]:
            lines.append(f"{'':<12} note: more than {100 * _LATE_NOTED:g} % late: timing of this run was disturbed")
        lines += [f"{'':<12} note: {text}" for text in service["not_available"]]
        if service["telemetry"] not in ("ended", "off"):
            lines.append(f"{'':<12} note: telemetry {service['telemetry']}")
    if "speed" in timing:
        lines.append(f"speed:       {timing['speed']:.1f} x real time")
    return lines
