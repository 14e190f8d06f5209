"""Plant and controller as processes on a local bus: what they write, what they refuse, how they end."""

import json
import os
import signal
import subprocess
import threading
import time
from functools import cache
from pathlib import Path

import can
import numpy as np
import psutil
import pytest

from clutch_hil.bench.in_process import Played, play
from plant_sim.node.plant_cycle import Actuators
from plant_sim.node.plant_node import PlantNode
from plant_sim.profiles.profile import load_profile
from protocols.buses.bus import Port, listen, open_bus
from protocols.can.frames import Frame, load_frames
from protocols.can.reception import INTRUSION
from protocols.files.runs import REQUIRED, read_run
from protocols.node import load_node
from protocols.realtime import child
from rt_controller.law.phases import Fault
from tests.processes import ONE_CPU, PATIENCE, list_errors, play_here, service

FRAMES = load_frames()
RATE = 250  # Hz: five cycles are 20 ms, which a shared machine seldom loses; at 1 kHz a hiccup of 6 ms is a fault
SECONDS = 3.0  # s of the profile `engagement`: fill, 5 Nm, 10 Nm
# Nm: real time adds jitter of the machine to the deterministic run; 0.001 measured when idle
REAL_TIME_DIFFERENCE = 0.3


def run_command(*arguments: str) -> subprocess.CompletedProcess:
    return subprocess.run(child.list_command(*arguments), capture_output=True, text=True, timeout=PATIENCE, check=False)


def run_up(bus: str, out: Path, *arguments: str) -> dict:
    done = play_here("up", "--bus", bus, "--out", out, "--seconds", SECONDS, "--json", *arguments)
    assert done.returncode == 0, done.stdout + done.stderr
    return json.loads(done.stdout)


def await_end(process: subprocess.Popen) -> tuple[int, str]:
    """Exit code and last line on stderr of a service that ends by itself."""
    _, errors = process.communicate(timeout=PATIENCE)
    return process.returncode, (errors.strip().splitlines() or [""])[-1]


def read_summary(process: subprocess.Popen) -> tuple[dict, int]:
    """Summary and exit code of a service with --json, which is asked to end."""
    process.terminate()
    output, _ = process.communicate(timeout=PATIENCE)
    return json.loads(output), process.returncode


def await_frame(port: Port, frame: str, wanted) -> object:
    """The first values of `frame` on the bus that are `wanted`."""
    codec = FRAMES[frame]
    deadline = time.monotonic() + PATIENCE
    values = None
    while time.monotonic() < deadline:
        for can_id, data in listen(port, 0.05):
            if can_id == codec.can_id and wanted(values := codec.unpack(data)):
                return values
    raise AssertionError(f"{frame} never came as wanted; last: {values}")


@cache  # tests only compare with it
def play_in_one_process(rate: int = 1000) -> Played:
    plant = PlantNode(rate=rate, profile=load_profile("engagement", SECONDS))
    return play(plant, load_node("controller")(rate=rate))


def test_lock_step_of_two_processes_is_one_process_to_the_bit(local_bus: str, tmp_path: Path) -> None:
    result = run_up(local_bus, tmp_path, "--lockstep")
    run, expected = read_run(Path(result["run"])), play_in_one_process()
    for column in expected.plant_columns:
        assert np.array_equal(run[column.name], expected[column.name]), column.name
    for column in expected.controller_columns[0]:
        name = f"controller_{column.name}"
        assert np.array_equal(run[name], expected[name]), name


def test_lock_step_goes_on_whoever_comes_and_goes(local_bus: str, tmp_path: Path) -> None:
    """Some while a sample or its answer is waited for."""
    ended = threading.Event()

    def come_and_go() -> None:
        while not ended.is_set():
            with open_bus(local_bus):
                time.sleep(0.002)

    guest = threading.Thread(target=come_and_go)
    guest.start()
    try:
        result = run_up(local_bus, tmp_path, "--lockstep")
    finally:
        ended.set()
        guest.join()
    run, expected = read_run(Path(result["run"])), play_in_one_process()
    for column in expected.plant_columns:
        assert np.array_equal(run[column.name], expected[column.name]), column.name


