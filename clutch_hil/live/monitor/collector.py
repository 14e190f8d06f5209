"""Collector: make a snapshot of a bench's last ten seconds from its batches, without zenoh."""

from collections import deque
from collections.abc import Iterable, Mapping
from typing import Any

import numpy as np

from clutch_hil.bench import clutch_state
from clutch_hil.bench.direction import find_directions
from clutch_hil.live.monitor.snapshot import NO_TIMES, QUANTITIES, ClutchSnapshot, NodeState, Percentiles, Snapshot
from clutch_hil.live.viewer.dashboard import split_clutch_name
from protocols.can.claim import Supervision
from protocols.can.fault_text import FaultWatch, find_clutch, waits_for_idle
from protocols.can.frames import load_frames
from protocols.can.two_clutches import CLUTCHES, CONTROLLERS
from protocols.telemetry.batch import Batch
from protocols.telemetry.keys import NODES

WINDOW = 10.0  # s of rows for percentiles and sparklines
STALL_SECONDS = 0.5  # s without a row after which a service counts as stalled; batches arrive every 20 ms
POINTS = 30  # characters of a sparkline: three per second
_CHANGES = 3  # parameter changes that are shown
_TIMING = ("clock_s", "wake_us", "work_us", "late_cycles")
# columns by their names on a rig with a single clutch
_SHOWN = (
    {q.column for q in QUANTITIES}
    | {f"controller_{name}" for name in ("phase", "request", "fault", "supervisor")}
    | {clutch_state.COLUMN}
)


class _RecentRows:
    """Rows of the last WINDOW seconds since the last start of a service, in the displayed columns.

    of_two: whether the rows belong to a plant with two clutches.
    """

    def __init__(self, batch: Batch) -> None:
        wanted = _SHOWN | {f"{node}_{name}" for node in ("plant", "controller") for name in _TIMING}
        single = [split_clutch_name(column) for column in batch.columns]
        if batch.node in CONTROLLERS:  # all its columns belong to one clutch, so their names have no clutch
            single = [(name, "") for name, _ in single]
        self.session, self.rate = batch.session, batch.rate
        self.of_two = CLUTCHES[1] in {clutch for _, clutch in single}
        self._index = [i for i, (name, _) in enumerate(single) if name in wanted]
        self._place = {single[i]: place for place, i in enumerate(self._index)}
        self._pieces: deque[np.ndarray] = deque()
        self._count = 0
        self.newest = 0.0  # s, arrival of the newest row

    def take(self, batch: Batch, now: float) -> None:
        """Add rows that arrived at `now` [s]."""
        if not len(batch.rows):
            return
        self.newest = now
        self._pieces.append(batch.rows[:, self._index])
        self._count += len(batch.rows)
        while self._count - len(self._pieces[0]) >= WINDOW * self.rate:
            self._count -= len(self._pieces.popleft())

    def join_rows(self) -> np.ndarray:
        """Return the rows, shape (rows, columns), at most WINDOW seconds."""
        return np.concatenate(self._pieces)[-round(WINDOW * self.rate) :]

    def select_column(self, rows: np.ndarray, name: str, clutch: str = "") -> np.ndarray:
        """Return a column of `rows` by its name for a single clutch; NaN when the service does not publish it.

        clutch: a or b, for a column of one of two clutches of a plant.
        """
        place = self._place.get((name, clutch))
        return rows[:, place] if place is not None else np.full(len(rows), np.nan)


