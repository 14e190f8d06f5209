"""The bench on a real SocketCAN bus, vcan0."""

import json
import socket
import subprocess
import sys
import time
from pathlib import Path

import can
import cantools
import numpy as np
import pytest

from clutch_hil.bench.in_process import play
from clutch_hil.bench.scenario import choose_scenario
from clutch_hil.bench.up import Bench
from plant_sim.node.plant_node import PlantNode
from plant_sim.profiles.profile import load_profile
from protocols.buses.bus import Port, listen, open_bus
from protocols.buses.exchange import Exchange
from protocols.can.frame_batch import load, make_batch, unload
from protocols.can.frames import DBC, Frame, load_frames
from protocols.can.reception import Reception
from protocols.errors import InputError
from protocols.files.runs import read_run
from protocols.node import load_node
from tests import needs
from tests.processes import list_errors
from tests.rt_controller.bus_log import write_log

RATE = 100  # Hz: a guest pays 15 us a system call and now and then 25 ms; timing is judged on the host (timing.md)
BUS = "vcan0"
COMMAND = [sys.executable, "-m", "clutch_hil"]


def run_command(*arguments: str, timeout: float = 120.0) -> subprocess.CompletedProcess:
    return subprocess.run([*COMMAND, *arguments], capture_output=True, text=True, timeout=timeout, check=False)


def set_link(state: str) -> None:
    subprocess.run(["ip", "link", "set", BUS, state], check=True)


@pytest.fixture(scope="module")
def played(tmp_path_factory: pytest.TempPathFactory) -> tuple[dict, Path]:
    """What a bench says whose controller is begun by samples, and the traffic as candump saw it: starting takes half a minute
    in a guest, so one run is looked at from all sides."""
    folder = tmp_path_factory.mktemp("played")
    log = folder / "traffic.log"
    with log.open("w") as file:
        dump = (
            subprocess.Popen(["candump", "-L", "-n", "1000", BUS], stdout=file) if needs.is_there("candump") else None
        )
        common = ("--bus", BUS, "--rate", str(RATE), "--seconds", "4", "--trigger", "bus")
        done = run_command("up", *common, "--out", str(folder), "--json")
        assert done.returncode == 0, done.stdout + done.stderr
        if dump:
            dump.wait(10)
    return json.loads(done.stdout), log


def test_two_processes_close_the_torque_loop(played: tuple[dict, Path]) -> None:
    result, _ = played
    assert result["samples"] == 4 * RATE
    assert result["regime_error_nm"] < 0.5  # Nm; 0.1 on the host at 1 kHz
    for name in ("plant", "controller"):
        assert all(frame["corrupt"] == frame["repeated"] == 0 for frame in result[name]["frames"].values())
        assert result[name]["port"]["refused"] == 0


@pytest.mark.needs("candump")
def test_candump_reads_the_traffic(played: tuple[dict, Path]) -> None:
    database = cantools.database.load_file(DBC)
    messages = list(can.CanutilsLogReader(played[1]))
    assert len(messages) == 1000
    names = {database.get_message_by_frame_id(message.arbitration_id).name for message in messages}
    assert {"VALVE_COMMAND", "MOTOR_COMMAND", "ANALOG_SENSORS", "ENCODER", "TORQUE_SETPOINT"} <= names
    codecs = {codec.can_id: codec for codec in load_frames().values()}
    claim, setpoint = load_frames()["SUPERVISOR_CLAIM"], load_frames()["TORQUE_SETPOINT"]
    claims = (claim.raw(bytes(message.data)) for message in messages if message.arbitration_id == claim.can_id)
    (session,) = {one.session for one in claims}
    codecs[setpoint.can_id] = setpoint.bind(session)
    assert all(codecs[message.arbitration_id].is_valid(bytes(message.data)) for message in messages)


def test_lock_step_on_vcan_is_bit_identical_to_one_process(tmp_path: Path) -> None:
    scenario = choose_scenario(None, {"seconds": 2.0, "out": tmp_path})
    result = Bench(scenario, BUS, lockstep=True, telemetry=False).run(quiet=True)
    assert result.good, result.text
    run = read_run(Path(result.document["run"]))
    plant = PlantNode(profile=load_profile("engagement", 2.0))
    played = play(plant, load_node("controller")())
    for column in plant.columns:
        assert np.array_equal(run[column.name], played[column.name]), column.name


def test_a_log_is_answered_the_same_on_vcan_and_in_one_process(tmp_path: Path) -> None:
    log = tmp_path / "bus.blf"
    write_log(log, 0.5)
    there, here = (run_command("replay", str(log), "--json", *bus) for bus in (("--bus", BUS), ()))
    assert (there.returncode, here.returncode) == (0, 0), there.stderr + here.stderr
    there, here = json.loads(there.stdout), json.loads(here.stdout)
    assert there["sha256"] == here["sha256"]
    assert there["equal"] == here["equal"] == here["cycles"]


