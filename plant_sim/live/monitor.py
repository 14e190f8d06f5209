"""`clutch-hil monitor`: a running bench on one screen of 80 x 24, from its telemetry.

`Collector` turns batches into a `Snapshot` and knows no zenoh; `drawn`, `line` and `document` show a snapshot.
"""

import time
from collections import deque
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import asdict, dataclass
from datetime import datetime
from typing import Any, NamedTuple

import numpy as np
from rich.console import Console, Group
from rich.live import Live
from rich.rule import Rule
from rich.table import Table
from rich.text import Text

from plant_sim.live.bars import bar, sparkline
from plant_sim.live.supervisor import choice_names
from protocols.errors import InputError
from protocols.frames import load_frames
from protocols.stopping import Stop
from protocols.telemetry.batch import Batch
from protocols.telemetry.feed import Feed, ask, find_bench
from protocols.telemetry.keys import NODES, Keys, bus_of
from protocols.telemetry.session import consumer_session

WINDOW = 10.0  # s of rows that percentiles and sparklines are made of
STALLED = 0.5  # s without a row; batches come every 20 ms
_FIRST_LOOK = 1.0  # s to hear who lives before the first judgement: twice STALLED
_DRAW_EVERY = 0.25  # s
_PLAIN_EVERY = 2.0  # s between lines where the output is no terminal
_READ = 0.1  # s to wait for a batch, so that silence is noticed and drawn too
_CHANGES = 3  # last changes of parameters that are shown
_POINTS = 30  # characters of a sparkline: three a second
_LEAST_RANGE = 0.05  # of the full scale, between bottom and top of a sparkline: noise stays small
_TIMING = ("clock_s", "wake_us", "work_us", "late_cycles")


class Quantity(NamedTuple):
    """A number on the screen: the column it comes from, the full scale of its bar, whose sparkline scale it shares."""

    name: str
    node: str
    column: str
    unit: str
    full: float
    group: str


QUANTITIES = (
    Quantity("torque demand", "controller", "controller_torque_demand_nm", "Nm", 30.0, "torque"),
    Quantity("torque estimate", "controller", "controller_torque_estimate_nm", "Nm", 30.0, "torque"),
    Quantity("torque true", "plant", "truth_clutch_torque_nm", "Nm", 30.0, "torque"),
    Quantity("pressure demand", "controller", "controller_pressure_demand_bar", "bar", 5.0, "pressure"),
    Quantity("pressure", "controller", "controller_pressure_bar", "bar", 5.0, "pressure"),
    Quantity("slip", "controller", "controller_slip_rad_s", "rad/s", 26.2, "slip"),
    Quantity("oil temperature", "controller", "controller_temperature_degc", "degC", 150.0, "temperature"),
    Quantity("friction level", "controller", "controller_friction_level", "1", 2.0, "level"),
)
_STATES = ("controller_phase", "controller_fault")


class Percentiles(NamedTuple):
    """Of the last 10 s [us]; NaN when there are none."""

    p50: float
    p99: float
    maximum: float


_NO_TIMES = Percentiles(float("nan"), float("nan"), float("nan"))


@dataclass(frozen=True)
class NodeState:
    """A service: `state` is running, stalled, waiting (no row yet), gone or absent; `age` of its newest row [s]."""

    state: str
    age: float | None = None
    rate: float = float("nan")  # Hz, measured over the last 10 s
    period_us: float = float("nan")
    cycles: int = 0  # in the last 10 s
    late: int = 0  # of them
    lost: int = 0  # rows that never came, since the first that did, and rows lost in the service's ring
    wake: Percentiles = _NO_TIMES
    work: Percentiles = _NO_TIMES


@dataclass(frozen=True)
class Snapshot:
    """A bench at one instant: `values` and `traces` (shape (points,), the last 10 s) by name of QUANTITIES."""

    bench: str
    nodes: Mapping[str, NodeState]
    phase: str | None
    fault: str | None
    values: Mapping[str, float]
    traces: Mapping[str, np.ndarray]
    changes: Sequence[Mapping[str, Any]]

    def troubles(self) -> list[str]:
        """What a person must look at, one phrase each."""
        found = [
            f"the {name} is {state.state}" for name, state in self.nodes.items() if state.state in ("stalled", "gone")
        ]
        if self.fault not in (None, "none"):
            found.append(f"fault: {self.fault}")
        if all(state.state in ("absent", "gone") for state in self.nodes.values()):
            found.append("no service runs")
        return found


