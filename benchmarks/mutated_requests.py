"""Mutated requests: a running bench gets damaged requests over zenoh, and a peer publishes invalid data under its keys.

    python -m benchmarks.mutated_requests --minutes 3

Every queryable of both nodes gets damaged requests: changes, injections, demands, and queries of every other key (keys.py). A
peer that listens like a publisher sends damaged batches, events and requests, and damaged answers to queries. A monitor, a
recorder and a viewer run in parallel. The bench must keep running, and answer each request or refuse it in one sentence of less
than 1000 characters. It must demand no more torque than its profile, and no higher voltage than the guard allows.
"""

import itertools
import json
import os
import signal
import subprocess
import tempfile
import threading
import time
from collections import Counter
from collections.abc import Callable, Iterator
from concurrent.futures import FIRST_COMPLETED, Future, ThreadPoolExecutor, wait
from contextlib import ExitStack, contextmanager, suppress
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import typer
import zenoh

from benchmarks.loop import Target
from benchmarks.requests import compute_percentiles
from clutch_hil.bench.faults.damage import Sound, damage
from clutch_hil.bench.faults.rubbish_peer import FRESH, QUESTIONS, RubbishPeer
from clutch_hil.bench.progress import format_table
from clutch_hil.bench.run_file import read_run
from clutch_hil.bench.scenario import Scenario
from clutch_hil.bench.settings import RunSettings
from clutch_hil.bench.up import POLL, Bench, Session
from clutch_hil.command import report, run_command
from clutch_hil.live.tuning.tune import request_parameters
from plant_sim.profiles.profile import load_profile
from protocols.errors import InputError
from protocols.realtime.child import list_command
from protocols.realtime.stopping import Stop
from protocols.telemetry.keys import NODES, Keys, make_bench_name
from protocols.telemetry.session import open_consumer_session

_PROFILE = "engagement"
_CONSUMERS = {"monitor": (), "record": ("seen.parquet",), "view": ("--web", "--no-open")}
_LATE = (
    ("monitor", "--once"),
    ("tune",),
    ("inject",),
    ("record", "late.parquet", "--seconds", "1"),
)  # consumers that start later
_RATE = 100.0  # requests a second at most; a bench that answers slowly gets fewer
_WORKERS = 40  # concurrent requests; ten of them may be waiting changes
_ANSWER_TIMEOUT = 10.0  # s: ten changes may wait, five are made per second; with margin for a busy machine
_MOST_REASON = 1000  # characters of a refusal
_START = 6.0  # s of the bench before the requests: the consumers start meanwhile
_WINDOW = 5.0  # s of the loops before the requests, to compare with
_END_PATIENCE = 30.0  # s for a consumer to end
_MOST_MINUTES = 7 * 1440.0
_MOST_VOLTAGE = 4.0  # V, of the guard's limits
_MOST_WORK = 100.0  # ms of computing in a cycle: chosen; a tenth of the systemd watchdog time is 200
_ODD_NAMES = ("ann", "x" * 5000, "a b", "\u00b5", "ann~", "-", "0", "a\nb", "'", '"', "%s", "..", "{}")
_TIMEOUT_REPLY = "Timeout"


