"""Plant and controllers in one process, frame by frame as on a bus. It is deterministic, for sweeps and tests."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from clutch_hil.bench.following import Following
from clutch_hil.bench.measures import measure_following
from clutch_hil.bench.recording import TORQUE_DEMAND, list_run_columns
from protocols.can.two_clutches import CONTROLLERS
from protocols.node import Column, Node

_PROGRESS_INTERVAL = 500  # cycles between two calls of `progress`


@dataclass(frozen=True)
class Played:
    """Records of the plant and of each controller, shape (cycles, columns of the node), and the names of those columns."""

    plant: np.ndarray
    controllers: tuple[np.ndarray, ...]
    plant_columns: tuple[Column, ...]
    controller_columns: tuple[tuple[Column, ...], ...]

    def __getitem__(self, name: str) -> np.ndarray:
        """A column, shape (cycles,), by its name in a run file."""
        return self.make_columns()[name]

    def make_columns(self) -> dict[str, np.ndarray]:
        """Columns that a run file of this would have, by name, each (cycles,)."""
        names = [column.name for column in self.describe_columns()]
        plant = len(self.plant_columns)
        values = [*self.plant.T, *(column for controller in self.controllers for column in controller.T)]
        by_name = dict(zip(names[:plant] + names[plant + 1 :], values, strict=True))
        demand = by_name[f"{CONTROLLERS[0]}_{TORQUE_DEMAND.name}"]
        return {name: demand if name == TORQUE_DEMAND.name else by_name[name] for name in names}

    def describe_columns(self) -> list[Column]:
        """Name, unit and meaning of those columns."""
        return list_run_columns(self.plant_columns, self.controller_columns)

    def judge_following(self, begin: float = 0.0, end: float = float("inf")) -> Following:
        """How well the true torque followed its demand from `begin` [s] to before `end` [s]."""
        columns = self.make_columns()
        part = (columns["time_s"] >= begin) & (columns["time_s"] < end)
        return measure_following({name: column[part] for name, column in columns.items()})


def play(plant: Any, *controllers: Node, progress: Callable[[int], None] | None = None) -> Played:
    """Play the plant's profile to its end, with one controller for each clutch. `progress(cycle)` is called now and then."""
    rows: list[list[np.ndarray]] = [[] for _ in (plant, *controllers)]
    commands = [0] * len(controllers)
    while not plant.finished:
        for controller, count in zip(controllers, commands, strict=True):
            plant.take(controller.outbox, count)
        sensors = plant.show()
        rows[0].append(plant.record.copy())
        plant.advance()
        inboxes = _make_inboxes(
            plant.outbox, sensors, [c.outbox[:n] for c, n in zip(controllers, commands, strict=True)]
        )
        commands = [controller.run_cycle(*inbox) for controller, inbox in zip(controllers, inboxes, strict=True)]
        for record, controller in zip(rows[1:], controllers, strict=True):
            record.append(controller.record.copy())
        if progress and plant.tick % _PROGRESS_INTERVAL == 0:
            progress(plant.tick)
    records, *terms = map(np.array, rows)
    return Played(
        records,
        tuple(terms),
        tuple(plant.columns),
        tuple(tuple(controller.columns) for controller in controllers),
    )


def _make_inboxes(
    plant_frames: np.ndarray, count: int, controller_frames: Sequence[np.ndarray]
) -> list[tuple[np.ndarray, int]]:
    """Frames that reach each controller: an array and the number of its rows that count.

    As on a bus, the `controller_frames` of the others since the last sample come first. The first `count` rows of
    `plant_frames` follow.
    """
    if len(controller_frames) == 1:
        return [(plant_frames, count)]
    batches = [
        np.concatenate([*(frames for j, frames in enumerate(controller_frames) if j != k), plant_frames[:count]])
        for k in range(len(controller_frames))
    ]
    return [(batch, len(batch)) for batch in batches]