class Collector:
    """Store the last ten seconds of batches of a feed, and make snapshots."""

    def __init__(self, bench: str) -> None:
        frames = load_frames()
        self.alive: Mapping[str, bool] = {}
        self.lost: Mapping[str, int] = {}
        self.last_rows: dict[str, int] = {}  # newest row of a service that sends none: -1 when it has no row yet
        self._bench = bench
        self._phases = frames["CONTROLLER_STATUS"].list_choices("phase")
        self._faults = frames["CONTROLLER_STATUS"].list_choices("fault")
        self._traces: dict[str, _RecentRows] = {}
        self._watches: dict[str, FaultWatch] = {}  # by controller
        self._fault_lines: dict[str, str] = {}  # the last line of each, newest last
        self._changes: list[Mapping[str, Any]] = []

    def take(self, batches: Iterable[Batch], now: float) -> None:
        """Add batches that arrived at `now` [s, of any steady clock]."""
        for batch in batches:
            trace = self._traces.get(batch.node)
            if anew := trace is None or trace.session != batch.session:
                trace = self._traces[batch.node] = _RecentRows(batch)
            trace.take(batch, now)
            if anew:
                self._watches.pop(batch.node, None)
            names = [column.name.removeprefix(f"{batch.node}_") for column in batch.columns]
            if len(batch.rows) and batch.node.startswith("controller") and "fault" in names:
                self._take_faults(batch, names)

    def _take_faults(self, batch: Batch, names: list[str]) -> None:
        """Store the faults that begin or end in a controller's batch; names: its columns without the node's prefix."""
        node = batch.node
        watch = self._watches.setdefault(node, FaultWatch(names, batch.rate, clutch=find_clutch(node)))
        for fault in watch.take(batch.rows):
            before = self._fault_lines.pop(node, None)
            self._fault_lines[node] = fault.line if fault.name != "none" else f"{before}; {fault.line}"

    def add_changes(self, events: Iterable[Mapping[str, Any]]) -> None:
        """Add changes of parameters; a change that arrives twice, live and with the history, counts once."""
        new = [event for event in events if event not in self._changes]
        self._changes = sorted((*self._changes, *new), key=lambda event: event["time"])[-_CHANGES:]

    def list_silent(self) -> list[str]:
        """Return the nodes that run and have sent no row."""
        return [node for node in self._list_nodes() if self.alive.get(node) and node not in self._traces]

    def make_snapshot(self, now: float) -> Snapshot:
        """Return the state of the bench at `now` [s]."""
        rows = {node: trace.join_rows() for node, trace in self._traces.items()}
        plant, *controllers = self._list_nodes()
        names = CLUTCHES if len(controllers) > 1 else ("",)
        return Snapshot(
            self._bench,
            {node: self._describe_node(node, rows.get(node), now) for node in (plant, *controllers)},
            [self._describe_clutch(rows, name, node) for name, node in zip(names, controllers, strict=True)],
            tuple(self._changes),
            next(reversed(self._fault_lines.values()), None),
        )

    def _list_nodes(self) -> tuple[str, ...]:
        """Return the nodes of the bench; clutch b's controller only if it publishes or the plant has two clutches."""
        second = CONTROLLERS[1]
        plant = self._traces.get("plant")
        of_two = second in self._traces or self.alive.get(second) is not None or (plant is not None and plant.of_two)
        return (*NODES, second) if of_two else NODES

    def _describe_clutch(self, rows: Mapping[str, np.ndarray], name: str, controller: str) -> ClutchSnapshot:
        values, traces = {}, {}
        for quantity in QUANTITIES:
            of_plant = quantity.node == "plant"
            node = "plant" if of_plant else controller
            column = self._select_column(rows, node, quantity.column, name if of_plant else "")
            values[quantity.name] = float(column[-1]) if len(column) else float("nan")
            traces[quantity.name] = self._decimate(node, column)
        # the demand is a magnitude; it is drawn over the signed torque
        traces["torque demand"] = traces["torque demand"] * find_directions(traces["slip"], traces["torque estimate"])
        alive = self.alive.get(controller, False)
        watch = self._watches.get(controller)
        phase, request = (self._select_column(rows, controller, f"controller_{term}") for term in ("phase", "request"))
        supervisor = self._select_column(rows, controller, "controller_supervisor")
        states = dict(enumerate(clutch_state.STATES))
        return ClutchSnapshot(
            name,
            controller,
            self._find_state_name(rows, controller, "controller_phase", self._phases) if alive else None,
            self._find_state_name(rows, controller, "controller_fault", self._faults) if alive else None,
            self._find_state_name(rows, controller, clutch_state.COLUMN, states) if alive else None,
            values,
            traces,
            self._fault_lines.get(controller),
            alive and watch is not None and watch.stands,
            alive and bool(len(phase)) and waits_for_idle(float(phase[-1]), float(request[-1])),
            alive and bool(len(supervisor)) and bool(supervisor[-1] == Supervision.CONTESTED),
        )

    def _select_column(self, rows: Mapping[str, np.ndarray], node: str, name: str, clutch: str = "") -> np.ndarray:
        return self._traces[node].select_column(rows[node], name, clutch) if node in rows else np.empty(0)

    def _find_state_name(
        self, rows: Mapping[str, np.ndarray], controller: str, column: str, names: Mapping[int, str]
    ) -> str | None:
        values = self._select_column(rows, controller, column)
        if not len(values) or not np.isfinite(values[-1]):
            return None
        return names.get(int(values[-1]), f"{values[-1]:g}")

    def _decimate(self, node: str, column: np.ndarray) -> np.ndarray:
        """Return POINTS values of the last WINDOW seconds, newest last; NaN before the first row."""
        if not len(column):
            return np.full(POINTS, np.nan)
        ago = np.arange(POINTS)[::-1] * WINDOW * self._traces[node].rate / POINTS
        index = len(column) - 1 - np.round(ago).astype(int)
        return np.where(index >= 0, column[np.maximum(index, 0)], np.nan)

    def _describe_node(self, node: str, rows: np.ndarray | None, now: float) -> NodeState:
        alive, trace = self.alive.get(node, False), self._traces.get(node)
        if trace is None or rows is None:
            stalled = self.last_rows.get(node, -1) >= 0
            return NodeState(("stalled" if stalled else "waiting") if alive else "absent")
        age = now - trace.newest
        kind = "plant" if node == "plant" else "controller"
        clock, wake, work, late = (trace.select_column(rows, f"{kind}_{name}") for name in _TIMING)
        took = clock[-1] - clock[0]
        return NodeState(
            "gone" if not alive else "stalled" if age > STALL_SECONDS else "running",
            age,
            (len(rows) - 1) / took if took > 0.0 else float("nan"),
            1e6 / trace.rate,
            len(rows),
            int(np.nan_to_num(late[-1] - late[0])),
            self.lost.get(node, 0),
            _compute_percentiles(wake),
            _compute_percentiles(work),
        )


def _compute_percentiles(values: np.ndarray) -> Percentiles:
    known = values[np.isfinite(values)]
    return Percentiles(*np.percentile(known, (50.0, 99.0, 100.0)).tolist()) if len(known) else NO_TIMES