class _Trace:
    """Rows of one life of a service, the last WINDOW seconds, in the columns that are shown."""

    def __init__(self, batch: Batch) -> None:
        wanted = {q.column for q in QUANTITIES} | {f"{batch.node}_{name}" for name in _TIMING} | set(_STATES)
        names = [column.name for column in batch.columns]
        self.session, self.rate = batch.session, batch.rate
        self._index = [i for i, name in enumerate(names) if name in wanted]
        self._place = {names[i]: place for place, i in enumerate(self._index)}
        self._pieces: deque[np.ndarray] = deque()
        self._count = 0
        self.newest = 0.0  # s, when the newest row came
        self.rows_lost = 0

    def take(self, batch: Batch, now: float) -> None:
        """Add rows that came at `now` [s]."""
        if not len(batch.rows):
            return
        self.newest, self.rows_lost = now, batch.rows_lost
        self._pieces.append(batch.rows[:, self._index])
        self._count += len(batch.rows)
        while self._count - len(self._pieces[0]) >= WINDOW * self.rate:
            self._count -= len(self._pieces.popleft())

    def rows(self) -> np.ndarray:
        """Shape (rows, columns), at most WINDOW seconds."""
        return np.concatenate(self._pieces)[-round(WINDOW * self.rate) :]

    def column(self, rows: np.ndarray, name: str) -> np.ndarray:
        """A column of `rows`; NaN when the service does not publish it."""
        place = self._place.get(name)
        return rows[:, place] if place is not None else np.full(len(rows), np.nan)


class Collector:
    """Takes what a feed gives, keeps ten seconds of it, and tells how the bench is."""

    def __init__(self, bench: str) -> None:
        frames = load_frames()
        self.alive: Mapping[str, bool] = {}
        self.lost: Mapping[str, int] = {}
        self.last_rows: dict[str, int] = {}  # newest row of a service of which none came: -1 when it has none yet
        self._bench = bench
        self._phases = choice_names(frames["CONTROLLER_STATUS"], "PHASE")
        self._faults = choice_names(frames["CONTROLLER_STATUS"], "FAULT")
        self._traces: dict[str, _Trace] = {}
        self._changes: list[Mapping[str, Any]] = []

    def take(self, batches: Iterable[Batch], now: float) -> None:
        """Add batches that came at `now` [s, of any steady clock]."""
        for batch in batches:
            trace = self._traces.get(batch.node)
            if trace is None or trace.session != batch.session:
                trace = self._traces[batch.node] = _Trace(batch)
            trace.take(batch, now)

    def note(self, events: Iterable[Mapping[str, Any]]) -> None:
        """Add changes of parameters."""
        self._changes = sorted((*self._changes, *events), key=lambda event: event["time"])[-_CHANGES:]

    def silent(self) -> list[str]:
        """Nodes that live and of which no row has come."""
        return [node for node in NODES if self.alive.get(node) and node not in self._traces]

    def snapshot(self, now: float) -> Snapshot:
        """The bench at `now` [s]."""
        rows = {node: trace.rows() for node, trace in self._traces.items()}
        values, traces = {}, {}
        for quantity in QUANTITIES:
            column = self._column(rows, quantity.node, quantity.column)
            values[quantity.name] = float(column[-1]) if len(column) else float("nan")
            traces[quantity.name] = self._thinned(quantity.node, column)
        return Snapshot(
            self._bench,
            {node: self._node_state(node, rows.get(node), now) for node in NODES},
            self._state_name(rows, "controller_phase", self._phases),
            self._state_name(rows, "controller_fault", self._faults),
            values,
            traces,
            tuple(self._changes),
        )

    def _column(self, rows: Mapping[str, np.ndarray], node: str, name: str) -> np.ndarray:
        return self._traces[node].column(rows[node], name) if node in rows else np.empty(0)

    def _state_name(self, rows: Mapping[str, np.ndarray], column: str, names: Mapping[int, str]) -> str | None:
        values = self._column(rows, "controller", column)
        if not len(values) or not np.isfinite(values[-1]):
            return None
        return names.get(int(values[-1]), f"{values[-1]:g}")

    def _thinned(self, node: str, column: np.ndarray) -> np.ndarray:
        """_POINTS values of the last WINDOW seconds, the newest last; NaN before the first row."""
        if not len(column):
            return np.full(_POINTS, np.nan)
        ago = np.arange(_POINTS)[::-1] * WINDOW * self._traces[node].rate / _POINTS
        index = len(column) - 1 - np.round(ago).astype(int)
        return np.where(index >= 0, column[np.maximum(index, 0)], np.nan)

    def _node_state(self, node: str, rows: np.ndarray | None, now: float) -> NodeState:
        alive, trace = self.alive.get(node, False), self._traces.get(node)
        if trace is None or rows is None:
            stalled = self.last_rows.get(node, -1) >= 0
            return NodeState(("stalled" if stalled else "waiting") if alive else "absent")
        age = now - trace.newest
        clock, wake, work, late = (trace.column(rows, f"{node}_{name}") for name in _TIMING)
        took = clock[-1] - clock[0]
        return NodeState(
            "gone" if not alive else "stalled" if age > STALLED else "running",
            age,
            (len(rows) - 1) / took if took > 0.0 else float("nan"),
            1e6 / trace.rate,
            len(rows),
            int(np.nan_to_num(late[-1] - late[0])),
            self.lost.get(node, 0) + trace.rows_lost,
            _percentiles(wake),
            _percentiles(work),
        )