def test_frames_carry_the_time_at_which_the_kernel_took_them() -> None:
    with open_bus(BUS) as one, open_bus(BUS) as other:
        before = time.time_ns()
        one.send(Frame(0x123, b"x"))
        after = time.time_ns()
        time.sleep(0.05)
        ((stamp, frame),) = [sentence for sentence in other.receive_stamped() if sentence[1].can_id == 0x123]
        assert before <= stamp == other.stamps[0x123] <= after
        assert frame == Frame(0x123, b"x")


def test_the_kernel_keeps_away_what_is_not_wanted() -> None:
    with open_bus(BUS) as one, open_bus(BUS, [0x123, 0x124]) as picky, open_bus(BUS, []) as anything:
        for can_id in (0x122, 0x123, 0x124, 0x125):
            one.send(Frame(can_id, b"x"))
        assert [can_id for can_id, _ in listen(picky, 0.2)] == [0x123, 0x124]
        assert len(listen(anything, 0.0) + anything.receive()) == 4


def test_the_jitter_report_on_a_can_kernel() -> None:
    """Every phase is measured; nothing bounds a duration. The report is kept."""
    out = Path(__file__).parents[2] / "runs" / "jitter-vcan"
    done = run_command(
        "jitter", "--bus", BUS, "--rate", str(RATE), "--seconds", "2", "--rounds", "1", "--no-telemetry",
        "--out", str(out), "--overwrite", "--json", timeout=240.0,
    )  # fmt: skip
    assert done.returncode in (0, 1), done.stderr
    sentence = json.loads(done.stdout)
    phases = sentence["phases"]
    for name in ("empty loop, sleep", "empty loop, spin", "closed loop, clock", "closed loop, bus"):
        assert 0 <= phases[name]["unexplained"] <= phases[name]["late"] <= phases[name]["cycles"]
        assert phases[name]["cycles"] > 0.3 * 2.0 * RATE
    for name in ("closed loop, bus", "echo, raw frames", "echo, python-can and cantools"):
        assert phases[name]["latency"]["p50"] > 0.0
    assert (out / "jitter.png").stat().st_size > 10_000


def test_frames_keep_their_order() -> None:
    sender = f"""
from protocols.buses.bus import open_bus
from protocols.can.frames import Frame
import time
with open_bus("{BUS}") as port:
    for k in range(5000):
        port.send(Frame(0x123, k.to_bytes(4, "little")))
        if k % 50 == 0:
            time.sleep(0.001)
"""
    with open_bus(BUS) as port:
        process = subprocess.Popen([sys.executable, "-c", sender])
        frames: list[Frame] = []
        while process.poll() is None:
            frames += listen(port, 0.05)
        frames += listen(port, 0.1)
    assert process.returncode == 0
    assert [int.from_bytes(data, "little") for can_id, data in frames if can_id == 0x123] == list(range(5000))


def test_own_frames_do_not_come_back() -> None:
    with open_bus(BUS) as one, open_bus(BUS) as other:
        one.send(Frame(0x123, b"\x01"))
        assert [frame.can_id for frame in listen(other, 0.1)] == [0x123]
        assert one.receive() == []


def test_filters_of_python_can_act_on_the_kernel() -> None:
    wanted = [{"can_id": 0x101, "can_mask": 0x7FF}]
    with can.Bus(interface="socketcan", channel=BUS, can_filters=wanted) as tool, open_bus(BUS) as port:
        for can_id in (0x100, 0x101, 0x102, 0x101):
            port.send(Frame(can_id, b"\x00"))
        received = [tool.recv(0.2) for _ in range(3)]
    assert [message and message.arbitration_id for message in received] == [0x101, 0x101, None]


def test_frames_of_others_are_passed_over() -> None:
    with can.Bus(interface="socketcan", channel=BUS) as tool, open_bus(BUS) as port:
        tool.send(can.Message(arbitration_id=0x101, is_extended_id=True, data=b"\x00"))
        tool.send(can.Message(arbitration_id=0x101, is_extended_id=False, is_remote_frame=True, dlc=8))
        tool.send(can.Message(arbitration_id=0x101, is_extended_id=False, data=b"\x07"))
        assert listen(port, 0.1) == [Frame(0x101, b"\x07")]


def test_an_interface_that_goes_down_is_counted_and_comes_back() -> None:
    with open_bus(BUS) as one, open_bus(BUS) as other:
        try:
            set_link("down")
            one.send(Frame(0x123, b"\x01"))
            assert one.down == 1
            assert one.receive() == other.receive() == []
        finally:
            set_link("up")
        one.send(Frame(0x123, b"\x02"))
        assert listen(other, 0.1) == [Frame(0x123, b"\x02")]


