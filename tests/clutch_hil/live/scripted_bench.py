"""A scripted bench: batches as a feed would give them, of a run that was played in this process."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from clutch_hil.bench.in_process import Played
from clutch_hil.live.recording import recorder
from clutch_hil.live.recording.recorder import Recorder, RecordingResult
from protocols.node import Column
from protocols.telemetry.batch import Batch, list_run_columns

SECONDS = 4.0  # s of the profile
RATE = 500  # Hz: gentle to a machine that runs other tests
EPOCH = 1.7e9  # s: UNIX time of a scripted bench
PIECE = 100  # rows a scripted batch


# --- a scripted bench: batches as a feed would give them


class ScriptedFeed:
    """Gives batches step by step; None of zenoh."""

    bench = "local:script@here"
    rejections = ""

    def __init__(self, played: Played, steps: list[list[Batch]]) -> None:
        self.lost = {"plant": 0, "controller": 0}
        self.alive = {"plant": True, "controller": True}
        self.steps = steps
        self._columns = {"plant": list_plant_columns(played), "controller": list_controller_columns(played)}

    def read(self, timeout: float = 0.0) -> list[Batch]:
        return self.steps.pop(0) if self.steps else []

    def take_events(self) -> list[dict[str, Any]]:
        return []

    def read_requests(self) -> list[dict[str, Any]]:
        return []

    def read_clock(self, node: str) -> float:
        return -np.inf

    def describe(self, node: str) -> dict[str, Any]:
        return {"columns": [column._asdict() for column in self._columns[node]], "session": 1, "versions": {}}


def list_plant_columns(played: Played) -> tuple[Column, ...]:
    return (*played.plant_columns, Column("plant_clock_s", "s", "clock"))


def list_controller_columns(played: Played) -> tuple[Column, ...]:
    return list_run_columns("controller", (*played.controller_columns[0], Column("clock_s", "s", "clock")))


def make_batches(played: Played, node: str, clock: float = 1000.0) -> list[Batch]:
    rows = played.plant if node == "plant" else played.controllers[0]
    columns = list_plant_columns(played) if node == "plant" else list_controller_columns(played)
    times = clock + np.arange(len(rows)) / RATE
    rows = np.column_stack([rows, times])
    return [
        Batch(node, 1, first, float(RATE), EPOCH, 0, columns, rows[first : first + PIECE])
        for first in range(0, len(rows), PIECE)
    ]


def split_steps(played: Played) -> list[list[Batch]]:
    return [list(pair) for pair in zip(make_batches(played, "plant"), make_batches(played, "controller"), strict=True)]


def record_script(
    played: Played, script: list[list[Batch]], path: Path, monkeypatch: pytest.MonkeyPatch
) -> RecordingResult:
    monkeypatch.setattr(recorder, "request_parameters", lambda session, bench, node: [{"name": "a.b", "value": 1.0}])
    return record_feed(ScriptedFeed(played, script), path)


def record_feed(feed: Any, path: Path) -> RecordingResult:
    session: Any = None
    with Recorder(session, feed, path) as made:
        for _ in range(len(feed.steps)):
            made.step()
        made.finish()
    return made.recorded
