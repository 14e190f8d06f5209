"""Mutated requests: a running bench gets damaged requests over zenoh, and a peer publishes invalid data under its keys.

    python -m benchmarks.mutated_requests --minutes 3

Every queryable of both nodes gets damaged requests: changes, injections, demands, and queries of every other key (keys.py). A
peer that listens like a publisher sends damaged batches, events and requests, and damaged answers to queries. A monitor, a
recorder and a viewer run in parallel. The bench must keep running, and answer each request or refuse it in one sentence of less
than 1000 characters. It must demand no more torque than its profile, and no higher voltage than the guard allows.
"""

import tempfile
import time
from collections.abc import Callable
from contextlib import ExitStack
from pathlib import Path
from typing import Any

import numpy as np
import typer

from benchmarks.loop import Target
from benchmarks.request_sender import MOST_REASON, RequestSender
from benchmarks.requests import compute_percentiles
from benchmarks.telemetry_consumers import LateConsumers, end_consumer, read_last_line, run_consumers
from clutch_hil.bench.faults.rubbish_peer import RubbishPeer
from clutch_hil.bench.progress import format_table
from clutch_hil.bench.run_file import read_run
from clutch_hil.bench.scenario import Scenario
from clutch_hil.bench.settings import RunSettings
from clutch_hil.bench.up import POLL, Bench, Session
from clutch_hil.command import report, run_command
from plant_sim.profiles.profile import load_profile
from protocols.errors import InputError
from protocols.realtime.stopping import Stop
from protocols.telemetry.keys import NODES, make_bench_name

_PROFILE = "engagement"
_START = 6.0  # s of the bench before the requests: the consumers start meanwhile
_WINDOW = 5.0  # s of the loops before the requests, to compare with
_MOST_MINUTES = 7 * 1440.0
_MOST_VOLTAGE = 4.0  # V, of the guard's limits
_MOST_WORK = 100.0  # ms of computing in a cycle: chosen; a tenth of the systemd watchdog time is 200


def mutate_requests(
    minutes: float = typer.Option(3.0, help="how long the bench is asked"),
    seed: int = typer.Option(1, help="seed of the damage", min=0),
    json_output: bool = typer.Option(False, "--json", help="print the result as JSON"),
) -> None:
    """Ask a running bench wrongly through zenoh, and publish rubbish under its keys: it must live on."""
    targets, document = measure_mutated_requests(minutes, seed, lambda line: typer.echo(line, err=True))
    rows = [Target.HEAD, *(target.format_row() for target in targets)]
    missed = [target.name for target in targets if not target.is_met]
    tables = [tabulate_requests(document), tabulate_consumers(document), tabulate_loops(document), rows]
    text = "\n\n".join(map(format_table, tables))
    verdict = (
        f"not met: {', '.join(missed)}" if missed else "the bench lives, and all requests were answered or refused"
    )
    report(document, text, verdict, not missed, json_output)


def measure_mutated_requests(
    minutes: float, seed: int, say: Callable[[str], None], bus: str = "local:requests"
) -> tuple[list[Target], dict[str, Any]]:
    """Send damaged requests to a bench for `minutes` [min]; return targets, and counts of requests and cycles.

    Raises InputError.
    """
    if not 0.0 < minutes <= _MOST_MINUTES:
        raise InputError(f"--minutes is {minutes:g}; allowed are more than 0, to {_MOST_MINUTES:g}")
    seconds = 60.0 * minutes
    with ExitStack() as stack:
        folder = Path(stack.enter_context(tempfile.TemporaryDirectory(prefix="ch-")))
        stop = stack.enter_context(Stop())
        settings = RunSettings(profile=_PROFILE, seconds=seconds + 300.0, out=folder)
        session = stack.enter_context(Bench(Scenario.of(settings), bus).start(stop, say))
        watch = _Watch(session)
        consumers = stack.enter_context(run_consumers(session.bus, folder))
        watch.watch(_START, stop)
        before = watch.take()
        watch.watch(_WINDOW, stop)
        without = watch.take()
        bench = make_bench_name(session.bus)
        with (
            RubbishPeer(bench, seed) as peer,
            RequestSender(bench, seed, peer.zid) as sender,
            LateConsumers(session.bus, folder) as late,
        ):
            say(f"asking for {seconds:.0f} s")
            watch.watch(seconds, stop)
            sender.finish()
            late.finish()
        beside = watch.take()
        lived = {name: consumer.poll() is None for name, consumer in consumers.items()}
        watch.watch(1.0, stop)
        ended = {name: end_consumer(consumer) for name, consumer in consumers.items()}
        session.finish(interrupted=True)
        stop.check("the requests were ended; nothing is kept")
        own = read_run(session.path)
        seen = sorted(folder.glob("seen*.parquet"))
        rows_seen = sum(len(read_run(path)["time_s"]) for path in seen)
        document = {
            "asked": {kind: dict(counts) for kind, counts in sender.counts.items()},
            "longest_reason": sender.longest, "unsendable": sender.unsendable, "published": peer.published,
            "answered_wrongly": peer.answered,
            "loops": {"without": without, "with": beside}, "rows_before": before["plant"]["cycles"],
            "changes": len(own.metadata["parameter_changes"]) + len(own.metadata["injections"]),
            "torque_demand_nm": float(np.nanmax(own["torque_demand_nm"])),
            "voltage_v": float(np.max(own["controller_voltage_v"][np.isfinite(own["controller_voltage_v"])])),
            "clutch_torque_nm": float(np.max(np.abs(own["truth_clutch_torque_nm"]))),
            "consumers": {
                name: {"lived": lived[name], "ended": ended[name], "said": read_last_line(folder / f"{name}.log")}
                for name in consumers
            },
            "late_consumers": {name: dict(counts) for name, counts in late.counts.items()}, "broken": late.broken,
            "rows_recorded": rows_seen, "files_recorded": len(seen),
            "rows": len(own["time_s"]), "rows_lost": sum(ring.lost for ring in session.rings),
        }  # fmt: skip
    return _judge(document), document


