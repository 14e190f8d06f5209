"""Replay: show one recorded run in the viewer, or two side by side, and convert run files to .rrd."""

from collections import Counter
from collections.abc import Iterator, Sequence
from concurrent.futures import Future, ThreadPoolExecutor
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from clutch_hil.bench.direction import find_symmetric_reach
from clutch_hil.bench.run_file import COLUMNS_OF_ANY_RIG, read_run
from clutch_hil.live.viewer.blueprint import build_blueprint
from clutch_hil.live.viewer.dashboard import SLIP
from clutch_hil.live.viewer.rrd_writer import RrdWriter
from clutch_hil.live.viewer.screen import Screen
from clutch_hil.live.viewer.stream import make_recording
from clutch_hil.live.viewer.view import Watch
from clutch_hil.live.viewer.viewer import Say, Viewer
from protocols.can.two_clutches import CONTROLLERS
from protocols.errors import InputError, join_names
from protocols.files.run import Run
from protocols.files.runs import SUFFIXES
from protocols.files.stretch import WHOLE, Stretch
from protocols.input_file import check_file
from protocols.node import Column
from protocols.realtime.notify import NoNotifier
from protocols.realtime.stopping import Stop
from protocols.telemetry.batch import Batch

TIMELINE = "rig_time"
MOST_RUNS = 2  # side by side
_BATCH_ROWS = 10_000  # few large batches cost least
_PREFIXES = ("/a", "/b")  # prefixes of two runs


def load_batches(path: Path, stretch: Stretch = WHOLE) -> list[Batch]:
    """Return the rows of a run file, or part of one, or of a saved view (.rrd), node by node. Raises InputError."""
    if path.suffix.lower() not in (*SUFFIXES, ".rrd"):
        raise InputError(
            f"run {path} has the suffix {path.suffix or '-'}; allowed are {join_names((*SUFFIXES, '.rrd'))}"
        )
    check_file(path, "run")
    if path.suffix.lower() == ".rrd":
        if not stretch.is_whole:
            raise InputError(
                f"run {path} is a saved view, which can only be shown completely; a part can be taken from"
                f" {join_names(SUFFIXES)}"
            )
        from clutch_hil.live.viewer.rrd_reader import read_rrd

        tables = read_rrd(path)
        if any("/" in node for node in tables):
            raise InputError(f"run {path} contains two runs side by side; give the original files")
        return [batch for table in tables.values() for batch in table.make_batches()]
    return list(run_batches(read_run(path, COLUMNS_OF_ANY_RIG, from_s=stretch.from_s, to_s=stretch.to_s)))


def run_batches(run: Run) -> Iterator[Batch]:
    """Yield the rows of a run as a bench would have published them: those of the plant, then those of each controller."""
    rate = 1.0 / float(np.median(np.diff(run["time_s"])))
    described = run.describe_columns()
    by_node: dict[str, list[Column]] = {node: [] for node in ("plant", *CONTROLLERS)}
    for column in described:
        own = [node for node in CONTROLLERS if column.name.startswith(f"{node}_")]
        by_node[max(own, key=len, default="plant")].append(column)  # the name of a's controller begins that of b's
    for node, columns in by_node.items():
        if columns:
            rows = np.column_stack([run[column.name] for column in columns])
            for first in range(0, len(rows), _BATCH_ROWS):
                yield Batch(node, 0, first, round(rate, 6), 0.0, 0, tuple(columns), rows[first : first + _BATCH_ROWS])


def export_rrd(run_path: Path, out_path: Path, stretch: Stretch = WHOLE) -> None:
    """Write a run file, or a part of it, as an .rrd file. Raises InputError."""
    Replay([run_path], stretch).save(out_path)


