"""Recorder: write the rows of a bench to run files.

A run file has one row for each sample, at a constant rate, and no row is invented. So where rows of the plant were lost, or
where the plant was restarted, a file ends and the next one begins: RUN.parquet, RUN-2.parquet, ...
"""

import contextlib
import itertools
import time
from collections import defaultdict, deque
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from datetime import datetime
from pathlib import Path
from types import TracebackType
from typing import Any

import zenoh

from clutch_hil.bench.recording import Recording, make_writable, reserve_run_path
from clutch_hil.bench.rig import DEFAULT_RIG, find_rig
from clutch_hil.bench.sealed import SealedRecording
from clutch_hil.live.recording.tape import Tape
from clutch_hil.live.tuning.tune import request_parameters
from protocols.can.fault_text import FaultWatch, find_clutch
from protocols.can.two_clutches import CONTROLLERS
from protocols.errors import InputError, format_count
from protocols.node import Column
from protocols.telemetry.batch import Batch
from protocols.telemetry.feed import Feed
from protocols.telemetry.keys import NODES, find_bus

RUNS = "runs"  # folder of recordings without a given name
_INJECTION_KEYS = ("name", "unit", "old", "new", "at", "ramp", "row")  # of an event, for the metadata
_KEPT_BATCHES = 100  # batches kept of each controller, because they may arrive before the rows of the plant
_DESCRIPTION_TIMEOUT = 10.0  # s from the first row, within which every node must have described itself


@dataclass
class RecordingResult:
    """Result of a recording: number of samples by file, number of lost rows by node, number of parameter changes; rate [Hz]."""

    bench: str
    rate: int = 0
    files: dict[Path, int] = field(default_factory=dict)
    lost: dict[str, int] = field(default_factory=dict)
    parameter_changes: int = 0
    faults: str = ""  # as text, for the verdict
    fault_count: int = 0
    rejections: str = ""  # data from other senders under the keys of the bench, for the verdict

    @property
    def good(self) -> bool:
        """Return whether no row was lost, and no controller had a fault."""
        return not any(self.lost.values()) and not self.fault_count

    @property
    def verdict(self) -> str:
        """Return the verdict line."""
        seconds = sum(self.files.values()) / self.rate
        length = f"{seconds:.1f} s recorded"
        if len(self.files) > 1:
            length += f" in {len(self.files)} files: the plant was restarted or rows were lost"
        lost = f"; rows that did not arrive: {_count_rows(self.lost)}" if any(self.lost.values()) else ", no row lost"
        return "; ".join(filter(None, (f"{length}{lost}", self.faults, self.rejections)))

    @property
    def text(self) -> str:
        """Return what was read and written, as text."""
        changes = f", {format_count(self.parameter_changes, 'parameter')} changed" if self.parameter_changes else ""
        lines = [f"read:    bench {self.bench}, {self.rate} Hz{changes}"]
        lines += [f"wrote:   {path}  ({samples} samples)" for path, samples in self.files.items()]
        return "\n".join(lines)

    @property
    def document(self) -> dict[str, Any]:
        """Return the result for JSON."""
        return {
            "bench": self.bench,
            "rate_hz": self.rate,
            "runs": {str(path): samples for path, samples in self.files.items()},
            "rows_lost": self.lost,
            "parameter_changes": self.parameter_changes,
            "faults": self.fault_count,
            "rejections": self.rejections,
            "verdict": self.verdict,
            "good": self.good,
        }


@dataclass(frozen=True)
class _NodeDescription:
    """Description that a node gave of itself when it was `asked` [s of CLOCK_MONOTONIC, which nobody sets]."""

    node: str
    described: dict[str, Any]
    parameters: dict[str, float]
    asked: float

    def list_parameters_at(self, clock: float, changes: Sequence[dict[str, Any]]) -> dict[str, float]:
        """Return the parameters at a `clock` [s of CLOCK_MONOTONIC]: those when `asked`, with later changes made or undone."""
        own = [(change["clock_s"], change) for change in changes if change["node"] == self.node and "clock_s" in change]
        later = {change["name"]: change["new"] for at, change in own if self.asked < at < clock}
        earlier = {change["name"]: change["old"] for at, change in reversed(own) if clock <= at <= self.asked}
        return self.parameters | later | earlier


