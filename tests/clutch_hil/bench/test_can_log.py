"""CAN logs: every frame of a running bench is in the file, and decodes to what the run file says."""

import json
import os
import signal
import subprocess
import time
from collections import Counter
from pathlib import Path

import can
import cantools
import numpy as np
import pytest

from clutch_hil.bench.can_log import WRITERS, Backlog, CanLog
from protocols.buses.bus import open_bus
from protocols.can.frames import DBC, Frame, load_frames
from protocols.errors import InputError, InterruptionError
from protocols.files.run import Run
from protocols.files.runs import read_run
from protocols.realtime.child import list_command
from protocols.realtime.stopping import Stop
from tests import needs
from tests.processes import PATIENCE

SECONDS = 3.0  # s of the profile: fill, 5 Nm, 10 Nm
RATE = 1000
CYCLIC = ("ANALOG_SENSORS", "ENCODER", "TORQUE_SETPOINT", "VALVE_COMMAND", "MOTOR_COMMAND")
SLOW = {"CONTROLLER_STATUS": 0.1, "PLANT_STATUS": 0.1, "CONTROLLER_HEARTBEAT": 0.05, "PLANT_HEARTBEAT": 0.05}  # s
SLOW["SUPERVISOR_CLAIM"] = 0.05  # s
CYCLE_TOLERANCE = 0.05  # of the time between two frames, by the median: single hiccups of the machine do not count
CLOCK_TOLERANCE = 0.01  # s between a frame's time stamp and its row's cycle; 1 ms when idle
FRAMES = load_frames()


def start(log: Path, bus: str, *arguments: str) -> subprocess.Popen:
    """A recorder that listens: its file is opened after the bus."""
    process = subprocess.Popen(
        list_command("record", str(log), "--bus", bus, "--json", *arguments),
        stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True,
    )  # fmt: skip
    part = log.with_name(log.name + ".part")
    deadline = time.monotonic() + PATIENCE
    while not part.exists():
        if process.poll() is not None or time.monotonic() > deadline:
            process.kill()
            raise AssertionError(process.communicate())
        time.sleep(0.01)
    return process


def stop_process(process: subprocess.Popen, how: signal.Signals) -> dict:
    process.send_signal(how)
    out, errors = process.communicate(timeout=PATIENCE)
    assert out, errors
    result = json.loads(out)
    assert process.returncode == (0 if result["good"] else 1)
    return result


@pytest.fixture(scope="module")
def bench(tmp_path_factory: pytest.TempPathFactory) -> tuple[dict, Run, dict[str, Path], dict[str, dict]]:
    """One run of `clutch-hil up` with two recorders on its bus: its result, its run file, the logs and their results."""
    out = tmp_path_factory.mktemp("bench")
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("CLUTCH_HIL_BUS_DIR", str(tmp_path_factory.mktemp("b")))
        logs = {suffix: out / f"wire{suffix}" for suffix in (".blf", ".asc")}
        recorders = {suffix: start(log, "local:bench") for suffix, log in logs.items()}
        try:
            done = subprocess.run(
                list_command("up", "--bus", "local:bench", "--seconds", str(SECONDS), "--out", str(out), "--json"),
                capture_output=True, text=True, timeout=PATIENCE, check=False,
            )  # fmt: skip
            assert done.returncode == 0, done.stderr
            ends = {".blf": signal.SIGINT, ".asc": signal.SIGTERM}
            results = {suffix: stop_process(recorder, ends[suffix]) for suffix, recorder in recorders.items()}
        finally:
            for recorder in recorders.values():
                recorder.kill()
    result = json.loads(done.stdout)
    return result, read_run(Path(result["run"])), logs, results


def read_messages(path: Path) -> list[can.Message]:
    with can.LogReader(path) as reader:
        return list(reader)


def decode_log(log: list[can.Message], name: str) -> dict[str, np.ndarray]:
    """Signals of one frame by cantools, in the order of the log."""
    frame = cantools.database.load_file(DBC).get_message_by_name(name)
    values = [frame.decode(bytes(m.data), decode_choices=False) for m in log if m.arbitration_id == frame.frame_id]
    return {signal.name: np.array([float(value[signal.name]) for value in values]) for signal in frame.signals}


each_log = pytest.mark.parametrize("suffix", [".blf", ".asc"])


@each_log
def test_every_frame_that_was_sent_is_in_the_log(bench: tuple, suffix: str) -> None:
    result, _, logs, results = bench
    log, sentence = read_messages(logs[suffix]), results[suffix]
    counts = Counter(message.arbitration_id for message in log)
    ports = [result[name]["port"] for name in ("plant", "controller")]
    assert {FRAMES[name].can_id: count for name, count in sentence["frames"].items()} == counts
    # nothing is missing but what found a full queue, which the senders count: only where the machine lets nobody read
    missing = sum(port["sent"] for port in ports) - len(log)
    assert 0 <= missing <= sum(port["refused"] for port in ports)
    assert missing == 0 or not sentence["good"]
    assert sentence["frames_lost"] <= missing
    assert set(sentence["frames"]) == set(FRAMES)


