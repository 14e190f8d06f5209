"""A timing budget for every frame: how often it comes, and how evenly. Checked on a real bench beside whatever else runs here.

The budget is loose, because machines are shared: medians and means, no maxima. `clutch-hil jitter` measures; this notices a
frame that comes at another rate, in bursts, or not at all. After openpilot's table of timings (selfdrive/test/test_onroad.py).
"""

import time
from collections import defaultdict
from collections.abc import Iterator
from tempfile import TemporaryDirectory
from typing import NamedTuple

import numpy as np
import pytest

from protocols.bus import open_bus
from protocols.frames import load_frames
from tests.processes import ONE_CPU, PATIENCE, service

RATE = 500  # Hz
SECONDS = 4.0


class Budget(NamedTuple):
    """Of a frame: its period [s], the share of periods within half of it, and how far their mean and the median of all may be
    off it. Other periods are slots that a machine which stood still has left out."""

    period: float
    mean: float
    median: float
    even: float


CYCLE = 1.0 / RATE
BUDGETS = {
    "ANALOG_SENSORS": Budget(CYCLE, 0.05, 0.1, 0.8),
    "ENCODER": Budget(CYCLE, 0.05, 0.1, 0.8),
    "VALVE_COMMAND": Budget(CYCLE, 0.05, 0.1, 0.8),
    "MOTOR_COMMAND": Budget(CYCLE, 0.05, 0.1, 0.8),
    "TORQUE_SETPOINT": Budget(CYCLE, 0.05, 0.1, 0.8),
    "CONTROLLER_STATUS": Budget(0.100, 0.05, 0.1, 0.8),
    "PLANT_STATUS": Budget(0.100, 0.05, 0.1, 0.8),
    "CONTROLLER_HEARTBEAT": Budget(0.050, 0.05, 0.1, 0.8),
    "PLANT_HEARTBEAT": Budget(0.050, 0.05, 0.1, 0.8),
}


@pytest.fixture(scope="module")
def module_bus() -> Iterator[str]:
    with pytest.MonkeyPatch.context() as patch, TemporaryDirectory(prefix="ch-") as folder:  # short: sockets' paths are
        patch.setenv("CLUTCH_HIL_BUS_DIR", folder)
        yield "local:bench"


@pytest.fixture(scope="module")
def heard(module_bus: str) -> dict[str, np.ndarray]:
    """Stamps [s] of each frame while the loop is closed."""
    names = {codec.can_id: codec.name for codec in load_frames().values()}
    stamps: dict[str, list[int]] = defaultdict(list)
    common = ("--bus", module_bus, "--rate", str(RATE), *ONE_CPU)
    with (
        service("controller", *common),
        service("plant", *common, "--profile", "engagement"),
        open_bus(module_bus) as port,
    ):
        begin = end = 0.0
        deadline = time.monotonic() + PATIENCE
        while not begin or time.monotonic() < end:
            assert time.monotonic() < deadline, "the loop never closed"
            if port.wait(0.02):
                for stamp, (can_id, _) in port.stamped():
                    if begin and time.monotonic() > begin:
                        stamps[names[can_id]].append(stamp)
                    elif not begin and names[can_id] == "VALVE_COMMAND":
                        begin = time.monotonic() + 1.0
                        end = begin + SECONDS
                        deadline = end + 1.0
    return {name: np.array(found) / 1e9 for name, found in stamps.items()}


def test_every_frame_of_the_bus_has_a_budget(heard: dict[str, np.ndarray]) -> None:
    assert set(BUDGETS) == set(load_frames()) == set(heard)


@pytest.mark.parametrize("name", BUDGETS)
def test_a_frame_keeps_its_budget(heard: dict[str, np.ndarray], name: str) -> None:
    budget, periods = BUDGETS[name], np.diff(heard[name])
    told = f"{name}: mean {periods.mean():.5f} s, median {np.median(periods):.5f} s, budget {budget.period} s"
    even = np.abs(periods - budget.period) < 0.5 * budget.period
    assert even.mean() >= budget.even, told
    assert periods[even].mean() == pytest.approx(budget.period, rel=budget.mean), told
    assert np.median(periods) == pytest.approx(budget.period, rel=budget.median), told


def test_budgets_are_those_of_the_dbc(heard: dict[str, np.ndarray]) -> None:
    for name, codec in load_frames().items():
        assert BUDGETS[name].period == pytest.approx(max(codec.cycle_time, CYCLE)), name