class Recorder:
    """Record the rows of `feed` to `path`, and to further files beside it. Use as a context manager.

    path: if None, the file is named by date and time, in the folder `runs`. blind: keep the truth out of the run files.
    tell: called with lines that remain on the terminal.
    """

    def __init__(
        self,
        session: zenoh.Session,
        feed: Feed,
        path: Path | None,
        blind: bool = False,
        tell: Callable[[str], None] = print,
    ) -> None:
        self.recorded = RecordingResult(feed.bench)
        self._session, self._feed, self._path = session, feed, path
        self._blind = blind
        self._tapes: dict[Path, Tape] = {}  # the last one receives rows; earlier ones wait for rows of the controllers
        self._metadata: dict[Path, dict[str, Any]] = {}
        self._descriptions: dict[str, _NodeDescription] = {}  # by node
        self._early: list[Batch] = []  # of the plant, before every node has described itself
        self._deadline = float("inf")  # s of CLOCK_MONOTONIC, for all nodes to describe themselves
        self._recent: dict[str, deque[Batch]] = defaultdict(lambda: deque(maxlen=_KEPT_BATCHES))  # by controller
        self._tell = tell  # prints a line that remains on the terminal
        self._faults: dict[str, FaultWatch] = {}  # by controller
        self._changes: list[dict[str, Any]] = []

    def __enter__(self) -> "Recorder":
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        kept: InputError | None = None
        for tape in self._tapes.values():
            try:
                tape.abandon(error)
            except InputError as where:  # `error`, and the file that has the rows
                kept = where
        if kept:
            raise kept

    @property
    def began(self) -> bool:
        """Return whether rows of the plant have arrived."""
        return bool(self._metadata)

    def describe_status(self) -> str:
        """Return what has been recorded so far, as text."""
        if not self.began:
            return f"bench {self._feed.bench}: waiting for the plant's first row"
        samples = sum(self.recorded.files.values()) + sum(tape.rows for tape in self._tapes.values())
        return f"bench {self._feed.bench}: {samples} samples, lost {sum(self._feed.lost.values())}"

    def step(self, plant: bool = True) -> bool:
        """Process the rows that have arrived, those of the plant only if `plant`; return whether any arrived.

        Raises InputError when a node does not describe itself.
        """
        for path in list(self._tapes)[:-1]:
            self._close(path)
        batches = self._feed.read()
        for node, alive in self._feed.alive.items():
            if alive and node not in self._descriptions:
                self._ask(node)
        if plant:
            self._early += [batch for batch in batches if batch.node == "plant"]
        if (batches or self._early) and self._are_all_described():
            for batch in self._early:
                self._add_plant(batch)
            self._early.clear()
        for batch in batches:
            if batch.node in CONTROLLERS:
                self._take_faults(batch)
                self._recent[batch.node].append(batch)
                for tape in self._tapes.values() if batch.node in self._list_nodes() else ():
                    tape.add_controller(batch)
        self._note_changes()
        return bool(batches)

    def finish(self) -> None:
        """Finish the files. Raises InputError if there is none."""
        for path in list(self._tapes):
            self._close(path)
        self.recorded.lost = dict(self._feed.lost)
        self.recorded.rejections = self._feed.rejections
        self.recorded.faults = "; ".join(watch.verdict for watch in self._faults.values() if watch.count)
        self.recorded.fault_count = sum(watch.count for watch in self._faults.values())
        self.recorded.parameter_changes = len(self._changes)
        if not self.recorded.files:
            raise InputError(f"bench {self._feed.bench} published no rows; nothing was recorded")

    def _take_faults(self, batch: Batch) -> None:
        """Report the faults that begin or end in a batch of a controller."""
        node = batch.node
        if node not in self._faults:
            about = self._descriptions.get(node)
            names = [column.name.removeprefix(f"{node}_") for column in batch.columns]
            self._faults[node] = FaultWatch(names, batch.rate, about.parameters if about else None, find_clutch(node))
        for fault in self._faults[node].take(batch.rows):
            self._tell(fault.line)

    def _list_nodes(self) -> tuple[str, ...]:
        """Return the nodes of a run: the plant, and the controllers that it names."""
        if "plant" not in self._descriptions:
            return NODES
        return ("plant", *self._descriptions["plant"].described.get("controllers", NODES[1:]))

    def _are_all_described(self) -> bool:
        """Return whether all nodes have described themselves. Raises InputError when one has not before the deadline."""
        missing = [node for node in self._list_nodes() if node not in self._descriptions]
        self._deadline = min(self._deadline, time.monotonic() + _DESCRIPTION_TIMEOUT)
        if missing and time.monotonic() > self._deadline:
            raise InputError(
                f"the {missing[0]} of bench {self._feed.bench} publishes no telemetry; a run needs plant and controller"
            )
        return not missing

    def _add_plant(self, batch: Batch) -> None:
        """Add `batch` to the last tape if it continues there; else to a new tape, with the recent rows of the controllers."""
        last = list(self._tapes.values())[-1:]
        if last and last[0].follows(batch):
            last[0].add_plant(batch)
            return
        tape = self._make_tape(batch)
        tape.add_plant(batch)
        _, *controllers = self._list_nodes()
        for recent in (recent for node in controllers for recent in self._recent[node]):
            tape.add_controller(recent)

    def _make_tape(self, batch: Batch) -> Tape:
        """Return a tape that begins with `batch` of the plant."""
        if self._descriptions["plant"].described["session"] != batch.session:
            for node in self._list_nodes():
                self._ask(node)
        first = self._path = self._path or reserve_run_path(make_writable(Path(RUNS)), "recorded")
        further = (first.with_stem(f"{first.stem}-{count}") for count in itertools.count(2))
        path = next(p for p in further if not (p.exists() or p in self._metadata)) if self._metadata else first
        rig = self._descriptions["plant"].described.get("rig", DEFAULT_RIG)
        if self._blind:
            find_rig(rig).plant.check_blind(True)
        columns = {node: self._list_columns(node) for node in self._list_nodes()}
        plant = columns.pop("plant")
        recording = SealedRecording if self._blind else Recording
        tape = self._tapes[path] = Tape(make_rows_path(path), batch, plant, columns, recording)
        clock = float(batch["plant_clock_s"][0])
        # of the description: the time of day may have been set since the start of the plant
        began = clock + float(self._descriptions["plant"].described.get("epoch_s", batch.epoch))
        self.recorded.rate = round(batch.rate)
        self._note_changes()
        self._metadata[path] = {
            "rig": rig,
            "sample_rate_hz": round(batch.rate),
            "notes": "",
            "recorded_at": _format_time(began),
            "time_zero": _format_time(began - batch["time_s"][0]),
            "versions": self._descriptions["plant"].described["versions"],
            **{
                f"{node}_parameters": self._descriptions[node].list_parameters_at(clock, self._changes)
                for node in self._list_nodes()
            },
            "settings": {"mode": "recorded from telemetry"},
            "bus": find_bus(self._feed.bench),
            "blind": self._descriptions["plant"].described.get("blind", False),
        }
        tape.keep_journal(self._metadata[path])
        return tape

    def _list_columns(self, node: str) -> list[Column]:
        """Return the columns of a node, from its description."""
        return [Column(**column) for column in self._descriptions[node].described["columns"]]

    def _note_changes(self) -> None:
        self._changes += self._feed.take_events()

    def _ask(self, node: str) -> None:
        """Request the description of a node as soon as it is alive: it may have ended before its last rows arrive."""
        asked_at = self._feed.read_clock(node)
        if (described := self._feed.describe(node)) is not None:
            with contextlib.suppress(InputError):  # it has ended in the meantime
                entries = request_parameters(self._session, self._feed.bench, node)
                values = {entry["name"]: entry["value"] for entry in entries}
                self._descriptions[node] = _NodeDescription(node, described, values, asked_at)

    def _close(self, path: Path) -> None:
        closing = {
            "parameter_changes": [change for change in self._changes if "injection" not in change],
            "injections": [
                {key: change[key] for key in _INJECTION_KEYS} for change in self._changes if "injection" in change
            ],
            "requests": self._feed.read_requests(),
            "record_rows_lost": sum(self._feed.lost.values()),
        }
        tape = self._tapes[path]
        tape.close(self._metadata[path] | closing)
        del self._tapes[path]
        if tape.rows > 1:
            self.recorded.files[path] = tape.rows


def make_rows_path(path: Path) -> Path:
    """Return the Parquet file to which rows for `path` are written as they arrive."""
    return path if path.suffix.lower() == ".parquet" else path.with_name(path.name + ".parquet")


def _count_rows(rows: dict[str, int]) -> str:
    return ", ".join(f"{count} of the {node}" for node, count in rows.items() if count)


def _format_time(unix: float) -> str:
    return datetime.fromtimestamp(unix).astimezone().isoformat(timespec="microseconds")
