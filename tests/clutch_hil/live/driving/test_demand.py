"""`clutch-hil demand`: a supervisor on the bus, as a process, against a real controller and plant."""

import json
import re
import signal
import threading
from collections.abc import Iterator
from itertools import groupby, pairwise
from pathlib import Path
from statistics import median
from typing import Any

import can
import pytest
from typer.testing import Result

from clutch_hil.bench.clutch_state import STATES
from clutch_hil.live.driving.demand import Lock, Regime, make_pressure_profile, make_torque_profile
from clutch_hil.live.driving.supervisor import RATE as SETPOINTS
from clutch_hil.live.driving.supervisor import Answer, Supervisor
from protocols.buses.bus import open_bus
from protocols.can.frames import Frame
from protocols.can.request import Request
from protocols.errors import InputError
from rt_controller.law.clutch_state import ClutchState
from tests.clutch_hil.live.running import FRAMES, Running, hear, run_command, running_bench, wait_until_open
from tests.processes import PATIENCE, service

IDLE, ENGAGE, RELEASE, PRESSURE, LOCK = range(5)  # values of REQUEST in the DBC
SLIP_CONTROL = 2  # value of PHASE in the DBC
PACE_ERROR = 0.1  # of the period of set-points, in the median: a shared machine delays some of them
RAMP = 20.0  # Nm/s
PRESSURE_REACHED = 0.03  # bar: three times the noise and the resolution of the sensor, 5 mbar each
STANDING = 0.05  # rad/s: two counts of the encoder within the 20 ms of a look
REACHED = 0.8  # Nm, a tenth of the 8 Nm: what the command itself takes for reached


@pytest.fixture(scope="module")
def services() -> Iterator[Running]:
    with running_bench(telemetry=False) as running:
        yield running


@pytest.fixture
def bench(services: Running) -> Running:
    with open_bus(services.bus) as port:
        wait_until_open(port)
    return services


def run_demand(bus: str, *arguments: str) -> Result:
    return run_command("demand", *arguments, "--bus", bus)


class Witness:
    """Every TORQUE_SETPOINT on a local bus, with the time [s] it was sent."""

    def __init__(self, bus: str) -> None:
        self.setpoints: list[tuple[float, Any]] = []
        self._channel, self._ended = bus.removeprefix("local:"), threading.Event()
        self._thread = threading.Thread(target=self._listen)

    def __enter__(self) -> "Witness":
        self._thread.start()
        return self

    def __exit__(self, *_: object) -> None:
        self._ended.set()
        self._thread.join()

    def _listen(self) -> None:
        codec = FRAMES["TORQUE_SETPOINT"]
        with can.Bus(self._channel, interface="local") as bus:
            while not self._ended.is_set():
                message = bus.recv(0.05)
                if message is not None and message.arbitration_id == codec.can_id:
                    self.setpoints.append((message.timestamp, codec.unpack(bytes(message.data))))

    def list_requests(self) -> list[int]:
        """Requests in the order they were made, each once."""
        return [request for request, _ in groupby(setpoint.request for _, setpoint in self.setpoints)]


def test_a_torque_is_reached_and_released(bench: Running) -> None:
    with Witness(bench.bus) as witness:
        done = run_demand(bench.bus, "8", "--seconds", "1.5", "--ramp", str(RAMP), "--json")
    assert done.exit_code == 0, done.stdout
    result = json.loads(done.stdout)
    assert result["good"]
    assert result["released"]
    assert abs(result["last_answer"]["torque_estimate"] - 8.0) < REACHED
    assert abs(result["last_answer"]["clutch_torque"] - 8.0) < REACHED
    assert witness.list_requests() == [IDLE, ENGAGE, RELEASE, IDLE]
    times = [sent for sent, _ in witness.setpoints]
    assert median(after - before for before, after in pairwise(times)) == pytest.approx(1.0 / SETPOINTS, rel=PACE_ERROR)
    engaged = [(sent, setpoint.torque_demand) for sent, setpoint in witness.setpoints if setpoint.request == ENGAGE]
    start = max(sent for sent, setpoint in witness.setpoints if setpoint.request == IDLE and sent < engaged[0][0])
    # the last idle may be sent up to a period after the time it is of
    assert all(torque <= RAMP * (sent - start + 1.0 / SETPOINTS) for sent, torque in engaged)


