"""Play plant and controllers in one process, frame by frame as on a bus. Deterministic, for sweeps and tests."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from clutch_hil.bench.compiled_play import play_steadily
from clutch_hil.bench.judgement.following import Following
from clutch_hil.bench.judgement.measures import measure_following
from clutch_hil.bench.recording import TORQUE_DEMAND, list_run_columns
from protocols.can.frame_batch import make_batch
from protocols.can.two_clutches import CONTROLLERS
from protocols.node import Column, Node
from protocols.user_code import tell_node_failure
from rt_controller.loop.node import ControllerNode

_PROGRESS_INTERVAL = 500  # cycles between two calls of `progress`; Ctrl-C can also act at these calls


@dataclass(frozen=True)
class Played:
    """Records of the plant and of each controller, shape (cycles, columns of the node), and the names of those columns."""

    plant: np.ndarray
    controllers: tuple[np.ndarray, ...]
    plant_columns: tuple[Column, ...]
    controller_columns: tuple[tuple[Column, ...], ...]

    def __getitem__(self, name: str) -> np.ndarray:
        """Return a column, shape (cycles,), by its name in a run file."""
        return self.make_columns()[name]

    def make_columns(self) -> dict[str, np.ndarray]:
        """Return the columns that a run file of these records would have, by name, each (cycles,)."""
        names = [column.name for column in self.describe_columns()]
        plant = len(self.plant_columns)
        values = [*self.plant.T, *(column for controller in self.controllers for column in controller.T)]
        by_name = dict(zip(names[:plant] + names[plant + 1 :], values, strict=True))
        demand = by_name[f"{CONTROLLERS[0]}_{TORQUE_DEMAND.name}"]
        return {name: demand if name == TORQUE_DEMAND.name else by_name[name] for name in names}

    def describe_columns(self) -> list[Column]:
        """Return name, unit and meaning of those columns."""
        return list_run_columns(self.plant_columns, self.controller_columns)

    def judge_following(self, begin: float = 0.0, end: float = float("inf")) -> Following:
        """Return how well the true torque followed its demand from `begin` [s] to before `end` [s]."""
        columns = self.make_columns()
        part = (columns["time_s"] >= begin) & (columns["time_s"] < end)
        return measure_following({name: column[part] for name, column in columns.items()})


def play(plant: Any, *controllers: Node, progress: Callable[[int], None] | None = None) -> Played:
    """Play the plant's profile to its end, with one controller per clutch. `progress(cycle)` is called from time to time.

    Raises InputError, also for any error of a plant of a user's class.
    """
    with tell_node_failure(plant):
        return _play(plant, controllers, progress)


def _play(plant: Any, controllers: Sequence[Node], progress: Callable[[int], None] | None) -> Played:
    rows: list[list[np.ndarray]] = [[] for _ in (plant, *controllers)]
    commands = [0] * len(controllers)
    room = sum(len(node.outbox) for node in (plant, *controllers))
    inboxes = [make_batch(room) for _ in controllers]
    while not plant.finished:
        if plant.steady and len(controllers) == 1 and isinstance(controllers[0], ControllerNode):
            most = _PROGRESS_INTERVAL - plant.tick % _PROGRESS_INTERVAL
            *records, commands[0] = play_steadily(plant, controllers[0], commands[0], most)
        else:
            records = _play_cycle(plant, controllers, commands, inboxes)
        for part, record in zip(rows, records, strict=True):
            part.append(record)
        if progress and plant.tick % _PROGRESS_INTERVAL == 0:
            progress(plant.tick)
    plant_record, *terms = map(np.concatenate, rows)
    return Played(
        plant_record,
        tuple(terms),
        tuple(plant.columns),
        tuple(tuple(controller.columns) for controller in controllers),
    )


def _play_cycle(
    plant: Any, controllers: Sequence[Node], commands: list[int], inboxes: Sequence[np.ndarray]
) -> list[np.ndarray]:
    """Play one cycle; return the record of each node, shape (1, columns).

    `commands` are the numbers of frames in the controllers' outboxes; they are updated. `inboxes` are overwritten.
    """
    for controller, count in zip(controllers, commands, strict=True):
        plant.take(controller.outbox, count)
    sensors = plant.show()
    records = [plant.record[None].copy()]
    plant.advance()
    answers = [controller.outbox[:count] for controller, count in zip(controllers, commands, strict=True)]
    # As on a bus, the other controllers' frames since the last sample come first
    counts = [_fill(inbox, *answers[:k], *answers[k + 1 :], plant.outbox[:sensors]) for k, inbox in enumerate(inboxes)]
    for k, controller in enumerate(controllers):
        commands[k] = controller.run_cycle(inboxes[k], counts[k])
    return [*records, *(controller.record[None].copy() for controller in controllers)]


def _fill(inbox: np.ndarray, *batches: np.ndarray) -> int:
    """Write the frames of `batches` to `inbox`, one after the other; return their number."""
    end = 0
    for batch in batches:
        begin, end = end, end + len(batch)
        inbox[begin:end] = batch
    return end