def tabulate_requests(document: dict[str, Any]) -> list[tuple[str, ...]]:
    """Return the rows of a table: requests and their outcomes."""
    rows = [("request", "asked", "answered", "refused", "without an answer")]
    for kind, counts in document["asked"].items():
        cells = [counts.get(name, 0) for name in ("answered", "refused", "silent")]
        rows.append((kind, str(sum(cells)), *map(str, cells)))
    return rows


def tabulate_consumers(document: dict[str, Any]) -> list[tuple[str, ...]]:
    """Return the rows of a table: outcomes of consumers that started while the peer published invalid data."""
    rows = [("consumer", "fine", "refused in one sentence", "broken")]
    for name, counts in document["late_consumers"].items():
        rows.append((name, *(str(counts.get(became, 0)) for became in ("fine", "refused", "broken"))))
    return rows


def tabulate_loops(document: dict[str, Any]) -> list[tuple[str, ...]]:
    """Return the rows of a table: cycles of both loops before and during the requests."""
    rows = [("loop", "cycles", "late", "late [%]", "work, p50 [us]", "p99", "most")]
    for when, loops in document["loops"].items():
        for node, own in loops.items():
            share = 100.0 * own["late"] / max(own["cycles"], 1)
            work = (f"{own[name]:.0f}" for name in ("p50_us", "p99_us", "max_us"))
            rows.append((f"{node}, {when} requests", str(own["cycles"]), str(own["late"]), f"{share:.2f}", *work))
    return rows


def _judge(document: dict[str, Any]) -> list[Target]:
    counts = document["asked"].values()
    work = max(own["max_us"] for own in document["loops"]["with"].values()) / 1e3
    consumers = document["consumers"].values()
    return [
        Target("requests without an answer", float(sum(own.get("silent", 0) for own in counts)), "", "at most", 0.0),
        Target(
            "characters of the longest refusal", float(document["longest_reason"]), "", "at most", MOST_REASON - 1.0
        ),
        Target("work of a cycle, most", work, "ms", "at most", _MOST_WORK),
        Target(
            "torque demand, most", document["torque_demand_nm"], "Nm", "at most", max(load_profile(_PROFILE).torque)
        ),
        Target("voltage, most", document["voltage_v"], "V", "at most", _MOST_VOLTAGE),
        Target(
            "consumers that lived on", float(sum(one["lived"] for one in consumers)), "", "at least", len(consumers)
        ),
        Target(
            "consumers that ended well",
            float(sum(one["ended"] == "" for one in consumers)),
            "",
            "at least",
            len(consumers),
        ),
        Target("consumers that broke", float(len(document["broken"])), "", "at most", 0.0),
        Target("rows lost by the bench", float(document["rows_lost"]), "", "at most", 0.0),
    ]


class _Watch:
    """Reads the rings of a bench; raises InputError when a service ends."""

    def __init__(self, session: Session) -> None:
        self._session = session
        names = [[column.name for column in ring.columns] for ring in session.rings]
        self._places = {
            node: (own.index(f"{prefix}work_us"), own.index(f"{prefix}late_cycles"))
            for node, own, prefix in zip(NODES, names, ("plant_", ""), strict=True)
        }
        self._rows: dict[str, list[np.ndarray]] = {node: [] for node in NODES}
        self._late = dict.fromkeys(NODES, 0.0)

    def watch(self, seconds: float, stop: Stop) -> None:
        """Follow the bench for some `seconds` [s]."""
        end = time.monotonic() + seconds
        while time.monotonic() < end and not stop.asked:
            for node, rows in zip(NODES, self._session.step(), strict=True):
                self._rows[node].append(rows[:, self._places[node]])
            time.sleep(POLL)

    def take(self) -> dict[str, dict[str, float]]:
        """Return the numbers of cycles and late cycles, and computing times [us], since the last call, by node."""
        taken = {}
        for node, pieces in self._rows.items():
            rows = np.concatenate(pieces)
            late = float(rows[-1, 1])
            taken[node] = compute_percentiles(rows[:, 0]) | {"late": int(late - self._late[node])}
            self._late[node] = late
            pieces.clear()
        return taken


if __name__ == "__main__":
    run_command(mutate_requests)