def test_a_pressure_is_reached_and_released(bench: Running) -> None:
    with Witness(bench.bus) as witness:
        done = run_demand(bench.bus, "--pressure", "3.4", "--seconds", "2", "--json")
    assert done.exit_code == 0
    result = json.loads(done.stdout)
    assert result["good"]
    assert result["released"]
    assert result["regime_demand_bar"] == pytest.approx(3.4)
    assert abs(result["last_answer"]["pressure"] - 3.4) < PRESSURE_REACHED
    assert result["last_answer"]["torque_estimate"] > 12.0  # Nm; 16 at that pressure
    assert result["regime_error_nm"] is None
    assert result["verdict"].startswith("reached, regime error 0.0")
    assert witness.list_requests() == [IDLE, PRESSURE, RELEASE, IDLE]
    assert {setpoint.torque_demand for _, setpoint in witness.setpoints} == {0.0}


def test_a_profile_file_is_followed(bench: Running, tmp_path: Path) -> None:
    path = tmp_path / "steps.csv"
    path.write_text(
        "time_s,torque_demand_nm,motor_speed_demand_rad_s\n0,0,12\n0.2,5,12\n1.4,5,12\n1.6,0,12\n", encoding="utf-8"
    )
    with Witness(bench.bus) as witness:
        done = run_demand(bench.bus, "--profile", str(path), "--json")
    assert done.exit_code == 0
    assert json.loads(done.stdout)["regime_demand_nm"] == pytest.approx(5.0)
    assert {setpoint.speed_demand for _, setpoint in witness.setpoints} == {12.0}


def test_a_clutch_locks_and_is_released(bench: Running) -> None:
    with Witness(bench.bus) as witness:
        done = run_demand(bench.bus, "--lock", "--speed", "1", "--seconds", "3", "--json")
    result = json.loads(done.stdout)
    assert done.exit_code == 0, result
    assert result["locked"]
    assert result["released"]
    assert result["verdict"] == f"locked after {result['locked_after_s']:.2f} s"
    assert result["last_answer"]["clutch"] == "locked"
    assert result["last_answer"]["sticking"]
    assert abs(result["last_answer"]["slip"]) < STANDING
    assert witness.list_requests() == [IDLE, LOCK, RELEASE, IDLE]


def test_a_demand_whose_ramp_outlasts_it_is_told_what_it_needs(bench: Running) -> None:
    done = run_demand(bench.bus, "20", "--ramp", "2", "--seconds", "1", "--json")
    assert done.exit_code == 1
    verdict = json.loads(done.stdout)["verdict"]
    assert verdict.startswith("not reached: no demand was held for 0.5 s; it needs more --seconds, or a steeper --ramp")


def test_what_the_clutch_did_is_told_of_a_demand_that_is_not_reached(bench: Running) -> None:
    """A pressure below the least one that the controller follows."""
    done = run_demand(bench.bus, "--pressure", "1", "--seconds", "1.5", "--json")
    assert done.exit_code == 1
    verdict = json.loads(done.stdout)["verdict"]
    assert re.fullmatch(
        r"not reached, regime error .*; at its end the clutch was \w+, with \S+ bar and a slip of \S+ rad/s", verdict
    )


def test_a_torque_is_reached_the_other_way_round(bench: Running) -> None:
    done = run_demand(bench.bus, "8", "--speed", "-5", "--seconds", "1.5", "--json")
    result = json.loads(done.stdout)
    assert done.exit_code == 0, result
    assert abs(result["last_answer"]["torque_estimate"] + 8.0) < REACHED  # signed as the slip
    assert result["regime_error_nm"] < REACHED
    assert result["last_answer"]["slip"] < -4.0
    assert result["last_answer"]["clutch"] == "sliding"


def test_ctrl_c_releases_the_clutch(bench: Running) -> None:
    with open_bus(bench.bus) as port, service("demand", "6", "--bus", bench.bus) as child:
        hear(port, "CONTROLLER_STATUS", lambda status: status.phase == SLIP_CONTROL)
        child.send_signal(signal.SIGINT)
        text, _ = child.communicate(timeout=PATIENCE)
        hear(port, "CONTROLLER_STATUS", lambda status: status.phase == IDLE)
    assert "the clutch is released" in text
    assert "verdict: interrupted after" in text


def test_a_killed_supervisor_is_missed(bench: Running) -> None:
    with open_bus(bench.bus) as port, service("demand", "6", "--bus", bench.bus) as child:
        hear(port, "CONTROLLER_STATUS", lambda status: status.phase == SLIP_CONTROL)
        child.kill()
        hear(port, "CONTROLLER_STATUS", lambda status: status.phase == IDLE)