def _percentiles(values: np.ndarray) -> Percentiles:
    known = values[np.isfinite(values)]
    return Percentiles(*np.percentile(known, (50.0, 99.0, 100.0)).tolist()) if len(known) else _NO_TIMES


def document(snapshot: Snapshot) -> dict[str, Any]:
    """A snapshot for machines."""
    nodes = {
        name: asdict(state) | {part: getattr(state, part)._asdict() for part in ("wake", "work")}
        for name, state in snapshot.nodes.items()
    }
    return {
        "bench": snapshot.bench,
        "nodes": nodes,
        "phase": snapshot.phase,
        "fault": snapshot.fault,
        "values": {q.name: {"value": snapshot.values[q.name], "unit": q.unit} for q in QUANTITIES},
        "changes": list(snapshot.changes),
        "troubles": snapshot.troubles(),
    }


def line(snapshot: Snapshot) -> str:
    """A snapshot on one line."""
    states = "  ".join(f"{name} {state.state}" for name, state in snapshot.nodes.items())
    value = snapshot.values
    return (
        f"{states}  {snapshot.phase or '-'}  fault {snapshot.fault or '-'}"
        f"  torque demand {value['torque demand']:.2f} estimate {value['torque estimate']:.2f}"
        f" true {value['torque true']:.2f} Nm  pressure {value['pressure']:.2f} bar  slip {value['slip']:.2f} rad/s"
        f"  late {sum(state.late for state in snapshot.nodes.values())}"
        f"  lost {sum(state.lost for state in snapshot.nodes.values())}"
    )


_STATE_STYLES = {"running": "green", "waiting": "yellow", "stalled": "bold red", "gone": "bold red"}
_PHASE_STYLES = {"slip control": "green", "fill": "yellow", "release": "yellow", "fault": "bold red"}


def drawn(snapshot: Snapshot) -> Group:
    """A snapshot as a screen of 80 x 24."""
    phase = Text.assemble(
        ("phase ", "bright_black"),
        (snapshot.phase or "-", _PHASE_STYLES.get(snapshot.phase or "", "")),
        ("   fault ", "bright_black"),
        (snapshot.fault or "-", "" if snapshot.fault in (None, "none") else "bold red"),
    )
    return Group(
        _rule(f"clutch-hil monitor, {bus_of(snapshot.bench)}"),
        _services(snapshot),
        phase,
        _rule(f"now, and the last {WINDOW:g} s"),
        _quantities(snapshot),
        _rule(f"loop timing of the last {WINDOW:g} s [us]"),
        _timing(snapshot),
        _rule("last changes of parameters"),
        *_changes(snapshot),
    )


def _rule(title: str) -> Rule:
    return Rule(Text(title), align="left", style="bright_black")


def _services(snapshot: Snapshot) -> Table:
    table = _grid(12, 9, 11, 14, 30)
    for name, state in snapshot.nodes.items():
        age = "" if state.age is None else f"newest row {state.age:.1f} s ago"
        table.add_row(
            Text(name, "bright_black"),
            Text(state.state, _STATE_STYLES.get(state.state, "bright_black")),
            Text(_number(state.rate, "{:.1f} Hz")),
            Text(f"lost {state.lost}", "bold red" if state.lost else ""),
            Text(age if state.state != "running" else "", "bold red"),
        )
    return table


def _quantities(snapshot: Snapshot) -> Table:
    table = _grid(16, 8, 6, 14, 1, _POINTS)
    table.columns[1].justify = "right"
    for quantity in QUANTITIES:
        value, trace = snapshot.values[quantity.name], snapshot.traces[quantity.name]
        shared = np.concatenate([snapshot.traces[q.name] for q in QUANTITIES if q.group == quantity.group])
        low = float(np.nanmin(shared, initial=quantity.full))
        high = max(float(np.nanmax(shared, initial=0.0)), low + _LEAST_RANGE * quantity.full)
        table.add_row(
            Text(quantity.name, "bright_black"),
            Text("-" if np.isnan(value) else f"{value:.2f}", "bold"),
            "" if quantity.unit == "1" else quantity.unit,
            bar(value, quantity.full, 14),
            "",
            Text(sparkline(trace, low, high), "cyan"),
        )
    return table


