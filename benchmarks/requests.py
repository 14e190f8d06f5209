"""Requests: what valid requests over telemetry cost the loops, side by side in one run: windows without and with them in turn.

The requests are those of the host fault `request_flood`, from a process of its own.
"""

import subprocess
import tempfile
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.loop import Target
from clutch_hil.bench.faults import request_flood
from clutch_hil.bench.scenario import Scenario
from clutch_hil.bench.settings import RunSettings
from clutch_hil.bench.up import POLL, Bench, Session
from protocols.files.runs import read_run
from protocols.realtime.child import list_module_command, spawn
from protocols.realtime.stopping import Stop
from protocols.telemetry.keys import make_bench_name

RATE = 1300  # requests a second: what took the controller's work from 12 to 283 us (p50) before requests were bounded
_PAIRS = 5  # windows without and with requests
_SETTLING = 2.0  # s of the run before the first window, and of the asker before its windows count
_MOST_INCREASE = 1.2  # of the p99 of the work, by requests
_LEAST_SHARE = 0.95  # of RATE that must have been sent, for the measurement to be one


def measure_requests(bus: str, seconds: float, say: Callable[[str], None]) -> tuple[list[Target], dict[str, Any]]:
    """Run a bench for about `seconds` [s]; return targets, and the computing times [us] of all windows. Raises InputError."""
    window = max(seconds / (2 * _PAIRS), 1.0)
    sent: list[float] = []  # requests a second
    work: dict[str, dict[str, list[np.ndarray]]] = {
        node: {"without": [], "with": []} for node in ("plant", "controller")
    }
    with tempfile.TemporaryDirectory() as folder, Stop() as stop:
        longest = _SETTLING + 2 * _PAIRS * (window + _SETTLING) + 60.0  # s; the rest is not played
        bench = Bench(Scenario.of(RunSettings(seconds=longest, out=Path(folder))), bus)
        with bench.start(stop, say) as session:
            read_work(session, _SETTLING)
            for pair in range(_PAIRS):
                say(f"windows {2 * pair + 1} and {2 * pair + 2} of {2 * _PAIRS}")
                _append(work, "without", read_work(session, window))
                words = make_bench_name(session.bus), str(RATE)
                asker = spawn(list_module_command(request_flood.__name__, *words), subprocess.PIPE)
                try:
                    read_work(session, _SETTLING)
                    _append(work, "with", read_work(session, window))
                    asker.terminate()
                    while asker.poll() is None:
                        read_work(session, POLL)
                    number, asking = asker.communicate()[0].split()
                    sent.append(int(number) / float(asking))
                finally:
                    asker.kill()
                read_work(session, _SETTLING)
            session.finish(interrupted=True)
            made = len(read_run(session.path).metadata["requests"])
    document: dict[str, Any] = {"sent_a_second": sent, "window_s": window, "pairs": _PAIRS, "changes_made": made}
    targets = []
    for node, kinds in work.items():
        shares = {kind: [compute_percentiles(rows) for rows in windows] for kind, windows in kinds.items()}
        document[node] = shares
        ratios = [
            asked["p99_us"] / none["p99_us"] for none, asked in zip(shares["without"], shares["with"], strict=True)
        ]
        ratio = float(np.median(ratios))
        targets.append(Target(f"{node}, p99 of the work with requests over none", ratio, "", "at most", _MOST_INCREASE))
    targets.append(Target("requests a second", float(np.min(sent)), "1/s", "at least", _LEAST_SHARE * RATE))
    return targets, document


def tabulate_requests(document: dict[str, Any]) -> list[tuple[str, ...]]:
    """Rows of a table: the median over the windows of each percentile [us]."""
    rows = [("work, median of the windows [us]", "p50", "p99", "max")]
    for node in ("plant", "controller"):
        for kind in ("without", "with"):
            cells = [np.median([one[name] for one in document[node][kind]]) for name in ("p50_us", "p99_us", "max_us")]
            rows.append((f"{node}, {kind} requests", *(f"{cell:.0f}" for cell in cells)))
    return rows


def read_work(session: Session, seconds: float) -> dict[str, np.ndarray]:
    """Computing times [us] of the cycles of the next `seconds` [s], by node."""
    end = time.monotonic() + seconds
    pieces: dict[str, list[np.ndarray]] = {"plant": [], "controller": []}
    places = [
        [column.name for column in ring.columns].index(name) for ring, name in zip(session.rings, _WORK, strict=True)
    ]
    while time.monotonic() < end:
        for own, rows, place in zip(pieces.values(), session.step(), places, strict=True):
            own.append(rows[:, place])
        time.sleep(POLL)
    return {node: np.concatenate(own) for node, own in pieces.items()}


_WORK = ("plant_work_us", "work_us")  # columns of the rings


def _append(work: dict[str, dict[str, list[np.ndarray]]], kind: str, rows: dict[str, np.ndarray]) -> None:
    for node, own in rows.items():
        work[node][kind].append(own)


def compute_percentiles(work: np.ndarray) -> dict[str, float]:
    p50, p99, most = np.percentile(work, (50.0, 99.0, 100.0)).tolist()
    return {"p50_us": p50, "p99_us": p99, "max_us": most, "cycles": len(work)}
