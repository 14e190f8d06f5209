"""`python -m tests.kernels`: compile the kernels of the plant with two clutches into NUMBA_CACHE_DIR."""

from plant_sim.node.plant_service import PlantService
from plant_sim.node.power_shift_node import RIG

if __name__ == "__main__":
    PlantService("", 1000, RIG).warm()