class Asked(NamedTuple):
    """Outcome of a request of a `kind`: `ok` whether it was done; `reason` of a refusal, None for an answer or no reply."""

    kind: str
    ok: bool
    reason: str | None


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
        consumers = stack.enter_context(_run_consumers(session.bus, folder))
        watch.watch(_START, stop)
        before = watch.take()
        watch.watch(_WINDOW, stop)
        without = watch.take()
        bench = make_bench_name(session.bus)
        with (
            RubbishPeer(bench, seed) as peer,
            _Asker(bench, seed, peer.zid) as asker,
            _Late(session.bus, folder) as late,
        ):
            say(f"asking for {seconds:.0f} s")
            watch.watch(seconds, stop)
            asker.finish()
            late.finish()
        asked = watch.take()
        lived = {name: consumer.poll() is None for name, consumer in consumers.items()}
        watch.watch(1.0, stop)
        ended = {name: _end(consumer) for name, consumer in consumers.items()}
        session.finish(interrupted=True)
        stop.check("the requests were ended; nothing is kept")
        own = read_run(session.path)
        seen = sorted(folder.glob("seen*.parquet"))
        rows_seen = sum(len(read_run(path)["time_s"]) for path in seen)
        document = {
            "asked": {kind: dict(counts) for kind, counts in asker.counts.items()},
            "longest_reason": asker.longest, "unsendable": asker.unsendable, "published": peer.published,
            "answered_wrongly": peer.answered,
            "loops": {"without": without, "with": asked}, "rows_before": before["plant"]["cycles"],
            "changes": len(own.metadata["parameter_changes"]) + len(own.metadata["injections"]),
            "torque_demand_nm": float(np.nanmax(own["torque_demand_nm"])),
            "voltage_v": float(np.max(own["controller_voltage_v"][np.isfinite(own["controller_voltage_v"])])),
            "clutch_torque_nm": float(np.max(np.abs(own["truth_clutch_torque_nm"]))),
            "consumers": {
                name: {"lived": lived[name], "ended": ended[name], "said": _read_last_line(folder / f"{name}.log")}
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
            "characters of the longest refusal", float(document["longest_reason"]), "", "at most", _MOST_REASON - 1.0
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


class _Asker:
    """Sends damaged requests to a bench from threads while entered. counts: of outcomes by kind of request.

    longest: longest refusal. foreign: session whose answers do not count.
    """

    def __init__(self, bench: str, seed: int, foreign: zenoh.ZenohId) -> None:
        self.counts: dict[str, Counter[str]] = {}
        self.longest = self.unsendable = 0
        self._bench, self._foreign = bench, foreign
        self._random = np.random.default_rng(seed)
        self._seeds = itertools.count(1000 * seed)
        self._over = threading.Event()
        self._session = open_consumer_session()
        self._shipped: dict[str, dict[str, float]] = {}
        self._changes: list[tuple[str, str, bytes]] = []
        self._thread = threading.Thread(target=self._turn)
        self._failure: BaseException | None = None

    def __enter__(self) -> "_Asker":
        end = time.monotonic() + _END_PATIENCE
        while not self._session.info.peers_zid() and time.monotonic() < end:
            time.sleep(0.01)
        for node in NODES:
            entries = request_parameters(self._session, self._bench, node)
            self._shipped[node] = {one["name"]: one["value"] for one in entries if not one["fixed"]}
        self._changes = list(self._list_sound_changes())
        self._thread.start()
        return self

    def __exit__(self, *_: object) -> None:
        self._over.set()
        self._thread.join()
        self._session.close()

    def finish(self) -> None:
        """Wait for the last answers. Raises the exception of a thread, if there was one."""
        self._over.set()
        self._thread.join()
        if self._failure:
            raise self._failure

    def _list_sound_changes(self) -> Iterator[tuple[str, str, bytes]]:
        """Yield the kind, node and payload of sound requests of each kind."""
        for node, values in self._shipped.items():
            few = dict(self._random.permutation(list(values.items()))[:6])
            yield "tune", node, json.dumps({name: float(value) for name, value in few.items()}).encode()
        for when in ({}, {"after": 0.2, "ramp": 0.1}, {"after": 0.1, "for": 0.2}, {"at": 1e6, "until": 2e6}):
            values = {"oil.sump_temperature": self._shipped["plant"]["oil.sump_temperature"]}
            yield "inject", "plant", json.dumps({"values": values, **when}).encode()
        yield "demand", "controller", json.dumps({"demand": "5 Nm"}).encode()

    def _turn(self) -> None:
        try:
            with ThreadPoolExecutor(_WORKERS) as pool:
                waiting: list[Future[Asked | None]] = []
                restored = 0.0
                while not self._over.is_set():
                    if time.monotonic() > restored + FRESH:
                        restored = time.monotonic()
                        for node, values in self._shipped.items():
                            key = Keys(self._bench, node).change_by("fuzz")
                            waiting.append(pool.submit(self._ask, "restore", key, json.dumps(values).encode()))
                    waiting.append(pool.submit(self._ask, *self._draw()))
                    while len(waiting) >= _WORKERS:  # changes wait for their turn; other queries need not wait for them
                        done, still = wait(waiting, return_when=FIRST_COMPLETED)
                        waiting = list(still)
                        for one in done:
                            self._count(one.result())
                    time.sleep(1.0 / _RATE)
                for one in waiting:
                    self._count(one.result())
        except BaseException as error:
            self._failure = error

    def _draw(self) -> tuple[str, str, bytes | None]:
        """Return the kind, selector and payload of the next request."""
        if self._random.random() < 0.5:
            kind, node, sound = self._changes[self._random.integers(len(self._changes))]
            name = str(self._random.choice(_ODD_NAMES)) if self._random.random() < 0.2 else "fuzz"
            return kind, Keys(self._bench, node).change_by(name), self._damage(Sound(sound, True))
        leaf = str(self._random.choice(QUESTIONS))
        key = getattr(Keys(self._bench, str(self._random.choice(NODES))), leaf)
        if self._random.random() < 0.5:
            asked = self._damage(Sound(b"from=100;to=900", True)).decode(errors="replace").replace("\0", "")
            key = f"{key}?{asked}"
        return leaf, key, self._damage(Sound(b'{"valve.gain": 2.0}', True)) if self._random.random() < 0.3 else None

    def _damage(self, sound: Sound) -> bytes:
        return damage(sound, self._random, next(self._seeds))

    def _ask(self, kind: str, selector: str, payload: bytes | None) -> Asked | None:
        """Send a request and wait for the answer; return None if zenoh itself rejects the key."""
        try:
            replies = self._session.get(
                selector, payload=payload, timeout=_ANSWER_TIMEOUT, consolidation=zenoh.ConsolidationMode.NONE
            )
        except (zenoh.ZError, ValueError, UnicodeError):
            return None
        ok, late, reasons = False, False, []
        for reply in replies:
            if reply.replier_id is not None and reply.replier_id.zid == self._foreign:
                continue
            if reply.ok is not None:
                ok = True
            elif reply.err is not None and (reason := reply.err.payload.to_bytes()) != _TIMEOUT_REPLY.encode():
                reasons.append(reason.decode(errors="replace"))
            else:
                late = True
        # a history without rows has no reply, but the query ends
        return Asked(kind, ok or (kind == "history" and not (late or reasons)), max(reasons, key=len, default=None))

    def _count(self, asked: Asked | None) -> None:
        if asked is None:
            self.unsendable += 1
            return
        if asked.reason is not None:
            self.longest = max(self.longest, _MOST_REASON if "\n" in asked.reason else len(asked.reason))
        became = "answered" if asked.ok else "refused" if asked.reason is not None else "silent"
        self.counts.setdefault(asked.kind, Counter())[became] += 1


class _Late:
    """Consumers that start while a peer publishes invalid data, one after the other, from a thread.

    counts: by command, how many were `fine`, or `refused` in one sentence. broken: output of all others.
    """

    def __init__(self, bus: str, folder: Path) -> None:
        self.counts: dict[str, Counter[str]] = {}
        self.broken: list[str] = []
        self._bus, self._folder = bus, folder
        self._over = threading.Event()
        self._thread = threading.Thread(target=self._turn)

    def __enter__(self) -> "_Late":
        self._thread.start()
        return self

    def __exit__(self, *_: object) -> None:
        self.finish()

    def finish(self) -> None:
        """Wait for the last consumer to end."""
        self._over.set()
        self._thread.join()

    def _turn(self) -> None:
        for number in itertools.count():
            name, *arguments = _LATE[number % len(_LATE)]
            if self._over.is_set():
                return
            words = [
                str(self._folder / f"{number}-{word}") if word.endswith(".parquet") else word for word in arguments
            ]
            command = list_command(name, *words, "--bus", self._bus)
            try:
                done = subprocess.run(command, capture_output=True, text=True, timeout=_END_PATIENCE, check=False)
                code, error = done.returncode, done.stderr.strip()
            except subprocess.TimeoutExpired:
                code, error = -1, f"it did not end within {_END_PATIENCE:g} s"
            last = error.splitlines()[-1] if error else ""
            became = "fine" if code in (0, 1) else "refused" if code == 2 and last.startswith("error: ") else "broken"
            if became == "broken" or "Traceback" in error or len(last) >= _MOST_REASON:
                became = "broken"
                self.broken.append(f"{name}: {error[-2000:]}")
            self.counts.setdefault(name, Counter())[became] += 1


@contextmanager
def _run_consumers(bus: str, folder: Path) -> Iterator[dict[str, "subprocess.Popen[str]"]]:
    """Run the consumers of the telemetry during the `with` block, and yield them."""
    running: dict[str, subprocess.Popen[str]] = {}
    try:
        for name, arguments in _CONSUMERS.items():
            words = [str(folder / word) if word.endswith(".parquet") else word for word in arguments]
            with (folder / f"{name}.log").open("w") as log:
                running[name] = subprocess.Popen(
                    list_command(name, *words, "--bus", bus), stdin=subprocess.DEVNULL, stdout=log,
                    stderr=log, text=True, start_new_session=True,
                )  # fmt: skip
        yield running
    finally:
        for process in running.values():
            with suppress(ProcessLookupError):
                os.killpg(process.pid, signal.SIGKILL)
            process.wait()


def _read_last_line(log: Path) -> str:
    lines = log.read_text(errors="replace").strip().splitlines()
    return lines[-1] if lines else ""


def _end(consumer: "subprocess.Popen[str]") -> str:
    """Ask a consumer to end; return how it ended if it failed."""
    if consumer.poll() is None:
        consumer.send_signal(signal.SIGINT)
    try:
        code = consumer.wait(_END_PATIENCE)
    except subprocess.TimeoutExpired:
        return f"it did not end within {_END_PATIENCE:g} s"
    return "" if code in (0, 1) else f"exit code {code}"


if __name__ == "__main__":
    run_command(mutate_requests)
