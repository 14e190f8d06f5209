"""What several files of this folder play."""

from pathlib import Path

import pytest

from clutch_hil.bench.in_process import Played, play
from plant_sim.node.plant_node import PlantNode
from plant_sim.profiles.profile import load_profile
from protocols.node import load_node
from protocols.telemetry.batch import Batch
from tests.clutch_hil.live.scripted_bench import RATE, SECONDS
from tests.clutch_hil.live.viewer.screen_recording import Logged, simulate_nodes


@pytest.fixture(scope="module")
def played() -> Played:
    plant = PlantNode(rate=RATE, profile=load_profile("engagement", SECONDS))
    return play(plant, load_node("controller")(rate=RATE))


@pytest.fixture(scope="module")
def nodes() -> dict[str, Batch]:
    return simulate_nodes()


@pytest.fixture
def logged(tmp_path: Path) -> Logged:
    return Logged(tmp_path / "run.rrd")