def test_a_second_supervisor_is_refused(bench: Running) -> None:
    with service("demand", "6", "--bus", bench.bus), open_bus(bench.bus) as port:
        hear(port, "TORQUE_SETPOINT", lambda setpoint: True)
        refusal = run_demand(bench.bus, "3").exception
    assert isinstance(refusal, InputError)
    assert "another supervisor" in str(refusal)
    assert "clutch-hil plant without --profile" in str(refusal)


def test_a_supervisor_that_comes_later_stops_the_demand(bench: Running) -> None:
    codec = FRAMES["TORQUE_SETPOINT"]
    with service("demand", "6", "--bus", bench.bus) as child, open_bus(bench.bus) as port:
        hear(port, "CONTROLLER_STATUS", lambda status: status.phase == SLIP_CONTROL)
        port.send(Frame(codec.can_id, codec.pack(0, IDLE, 0.0, 0.0, 0.0)))
        _, errors = child.communicate(timeout=PATIENCE)
        hear(port, "CONTROLLER_STATUS", lambda status: status.phase == IDLE)
    assert child.returncode == 2
    assert "another supervisor" in errors


def test_a_demand_beyond_a_limit_of_the_controller_is_named_as_a_cause(bench: Running) -> None:
    """The frame carries 40 Nm and a larger bench's profiles may ask for it, but this controller follows 30 Nm at most."""
    with open_bus(bench.bus) as port, Supervisor(port) as supervisor:
        supervisor.demand_idle(10.0)
        for _ in range(2 * SETPOINTS):
            supervisor.ask(Request.ENGAGE, 40.0, 10.0)
            if objection := supervisor.explain_objection():
                break
        supervisor.release(10.0)
    assert objection is not None
    assert "beyond the controller's torque.demand_limit, phases.speed_limit or torque.pressure_limit" in objection


def test_a_fault_is_told_by_name(bench: Running) -> None:
    with open_bus(bench.bus) as port, service("demand", "6", "--bus", bench.bus) as child:
        hear(port, "CONTROLLER_STATUS", lambda status: status.phase == SLIP_CONTROL)
        bench.plant.send_signal(signal.SIGSTOP)
        try:
            text, _ = child.communicate(timeout=PATIENCE)
        finally:
            bench.plant.send_signal(signal.SIGCONT)
    assert child.returncode == 1
    assert text.strip().endswith("verdict: fault: stale sensors")


def test_without_a_controller_nothing_is_asked(local_bus: str) -> None:
    with Witness(local_bus) as witness:
        refusal = run_demand(local_bus, "6").exception
    assert isinstance(refusal, InputError)
    assert "no controller is on local:bench" in str(refusal)
    assert not witness.setpoints


@pytest.mark.parametrize(
    ("arguments", "sentence"),
    [
        ((), "needs one of TORQUE, --pressure, --lock and --profile; given: none"),
        (
            ("5", "--profile", "engagement"),
            "needs one of TORQUE, --pressure, --lock and --profile; given: 5.0 and engagement",
        ),
        (("5", "--pressure", "3"), "given: 5.0 and 3.0"),
        (("5", "--lock"), "given: 5.0 and --lock"),
        (("--lock", "--profile", "engagement"), "given: engagement and --lock"),
        (("--lock", "--ramp", "3"), "--lock and --ramp 3 cannot be combined; a ramp needs a TORQUE or a --pressure"),
        (("--lock", "--speed", "-27"), "speed -27 rad/s is outside -26.2..26.2 rad/s"),
        (("5", "--speed", "-27"), "speed -27 rad/s is outside -26.2..26.2 rad/s"),
        (("--pressure", "4.6"), "pressure 4.6 bar is outside 0..4.5 bar"),
        (("--pressure", "3", "--ramp", "0"), "ramp 0 bar/s is not possible; it must be 0.001 or more"),
        (("--profile", "multisine", "--ramp", "1"), "--speed or --ramp; the profile sets both"),
        (("31",), "torque 31 Nm is outside 0..30 Nm"),
        (("-1",), "torque -1 Nm is outside 0..30 Nm"),
        (("much",), "invalid value 'much' for 'torque': not a number"),
        (("--torque", "3"), "no such option: --torque"),
        (("10", "20"), "unexpected word: 20"),
        (("5", "--seconds", "0"), "0 s is not possible"),
        (("--profile", "none"), "profile 'none' does not exist; known are"),
        (("--profile", "/etc/passwd"), "profile '/etc/passwd' has the wrong suffix; a profile file ends with .csv"),
    ],
)
def test_bad_input_is_told(arguments: tuple[str, ...], sentence: str) -> None:
    done = run_demand("local:nobody", *arguments)
    assert done.exit_code != 0
    assert sentence in f"{done.output} {done.exception}"


