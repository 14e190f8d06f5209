"""What several files of this folder play."""

import pytest

from clutch_hil.bench.in_process import Played, play
from plant_sim.node.plant_node import PlantNode
from plant_sim.profiles.profile import load_profile
from protocols.node import node_factory
from tests.clutch_hil.live.scripted_bench import RATE, SECONDS


@pytest.fixture(scope="module")
def played() -> Played:
    plant = PlantNode(rate=RATE, profile=load_profile("engagement", SECONDS))
    return play(plant, node_factory("controller")(rate=RATE))