def test_real_time_agrees_with_one_process(local_bus: str, tmp_path: Path) -> None:
    result = run_up(local_bus, tmp_path, "--rate", str(RATE))
    run, expected = read_run(Path(result["run"])), play_in_one_process(RATE)
    difference = run["truth_clutch_torque_nm"] - expected["truth_clutch_torque_nm"]
    assert np.sqrt(np.mean(difference**2)) < REAL_TIME_DIFFERENCE
    for name in ("plant", "controller"):
        clock = result[name]["timing"]
        assert clock["wake"]["p50_us"] > 0.0
        assert clock["late"] <= clock["cycles"]
        assert clock["slots"] == clock["cycles"] + clock["skipped"]
        assert all(counts["lost"] == counts["corrupt"] == 0 for counts in result[name]["frames"].values())
    plant, controller = result["plant"], result["controller"]
    # heartbeats before the plant has come are nobody's
    assert plant["port"]["received"] <= controller["port"]["sent"] - controller["port"]["refused"]
    cycles = controller["timing"]["cycles"]
    commands = plant["frames"]["VALVE_COMMAND"]["received"]
    assert cycles <= commands <= cycles + 0.5 * RATE  # those of the warm-up, and the safe ones at the end
    assert plant["frames"]["MOTOR_COMMAND"]["received"] == commands
    assert controller["frames"]["ENCODER"]["received"] <= plant["samples"]  # which outlives its controller


def test_a_run_file_has_everything(local_bus: str, tmp_path: Path) -> None:
    result = run_up(local_bus, tmp_path, "--rate", "500")
    run = read_run(Path(result["run"]))
    assert list(run.columns)[: len(REQUIRED)] == list(REQUIRED)
    assert {"torque_demand_nm", "controller_feedforward_bar", "truth_clutch_torque_nm"} <= set(run.columns)
    assert len(run["time_s"]) == SECONDS * 500
    assert run.metadata["rig"] == "wet_clutch"
    assert run.metadata["sample_rate_hz"] == 500
    assert run.metadata["bus"] == local_bus
    assert run.metadata["plant_parameters"]["clutch.coulomb_slope"] == 10.8
    assert run.metadata["controller_parameters"]["model.coulomb_slope"] == 10.8
    assert run.metadata["timing"]["controller"]["timing"]["cycles"] > 0
    assert Path(result["picture"]).stat().st_size > 10_000
    assert sorted(path.suffix for path in tmp_path.iterdir()) == [".parquet", ".png"]


def test_paused_and_interrupted_a_lock_step_run_is_whole(local_bus: str, tmp_path: Path) -> None:
    """The services wait for the process that records; the ring would hold 3 s of what they make."""
    arguments = ("--bus", local_bus, "--lockstep", "--seconds", "10000", "--out", str(tmp_path))
    with service("up", *arguments) as process:
        with open_bus(local_bus) as port:  # closed before we wait: a port that is not read fills up
            await_frame(port, "CONTROLLER_STATUS", lambda status: status.phase == 2)
        process.send_signal(signal.SIGSTOP)
        time.sleep(6.0)  # a service may be silent for 5 s
        process.send_signal(signal.SIGCONT)
        time.sleep(0.5)
        process.send_signal(signal.SIGINT)
        out, errors = process.communicate(timeout=PATIENCE)
    assert "verdict: interrupted after" in out, errors
    (path,) = tmp_path.glob("*.parquet")
    run = read_run(path)
    ticks = np.arange(len(run["time_s"]))
    assert len(ticks) > 8192  # what the services may be ahead
    assert np.array_equal(np.rint(1000.0 * run["time_s"]), ticks)
    assert np.array_equal(run["controller_sample_tick"][:-1], ticks[:-1])


def test_a_telemetry_process_that_dies_is_told_and_the_run_goes_on(local_bus: str, tmp_path: Path) -> None:
    with service("up", "--bus", local_bus, "--seconds", "3", "--out", str(tmp_path)) as process:
        with open_bus(local_bus) as port:
            await_frame(port, "CONTROLLER_STATUS", lambda status: status.phase == 2)
        children = psutil.Process(process.pid).children(recursive=True)
        (telemetry,) = [
            c for c in children if "protocols.telemetry" in c.cmdline() and "plant.ring" in " ".join(c.cmdline())
        ]
        telemetry.kill()
        out, errors = process.communicate(timeout=PATIENCE)
    assert process.returncode == 0, errors
    assert "note: telemetry failed with exit code -9" in out


