"""A run of a scenario: its limits decide, and it is the same live, blind and swept."""

import json
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from clutch_hil.bench.limits import Judgement, Limit
from clutch_hil.bench.result import Result, _describe_limited
from clutch_hil.bench.rig import DEFAULT_RIG, find_rig
from clutch_hil.bench.scenario import load_scenario
from clutch_hil.bench.simulate import Simulation
from protocols.files.runs import read_run
from tests.clutch_hil.bench.scenario_files import FULL, RUN, invoke_command, make_writer
from tests.processes import play_here


@pytest.fixture
def written(tmp_path: Path) -> Callable[[str], Path]:
    return make_writer(tmp_path)


def test_limits_decide(written, tmp_path: Path) -> None:
    """The same run passes and fails by its limits alone, with exit codes 0 and 1."""
    for most, code in ((12.0, 0), (5.0, 1)):
        path = written(f"title = 'x'{RUN}[limits]\npeak_torque_nm = {{ most = {most} }}")
        result = invoke_command("simulate", path, "--out", tmp_path / "runs", "--json")
        assert result.exit_code == code
        document = json.loads(result.stdout)
        assert document["good"] is (code == 0)
        limit = document["limits"][0]
        assert (limit["measure"], limit["unit"], limit["most"], limit["holds"]) == (
            "peak_torque_nm",
            "Nm",
            most,
            not code,
        )
        assert 8.0 < limit["value"] < 12.0


def test_a_fault_fails_a_scenario_that_does_not_expect_it(written, tmp_path: Path) -> None:
    run = RUN.replace("short.csv", "engagement") + "seconds = 2.5\n"
    text = f"title = 'x'{run}[[inject]]\nat = 0.6\nfreeze = 'encoder'\n[limits]\npeak_pressure_bar = {{ most = 9 }}\n"
    result = invoke_command("simulate", written(text), "--out", tmp_path)
    assert result.exit_code == 1
    assert "BROKEN  fault = none: torque implausible" in result.stdout
    result = invoke_command("simulate", written(f"{text}fault = 'torque implausible'"), "--out", tmp_path)
    assert result.exit_code == 0


@pytest.mark.parametrize(("bias", "how"), [(0.0, "torque followed, "), (0.5, "torque followed poorly, ")])
def test_a_torque_far_from_its_demand_has_not_simply_followed(written, tmp_path: Path, bias: float, how: str) -> None:
    """A pressure that reads too high after the demand was reached; the exit code is left to limits."""
    run = RUN.replace("short.csv", "engagement") + "seconds = 4.0\n"
    path = written(f"title = 'x'{run}[[inject]]\nat = 1.0\nbias = {{ pressure = {bias} }}\n")
    result = invoke_command("simulate", path, "--out", tmp_path, "--json")
    document = json.loads(result.stdout)
    assert document["verdict"].startswith(f"{how}regime error {document['regime_error_nm']:.2f} Nm")
    assert ("% of the highest demand" in document["verdict"]) is (bias > 0.0)
    assert (result.exit_code, document["good"]) == (0, True)


def test_what_cannot_be_measured_breaks_its_limit(written, tmp_path: Path) -> None:
    path = written(f"title = 'x'{RUN}[limits]\nfault_time_s = {{ most = 9 }}")
    assert (
        "failed: fault_time_s <= 9 s: cannot be measured in this run"
        in invoke_command("simulate", path, "--out", tmp_path).stdout
    )


def test_a_blind_run_is_judged_by_what_was_measured(written, tmp_path: Path) -> None:
    path = written(
        f"title = 'x'{RUN}[effects]\ntorque_sensor_gain = {{ gain = 1.1 }}\n[limits]\npeak_torque_nm = {{ most = 99 }}"
    )
    peaks = []
    for option in ([], ["--blind"]):
        document = json.loads(invoke_command("simulate", path, "--out", tmp_path, "--json", *option).stdout)
        peaks.append(document["limits"][0]["value"])
    run = read_run(Path(document["run"]))
    assert not [name for name in run.columns if name.startswith("truth_")]
    assert "case" not in document["run"]
    assert peaks[1] == np.max(run["clutch_torque_nm"])
    assert peaks[1] > 1.05 * peaks[0]  # the sensor shows 10 % more, less what noise adds to the true peak


def test_a_sweep_of_a_scenario_counts_broken_limits(written, tmp_path: Path) -> None:
    path = written(f"title = 'x'{RUN}[limits]\npeak_torque_nm = {{ most = 9.5 }}")
    arguments = ("simulate", path, "--vary", "friction_level.level=1:2:2", "--out", tmp_path)
    result = invoke_command(*arguments)
    assert result.exit_code == 1
    assert "verdict: 2 runs, 1 broke a limit" in result.stdout