@dataclass
class ReplayResult:
    """Result of a replay."""

    read: dict[str, int]  # rows by file
    saved: dict[str, Any] | None = None  # path and bytes of the file
    viewer: str | None = None  # why the viewer failed; None when it was closed by a person or by this program

    @property
    def good(self) -> bool:
        """Return whether the viewer did not fail."""
        return not self.viewer

    @property
    def verdict(self) -> str:
        """Return the verdict line."""
        return self.viewer or ("side by side" if len(self.read) > 1 else "completely")

    @property
    def text(self) -> str:
        """Return the files read and written, for people."""
        lines = [f"read:    {path}  ({rows} samples)" for path, rows in self.read.items()]
        if self.saved:
            lines.append(f"wrote:   {self.saved['path']}  ({self.saved['bytes'] / 1e6:.1f} MB)")
        return "\n".join(lines)

    @property
    def document(self) -> dict[str, Any]:
        """Return the result for JSON."""
        return {"read": self.read, "saved": self.saved, "viewer_ended": self.viewer, "verdict": self.verdict}


class Replay:
    """One or two recorded runs on the rig's time, or the same part of each. Raises InputError for an invalid file."""

    def __init__(self, paths: Sequence[Path], stretch: Stretch = WHOLE) -> None:
        if len(paths) > MOST_RUNS:
            raise InputError(f"{len(paths)} runs were given; allowed are one, or two to show side by side")
        if len(set(paths)) < len(paths):
            raise InputError(f"run {paths[0]} was given twice; give two different files")
        self._runs = {path: load_batches(path, stretch) for path in paths}
        self._prefixes = _PREFIXES if len(paths) > 1 else ("",)
        stems = [path.stem for path in paths]
        self._names = stems if len(set(stems)) == len(stems) else list(map(str, paths))
        titles = self._names if len(paths) > 1 else [""]
        slips = [_find_slip_reach(batches) for batches in self._runs.values()]
        self._blueprint = build_blueprint(TIMELINE, self._prefixes, titles, window=None, slips=slips)

    @property
    def name(self) -> str:
        """Return the name of the recording in the viewer."""
        return " and ".join(self._names)

    def run(self, viewer: Viewer | None, save: Path | None, seconds: float | None, say: Say) -> ReplayResult:
        """Save, then show until the window is closed, `seconds` have passed or a signal arrives. Raises InputError."""
        rows = {str(path): _count_rows(batches) for path, batches in self._runs.items()}
        result = ReplayResult(rows, saved=self.save(save) if save else None)
        if viewer:
            with Stop() as stop, ThreadPoolExecutor(1) as pool, viewer:
                viewer.announce(say)
                watch = Watch(stop, seconds, NoNotifier())
                # rerun's calls may block for ever while the viewer runs, so another thread sends
                sending = pool.submit(self._send, viewer.url)
                while not watch.is_over and viewer.find_exit_reason() is None:
                    watch.wait()
                    _raise_error(sending)
                result.viewer = viewer.find_exit_reason() or None
        return result

    def save(self, path: Path) -> dict[str, Any]:
        """Write an .rrd file; return its path and size. Raises InputError."""
        with RrdWriter(path, self.name, self._blueprint, TIMELINE, self._prefixes) as writer:
            for number, batches in enumerate(self._runs.values()):
                writer.put(batches, screen=number)
            writer.finish()
        return {"path": str(path), "bytes": path.stat().st_size}

    def _send(self, url: str) -> None:
        recording = make_recording(self.name)
        recording.connect_grpc(url)
        recording.send_recording_name(self.name)
        recording.send_blueprint(self._blueprint, make_active=True, make_default=True)
        for prefix, batches in zip(self._prefixes, self._runs.values(), strict=True):
            screen = Screen(recording, TIMELINE, prefix)
            screen.open()
            for batch in batches:
                screen.log(batch)
        recording.flush()


def _find_slip_reach(batches: Sequence[Batch]) -> float | None:
    """Return the reach of the slip axis to both sides [rad/s]; None where the clutch slips in one direction only."""
    lines = {line.column for line in SLIP.lines}
    return find_symmetric_reach(
        *(batch[c.name] for batch in batches for c in batch.columns if c.name in lines), np.empty(0)
    )


def _count_rows(batches: Sequence[Batch]) -> int:
    """Return the number of rows of the node with the most rows."""
    rows: Counter[str] = Counter()
    for batch in batches:
        rows[batch.node] += len(batch.rows)
    return max(rows.values(), default=0)


def _raise_error(sending: "Future[None]") -> None:
    if sending.done():
        sending.result()
