"""A timing budget for every frame: how often it comes, and how evenly. Checked on a real bench beside whatever else runs here.

The budget is loose, because machines are shared: medians and means, no maxima, and a period in which the CPU did not run is the
machine's. `clutch-hil jitter` measures; this notices a frame that comes at another rate, in bursts, or not at all. After
openpilot's table of timings (selfdrive/test/test_onroad.py).
"""

import time
from collections import defaultdict
from collections.abc import Iterator
from tempfile import TemporaryDirectory
from typing import NamedTuple

import numpy as np
import pytest

from clutch_hil.bench.timing.lateness import mark_explained
from clutch_hil.bench.timing.stalls import StallWatch
from clutch_hil.bench.timing.witness import WITNESS_PRIORITY
from protocols.buses.bus import Port, open_bus
from protocols.can.frames import load_frames
from tests.processes import ONE_CPU, PATIENCE, service

RATE = 500  # Hz
SECONDS = 4.0
LEAST = 20  # periods of every frame in which the CPU ran; where it seldom does, the bench is heard for longer,
LONGEST = 40.0  # s, but no more than this
STALL = 0.25  # of a frame's period: what stops the CPU for longer, half of what makes it uneven, is the machine's


class Budget(NamedTuple):
    """Of a frame: its period [s], the share of periods within half of it, and how far their mean and the median of all may be
    off it. The rest of the periods is for who shares the CPU in shorter pieces."""

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
    "SUPERVISOR_CLAIM": Budget(0.050, 0.05, 0.1, 0.8),
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
    """Periods [s] of each frame while the loop is closed and the machine runs it."""
    names = {codec.can_id: codec.name for codec in load_frames().values()}
    stamps: dict[str, list[int]] = defaultdict(list)
    common = ("--bus", module_bus, "--rate", str(RATE), *ONE_CPU)
    result: dict[str, np.ndarray] = {}
    with (
        service("controller", *common),
        service("plant", *common, "--profile", "engagement"),
        open_bus(module_bus) as port,
    ):
        _wait_until_closed(port)
        end = time.monotonic() + LONGEST
        while time.monotonic() < end and (set(result) != set(names.values()) or min(map(len, result.values())) < LEAST):
            with StallWatch(int(ONE_CPU[1]), WITNESS_PRIORITY, round(1e9 * STALL * CYCLE), 0, 2.0 * SECONDS) as watch:
                stamps.clear()
                for stamp, can_id in _receive_frames(port, SECONDS):
                    stamps[names[can_id]].append(stamp)
            behind = time.time_ns() - time.monotonic_ns()  # the watch is, of the clock of stamps
            for name, each in stamps.items():
                periods = _run(np.array(each), watch.list_stalls(1e9 * STALL * BUDGETS[name].period) + behind)
                result[name] = np.append(result.get(name, periods[:0]), periods)
    return result


def _wait_until_closed(port: Port) -> None:
    """Wait until the controller has commanded for a second."""
    command, begin, end = load_frames()["VALVE_COMMAND"].can_id, 0.0, time.monotonic() + PATIENCE
    while not begin or time.monotonic() < begin + 1.0:
        assert time.monotonic() < end, "the loop never closed"
        if any(can_id == command for _, can_id in _receive_frames(port, 0.1)):
            begin = begin or time.monotonic()


def _receive_frames(port: Port, seconds: float) -> Iterator[tuple[int, int]]:
    """Stamp [ns of CLOCK_REALTIME] and identifier of what comes in so long."""
    end = time.monotonic() + seconds
    while time.monotonic() < end:
        if port.wait(0.02):
            yield from ((stamp, can_id) for stamp, (can_id, _) in port.receive_stamped())


def _run(stamps: np.ndarray, stalls: np.ndarray) -> np.ndarray:
    """Periods [s] between `stamps` [ns] without one of the `stalls`, begin and end (n, 2) [ns], in or near them."""
    periods = np.column_stack([stamps[:-1], stamps[1:]])
    return np.diff(stamps)[~mark_explained(periods, stalls, round(1e9 * CYCLE))] / 1e9


def test_every_frame_of_the_bus_has_a_budget(heard: dict[str, np.ndarray]) -> None:
    assert set(BUDGETS) == set(load_frames()) == set(heard)


@pytest.mark.parametrize("name", BUDGETS)
def test_a_frame_keeps_its_budget(heard: dict[str, np.ndarray], name: str) -> None:
    budget, periods = BUDGETS[name], heard[name]
    assert len(periods) >= LEAST, f"in {LONGEST} s the machine ran {len(periods)} periods of {name}"
    sentence = f"{name}: mean {periods.mean():.5f} s, median {np.median(periods):.5f} s, budget {budget.period} s"
    even = np.abs(periods - budget.period) < 0.5 * budget.period
    assert even.mean() >= budget.even, sentence
    assert periods[even].mean() == pytest.approx(budget.period, rel=budget.mean), sentence
    assert np.median(periods) == pytest.approx(budget.period, rel=budget.median), sentence


def test_budgets_are_those_of_the_dbc(heard: dict[str, np.ndarray]) -> None:
    for name, codec in load_frames().items():
        assert BUDGETS[name].period == pytest.approx(max(codec.cycle_time, CYCLE)), name
