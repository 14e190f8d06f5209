"""Compile what the services of a bench run, into NUMBA_CACHE_DIR: `python -m tests.kernels SIDE`, see below."""

import sys

from plant_sim.node import PlantNode
from plant_sim.power_shift_node import PowerShiftNode
from protocols.bus import open_bus
from protocols.exchange import Exchange
from protocols.frames import load_frames
from rt_controller.node import ControllerNode
from rt_controller.samples import Samples
from rt_controller.turn import Turn


def controller() -> None:
    """As a controller does before its first frame."""
    with open_bus("local:kernels") as port:
        frames = load_frames()
        Turn(Samples(Exchange(port, frames["ENCODER"].can_id), frames), ControllerNode(1000))


if __name__ == "__main__":
    {"plant": PlantNode.warm, "shift": PowerShiftNode.warm, "controller": controller}[sys.argv[1]]()
