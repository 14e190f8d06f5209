"""Result of a run: what was read and written, how well the torque followed its demand, and one verdict."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from textwrap import shorten
from typing import Any

import numpy as np

from clutch_hil.bench.faults.process_fault import ProcessFault
from clutch_hil.bench.judgement.calibration_check import (
    describe_coarse_pressure,
    describe_failed_fill,
    describe_late_piston,
    describe_mismatch,
    describe_slow_valve,
)
from clutch_hil.bench.judgement.declared_clutch import list_contradictions
from clutch_hil.bench.judgement.following import REACHED_SHARE, Following
from clutch_hil.bench.judgement.measures import MEASURES, find_highest_demand, measure_following
from clutch_hil.bench.judgement.other_rig import describe_hot_oil, describe_other_rig, describe_weak_motor
from clutch_hil.bench.limits import Judgement, Limit, judge_limits
from clutch_hil.bench.metadata import list_injection_times
from clutch_hil.bench.pictures.picture import draw_run
from clutch_hil.bench.sealed import SEAL
from clutch_hil.bench.service_text import format_service
from protocols.can.fault_text import WAITS_FOR_IDLE, FaultWatch, waits_for_idle, watch_run
from protocols.can.two_clutches import CONTROLLERS
from protocols.files.long_run import open_run

# Of the highest demand: regime error above which the torque followed poorly. It is at most 5 % in shipped scenarios without
# a fault, except with a motor that gives no torque (34 %); a pressure sensor with an error of 0.5 bar gives 37 %
_POOR_SHARE = 1.0 - REACHED_SHARE
_LIMITED_SHARE = 0.1  # of the samples with a demand: a fill is at the voltage limit for a smaller share
# Fault of a process that ends a run before its profile, as named in the metadata
PLANT_KILLED = ProcessFault("plant", "kill", at=0.0).what
_TITLE_WIDTH = 130  # characters that fit above the picture


@dataclass(frozen=True)
class Result:
    """document: for JSON. text: for people. verdict: one line. good: the verdict as a bool. judgements: of the limits."""

    document: dict[str, Any]
    text: str
    verdict: str
    good: bool
    judgements: tuple[Judgement, ...] = ()

    def with_limits(self, judgements: Sequence[Judgement]) -> "Result":
        """Return this result with its verdict from limits alone; unchanged without `judgements`."""
        if not judgements:
            return self
        broken = [judgement for judgement in judgements if not judgement.holds]
        holding = "1 limit holds" if len(judgements) == 1 else f"{len(judgements)} limits hold"
        verdict = f"failed: {'; '.join(map(str, broken))}" if broken else f"passed: {holding}"
        lines = [
            f"{'limits:' if not i else '':<9}{'BROKEN' if j in broken else 'holds '}  {j}"
            for i, j in enumerate(judgements)
        ]
        return replace(
            self,
            document=self.document
            | {"limits": [j.make_document() for j in judgements], "verdict": verdict, "good": not broken},
            text="\n".join([self.text, *lines]),
            verdict=verdict,
            good=not broken,
            judgements=tuple(judgements),
        )

    def mark_end(self, seconds: float, metadata: Mapping[str, Any], timing: Mapping[str, Any] | None) -> "Result":
        """Return this result of a run of `seconds` [s] with the cause of an early end, if there is one.

        An interrupted run with limits is not good. A run whose plant was killed is good only by its limits.
        """
        if timing and timing["interrupted"]:
            why, good = f"interrupted after {seconds:.1f} s", self.good and not self.judgements
        elif had_process_fault(metadata, PLANT_KILLED):
            why, good = (
                f"ended after {seconds:.1f} s, because the plant was killed",
                self.good and bool(self.judgements),
            )
        else:
            return self
        verdict = f"{why}; {self.verdict}"
        return replace(self, document=self.document | {"verdict": verdict, "good": good}, verdict=verdict, good=good)


def format_faults(watches: Sequence[FaultWatch]) -> list[str]:
    """Return a line for each controller that had a fault."""
    return [f"faults:  {watch.verdict}" for watch in watches if watch.count]


def judge_run(path: Path, read: str, limits: Sequence[Limit] = (), timing: dict[str, Any] | None = None) -> Result:
    """Judge the run file at `path`, and draw its picture beside it.

    read: description of the input. timing: summaries of the services; None for a simulation. In a run recorded blind, the
    measured torque replaces the true one.
    """
    run = open_run(path)
    columns = run.columns
    course, fault, locked = measure_following(columns), MEASURES["fault"].of(columns), MEASURES["locked_s"].of(columns)
    demanded, reached = bool(np.any(columns["torque_demand_nm"] > 0.0)), bool(np.isfinite(course.regime_error))
    parameters = run.metadata.get("controller_parameters", {})
    faults = watch_run(columns, run.metadata["sample_rate_hz"], parameters)
    good = fault == "none" and (reached or not demanded) and locked != 0.0
    rig = run.metadata.get("plant_parameters", {})
    # a controller that was killed or stopped no longer estimates
    mismatch = None if had_process_fault(run.metadata) else describe_mismatch(columns, parameters)
    poor = reached and course.regime_error > _POOR_SHARE * find_highest_demand(columns)
    advice = None
    if not good or poor:
        # what has its own cause goes before the sentence on the calibration, which would blame the friction maps
        cause = describe_coarse_pressure(fault, columns, parameters) or describe_late_piston(fault, columns)
        cause = cause or describe_slow_valve(fault, parameters, rig, poor=poor)
        advice = describe_other_rig(parameters, rig)
        mismatch = cause or mismatch or advice or describe_failed_fill(fault, parameters)
    told = dict.fromkeys(filter(None, (mismatch, advice)))
    warnings = [
        *told,
        *filter(None, (describe_weak_motor(columns, rig), describe_hot_oil(fault, columns, rig))),
        *list_contradictions(parameters),
        *list_contradictions(rig),
    ]
    if fault != "none":
        verdict = faults.verdict or f"fault: {fault}"
    elif locked == 0.0:
        verdict = "the clutch was to be locked, but its plates never stopped"
    elif reached:
        verdict = _describe_following(course, highest := find_highest_demand(columns))
        verdict += _describe_limited(columns) if course.regime_error > _POOR_SHARE * highest else ""
        verdict += f"; locked for {locked:.2f} s" if np.isfinite(locked) else ""
    elif demanded:
        verdict = f"torque never reached 90 % of the demand{_describe_limited(columns)}"
        if _stays_idle(columns):
            verdict += f": {WAITS_FOR_IDLE}"
    elif np.isfinite(locked):
        verdict = f"locked for {locked:.2f} s"
    elif np.isfinite(error := MEASURES["pressure_error_bar"].of(columns)):
        verdict = f"pressure followed, mean error {error:.3f} bar"
    elif _stays_idle(columns):
        verdict, good = f"the clutch never closed: {WAITS_FOR_IDLE}", False
    else:
        verdict = "no torque was demanded"
    picture = path.with_suffix(".png")
    document = {
        "run": str(path),
        "picture": str(picture),
        "samples": len(columns["time_s"]),
        "regime_error_nm": course.regime_error,
        "rise_time_s": course.rise_time,
        "fault": fault,
        "faults": faults.count,
        "first_fault": faults.first.line if faults.first else None,
        "calibration": mismatch,
        "warnings": warnings,
        "verdict": verdict,
        "good": good,
    } | (timing or {})
    lines = [f"read:    {read}", f"wrote:   {path}  ({len(columns['time_s'])} samples, {len(columns)} columns)"]
    if SEAL in run.metadata:
        lines.append(f"         {path.with_name(run.metadata[SEAL]['file'])}  (sealed: the truth)")
    lines += [f"         {picture}", *format_timing(timing or {})]
    if on := run.metadata.get("effects"):
        lines.append(f"effects: {', '.join(on)}")
    if injected := list_injection_times(run.metadata):
        lines.append(f"injections: {len(injected)}, the first at {injected[0]:.3f} s")
    lines += format_bench_faults(run.metadata)
    if requests := run.metadata.get("requests"):
        askers = ", ".join(sorted({request["by"] for request in requests}))
        lines.append(f"requests: {len(requests)} accepted from others while it ran, by {askers}")
    lines += format_faults([faults]) if limits else []  # without limits the verdict names the faults
    lines += [f"warning: {text}" for text in warnings]
    result = Result(document, "\n".join(lines), verdict, good).with_limits(judge_limits(limits, columns))
    draw_run(picture, columns, make_title(path, verdict, result), injected)
    return result.mark_end(columns["time_s"][-1], run.metadata, timing)


def _describe_following(course: Following, demand: float) -> str:
    """Return how well a torque followed that reached its demand, whose maximum is `demand` [Nm]."""
    error, rise = f"regime error {course.regime_error:.2f} Nm", f"rise time {course.rise_time:.2f} s"
    if course.regime_error <= _POOR_SHARE * demand:
        return f"torque followed, {error}, {rise}"
    return (
        f"torque followed poorly, {error} ({100.0 * course.regime_error / demand:.0f} % of the highest demand), {rise}"
    )


def _describe_limited(columns: Mapping[str, np.ndarray]) -> str:
    """Return the share of samples with a demand in which a pressure or voltage limit was active; "" for a small share."""
    demanded = columns["torque_demand_nm"] > 0.0
    limited = columns.get("controller_saturated", np.zeros(len(demanded)))[demanded] > 0.0
    share = float(np.mean(limited)) if len(limited) else 0.0
    if share <= _LIMITED_SHARE:
        return ""
    return (
        f"; in {100.0 * share:.0f} % of the samples with a demand the controller was at its pressure or voltage"
        " limit (torque.pressure_limit, pressure.voltage_limit)"
    )


def _stays_idle(columns: Mapping[str, np.ndarray]) -> bool:
    """Return whether the controller was asked to close the clutch but stayed idle to the end."""
    return waits_for_idle(
        float(columns["controller_phase"][-1]), float(columns["controller_request"][-1])
    ) and not np.any(columns["controller_phase"] > 0.0)


def make_title(path: Path, verdict: str, result: Result) -> str:
    """Return the title of a run's picture: its name and verdict, and the verdict of its limits if it has any."""
    lines = [f"{path.stem}: {verdict}"] + ([result.verdict] if result.judgements else [])
    return "\n".join(shorten(line, _TITLE_WIDTH, placeholder=" ...") for line in lines)


def had_process_fault(metadata: Mapping[str, Any], what: str | None = None) -> bool:
    """Return whether a service was killed or stopped during a run; `what` restricts this to one such fault, by its `what`."""
    faults = [one["fault"] for one in metadata.get("bench_faults", ()) if one["kind"] == ProcessFault.kind]
    return what in faults if what else bool(faults)


def format_bench_faults(metadata: Mapping[str, Any]) -> list[str]:
    """Format the faults of processes and of the computer during a run."""
    log = metadata.get("bench_faults", ())
    return [f"fault:   {one['fault']}, {one['does']} at {one['time_s']:.3f} s" for one in log]


def format_timing(timing: dict[str, Any]) -> list[str]:
    """Format the summaries of the services."""
    lines = []
    for name in ("plant", *CONTROLLERS):
        if timing.get(name):
            lines += format_service(name, timing[name])
    if "speed" in timing:
        lines.append(f"speed:       {timing['speed']:.1f} x real time")
    return lines