def test_ctrl_c_keeps_a_whole_run(local_bus: str, tmp_path: Path) -> None:
    with (
        service("up", "--bus", local_bus, "--rate", str(RATE), "--out", str(tmp_path)) as process,
        open_bus(local_bus) as port,
    ):
        await_frame(port, "CONTROLLER_STATUS", lambda status: status.phase == 2)
        time.sleep(0.5)
        process.send_signal(signal.SIGINT)
        _, errors = process.communicate(timeout=PATIENCE)
    run = read_run(next(tmp_path.glob("*.parquet")))
    assert run.metadata["interrupted"] is True
    assert len(run["time_s"]) > 0.5 * RATE, errors
    assert (
        run["controller_sample_tick"][-1] > len(run["time_s"]) - 0.2 * RATE
    )  # it has no rows from after its controller
    assert not list(tmp_path.glob("*.part"))


def test_a_controller_that_is_stopped_leaves_the_valve_closed(local_bus: str) -> None:
    with (
        service("plant", "--bus", local_bus, "--rate", str(RATE), "--profile", "engagement", *ONE_CPU),
        open_bus(local_bus) as port,
    ):
        with service("controller", "--bus", local_bus, "--rate", str(RATE), *ONE_CPU) as controller:
            await_frame(port, "CONTROLLER_STATUS", lambda status: status.phase == 2)
            controller.terminate()
            assert await_end(controller)[0] == 0
        last = [FRAMES["VALVE_COMMAND"].unpack(d) for i, d in port.receive() if i == FRAMES["VALVE_COMMAND"].can_id][-1]
        assert (last.valve_enable, last.valve_voltage) == (0, 0.0)


def test_a_controller_that_is_killed_leaves_the_valve_closed(local_bus: str) -> None:
    with (
        service("plant", "--bus", local_bus, "--rate", str(RATE), "--profile", "engagement", *ONE_CPU),
        open_bus(local_bus) as port,
    ):
        with service("controller", "--bus", local_bus, "--rate", str(RATE), *ONE_CPU) as controller:
            await_frame(port, "CONTROLLER_STATUS", lambda status: status.phase == 2)
            controller.kill()
        await_frame(port, "PLANT_STATUS", lambda status: status.actuators == Actuators.LOST)
        await_frame(port, "ANALOG_SENSORS", lambda sensors: sensors.cylinder_pressure < 0.5)


def test_a_plant_that_is_killed_faults_the_controller(local_bus: str) -> None:
    with (
        service("controller", "--bus", local_bus, "--rate", str(RATE), *ONE_CPU) as controller,
        open_bus(local_bus) as port,
    ):
        with service("plant", "--bus", local_bus, "--rate", str(RATE), "--profile", "engagement", *ONE_CPU) as plant:
            await_frame(port, "CONTROLLER_STATUS", lambda status: status.phase == 2)
            plant.kill()
        status = await_frame(port, "CONTROLLER_STATUS", lambda status: status.phase == 4)
        assert status.fault == 1  # type: ignore[attr-defined]
        valve = await_frame(port, "VALVE_COMMAND", lambda valve: True)
        assert (valve.valve_enable, valve.valve_voltage) == (0, 0.0)  # type: ignore[attr-defined]
        controller.terminate()
        assert await_end(controller)[0] == 1  # its verdict tells the fault


def test_a_second_controller_is_refused_and_the_first_goes_on(local_bus: str) -> None:
    with service("controller", "--bus", local_bus, "--rate", str(RATE), *ONE_CPU) as first, open_bus(local_bus) as port:
        await_frame(port, "CONTROLLER_HEARTBEAT", lambda heartbeat: heartbeat.lifecycle == 2)
        second = run_command("controller", "--bus", local_bus)
        assert second.returncode == 2
        assert list_errors(second.stderr)[0].startswith(f"error: a second controller is on {local_bus}")
        assert first.poll() is None
        await_frame(port, "CONTROLLER_HEARTBEAT", lambda heartbeat: heartbeat.lifecycle == 2)


def test_a_second_plant_is_refused(local_bus: str) -> None:
    with service("plant", "--bus", local_bus) as first, open_bus(local_bus) as port:
        await_frame(port, "PLANT_HEARTBEAT", lambda heartbeat: True)
        second = run_command("plant", "--bus", local_bus)
        assert second.returncode == 2
        assert list_errors(second.stderr)[0].startswith(f"error: a second plant is on {local_bus}")
        assert first.poll() is None


