"""Compile what the plant of two clutches runs, into NUMBA_CACHE_DIR: `python -m tests.kernels`; `first_start` has the rest."""

from plant_sim.node.plant_service import PlantService
from plant_sim.node.power_shift_node import RIG

if __name__ == "__main__":
    PlantService("", 1000, RIG).warm()
