"""Plant and controller in one process, frame by frame as on a bus: deterministic, for sweeps and tests."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from clutch_hil.bench.following import Following
from clutch_hil.bench.measures import followed
from plant_sim.node.plant_node import PlantNode
from protocols.node import Column, Node

_TOLD_EVERY = 500  # cycles between two calls of `progress`


@dataclass(frozen=True)
class Played:
    """Records of both nodes, shape (cycles, columns of the node), and the names of those columns."""

    plant: np.ndarray
    controller: np.ndarray
    plant_columns: tuple[Column, ...]
    controller_columns: tuple[Column, ...]

    def __getitem__(self, name: str) -> np.ndarray:
        """A column, shape (cycles,), by its name in a run file."""
        names = [column.name for column in self.plant_columns]
        if name in names:
            return self.plant[:, names.index(name)]
        terms = [f"controller_{column.name}" for column in self.controller_columns]
        return self.controller[:, terms.index(name)]

    def columns(self) -> dict[str, np.ndarray]:
        """The columns that a run file of this would have, by name."""
        terms = {f"controller_{column.name}": self.controller[:, i] for i, column in enumerate(self.controller_columns)}
        plant = {column.name: self.plant[:, i] for i, column in enumerate(self.plant_columns)}
        return plant | {"torque_demand_nm": terms["controller_torque_demand_nm"]} | terms

    def following(self, begin: float = 0.0, end: float = float("inf")) -> Following:
        """How well the true torque followed the demand between two times [s]."""
        time = self["time_s"]
        part = (time >= begin) & (time < end)
        return followed({name: column[part] for name, column in self.columns().items()})


def play(plant: PlantNode, controller: Node, progress: Callable[[int], None] | None = None) -> Played:
    """Play the plant's profile to its end. `progress(cycle)` is called now and then."""
    plant_rows, controller_rows = [], []
    commands = 0
    while not plant.finished:
        plant.take(controller.outbox, commands)
        sensors = plant.show()
        plant_rows.append(plant.record.copy())
        plant.advance()
        commands = controller.cycle(plant.outbox, sensors)
        controller_rows.append(controller.record.copy())
        if progress and plant.tick % _TOLD_EVERY == 0:
            progress(plant.tick)
    return Played(
        np.array(plant_rows),
        np.array(controller_rows),
        tuple(plant.columns),
        tuple(controller.columns),
    )