def test_strange_frames_are_counted_and_the_run_goes_on(local_bus: str) -> None:
    """Short, remote, CAN FD, extended, corrupt, out of range, and a few of a second plant and controller."""
    analog, setpoint, valve = (FRAMES[name] for name in ("ANALOG_SENSORS", "TORQUE_SETPOINT", "VALVE_COMMAND"))
    common = ("--bus", local_bus, "--rate", str(RATE), *ONE_CPU)
    channel = local_bus.removeprefix("local:")
    with (
        service("plant", *common, "--profile", "engagement", "--json") as plant,
        service("controller", *common, "--json") as controller,
        open_bus(local_bus) as port,
        can.Bus(channel, interface="local", fd=True) as tool,
    ):
        await_frame(port, "CONTROLLER_STATUS", lambda status: status.phase == 2)
        for n in range(5):
            port.send(Frame(analog.can_id, b"\0" * 7))
            port.send(Frame(analog.can_id, b"\1" * 8))
            port.send(Frame(analog.can_id, b""))
            port.send(Frame(valve.can_id, b"\0" * 3))
            if n < 2:  # more in short order are a second sender
                port.send(Frame(valve.can_id, valve.pack(n, 1, 2.0, 0)))
                port.send(Frame(analog.can_id + 1, FRAMES["ENCODER"].pack_raw(n, 0, n)))
            tool.send(can.Message(arbitration_id=analog.can_id, is_extended_id=False, is_remote_frame=True, dlc=8))
            tool.send(can.Message(arbitration_id=analog.can_id, is_extended_id=False, is_fd=True, data=bytes(64)))
            tool.send(can.Message(arbitration_id=analog.can_id, is_extended_id=True, data=bytes(8)))
        for counter in (0, 1):  # of a supervisor without a claim
            port.send(Frame(setpoint.can_id, setpoint.pack(counter, 1, 31.0, 10.0, 0.0)))
        await_frame(port, "PLANT_STATUS", lambda status: status.rejected_frames >= 5)
        await_frame(port, "CONTROLLER_STATUS", lambda status: status.phase == 2)
        assert plant.poll() is controller.poll() is None
        (summary, code), (of_plant, _) = read_summary(controller), read_summary(plant)
    assert code == 0
    assert summary["faults"] == 0
    sensors = summary["frames"]["ANALOG_SENSORS"]
    assert (sensors["misshapen"], sensors["corrupt"]) == (10, 5)
    assert summary["frames"]["TORQUE_SETPOINT"]["corrupt"] == 2
    assert summary["supervisor"]["claims_refused"] == 0
    assert summary["first_rejected"].startswith(
        "frame ANALOG_SENSORS (0x100) was received with 7 bytes; its definition has 8"
    )
    assert summary["port"]["ignored"] == 15
    strays = summary["stray_frames"]["VALVE_COMMAND"]
    assert (strays["received"], strays["misshapen"]) == (2, 5)
    assert of_plant["stray_frames"]["ENCODER"]["received"] == 2
    assert of_plant["stray_frames"]["ANALOG_SENSORS"] == {
        "received": 0, "lost": 0, "repeated": 0, "conflicting": 0, "wrong_sequence": 0, "corrupt": 5, "misshapen": 10,
        "unusable": 0,
    }  # fmt: skip


def test_a_second_controller_that_goes_on_is_a_fault_of_the_first_which_lives_and_closes_the_valve(
    local_bus: str,
) -> None:
    common = ("--bus", local_bus, "--rate", str(RATE), *ONE_CPU)
    valve = FRAMES["VALVE_COMMAND"]
    with (
        service("plant", *common, "--profile", "engagement"),
        service("controller", *common) as controller,
        open_bus(local_bus) as port,
    ):
        await_frame(port, "CONTROLLER_STATUS", lambda status: status.phase == 2)
        for counter in range(INTRUSION):
            port.send(Frame(valve.can_id, valve.pack(counter, 1, 2.0, 0)))
        await_frame(port, "CONTROLLER_STATUS", lambda status: status.fault == Fault.SECOND_SENDER)
        assert controller.poll() is None
        closed = await_frame(port, "VALVE_COMMAND", lambda command: command.valve_enable == 0)
        assert closed.valve_voltage == 0.0  # type: ignore[attr-defined]


