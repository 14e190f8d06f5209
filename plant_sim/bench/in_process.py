"""Plant and controller in one process, frame by frame as on a bus: deterministic, for sweeps and tests."""

from typing import Any, NamedTuple

import numpy as np

from plant_sim.node import PlantNode
from protocols.frames import Frame
from protocols.node import Node


class Rows(NamedTuple):
    """Records of both nodes, shape (cycles, columns of the node)."""

    plant: np.ndarray
    controller: np.ndarray


def run(plant: PlantNode, controller: Node, progress: Any = None) -> Rows:
    """Play the plant's profile to its end. `progress(cycle)` is called now and then."""
    assert plant.profile is not None
    plant_rows, controller_rows = [], []
    inbox: list[Frame] = []
    while not plant.finished:
        plant.receive(inbox)
        sensors = plant.sample()
        plant_rows.append(plant.row())
        plant.advance()
        inbox = controller.step(sensors)
        controller_rows.append(controller.row())
        if progress and not plant.tick % 500:
            progress(plant.tick)
    return Rows(np.array(plant_rows, dtype=float), np.array(controller_rows, dtype=float))
