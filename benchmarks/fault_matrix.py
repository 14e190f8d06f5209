"""Fault matrix: plays and judges every case of `fault_cases`: time to the safe state, torque, recording.

    python -m benchmarks.fault_matrix                       # in one process; cases of processes are left out
    python -m benchmarks.fault_matrix --bus local:faults    # plant and controller as services on a bus
    python -m benchmarks.fault_matrix --bus local:faults --clock    # also those that set the time of this computer
    python -m benchmarks.fault_matrix --bus vcan0                   # also those that take the interface down

A case is a scenario as a user writes it. In its run file the valve voltage shows when the valve is closed, and the true torque
the state of the clutch.
"""

import json
import tempfile
import time
from collections.abc import Callable, Mapping
from contextlib import suppress
from copy import copy
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
import typer

from benchmarks.fault_cases import AT, DEMAND, Borne, Either, FaultCase, PlantGone, RunEnds, Safe, list_fault_cases
from clutch_hil.bench.faults.interface import InterfaceDown
from clutch_hil.bench.progress import format_table, progress_bar
from clutch_hil.bench.recovery import recover_folder
from clutch_hil.bench.scenario import Scenario, load_scenario
from clutch_hil.bench.simulate import Simulation
from clutch_hil.bench.up import POLL, Bench
from clutch_hil.command import check_rate, report, run_command
from protocols.errors import InputError
from protocols.files.runs import read_run
from protocols.realtime.stopping import Stop

RATE = 1000  # Hz, control rate for which the limits of the cases hold
_CLOSING = 0.06  # s from the closed valve to the open clutch: measured 23 to 37 ms
_OPEN = 0.1  # Nm, highest torque of an open clutch
_SETTLED = 1.0  # s from which the clutch slips in every run
_NEAR = 0.5  # Nm, deviation from the demand at the end of a run that tolerated the fault


@dataclass(frozen=True)
class Judged:
    """Result of a case. safe_after [s] is None if the valve did not close; highest [Nm]: highest torque after the fault.

    wrong: violated requirements; empty if none. tries: number of runs; all but the last were disturbed by the machine.
    """

    case: FaultCase
    safe_after: float | None
    highest: float
    wrong: str
    tries: int = 1

    def format_row(self) -> tuple[str, ...]:
        """Return the cells of the table."""
        limit = f"{1e3 * self.case.outcome.within:.0f}" if isinstance(self.case.outcome, Safe | RunEnds) else "-"
        after = "-" if self.safe_after is None else f"{1e3 * self.safe_after:.0f}"
        return self.case.name, type(self.case.outcome).__name__.lower(), after, limit, f"{self.highest:.1f}", self.wrong


_TRIES = 3  # runs of a case, if the machine disturbs them
_WAKES = "plant_wake_us", "controller_wake_us"
_MOST_WAKE = 5000.0  # us; a single gap of commands of 9 ms is tolerated, and adds up to 3 Nm
HEAD = ("fault", "outcome", "safe after [ms]", "limit [ms]", "highest [Nm]", "wrong")


def play_in_process(case: FaultCase, folder: Path, rate: int) -> tuple[Mapping[str, np.ndarray], float]:
    """Play a case in one process at `rate` [Hz]; return the columns of its run, and the time [s] of the fault."""
    played, metadata = Simulation(_write_scenario(case, folder, rate)).play_with_metadata()
    return played.make_columns(), min(change["row"] for change in metadata["injections"]) / rate


def play_on_bus(case: FaultCase, folder: Path, rate: int, bus: str) -> tuple[Mapping[str, np.ndarray], float]:
    """Play a case by services on `bus` at `rate` [Hz]; return the columns of its run file, and the time [s] of the fault."""
    bench = Bench(_write_scenario(case, folder, rate), bus)
    if isinstance(case.outcome, RunEnds):
        return _play_to_error(bench)
    with Stop() as stop, bench.start(stop, lambda _: None) as session:
        while not (stop.asked or session.over):
            session.step()
            time.sleep(POLL)
        session.finish(interrupted=stop.asked)
        stop.check("the case was interrupted")
    run = read_run(session.path)
    begins = [change["row"] / rate for change in run.metadata["injections"]]
    begins += [one["time_s"] for one in run.metadata["bench_faults"]]
    return run.columns, min(begins)


