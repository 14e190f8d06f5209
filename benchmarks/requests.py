"""Requests: effect of telemetry requests on the loops, in one run with alternating windows without and with requests.

Half of the requests query the newest row. The others are valid changes in one window, changes of unknown names in the next.
They are those of the host fault `request_flood`, from a separate process.
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
from clutch_hil.bench.faults.peers import UNKNOWN, VALID
from clutch_hil.bench.scenario import Scenario
from clutch_hil.bench.settings import RunSettings
from clutch_hil.bench.up import POLL, Bench, Session
from protocols.errors import InputError
from protocols.files.runs import read_run
from protocols.realtime.child import list_module_command, spawn
from protocols.realtime.stopping import Stop
from protocols.telemetry.keys import make_bench_name

RATE = 1300  # requests a second: what took the controller's work from 12 to 283 us (p50) before requests were bounded
_ROUNDS = 5  # of one window of each kind
_NONE = "none"
_KINDS = (_NONE, VALID, UNKNOWN)
_NODES = ("plant", "controller")
_SETTLING = 2.0  # s of the run before the first window, and of the asker before its windows count
_MOST_SECONDS = 86400.0  # a day
_MOST_INCREASE = 1.2  # highest ratio of the p99 of the work, with to without requests
_LEAST_SHARE = 0.95  # of RATE that must have been sent for a valid measurement


def measure_requests(bus: str, seconds: float, say: Callable[[str], None]) -> tuple[list[Target], dict[str, Any]]:
    """Run a bench for about `seconds` [s]; return targets, and the computing times [us] of all windows. Raises InputError."""
    if not 0.0 < seconds <= _MOST_SECONDS:
        raise InputError(f"--seconds is {seconds:g} for requests; allowed are more than 0, to {_MOST_SECONDS:g} s")
    window = max(seconds / (len(_KINDS) * _ROUNDS), 1.0)
    sent: list[float] = []  # requests a second
    work: dict[str, dict[str, list[np.ndarray]]] = {node: {kind: [] for kind in _KINDS} for node in _NODES}
    with tempfile.TemporaryDirectory() as folder, Stop() as stop:
        longest = _SETTLING + len(_KINDS) * _ROUNDS * (window + 2 * _SETTLING) + 60.0  # s; the rest is not played
        bench = Bench(Scenario.of(RunSettings(seconds=longest, out=Path(folder))), bus)
        with bench.start(stop, say) as session:
            read_work(session, _SETTLING)
            for number in range(_ROUNDS):
                say(f"round {number + 1} of {_ROUNDS}")
                for kind in _KINDS:
                    if kind == _NONE:
                        _append(work, kind, read_work(session, window))
                    else:
                        sent.append(_measure_flooded(session, kind, window, work))
            session.finish(interrupted=True)
            made = len(read_run(session.path).metadata["requests"])
    document: dict[str, Any] = {"sent_a_second": sent, "window_s": window, "rounds": _ROUNDS, "changes_made": made}
    targets = []
    for node, kinds in work.items():
        shares = {kind: [compute_percentiles(rows) for rows in windows] for kind, windows in kinds.items()}
        document[node] = shares
        for kind in _KINDS[1:]:
            pairs = zip(shares[_NONE], shares[kind], strict=True)
            ratio = float(np.median([asked["p99_us"] / none["p99_us"] for none, asked in pairs]))
            targets.append(
                Target(f"{node}, p99 of the work, {kind} requests over none", ratio, "", "at most", _MOST_INCREASE)
            )
    targets.append(Target("requests a second", float(np.min(sent)), "1/s", "at least", _LEAST_SHARE * RATE))
    return targets, document


def _measure_flooded(session: Session, kind: str, window: float, work: dict[str, dict[str, list[np.ndarray]]]) -> float:
    """Add a window of `window` [s] with requests of a kind to `work`; return the requests sent per second."""
    words = make_bench_name(session.bus), str(RATE), kind
    asker = spawn(list_module_command(request_flood.__name__, *words), subprocess.PIPE)
    try:
        read_work(session, _SETTLING)
        _append(work, kind, read_work(session, window))
        asker.terminate()
        while asker.poll() is None:
            read_work(session, POLL)
        number, asking = asker.communicate()[0].split()
    finally:
        asker.kill()
    read_work(session, _SETTLING)
    return int(number) / float(asking)


def tabulate_requests(document: dict[str, Any]) -> list[tuple[str, ...]]:
    """Return the rows of a table: the median over the windows of each percentile [us]."""
    rows = [("work, median of the windows [us]", "p50", "p99", "max")]
    for node in _NODES:
        for kind in _KINDS:
            cells = [np.median([one[name] for one in document[node][kind]]) for name in ("p50_us", "p99_us", "max_us")]
            rows.append((f"{node}, requests: {kind}", *(f"{cell:.0f}" for cell in cells)))
    return rows


def read_work(session: Session, seconds: float) -> dict[str, np.ndarray]:
    """Return the computing times [us] of the cycles in the next `seconds` [s], by node."""
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
