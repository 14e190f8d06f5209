"""Writes a bus log of plant and controller in lock-step from one process: the frames are equal on every computer."""

from pathlib import Path

import can

from plant_sim.node.plant_node import PlantNode
from plant_sim.profiles.profile import load_profile
from protocols.can.frames import Frame
from protocols.can.lifecycle import Lifecycle
from protocols.node import load_node


def write_log(path: Path, seconds: float) -> None:
    """Write the frames of the first `seconds` [s] of the profile `engagement` to a log."""
    plant, controller = PlantNode(profile=load_profile("engagement", seconds)), load_node("controller")()
    inbox: list[Frame] = []
    with can.Logger(path) as log:

        def put(frames: list[Frame]) -> None:
            for can_id, data in frames:
                log(can.Message(plant.tick * 1e-3 + 1.0, can_id, is_extended_id=False, data=data, channel=0))

        put([plant.make_heartbeat(Lifecycle.INACTIVE)])
        while not plant.finished:
            sensors = plant.step(inbox)
            put(sensors)
            inbox = controller.step(sensors)
            put(inbox)