def _play_to_error(bench: Bench) -> tuple[Mapping[str, np.ndarray], float]:
    """Play a case whose run may end with an error; return the plant's columns to the end of its process, and `AT`.

    The column `recovered` marks the samples that can be recovered from the run.
    """
    with Stop() as stop:
        with suppress(InputError), bench.start(stop, lambda _: None) as session:
            witness = copy(session.rings[0])  # it has the rows of the plant up to its end
            while not (stop.asked or session.over):
                session.step()
                time.sleep(POLL)
            session.finish(interrupted=stop.asked)
        stop.check("the case was interrupted")
    recover_folder(session.path.parent, lambda _: None)
    rows = witness.read()
    columns = dict(zip((column.name for column in witness.columns), rows.T, strict=True))
    return columns | {"recovered": read_run(session.path)["time_s"], "controller_fault": np.zeros(len(rows))}, AT


def is_disturbed(columns: Mapping[str, np.ndarray], begin: float, rate: int) -> bool:
    """Return whether a run had a fault or no torque before its fault began at `begin` [s], because the machine stood still."""
    before = slice(round(_SETTLED * rate), round(begin * rate))
    return bool(
        columns["controller_fault"][before].any() or np.abs(columns["truth_clutch_torque_nm"][before]).min() < _OPEN
    )


def was_stalled(columns: Mapping[str, np.ndarray]) -> bool:
    """Return whether the machine delayed plant or controller by more than the shortest gap that closes the valve."""
    longest = [float(np.nanmax(columns[name])) for name in _WAKES if name in columns]
    return max(longest, default=0.0) > _MOST_WAKE


def judge(case: FaultCase, columns: Mapping[str, np.ndarray], begin: float, rate: int) -> Judged:
    """Judge the columns of the run of a case at `rate` [Hz], whose fault began at `begin` [s]."""
    time_s, torque, outcome = columns["time_s"], columns["truth_clutch_torque_nm"], case.outcome
    first = round(begin * rate)
    highest = float(np.abs(torque[first:]).max(initial=0.0))
    wrong = [_find_gap(time_s, first if isinstance(outcome, PlantGone | RunEnds) else round(case.seconds * rate), rate)]
    opened = np.flatnonzero(columns["valve_voltage_v"] > 0.0)
    closed = int(opened[-1]) + 1 if len(opened) else 0
    safe_after = max(closed - first, 0) / rate if closed < len(time_s) else None
    if isinstance(outcome, PlantGone):
        return Judged(case, None, highest, "; ".join(filter(None, wrong)))
    if isinstance(outcome, RunEnds):
        wrong.append(_find_gap(columns["recovered"], first, rate))
        wrong.append(
            "the valve stays open" if safe_after is None else "too late" if safe_after > outcome.within else ""
        )
        return Judged(case, safe_after, highest, "; ".join(filter(None, wrong)))
    wrong.append("" if highest <= outcome.highest else f"torque above {outcome.highest:g} Nm")
    if isinstance(outcome, Safe) or (isinstance(outcome, Either) and safe_after is not None):
        wrong += [
            _find_unsafe(columns, closed, safe_after, outcome.within if isinstance(outcome, Safe) else None, rate)
        ]
    else:
        wrong.append("" if safe_after is None else "the valve closed")
        wrong.append("" if not columns["controller_fault"][first:].any() else "the controller has a fault")
        off = abs(float(np.abs(torque[-1])) - DEMAND)
        near = _NEAR if isinstance(outcome, Borne) else outcome.highest - DEMAND
        wrong.append("" if off <= near else f"torque {off:.1f} Nm off at the end")
    return Judged(case, safe_after, highest, "; ".join(filter(None, wrong)))


def _find_unsafe(
    columns: Mapping[str, np.ndarray], closed: int, safe_after: float | None, within: float | None, rate: int
) -> str:
    """Return the violated requirement of the safe state; the valve is closed from row `closed` on. Empty if none."""
    if safe_after is None:
        return "the valve stays open"
    if within is not None and safe_after > within:
        return "too late"
    after = np.abs(columns["truth_clutch_torque_nm"][closed + round(_CLOSING * rate) :])
    return "" if after.max(initial=0.0) < _OPEN else "the clutch does not open"


