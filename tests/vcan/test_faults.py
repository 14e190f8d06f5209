"""Faults of bus and processes on a real SocketCAN bus. The guest cannot keep 1 kHz, so times are not judged here."""

import time
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from clutch_hil.bench.scenario import choose_scenario
from clutch_hil.bench.up import Bench
from plant_sim.node.plant_cycle import Actuators
from protocols.files.run import Run
from protocols.files.runs import read_run
from tests import needs
from tests.vcan.test_vcan import BUS, RATE

AT = 2.5  # s
SCENARIOS = {
    "no command arrives": 'bus_fault = "frame_loss"\nvalues = { commands = 1.0 }',
    "the controller is killed": 'process = "controller"\nsignal = "kill"',
    "the interface is down": f'host_fault = "interface_down"\nuntil = {AT + 0.5}',
    "the bus is off": 'bus_fault = "bus_off"\nvalues = { length = 500 }',
}
BORNE = {
    "the time of day jumps": f'host_fault = "clock_step"\nvalues = {{ step = 3600 }}\nuntil = {AT + 1.0}',
    "error frames": 'bus_fault = "error_frames"\nvalues = { commands = 3, samples = 3 }',
}


@pytest.fixture
def play(tmp_path: Path, capfd: pytest.CaptureFixture[str]) -> Callable[[str, str], Run]:
    """Plays a scenario whose fault begins at `AT`; its run is whole, and the clutch has torque before.

    Plant and controller are processes. What `clutch-hil up` does beside them is done in this one: a guest takes eight seconds
    of a CPU to start Python for it. Nothing is published: nobody listens. The fixture `played` (test_vcan.py) has both.
    """

    def play_fault(fault: str, entry: str) -> Run:
        path = tmp_path / "case.toml"
        path.write_text(f'title = "{fault}"\n[[inject]]\nat = {AT}\n{entry}\n', encoding="utf-8")
        scenario = choose_scenario(str(path), {"rate": RATE, "seconds": 4.0, "out": tmp_path})
        Bench(scenario, BUS, telemetry=False).run(quiet=True)
        assert "Traceback" not in capfd.readouterr().err
        (file,) = tmp_path.glob("*.parquet")
        run = read_run(file)
        np.testing.assert_array_equal(np.rint(run["time_s"] * RATE), np.arange(4 * RATE))
        assert run["truth_clutch_torque_nm"][round(AT * RATE) - 5] > 3.0
        assert run.metadata["injections"] or run.metadata["bench_faults"]
        return run

    return play_fault


@pytest.mark.parametrize("fault", SCENARIOS)
def test_the_clutch_opens_and_the_recording_is_whole(fault: str, play: Callable[[str, str], Run]) -> None:
    run = play(fault, SCENARIOS[fault])
    assert abs(run["truth_clutch_torque_nm"][-1]) < 0.1
    assert Actuators.LOST in run["actuators"][round(AT * RATE) :]  # until the controller commands to close, if it lives
    assert run["valve_voltage_v"][-1] <= 0.0


@pytest.mark.parametrize("fault", BORNE)
def test_a_fault_that_changes_nothing_is_borne(fault: str, play: Callable[[str, str], Run]) -> None:
    if "clock_step" in BORNE[fault]:
        needs.skip_without("clock to set")
    before = time.time() - time.monotonic()
    run = play(fault, BORNE[fault])
    assert run["truth_clutch_torque_nm"][-1] > 3.0
    assert run["actuators"][-1] != Actuators.LOST
    assert not run["controller_fault"].any()
    assert abs(time.time() - time.monotonic() - before) < 1.0  # the time of day is set back
