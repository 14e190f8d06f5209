"""Compile what the services of a bench run, into NUMBA_CACHE_DIR: `python -m tests.kernels plant` or `controller`."""

import sys

from plant_sim.node.plant_service import PlantService
from plant_sim.node.power_shift_node import RIG
from rt_controller.loop.service import ControllerService

SIDES = {
    "plant": PlantService("", 1000, RIG).warm,  # which compiles what the plant of one clutch runs, too
    "controller": ControllerService.warm,
}

if __name__ == "__main__":
    SIDES[sys.argv[1]]()