def _timing(snapshot: Snapshot) -> Table:
    table = _grid(10, 9, 6, 6, 11, 6, 6, 6, 1, 10)
    for column in table.columns[1:-1]:
        column.justify = "right"
    head = ("", "wake p50", "p99", "max", "work p50", "p99", "max", "late", "", "p99/period")
    table.add_row(*(Text(name, "bright_black") for name in head))
    for name, state in snapshot.nodes.items():
        busy = state.wake.p99 + state.work.p99
        table.add_row(
            Text(name, "bright_black"),
            *(_number(value, "{:.0f}") for value in (*state.wake, *state.work)),
            Text(str(state.late) if state.cycles else "-", "bold red" if state.late else ""),
            "",
            bar(busy, state.period_us, 10, "cyan" if busy < state.period_us else "bold red"),
        )
    return table


def _changes(snapshot: Snapshot) -> list[Text]:
    lines = [
        Text(
            f"{datetime.fromtimestamp(change['time']):%H:%M:%S}  {change['node']}.{change['name']}"
            f"  {change['old']:g} -> {change['new']:g} {change['unit']}",
            no_wrap=True,
            overflow="ellipsis",
        )
        for change in reversed(snapshot.changes)
    ]
    return lines or [Text("none", "bright_black")]


def _grid(*widths: int) -> Table:
    table = Table.grid(padding=(0, 1))
    for width in widths:
        table.add_column(width=width, no_wrap=True)
    return table


def _number(value: float, form: str) -> str:
    return "-" if np.isnan(value) else form.format(value)


def watch(
    bus: str | None, router: str | None, once: bool, seconds: float | None, quiet: bool
) -> tuple[dict[str, Any], str, str, bool]:
    """Watch the bench on `bus`, None for the only one, for `seconds`, None until Ctrl-C; `once`: only long enough to see.

    Returns document, text, verdict and whether all is well. Raises InputError when there is no such bench.
    """
    if seconds is not None and not seconds > 0.0:
        raise InputError(f"monitor cannot watch for {seconds:g} s; allowed is more than 0")
    with (
        Stop() as stop,
        consumer_session(router) as session,
        Feed(session, bench := find_bench(session, bus), live=True) as feed,
        _Screen(quiet or once) as screen,
    ):
        collector = Collector(bench)
        began = time.monotonic()
        end = _FIRST_LOOK if once else seconds
        looked = False
        while True:
            collector.take(feed.read(_READ), now := time.monotonic())
            collector.note(feed.events())
            collector.alive, collector.lost = feed.alive, feed.lost
            elapsed = now - began
            if not looked and elapsed >= _FIRST_LOOK:  # who stalled before we came has sent no row
                looked = True
                for node in collector.silent():
                    collector.last_rows[node] = (ask(session, Keys(bench, node).last) or {"row": -1})["row"]
            if stop.asked or (end is not None and elapsed >= end and looked):
                break
            screen.show(collector, now)
        snapshot = collector.snapshot(time.monotonic())
    troubles = snapshot.troubles()
    verdict = "; ".join(troubles) or f"{_listed(snapshot)}, phase {snapshot.phase or '-'}, no fault"
    text = f"read:    telemetry of {bus_of(bench)} for {elapsed:.1f} s\nwrote:   nothing"
    if once:
        text = f"{_plain(snapshot)}\n{text}"
    return document(snapshot), text, verdict, not troubles


def _listed(snapshot: Snapshot) -> str:
    return ", ".join(f"{name} {state.state}" for name, state in snapshot.nodes.items() if state.state != "absent")


def _plain(snapshot: Snapshot) -> str:
    """The screen as text, in the colours the terminal has."""
    console = Console(width=80)
    with console.capture() as capture:
        console.print(drawn(snapshot))
    return capture.get().rstrip("\n")


class _Screen:
    """Snapshots on the whole terminal, or a line every 2 s where there is none; nothing when `quiet`."""

    def __init__(self, quiet: bool) -> None:
        self._quiet = quiet
        self._console = Console()
        self._live = Live(console=self._console, screen=True, auto_refresh=False)
        self._every = _DRAW_EVERY if self._console.is_terminal else _PLAIN_EVERY
        self._next = 0.0

    def __enter__(self) -> "_Screen":
        if self._console.is_terminal and not self._quiet:
            self._live.start()
        return self

    def __exit__(self, *_: object) -> None:
        self._live.stop()

    def show(self, collector: Collector, now: float) -> None:
        """Show a snapshot when it is time."""
        if self._quiet or now < self._next:
            return
        self._next = now + self._every
        snapshot = collector.snapshot(now)
        if self._console.is_terminal:
            self._live.update(drawn(snapshot), refresh=True)
        else:
            print(line(snapshot), flush=True)