def test_two_rates_are_refused(local_bus: str) -> None:
    with service("plant", "--bus", local_bus, "--rate", "500"):
        controller = run_command("controller", "--bus", local_bus, "--rate", "1000")
    assert controller.returncode == 2
    assert "give both one rate" in controller.stderr


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["--bus", "nosuch"], "bus 'nosuch' does not exist; available are"),
        (["--bus", "local:a/b"], "allowed are 1 to 32 of A-Z a-z 0-9"),
        (["--rate", "7"], "rate 7 Hz is not possible; allowed are 50 to 10000 Hz"),
        (["--profile", "nosuch"], "profile 'nosuch' does not exist; known are broadband, cold_start, "),
        (["--seconds", "-1"], "a run of -1 s is not possible"),
        (["--law", "best"], "control law 'best' is unknown; allowed are both, feedforward, feedback"),
        (["--plant-parameters", "bad.toml"], "parameter clutch.coulomb_slope = -1 Nm/bar is outside 0."),
        (["--controller-parameters", "bad.toml"], "parameter 'clutch.coulomb_slope' is unknown; did you mean"),
        (["--plant-parameters", "missing.toml"], "parameter file missing.toml does not exist"),
        (["--router", "nonsense"], "error: zenoh router 'nonsense' cannot be reached; an address such as"),
        (["--temperature", "nan"], "error: oil temperature nan degC is outside 35..150 degC"),
        (["--trigger", "x"], "error: trigger 'x' is unknown; allowed are bus, clock, pll"),
        (["--spin-us", "nan"], "error: spin of nan us is not possible; allowed are 0 to"),
        (["--profile", "manual", "--seconds", "nan"], "error: a run of nan s is not possible"),
        (["--profile", "manual", "--lockstep"], "profile 'manual' cannot be played in lock-step"),
        (["--view", "--no-telemetry"], "a viewer and --no-telemetry were both given"),
        (["--profile", "high.csv"], "row 2: set-point 31 Nm is outside 0..30 Nm"),
    ],
)
def test_bad_input_is_one_sentence_and_leaves_nothing(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, local_bus: str, arguments: list[str], words: str
) -> None:
    monkeypatch.chdir(tmp_path)
    Path("bad.toml").write_text("[clutch]\ncoulomb_slope = -1\n")
    Path("high.csv").write_text("time_s,torque_demand_nm,motor_speed_demand_rad_s\n0,0,10\n1,31,10\n2,0,10\n")
    done = play_here("up", *(() if "--bus" in arguments else ("--bus", local_bus)), *arguments)
    assert done.returncode == 2
    assert words in done.stderr
    (error,) = list_errors(done.stderr)
    assert error.startswith("error: ")
    assert not Path("runs").exists() or not os.listdir("runs")


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["plant", "--cpu", "9999"], "CPU 9999 does not exist; allowed are 0 to"),
        (["plant", "--seconds", "nan"], "a run of nan s is not possible"),
        (["plant", "--temperature", "nan"], "oil temperature nan degC is outside 35..150 degC"),
        (["plant", "--router", "nonsense"], "zenoh router 'nonsense' cannot be reached; an address such as"),
        (["controller", "--cpu", "9999"], "CPU 9999 does not exist; allowed are 0 to"),
        (["controller", "--trigger", "x"], "trigger 'x' is unknown; allowed are bus, clock, pll"),
        (["controller", "--overrun", "x"], "overrun policy 'x' is unknown"),
        (["controller", "--router", "bench.jso"], "or a file of clutch-hil secure, which ends with .json"),
    ],
)
def test_a_service_is_refused_before_it_compiles(
    monkeypatch: pytest.MonkeyPatch, local_bus: str, arguments: list[str], words: str
) -> None:
    monkeypatch.setattr("protocols.kernels.progress_notice.compile_first", pytest.fail)
    done = play_here(*arguments, "--bus", local_bus)
    assert done.returncode == 2
    assert words in done.stderr


def test_a_malformed_dbc_is_one_sentence(tmp_path: Path) -> None:
    path = tmp_path / "bad.dbc"
    path.write_text("BO_ junk")
    done = play_here("frames", "--dbc", path)
    assert done.returncode == 2
    assert list_errors(done.stderr)[0].startswith(f"error: DBC {path} is malformed: ")
    assert len(list_errors(done.stderr)) == 1
