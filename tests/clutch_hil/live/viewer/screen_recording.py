"""A recording in a file that screens log into, and the simulated rows they log."""

from collections import defaultdict
from collections.abc import Iterable, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import rerun as rr
import rerun.blueprint as rrb
import rerun.chunk

from clutch_hil.bench.in_process import play
from clutch_hil.live.viewer.screen import Screen
from plant_sim.node.plant_node import PlantNode
from plant_sim.profiles.profile import load_profile
from protocols.node import Column
from protocols.telemetry.batch import Batch, list_run_columns
from rt_controller.loop.node import ControllerNode

RATE = 1000  # Hz
SECONDS = 1.0  # idle, fill and slip control of the engagement profile
EPOCH = 1.7e9  # s


def simulate_nodes() -> dict[str, Batch]:
    """The rows of both nodes of a simulated engagement, as a service publishes them."""
    profile = load_profile("engagement", SECONDS)
    controller = ControllerNode(RATE)
    played = play(PlantNode(RATE, profile=profile), controller)
    plant = _with_clock("plant", tuple(played.plant_columns), played.plant)
    return {
        "plant": plant,
        "controller": _with_clock(
            "controller", list_run_columns("controller", played.controller_columns[0]), played.controllers[0]
        ),
    }


def _with_clock(node: str, columns: tuple[Column, ...], rows: np.ndarray) -> Batch:
    more = tuple(Column(f"{node}_{name}", unit, "") for name, unit in (("clock_s", "s"), ("work_us", "us")))
    count = len(rows)
    clock = 100.0 + np.arange(count) / RATE
    return Batch(node, 1, 0, RATE, EPOCH, 0, columns + more, np.column_stack([rows, clock, np.full(count, 60.0)]))


def cut_pieces(nodes: dict[str, Batch], size: int = 100) -> Iterable[Batch]:
    """Batches of `size` rows, the nodes in turn."""
    for begin in range(0, len(nodes["plant"].rows), size):
        for batch in nodes.values():
            yield cut_rows(batch, begin, begin + size)


def cut_rows(batch: Batch, begin: int, end: int, **changes: Any) -> Batch:
    values = {
        "node": batch.node, "session": batch.session, "first_row": begin, "rate": batch.rate, "epoch": batch.epoch,
        "rows_lost": 0, "columns": batch.columns, "rows": batch.rows[begin:end],
    }  # fmt: skip
    return Batch(**(values | changes))


class Logged:
    """A recording in a file that screens log into, and what stands in it."""

    def __init__(self, path: Path, layout: rrb.Blueprint | None = None) -> None:
        self.path = path
        self.recording = rr.RecordingStream("clutch-hil")
        self.recording.set_log_time_enabled(False)
        self.recording.set_log_tick_enabled(False)
        self.recording.save(path, default_blueprint=layout)

    def make_screen(self, batches: Iterable[Batch], timeline: str = "time", prefix: str = "") -> Screen:
        screen = Screen(self.recording, timeline, prefix)
        screen.open()
        for batch in batches:
            screen.log(batch)
        return screen

    def list_chunks(self) -> dict[str, list[Any]]:
        """Record batches that have a time, by entity."""
        self.recording.flush()
        self.recording.disconnect()
        result = defaultdict(list)
        for chunk in rerun.chunk.RrdReader(self.path).stream():
            if not chunk.is_static:
                result[chunk.entity_path].append(chunk.to_record_batch())
        return result


def list_cells(chunks: Sequence[Any], column: str) -> list[Any]:
    return [cell for chunk in chunks for cell in chunk[column].to_pylist()]


def list_times(chunks: Sequence[Any], timeline: str = "rig_time") -> np.ndarray:
    """Of a timeline [s], in order."""
    return np.sort(np.concatenate([chunk[timeline].to_numpy().astype(np.int64) for chunk in chunks])) / 1e9


def negate(batch: Batch, columns: Sequence[str]) -> Batch:
    rows = batch.rows.copy()
    rows[:, [column.name in columns for column in batch.columns]] *= -1.0
    return replace(batch, rows=rows)