@each_log
def test_frames_come_at_the_rates_of_the_dbc(bench: tuple, suffix: str) -> None:
    log = read_messages(bench[2][suffix])
    for name in (*CYCLIC, *SLOW):
        times = np.array([m.timestamp for m in log if m.arbitration_id == FRAMES[name].can_id])
        cycle = SLOW.get(name, 1.0 / RATE)
        assert np.median(np.diff(times)) == pytest.approx(cycle, rel=CYCLE_TOLERANCE), name


@each_log
def test_what_was_on_the_wire_is_what_the_run_file_says(bench: tuple, suffix: str) -> None:
    _, run, logs, _ = bench
    log = read_messages(logs[suffix])
    analog, encoder, valve = (decode_log(log, name) for name in ("ANALOG_SENSORS", "ENCODER", "VALVE_COMMAND"))
    rows = len(run["time_s"])
    if len(analog["CLUTCH_TORQUE"]) < rows or bench[3][suffix]["frames_lost"]:
        needs.skip("quiet", "frames were lost")
    for signal_name, column in (
        ("CYLINDER_PRESSURE", "cylinder_pressure_bar"), ("OIL_TEMPERATURE", "oil_temperature_degc"),
        ("MOTOR_TORQUE", "motor_torque_nm"), ("CLUTCH_TORQUE", "clutch_torque_nm"),
    ):  # fmt: skip
        sensed = (analog | encoder)[signal_name][:rows]
        np.testing.assert_allclose(sensed, run[column], rtol=0, atol=1e-12)
    turn = 2**18 * FRAMES["ENCODER"].scale["shaft_angle"]  # rad, at which it wraps
    angle = np.unwrap(encoder["SHAFT_ANGLE"][:rows], period=turn)
    np.testing.assert_allclose(angle, run["shaft_angle_rad"], rtol=0, atol=1e-9)
    np.testing.assert_array_equal(encoder["SAMPLE_TICK"][:rows], np.arange(rows) % 2**10)
    # a command acts from the row after the one it answers: every voltage of the run was commanded
    assert set(np.round(run["valve_voltage_v"], 9)) <= {0.0, *np.round(valve["VALVE_VOLTAGE"], 9)}


def test_time_stamps_are_those_of_the_cycles(bench: tuple) -> None:
    _, run, logs, _ = bench
    log = read_messages(logs[".blf"])
    times = np.array([m.timestamp for m in log if m.arbitration_id == FRAMES["ENCODER"].can_id])
    epoch = time.time() - time.monotonic()
    lateness = times[: len(run["time_s"])] - (run["plant_clock_s"] + epoch)
    assert abs(np.median(lateness)) < CLOCK_TOLERANCE


@pytest.mark.parametrize("suffix", WRITERS)
def test_every_format_gives_frames_back(local_bus: str, tmp_path: Path, suffix: str) -> None:
    path = tmp_path / f"wire{suffix}"
    sent = [(0x123, b""), (0x080, bytes(range(6))), (0x7FF, b"\xff" * 8)]
    with start(path, local_bus) as recorder, open_bus(local_bus) as port:
        for can_id, data in sent:
            port.send(Frame(can_id, data))
        stop_process(recorder, signal.SIGTERM)
    assert [(message.arbitration_id, bytes(message.data)) for message in read_messages(path)] == sent
    assert [entry.name for entry in tmp_path.iterdir()] == [path.name]


def test_a_gap_in_the_alive_counter_is_told_and_a_restart_is_none(local_bus: str, tmp_path: Path) -> None:
    encoder, heartbeat = FRAMES["ENCODER"], FRAMES["PLANT_HEARTBEAT"]
    with start(tmp_path / "wire.blf", local_bus) as recorder, open_bus(local_bus) as port:
        for session, counters in ((1, (0, 1, 2, 5, 6)), (2, (0, 1, 2))):  # 3 and 4 are missing
            port.send(Frame(heartbeat.can_id, heartbeat.pack(0, 2, RATE, session)))
            for counter in counters:
                port.send(Frame(encoder.can_id, encoder.pack_raw(counter, sample_tick=counter)))
        recorder.send_signal(signal.SIGTERM)
        out, _ = recorder.communicate(timeout=PATIENCE)
    assert recorder.returncode == 1
    assert json.loads(out)["frames_lost"] == 2
    assert len(read_messages(tmp_path / "wire.blf")) == 10


def test_a_start_of_one_service_hides_no_gap_of_the_other(local_bus: str, tmp_path: Path) -> None:
    encoder, heartbeat = FRAMES["ENCODER"], FRAMES["CONTROLLER_HEARTBEAT"]
    with start(tmp_path / "wire.blf", local_bus) as recorder, open_bus(local_bus) as port:
        port.send(Frame(encoder.can_id, encoder.pack_raw(0)))
        port.send(Frame(heartbeat.can_id, heartbeat.pack(0, lifecycle=2, rate=RATE, session=7)))
        port.send(Frame(encoder.can_id, encoder.pack_raw(5, sample_tick=5)))
        assert stop_process(recorder, signal.SIGTERM)["frames_lost"] == 4