def test_a_fault_that_a_scenario_expects_is_a_whole_run_live(local_bus: str, tmp_path: Path) -> None:
    """A controller ends with exit code 1 after it."""
    arguments = ("--bus", local_bus, "--lockstep", "--no-telemetry", "--out", str(tmp_path), "--json")
    done = play_here("up", "frozen_pressure_sensor", *arguments)
    assert done.returncode == 0, done.stdout + done.stderr
    document = json.loads(done.stdout)
    assert document["verdict"].startswith("passed: ")
    assert Path(document["run"]).exists()


def test_live_in_lock_step_a_scenario_is_what_it_is_in_one_process(written, local_bus: str, tmp_path: Path) -> None:
    """Effects, injections and the controller's parameters reach their processes."""
    path = written(FULL)
    arguments = ("--bus", local_bus, "--lockstep", "--no-telemetry", "--out", str(tmp_path), "--json")
    done = play_here("up", path, *arguments)
    document = json.loads(done.stdout)
    run = read_run(Path(document["run"]))
    scenario = load_scenario(str(path))
    for name, expected in Simulation(scenario).play(scenario.plant, 3).make_columns().items():
        assert np.array_equal(run[name], expected, equal_nan=True), name
    assert done.returncode == (0 if document["good"] else 1)
    assert [limit["measure"] for limit in document["limits"]] == ["rise_time_s", "peak_torque_nm", "fault"]
    assert [change["name"] for change in run.metadata["injections"]][:2] == [
        "internal_leakage.conductance",
        "pressure_sensor_offset.offset",
    ]


def test_a_run_says_what_changed_its_rig(written, tmp_path: Path) -> None:
    changed = tmp_path / "rig.toml"
    changed.write_text("[friction_level]\nlevel = 0.9\n")
    path = written(f"title = 'x'{RUN}[[inject]]\nat = 0.5\neffect = 'valve_gain'\n")
    message = invoke_command("simulate", path, "--plant-parameters", changed, "--out", tmp_path).stdout
    assert f"s), changed by {changed}, in one process" in message
    assert "effects: friction_level\ninjections: 1, the first at 0.500 s\n" in message
    sentence = invoke_command("simulate", path, "--plant-parameters", changed, "--out", tmp_path, "--blind").stdout
    assert "effects:" not in sentence
    assert "injections:" not in sentence


def test_a_picture_tells_the_verdict_of_the_limits_and_when_something_was_injected(
    written, tmp_path, monkeypatch
) -> None:
    drawn = []
    monkeypatch.setattr("clutch_hil.bench.result.draw_run", lambda *arguments: drawn.append(arguments))
    text = (
        f"title = 'x'{RUN}[[inject]]\nat = 0.5\neffect = 'valve_gain'\n[limits]\npeak_pressure_bar = {{ most = 0.1 }}\n"
    )
    invoke_command("simulate", written(text), "--out", tmp_path)
    _, _, title, injected = drawn[0]
    assert title.splitlines()[1].startswith("failed: peak_pressure_bar <= 0.1 bar")
    assert injected == [0.5]


def test_a_run_that_a_kill_of_the_plant_ended_is_good_by_its_limits_alone() -> None:
    metadata = {"bench_faults": [{"kind": "process", "fault": "plant killed", "does": "began", "time_s": 2.6}]}
    good = Result({}, "", "torque followed", True)
    ended = good.mark_end(2.6, metadata, {"interrupted": False})
    assert (ended.verdict, ended.good) == ("ended after 2.6 s, because the plant was killed; torque followed", False)
    assert ended.document == {"verdict": ended.verdict, "good": False}
    limited = replace(good, judgements=(Judgement(Limit(find_rig(DEFAULT_RIG), "fault", equal="none"), "none", True),))
    assert limited.mark_end(2.6, metadata, {"interrupted": False}).good
    assert not limited.mark_end(2.6, metadata, {"interrupted": True}).good
    for others in ({}, {"bench_faults": [metadata["bench_faults"][0] | {"fault": "controller killed"}]}):
        assert good.mark_end(2.6, others, {"interrupted": False}) is good
        assert good.mark_end(2.6, others, None) is good


def test_a_torque_that_the_limits_of_the_controller_keep_away_says_so() -> None:
    """A calibration whose pressure limit was below what 100 Nm need said `torque followed poorly`, and no reason."""
    demand = np.repeat([0.0, 20.0], 50)
    columns = {"torque_demand_nm": demand, "controller_saturated": np.repeat([1.0, 0.0, 1.0], [50, 10, 40])}
    assert "in 80 % of the samples with a demand the controller was at its pressure" in _describe_limited(columns)
    assert not _describe_limited({**columns, "controller_saturated": np.zeros(100)})
    assert not _describe_limited({"torque_demand_nm": 0.0 * demand, "controller_saturated": np.ones(100)})
