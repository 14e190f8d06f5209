"""Faults of bus and processes on a real SocketCAN bus. The guest cannot keep 1 kHz, so times are not judged here."""

from pathlib import Path

import numpy as np
import pytest

from plant_sim.node.plant_cycle import Actuators
from protocols.files.runs import read_run
from tests.vcan.test_vcan import BUS, RATE, run_command

AT = 2.5  # s
SCENARIOS = {
    "no command arrives": 'bus_fault = "frame_loss"\nvalues = { commands = 1.0 }',
    "the controller is killed": 'process = "controller"\nsignal = "kill"',
}


@pytest.mark.parametrize("fault", SCENARIOS)
def test_the_clutch_opens_and_the_recording_is_whole(fault: str, tmp_path: Path) -> None:
    path = tmp_path / "case.toml"
    path.write_text(f'title = "{fault}"\n[[inject]]\nat = {AT}\n{SCENARIOS[fault]}\n', encoding="utf-8")
    common = ("--bus", BUS, "--rate", str(RATE), "--seconds", "4", "--out", str(tmp_path))
    done = run_command("up", str(path), *common)
    assert "Traceback" not in done.stderr
    (file,) = tmp_path.glob("*.parquet")
    run = read_run(file)
    np.testing.assert_array_equal(np.rint(run["time_s"] * RATE), np.arange(4 * RATE))
    before, after = run["truth_clutch_torque_nm"][round(AT * RATE) - 5], run["truth_clutch_torque_nm"][-1]
    assert before > 3.0
    assert abs(after) < 0.1
    assert run["actuators"][-1] == Actuators.LOST
    assert run.metadata["injections"] or run.metadata["process_faults"]
