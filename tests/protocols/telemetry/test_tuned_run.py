"""A change of parameters in a running bench is in its recording, at its row; what cannot be recorded is told."""

import json
import signal
import subprocess
from pathlib import Path

import numpy as np
import psutil
import pytest

from clutch_hil.live.tuning.tune import request_parameters, set_parameters
from protocols.errors import InputError
from protocols.files.runs import read_run
from protocols.realtime.child import list_command
from protocols.telemetry.feed import ask
from protocols.telemetry.keys import Keys
from protocols.telemetry.lab import find_asker_name
from protocols.telemetry.message import check_last
from protocols.telemetry.session import open_consumer_session
from tests.processes import PATIENCE
from tests.protocols.telemetry.benches import bench, wait_for_bench, wait_until

WEAKER = 0.6  # of the friction: the torque shows it at once
SETTLED = 50  # rows for the friction state to follow: three of its time constants


def test_a_change_is_in_the_recording_where_it_acts(local_bus: str, tmp_path: Path) -> None:
    arguments = ["--bus", local_bus, "--seconds", "8", "--no-adaptation", "--out", str(tmp_path), "--json"]
    with subprocess.Popen(list_command("up", *arguments), stdout=subprocess.PIPE, text=True) as up:
        with open_consumer_session() as session:
            name = wait_for_bench(session, local_bus)
            demand = "controller_torque_demand_nm"
            wait_until(
                lambda: ask(session, Keys(name, "controller").last, check_last)["values"][demand]["value"] == 10.0,
                "10 Nm",
            )
            weaker = set_parameters(session, name, "plant", {"friction_level.level": WEAKER})
            gains = {"torque.proportional_gain": 0.02, "torque.integral_gain": 0.2}
            tuned = set_parameters(session, name, "controller", gains)
            with pytest.raises(InputError, match=r"torque\.integral_gain = 9 bar/\(Nm s\) is outside 0..5"):
                set_parameters(session, name, "controller", {"torque.integral_gain": 9.0})
        out, _ = up.communicate()
    run = read_run(Path(json.loads(out)["run"]))
    changes = run.metadata["parameter_changes"]
    assert [(change["node"], change["name"], change["old"], change["new"]) for change in changes] == [
        ("plant", "friction_level.level", 1.0, WEAKER),
        ("controller", "torque.proportional_gain", 0.012, 0.02),
        ("controller", "torque.integral_gain", 0.3, 0.2),
    ]
    requests = [(request["node"], request["kind"], request["values"]) for request in run.metadata["requests"]]
    assert requests == [("plant", "tune", {"friction_level.level": WEAKER}), ("controller", "tune", gains)]
    assert {request["by"] for request in run.metadata["requests"]} == {find_asker_name(None)}
    # the plant's record is the run: its row numbers are the run's
    row = int(np.flatnonzero(run["plant_parameter_changes"])[0])
    assert row == weaker["row"] == changes[0]["row"]
    torque, estimate = run["truth_clutch_torque_nm"], run["controller_torque_estimate_nm"]
    assert torque[row - 1] / estimate[row - 1] == pytest.approx(1.0, rel=0.05)
    assert torque[row + SETTLED] / estimate[row + SETTLED] == pytest.approx(WEAKER, rel=0.05)
    # both gains from the same cycle on
    assert set(run["controller_parameter_changes"][SETTLED:]) == {0.0, 2.0}
    first = int(np.flatnonzero(run["controller_parameter_changes"] == 2.0)[0])
    error = run["controller_torque_demand_nm"] - run["controller_torque_estimate_nm"]
    proportional = run["controller_proportional_bar"]
    assert proportional[first - 1] == pytest.approx(0.012 * error[first - 1])
    assert proportional[first] == pytest.approx(0.02 * error[first])
    assert tuned["row"] == changes[1]["row"] == changes[2]["row"]


def test_a_lock_step_run_can_be_tuned(local_bus: str, tmp_path: Path) -> None:
    # five seconds of a quiet machine: time enough for a change to arrive
    arguments = ["--lockstep", "--bus", local_bus, "--seconds", "40", "--out", str(tmp_path), "--json"]
    with subprocess.Popen(list_command("up", *arguments), stdout=subprocess.PIPE, text=True) as up:
        with open_consumer_session() as session:
            name = wait_for_bench(session, local_bus)
            set_parameters(session, name, "plant", {"friction_level.level": WEAKER})
        out, _ = up.communicate()
    run = read_run(Path(json.loads(out)["run"]))
    assert run["plant_parameter_changes"][-1] == 1.0
    assert run.metadata["plant_parameters"]["friction_level.level"] == 1.0  # as it began


def test_a_stopped_service_refuses_a_change_and_does_not_make_it_later(local_bus: str) -> None:
    with bench(local_bus) as services, open_consumer_session() as session:
        name = wait_for_bench(session, local_bus)
        before = request_parameters(session, name, "controller")
        services["controller"].send_signal(signal.SIGSTOP)
        with pytest.raises(InputError, match=r"controller: the service has not answered .*; nothing was changed"):
            set_parameters(session, name, "controller", {"torque.integral_gain": 0.5})
        services["controller"].send_signal(signal.SIGCONT)
        changed = set_parameters(session, name, "controller", {"torque.proportional_gain": 0.02})["changed"]
        after = request_parameters(session, name, "controller")
        assert [change["name"] for change in changed] == ["torque.proportional_gain"]
        names = {"torque.integral_gain"}
        assert [e["value"] for e in after if e["name"] in names] == [e["value"] for e in before if e["name"] in names]


def test_a_recorder_says_that_the_plant_publishes_nothing(local_bus: str, tmp_path: Path) -> None:
    with bench(local_bus) as services, open_consumer_session() as session:
        wait_for_bench(session, local_bus)
        (telemetry,) = psutil.Process(services["plant"].pid).children()
        telemetry.kill()
        command = list_command("record", str(tmp_path / "run.parquet"), "--bus", local_bus, "--seconds", "1")
        done = subprocess.run(command, capture_output=True, text=True, timeout=PATIENCE, check=False)
    assert done.returncode == 2
    assert "the plant of bench" in done.stderr
    assert "publishes no telemetry; a run needs plant and controller" in done.stderr
    assert not list(tmp_path.iterdir())