def test_the_next_supervisor_counts_anew(local_bus: str, tmp_path: Path) -> None:
    setpoint = FRAMES["TORQUE_SETPOINT"]
    with start(tmp_path / "wire.blf", local_bus) as recorder, open_bus(local_bus) as port:
        for counters in ((0, 1, 2), (0, 1), (2, 4)):
            for counter in counters:
                port.send(Frame(setpoint.can_id, setpoint.pack(counter, 0, 0.0, 0.0, 0.0)))
            if counters == (0, 1, 2):
                time.sleep(0.2)  # the silence itself: a supervisor listens that long before it speaks
        assert stop_process(recorder, signal.SIGTERM)["frames_lost"] == 1


def test_a_log_that_slept_until_the_end_does_not_claim_to_be_whole(local_bus: str, tmp_path: Path) -> None:
    """Senders were refused, and no later frame shows a gap."""
    encoder = FRAMES["ENCODER"]
    with start(tmp_path / "wire.blf", local_bus) as recorder, open_bus(local_bus) as port:
        recorder.send_signal(signal.SIGSTOP)
        os.waitid(os.P_PID, recorder.pid, os.WSTOPPED)
        count = 0
        while not port.refused:
            port.send(Frame(encoder.can_id, encoder.pack_raw(count, sample_tick=count % 2**10)))
            count += 1
        recorder.send_signal(signal.SIGCONT)
        sentence = stop_process(recorder, signal.SIGTERM)
    assert sentence["frames_lost"] == 0
    assert sentence["frames"] == {"ENCODER": count - 1}
    assert not sentence["good"]
    assert "frames may be lost" in sentence["verdict"]


def test_a_backlog_counts_what_had_been_sent_when_its_first_frame_was_read() -> None:
    backlog = Backlog()
    for sent in (1.0, 2.0, 3.0):
        backlog.note(sent, now=sent + 0.1)
    assert backlog.most == 1
    for sent in (4.0, 5.0, 6.0, 7.0):  # read from 6.5 on: three had been sent
        backlog.note(sent, now=max(6.5, sent + 0.1))
    assert backlog.most == 3


def test_a_length_ends_the_log_by_itself(local_bus: str, tmp_path: Path) -> None:
    with start(tmp_path / "wire.asc", local_bus, "--seconds", "0.2") as recorder, open_bus(local_bus) as port:
        port.send(Frame(0x123, b"\x01"))
        recorder.communicate(timeout=PATIENCE)
    assert recorder.returncode == 0
    assert len(read_messages(tmp_path / "wire.asc")) == 1


def test_a_silent_bus_leaves_no_file(local_bus: str, tmp_path: Path) -> None:
    with Stop() as stop:
        os.kill(os.getpid(), signal.SIGTERM)
        with pytest.raises(InterruptionError, match=f"no frame was received on bus {local_bus}; nothing was recorded"):
            CanLog(local_bus, tmp_path / "wire.blf").record(stop, None, lambda text: None)
    assert list(tmp_path.iterdir()) == []


def test_a_suffix_no_writer_has_is_refused_with_those_there_are(local_bus: str, tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"cannot be written as '\.pcap'; allowed are \.asc, \.blf, \.log, \.trc"):
        CanLog(local_bus, tmp_path / "wire.pcap")


def test_a_bus_that_does_not_exist_is_refused(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="bus 'can7' does not exist"):
        CanLog("can7", tmp_path / "wire.blf")


def test_a_place_that_cannot_be_written_is_refused_by_name(local_bus: str, tmp_path: Path) -> None:
    (tmp_path / "file").write_text("in the way")
    path = tmp_path / "file" / "wire.blf"
    with Stop() as stop, pytest.raises(InputError, match=str(path)):
        CanLog(local_bus, path).record(stop, 1.0, lambda text: None)


def test_identifiers_without_end_are_counted_in_a_bounded_table(
    local_bus: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """There are 2^29 extended ones."""
    monkeypatch.setattr("clutch_hil.bench.can_log._MOST_NAMES", 3)
    sent = [can.Message(arbitration_id=0x10000 + k, is_extended_id=True, timestamp=1.0 + k) for k in (0, 1, 2, 3, 4, 1)]
    monkeypatch.setattr("clutch_hil.bench.can_log._receive", lambda bus, stop, seconds: iter(sent))
    with Stop() as stop:
        result = CanLog(local_bus, tmp_path / "wire.blf").record(stop, 1.0, lambda text: None)
    assert result.frames == {
        "extended frame 0x10000": 1, "extended frame 0x10001": 2, "extended frame 0x10002": 1,
        "extended frames of further identifiers": 2,
    }  # fmt: skip
    assert len(read_messages(tmp_path / "wire.blf")) == 6