def _find_gap(time_s: np.ndarray, rows: int, rate: int) -> str:
    """Return what is missing in the first `rows` of a recording; empty if nothing."""
    if len(time_s) < rows - 1:
        return f"{len(time_s)} rows of {rows} recorded"
    return "" if np.array_equal(np.rint(time_s * rate), np.arange(len(time_s))) else "rows are missing"


def _write_scenario(case: FaultCase, folder: Path, rate: int) -> Scenario:
    """Write the scenario of a case, with its profile, into `folder`, and load it."""
    (folder / "case.csv").write_text(case.profile, encoding="utf-8")
    lines = [
        f"title = {json.dumps(case.name)}",
        "[run]",
        'profile = "case.csv"',
        f"seconds = {case.seconds}",
        f"rate = {rate}",
    ]
    for entry in case.entries:
        times = {"at": AT} | ({"until": AT + entry["until"]} if "until" in entry else {})
        lines += ["[[inject]]", *(f"{name} = {_format_value(value)}" for name, value in (entry | times).items())]
    path = folder / "case.toml"
    path.write_text("\n".join(lines) + "\n", encoding="utf-8")
    return load_scenario(str(path), {"out": folder / "runs"})


def _format_value(value: Any) -> str:
    if isinstance(value, Mapping):
        return "{ " + ", ".join(f"{name} = {_format_value(one)}" for name, one in value.items()) + " }"
    return json.dumps(value)


def play_matrix(
    cases: list[FaultCase],
    bus: str | None,
    rate: int = RATE,
    progress: Callable[[int, int], None] = lambda done, of: None,
) -> list[Judged]:
    """Play and judge cases at `rate` [Hz], on `bus`, or in one process if it is None."""
    judged = []
    with tempfile.TemporaryDirectory() as parent:
        for number, case in enumerate(cases):
            folder = Path(parent) / str(number)
            folder.mkdir()
            for tries in range(1, _TRIES + 1):
                played = play_in_process(case, folder, rate) if bus is None else play_on_bus(case, folder, rate, bus)
                result = replace(judge(case, *played, rate), tries=tries)
                wrong_by_machine = bool(result.wrong) and not case.stops and was_stalled(played[0])
                if not (is_disturbed(*played, rate) or wrong_by_machine):
                    break
            judged.append(result)
            progress(number + 1, len(cases))
    return judged


def fault_matrix(
    bus: str | None = typer.Option(None, help="bus to play on by services; in one process if not given"),
    only: str = typer.Option("", help="cases whose name contains this"),
    rate: int = typer.Option(RATE, help="of samples, in Hz; the limits are those of the default"),
    clock: bool = typer.Option(False, help="also the cases that set the time of this computer for 1 s"),
    json_output: bool = typer.Option(False, "--json", help="print the result as JSON"),
) -> None:
    """Play every fault case and judge it: time to the safe state, highest torque, recording."""
    cases = [case for case in list_fault_cases() if only in case.name and (bus is not None or not case.live)]
    if not clock:
        cases = [case for case in cases if not any(entry.get("host_fault") == "clock_step" for entry in case.entries)]
    left_out = ""
    try:
        InterfaceDown.check(bus or "", telemetry=True)
    except InputError as error:  # refuse before the first case is played
        if any(case.needs_interface for case in cases):
            left_out = f"; left out: {error}"
        cases = [case for case in cases if not case.needs_interface]
    if not cases:
        raise InputError(f"--only is {only!r}, which no case contains that can be played here")
    with progress_bar("fault cases", json_output) as progress:
        judged = play_matrix(cases, bus, check_rate(rate), progress)
    wrong = [one for one in judged if one.wrong]
    rows = [HEAD, *(one.format_row() for one in judged)]
    document = {
        "bus": bus, "rate_hz": rate,
        "cases": [dict(zip(("name", "outcome", "safe_after_ms", "limit_ms", "highest_nm", "wrong"), row, strict=True))
                  for row in rows[1:]],
    }  # fmt: skip
    verdict = f"{len(judged) - len(wrong)} of {len(judged)} cases as they must be, {bus or 'in one process'}"
    if again := sum(one.tries - 1 for one in judged):
        verdict += f"; {again} runs, disturbed by the machine, were played again"
    verdict += left_out
    report(document | {"verdict": verdict}, format_table(rows), verdict, not wrong, json_output)


if __name__ == "__main__":
    run_command(fault_matrix)
