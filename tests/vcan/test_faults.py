"""Faults of bus and processes on a real SocketCAN bus. The guest cannot keep 1 kHz, so times are not judged here."""

import time
from pathlib import Path

import numpy as np
import pytest

from plant_sim.node.plant_cycle import Actuators
from protocols.files.run import Run
from protocols.files.runs import read_run
from tests import needs
from tests.vcan.test_vcan import BUS, RATE, run_command

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


@pytest.mark.parametrize("fault", SCENARIOS)
def test_the_clutch_opens_and_the_recording_is_whole(fault: str, tmp_path: Path) -> None:
    run = play(fault, SCENARIOS[fault], tmp_path)
    assert abs(run["truth_clutch_torque_nm"][-1]) < 0.1
    assert Actuators.LOST in run["actuators"][round(AT * RATE) :]  # until the controller commands to close, if it lives
    assert run["valve_voltage_v"][-1] <= 0.0


@pytest.mark.parametrize("fault", BORNE)
def test_a_fault_that_changes_nothing_is_borne(fault: str, tmp_path: Path) -> None:
    if "clock_step" in BORNE[fault]:
        needs.skip_without("clock to set")
    before = time.time() - time.monotonic()
    run = play(fault, BORNE[fault], tmp_path)
    assert run["truth_clutch_torque_nm"][-1] > 3.0
    assert run["actuators"][-1] != Actuators.LOST
    assert not run["controller_fault"].any()
    assert abs(time.time() - time.monotonic() - before) < 1.0  # the time of day is set back


def play(fault: str, entry: str, folder: Path) -> Run:
    """Play a scenario whose fault begins at `AT`; its run is whole, and the clutch has torque before."""
    path = folder / "case.toml"
    path.write_text(f'title = "{fault}"\n[[inject]]\nat = {AT}\n{entry}\n', encoding="utf-8")
    common = ("--bus", BUS, "--rate", str(RATE), "--seconds", "4", "--out", str(folder))
    done = run_command("up", str(path), *common)
    assert "Traceback" not in done.stderr
    (file,) = folder.glob("*.parquet")
    run = read_run(file)
    np.testing.assert_array_equal(np.rint(run["time_s"] * RATE), np.arange(4 * RATE))
    assert run["truth_clutch_torque_nm"][round(AT * RATE) - 5] > 3.0
    assert run.metadata["injections"] or run.metadata["bench_faults"]
    return run
