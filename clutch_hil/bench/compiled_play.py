"""Play cycles of a plant with one clutch and of its controller in one compiled call, bit-identical to `in_process`."""

from typing import Any

import numpy as np
from numba import njit

from plant_sim.node.plant_cycle import take
from plant_sim.node.plant_node import PlantNode
from plant_sim.node.plant_turn import PlantMemory, advance, make_sample
from rt_controller.loop.cycle import ControllerMemory, run_cycle
from rt_controller.loop.node import ControllerNode


def play_steadily(
    plant: PlantNode, controller: ControllerNode, count: int, most: int
) -> tuple[np.ndarray, np.ndarray, int]:
    """Play up to `most` cycles of a `steady` plant, until its rig changes or its profile ends.

    `count` is the number of frames in the controller's outbox. Return the records of plant and controller, shape (cycles,
    columns of the node), and the new `count`. Raises InputError as `ControllerNode.run_cycle` does.
    """
    cycles = plant.limit_samples(most)
    plant_rows, controller_rows = (np.empty((cycles, node.record.size)) for node in (plant, controller))
    answer = play_cycles(
        plant.memory, tuple(controller.memory), count, plant.tick + 1, plant.late_cycles, plant_rows, controller_rows
    )
    plant.tick += cycles
    return plant_rows, controller_rows, controller.check_sent(answer)


@njit(cache=True, nogil=True)
def play_cycles(
    plants: Any, controllers: Any, count: Any, tick: Any, late_cycles: Any, plant_rows: Any, controller_rows: Any
) -> int:
    """Play one cycle for each row of `plant_rows` and `controller_rows`, and fill these rows. See `play_steadily`.

    `plants` is a PlantMemory and `controllers` a ControllerMemory, as plain tuples: for a named tuple Numba keeps some kB.
    `tick` is that of the first sample; it is not the plant's first tick, because the plant may refuse a frame. Return the
    number of frames in the controller's outbox, or minus its Refusal, which ends the play.
    """
    plant, controller = PlantMemory(*plants), ControllerMemory(*controllers)
    for cycle in range(len(plant_rows)):
        take(plant.interfaces, plant.settings, controller.outbox, count)
        sent = make_sample(plant, tick + cycle, late_cycles)
        plant_rows[cycle] = plant.row
        advance(plant)
        count = run_cycle(controller.states, controller.settings, plant.outbox, sent, 1, controller.outbox)
        if count < 0:
            return count
        controller_rows[cycle] = controller.row
    return count
