"""Compile what the services of a bench run, into NUMBA_CACHE_DIR: `python -m tests.kernels plant` or `controller`."""

import sys

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


SIDES = {
    "plant": PowerShiftNode.warm,
    "controller": controller,
}  # that plant compiles what the one of one clutch runs, too

if __name__ == "__main__":
    SIDES[sys.argv[1]]()
