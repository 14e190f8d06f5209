"""What was streamed over zenoh into an .rrd file is what the bench recorded from its rings: the same values, to the bit."""

import json
import subprocess
from pathlib import Path

import numpy as np

from clutch_hil.live.viewer.rrd_reader import read_rrd
from protocols.files.runs import read_run
from protocols.realtime.child import list_command
from protocols.telemetry.session import open_consumer_session
from tests.processes import PATIENCE
from tests.protocols.telemetry.benches import wait_for_bench

SECONDS = 8


def test_the_rrd_file_holds_the_run_file(local_bus: str, tmp_path: Path) -> None:
    rrd = tmp_path / "seen.rrd"
    arguments = ["--bus", local_bus, "--seconds", str(SECONDS), "--out", str(tmp_path), "--json"]
    with subprocess.Popen(list_command("up", *arguments), stdout=subprocess.PIPE, text=True) as bench:
        with open_consumer_session() as session:
            wait_for_bench(session, local_bus)
        command = list_command("view", "--bus", local_bus, "--save", str(rrd))
        with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as view:
            out, _ = bench.communicate(timeout=PATIENCE)
            view.terminate()
            sentence, _ = view.communicate(timeout=PATIENCE)
    assert "verdict: nothing lost" in sentence
    run, seen = read_run(Path(json.loads(out)["run"])), read_rrd(rrd)
    plant, controller = seen["plant"], seen["controller"]
    samples = len(run["time_s"])
    assert samples == SECONDS * 1000
    np.testing.assert_array_equal(plant.row[:samples], np.arange(samples))
    for name in plant:
        np.testing.assert_array_equal(plant[name][:samples], run[name], name)
    # the cycle that answered a sample is the first that knew it; where no cycle did, the run file repeats the one before
    ticks, first = np.unique(controller["controller_sample_tick"], return_index=True)
    first, ticks = first[(ticks >= 0) & (ticks < samples)], ticks[(ticks >= 0) & (ticks < samples)].astype(int)
    assert len(ticks) > 1000  # of them are compared; how many are answered is the machine's matter
    for name in controller:
        np.testing.assert_array_equal(controller[name][first], run[name][ticks], name)
    columns = set(plant) | set(controller)
    assert columns == set(run.columns) - {"torque_demand_nm"}  # the controller's, under its name in a measured run