def test_frames_in_fixed_memory_are_stamped_and_outlive_an_interface_that_goes_down() -> None:
    room = make_batch(2)
    load(room, [Frame(0x123, b"ab"), Frame(0x124, b"cd")])
    with open_bus(BUS) as one, open_bus(BUS) as two:
        line, other = Exchange(one, 0x124), Exchange(two, 0x124)
        try:
            before = time.time_ns()
            line.send(room, 2)
            assert other.receive(1.0)
            assert unload(other.inbox[: other.count]) == [Frame(0x123, b"ab"), Frame(0x124, b"cd")]
            assert other.marks == 1
            assert before <= other.marked_ns <= time.time_ns()
            set_link("down")
            line.send(room, 2)
            assert (one.sent, one.down) == (2, 2)
            other.clear()
            assert not other.receive(0.1)  # the error is told once; it comes back from it
        finally:
            set_link("up")
        line.send(room, 1)
        assert other.receive(1.0)
        assert unload(other.inbox[: other.count]) == [Frame(0x123, b"ab")]
        assert one.read_counts() == {"sent": 3, "received": 0, "refused": 0, "down": 2, "ignored": 0}


def test_an_interface_that_is_down_is_refused_with_the_command_that_helps() -> None:
    set_link("down")
    try:
        with pytest.raises(InputError, match=r"^bus vcan0 is down; .*ip link set vcan0 up$"):
            open_bus(BUS)
        done = run_command("up", "--bus", BUS)
    finally:
        set_link("up")
    assert done.returncode == 2
    assert list_errors(done.stderr)[0].startswith("error: bus vcan0 is down")


def test_a_torn_bus_closes_the_valve_and_faults_the_controller() -> None:
    """Down for half a second while the clutch slips: 50 cycles without a sample, far more than 5."""
    frames = load_frames()
    status, actuators = frames["CONTROLLER_STATUS"], frames["PLANT_STATUS"]
    common = ("--bus", BUS, "--rate", str(RATE), "--no-telemetry")
    plant = subprocess.Popen([*COMMAND, "plant", *common, "--profile", "engagement"])
    controller = subprocess.Popen([*COMMAND, "controller", *common])
    try:
        with open_bus(BUS) as port:
            wait_for_phase(port, 2)
            set_link("down")
            time.sleep(0.5)
            port.receive()  # what was said before
            set_link("up")
            heard = listen(port, 0.5)
        phases = [status.unpack(data) for can_id, data in heard if can_id == status.can_id]
        assert [phase.phase for phase in phases][-1] == 4
        assert phases[-1].fault == 1
        valves = [frames["VALVE_COMMAND"].unpack(d) for i, d in heard if i == frames["VALVE_COMMAND"].can_id]
        assert valves
        assert not any(valve.valve_enable or valve.valve_voltage for valve in valves)
        assert any(can_id == actuators.can_id for can_id, _ in heard)
    finally:
        for process, code in ((controller, 1), (plant, 0)):  # the controller ends with 1: it has seen a fault
            process.terminate()
            assert process.wait(20) == code


def wait_for_phase(port: Port, phase: int) -> None:
    status = load_frames()["CONTROLLER_STATUS"]
    deadline = time.monotonic() + 60.0
    while time.monotonic() < deadline:
        for can_id, data in listen(port, 0.1):
            if can_id == status.can_id and status.unpack(data).phase == phase:
                return
    raise AssertionError(f"the controller never reached phase {phase}")


@pytest.mark.needs("tc", "root")
def test_a_full_transmit_queue_refuses_and_counts() -> None:
    """A bus of 8 kbit/s with room for 200 bytes: most of 50 frames find the queue full (ENOBUFS)."""
    queue = ["dev", BUS, "root", "tbf", "rate", "8kbit", "burst", "100", "limit", "200"]
    subprocess.run(["tc", "qdisc", "add", *queue], check=True)
    try:
        with open_bus(BUS) as sender, open_bus(BUS) as reader:
            for k in range(50):
                sender.send(Frame(0x123, bytes((k,))))
            received = listen(reader, 0.5)
            assert sender.refused > 0
            assert sender.sent + sender.refused == 50
            assert len(received) == sender.sent
            assert [data[0] for _, data in received] == sorted(data[0] for _, data in received)
    finally:
        subprocess.run(["tc", "qdisc", "del", "dev", BUS, "root"], check=True)


def test_a_full_receive_queue_loses_frames_there_alone_and_the_counter_tells() -> None:
    codec = load_frames()["ENCODER"]
    with open_bus(BUS) as sender, open_bus(BUS) as reader, can.Bus(interface="socketcan", channel=BUS) as stalled:
        stalled.socket.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 4096)  # type: ignore[attr-defined]
        received = []
        for k in range(500):
            sender.send(Frame(codec.can_id, codec.pack(k, 0.0, k)))
            received += reader.receive()
        received += listen(reader, 0.1)
        assert sender.refused == 0
        assert len(received) == 500
        late = Reception(codec)
        while message := stalled.recv(0.05):
            assert late.accept(bytes(message.data))
        answers = []
        for counter in (501, 502):
            sender.send(Frame(codec.can_id, codec.pack(counter, 0.0, 0)))
            message = stalled.recv(0.2)
            assert message is not None
            answers.append(late.accept(bytes(message.data)))
        assert answers == [False, True]  # a gap that long is no loss of single frames; what follows is believed
        assert late.wrong_sequence == 1
    assert late.received < 500