@pytest.mark.parametrize(
    ("torque", "speed", "ramp"),
    [(float("nan"), 10.0, 40.0), (5.0, 26.3, 40.0), (5.0, -26.3, 40.0), (5.0, 10.0, 0.0), (5.0, 10.0, float("inf"))],
)
def test_what_the_rig_cannot_do_is_refused(torque: float, speed: float, ramp: float) -> None:
    with pytest.raises(InputError):
        make_torque_profile(torque, speed, None, ramp)


def test_a_pressure_rises_from_where_the_clutch_is_filled() -> None:
    profile = make_pressure_profile(3.4, 10.0, None, 4.0)
    assert profile.interpolate(0.06).pressure == pytest.approx(2.6, abs=0.05)
    assert profile.interpolate(0.15).pressure == pytest.approx(3.0, abs=0.05)
    assert profile.interpolate(100.0).pressure == pytest.approx(3.4)
    assert make_pressure_profile(2.4, 10.0, None, 4.0).interpolate(0.06).pressure == pytest.approx(2.4)


def test_a_ramp_that_is_longer_than_the_demand_is_cut() -> None:
    profile = make_torque_profile(20.0, 10.0, 1.0, 10.0)
    assert profile.duration == 1.0
    assert profile.interpolate(0.9999).torque == pytest.approx(9.5, abs=0.01)  # after 50 ms of idle


def test_only_steady_demands_are_judged() -> None:
    rising, held = Regime(), Regime()
    for sample in range(400):
        rising.add(sample * 0.01, 0.0)
        held.add(10.0, 9.5)
    assert not rising.samples
    assert not rising.is_reached
    assert held.error == pytest.approx(0.5)
    assert held.is_reached
    held.error_sum *= 3.0
    assert not held.is_reached


def test_a_clutch_that_did_not_lock_is_told() -> None:
    lock = Lock()
    lock.add(False, "locked")  # nobody asked
    for clutch in ("open", "sliding", "sticking"):
        lock.add(True, clutch)
        assert not lock.locked
    assert str(lock) == "not locked within 0.01 s"
    lock.add(True, "locked")
    assert (lock.locked, str(lock)) == (True, "locked after 0.02 s")
    lock.add(True, "sliding")
    assert (lock.locked, str(lock)) == (False, "locked after 0.02 s, later unlocked")


@pytest.mark.parametrize(
    ("phase", "sticking", "clutch"),
    [
        ("idle", True, "open"), ("fill", True, "open"), ("release", False, "open"), ("fault", True, "open"),
        ("slip control", False, "sliding"), ("slip control", True, "sticking"), ("lock", False, "sliding"),
        ("lock", True, "locked"), (None, None, None),
    ],
)  # fmt: skip
def test_the_state_of_the_clutch_is_told_by_phase_and_sticking(
    phase: str | None, sticking: bool | None, clutch: str | None
) -> None:
    assert Answer("active", "active", phase, sticking=sticking).clutch == clutch


def test_the_words_of_the_state_are_the_controllers() -> None:
    assert list(STATES) == [state.name.lower() for state in ClutchState]


def test_a_demand_is_logged_where_telemetry_is_published(tmp_path: Path) -> None:
    summary = tmp_path / "controller.json"
    with running_bench(telemetry=True, summary=summary) as running:
        done = run_demand(running.bus, "5", "--seconds", "1")
        assert "logged:  by the controller, as demanded by " in done.stdout, done.output
    (logged,) = json.loads(summary.read_text(encoding="utf-8"))["requests"]
    assert (logged["kind"], logged["demand"], logged["checked"]) == ("demand", "5 Nm", False)


def test_a_demand_without_telemetry_says_that_it_is_not_logged(bench: Running) -> None:
    assert (
        "not logged: no bench on local:bench publishes telemetry" in run_demand(bench.bus, "5", "--seconds", "1").stdout
    )
