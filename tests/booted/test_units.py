"""A machine that has booted with the units of a bench, one test after the other: from the start to the uninstall.

Nothing but the boot has started them. Each test leaves the bench running, but for the last one.
"""

import os
import pwd
import signal
import subprocess
import sys
import time
import urllib.request
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import psutil
import pytest

from clutch_hil.bench.host.unit_files import UNITS, name_unit
from protocols.buses.bus import Port, listen, open_bus
from protocols.can.frames import load_frames
from protocols.can.request import Request
from protocols.files.runs import read_run
from tests.booted.supervisor import TORQUE

BUS = "vcan0"
PATIENCE = 240.0  # s for what takes seconds where the host runs the machine; a guest starts Python in ten
FRAMES = load_frames()
IDLE, SLIP_CONTROL, FAULT = 0, 2, 4  # of CONTROLLER_STATUS.PHASE
NEAR = 0.75  # Nm: a guest at 50 Hz is rough
ENGAGING = 10.0  # s; it takes 0.3 s
ATTEMPTS = 5  # to engage: where the guest stands still for 0.1 s, the controller rightly releases
OPEN_PRESSURE = 0.3  # bar: below the springs that open the clutch; 5 Nm need more than 1 bar
OBSERVED = 3.0  # s that a controller that has come back is watched: engaging takes 0.3 s
WATCHDOG = 2.0  # s, of the units


def run(*command: str) -> str:
    done = subprocess.run(command, capture_output=True, text=True, timeout=PATIENCE, check=False)
    assert done.returncode == 0, f"{' '.join(command)}: {done.stdout}{done.stderr}"
    return done.stdout.strip()


def show(name: str, key: str) -> str:
    """A property of a unit."""
    return run("systemctl", "show", f"--property={key}", "--value", name_unit(name))


def find_process(name: str) -> int:
    """Number of a unit's main process."""
    pid = int(show(name, "MainPID"))
    assert pid > 0, f"{name} does not run\n{read_log()}"  # a signal to 0 would be one to this test
    return pid


def await_that(what: str, is_so: Callable[[], bool]) -> None:
    deadline = time.monotonic() + PATIENCE
    while not is_so():
        assert time.monotonic() < deadline, f"{what} never came\n{read_log()}"
        time.sleep(0.2)


def read_log() -> str:
    units = [word for name in UNITS for word in ("--unit", name_unit(name))]
    return run("journalctl", "--boot", "--no-pager", "--lines=60", *units)


def await_active(name: str) -> None:
    await_that(f"{name} that is active", lambda: show(name, "ActiveState") == "active")


def hear_within(seconds: float, port: Port, frame: str, wanted: Callable[[Any], bool]) -> Any:
    """The first values of `frame` on the bus that are `wanted`; None if they do not come."""
    codec = FRAMES[frame]
    deadline = time.monotonic() + seconds
    while time.monotonic() < deadline:
        for can_id, data in listen(port, 0.02):
            if can_id == codec.can_id and codec.is_valid(data) and wanted(values := codec.unpack(data)):
                return values
    return None


def hear(port: Port, frame: str, wanted: Callable[[Any], bool]) -> Any:
    """The first values of `frame` on the bus that are `wanted`."""
    values = hear_within(PATIENCE, port, frame, wanted)
    assert values, f"{frame} never came as wanted\n{read_log()}"
    return values


@contextmanager
def engaged(port: Port) -> Iterator[None]:
    """A clutch that carries torque, by a supervisor that goes on asking for it, whatever the controller does."""
    command = [sys.executable, "-m", "tests.booted.supervisor", BUS]
    for attempt in range(ATTEMPTS):
        with subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE) as supervisor:
            assert supervisor.stdin
            assert supervisor.stdout
            try:
                assert supervisor.stdout.readline() == b"engaged\n"
                listen(port, 0.0)
                if hear_within(ENGAGING, port, "CONTROLLER_STATUS", lambda status: status.phase == SLIP_CONTROL):
                    yield
                    return
            finally:
                supervisor.stdin.close()
        print(f"attempt {attempt}: the guest stood still, and the controller missed its supervisor")
    raise AssertionError(f"the clutch was never engaged\n{read_log()}")


def test_units_start_with_the_machine() -> None:
    for name in UNITS:
        await_active(name)
        assert show(name, "NRestarts") == "0", read_log()
    assert run("systemctl", "is-active", "clutch-hil.target") == "active"


def test_networkd_has_made_the_bus() -> None:
    assert f"60-clutch-hil-{BUS}.network" in run("networkctl", "status", "--no-pager", BUS)
    assert int(Path(f"/sys/class/net/{BUS}/flags").read_text(), 16) & 1  # IFF_UP


def test_the_loop_is_closed() -> None:
    """From set-point to torque: the controller measures what the plant makes of its commands."""
    closed = False
    with open_bus(BUS) as port:
        for _ in range(ATTEMPTS):
            with engaged(port):
                closed = hear_torque(port)
            hear(port, "CONTROLLER_STATUS", lambda status: status.phase in (IDLE, FAULT))
            if closed:
                break
    assert closed, read_log()


def hear_torque(port: Port) -> bool:
    """Whether the controller's estimate and the plant's sensor reach the torque that is asked for."""
    return all(
        hear_within(ENGAGING, port, frame, lambda values, name=signal: abs(abs(getattr(values, name)) - TORQUE) < NEAR)  # type: ignore[misc]
        for frame, signal in (("CONTROLLER_STATUS", "torque_estimate"), ("ANALOG_SENSORS", "clutch_torque"))
    )


def test_no_process_of_a_unit_has_a_right_of_root() -> None:
    user = str(pwd.getpwnam("clutch-hil").pw_uid)
    slice_folder = Path("/sys/fs/cgroup/system.slice")
    for name in UNITS:
        processes = (slice_folder / name_unit(name) / "cgroup.procs").read_text().split()
        assert processes, name
        for pid in processes:
            lines = Path(f"/proc/{pid}/status").read_text().splitlines()
            status = dict(line.split(":\t", 1) for line in lines if ":\t" in line)
            assert set(status["Uid"].split()) == {user}
            assert {status[key].strip("0") for key in ("CapEff", "CapPrm", "CapBnd", "CapAmb")} == {""}
            assert (status["NoNewPrivs"], status["Seccomp"]) == ("1", "2")


@pytest.mark.parametrize("name", ["plant", "controller"])
def test_loops_have_real_time_priority_and_locked_memory(name: str) -> None:
    """In spite of that: by the limits of the unit."""
    pid = find_process(name)
    assert os.sched_getscheduler(pid) == os.SCHED_FIFO
    locked = [
        line.split()[1] for line in Path(f"/proc/{pid}/status").read_text().splitlines() if line.startswith("VmLck")
    ]
    assert int(locked[0]) > 10_000  # kB


def test_the_view_serves_its_page_to_this_machine_alone() -> None:
    with urllib.request.urlopen("http://127.0.0.1:9090/", timeout=PATIENCE) as answer:
        assert answer.status == 200
    listening = run("ss", "--tcp", "--listening", "--numeric", "--no-header").splitlines()
    assert listening
    assert all(line.split()[3].startswith(("127.0.0.1:", "[::1]:")) for line in listening), listening


def test_a_killed_controller_comes_back_after_the_safe_state_and_does_not_engage_by_itself() -> None:
    with open_bus(BUS) as port:
        before = hear(port, "CONTROLLER_HEARTBEAT", lambda heartbeat: True).session
        restarts, pid = int(show("controller", "NRestarts")), find_process("controller")
        with engaged(port):
            os.kill(pid, signal.SIGKILL)  # at once, while the clutch carries torque
            assert await_session(port, but=before) < OPEN_PRESSURE
            await_active("controller")
            assert int(show("controller", "NRestarts")) == restarts + 1
            listen(port, 0.0)
            phases, pressures, demands = watch_bus(port, OBSERVED)
        assert demands > 10  # it goes on being asked for torque
        assert phases <= {IDLE, FAULT}  # a guest that stands still for five cycles has lost samples
        assert max(pressures) < OPEN_PRESSURE
        with engaged(port):  # after a request for idle
            pass


def await_session(port: Port, but: int) -> float:
    """Wait for a controller of another session; return the pressure [bar] in the plant's last sample before its first frame."""
    heartbeat, sensors = FRAMES["CONTROLLER_HEARTBEAT"], FRAMES["ANALOG_SENSORS"]
    pressure, deadline = float("inf"), time.monotonic() + PATIENCE
    while time.monotonic() < deadline:
        for can_id, data in listen(port, 0.02):
            if can_id == sensors.can_id:
                pressure = float(sensors.unpack(data).cylinder_pressure)
            elif can_id == heartbeat.can_id and heartbeat.unpack(data).session != but:
                return pressure
    raise AssertionError(f"no other controller came\n{read_log()}")


def watch_bus(port: Port, seconds: float) -> tuple[set[int], list[float], int]:
    """Phases of the controller, pressures [bar] of the plant, and number of requests for torque within `seconds`."""
    status, sensors, setpoint = (FRAMES[name] for name in ("CONTROLLER_STATUS", "ANALOG_SENSORS", "TORQUE_SETPOINT"))
    phases, pressures, demands = set(), [], 0
    end = time.monotonic() + seconds
    while time.monotonic() < end:
        for can_id, data in listen(port, 0.02):
            if can_id == status.can_id:
                phases.add(int(status.unpack(data).phase))
            elif can_id == sensors.can_id:
                pressures.append(float(sensors.unpack(data).cylinder_pressure))
            elif can_id == setpoint.can_id:
                demands += setpoint.unpack(data).request == Request.ENGAGE
    return phases, pressures, demands


@pytest.mark.parametrize("name", ["controller", "plant"])
def test_a_loop_that_stands_still_is_ended_by_its_watchdog(name: str) -> None:
    restarts, pid = int(show(name, "NRestarts")), find_process(name)
    os.kill(pid, signal.SIGSTOP)
    await_that(f"{name} that is started anew", lambda: int(show(name, "NRestarts")) > restarts)
    assert f"{name_unit(name)}: Watchdog timeout (limit {WATCHDOG:g}s)!" in run("journalctl", "--boot", "--no-pager")
    await_active(name)
    assert find_process(name) != pid
    with open_bus(BUS) as port:
        hear(port, "CONTROLLER_STATUS", lambda status: True)
        hear(port, "ANALOG_SENSORS", lambda sensors: True)


def test_doctor_tells_of_the_units() -> None:
    done = subprocess.run(
        [sys.executable, "-m", "clutch_hil", "doctor"], capture_output=True, text=True, timeout=PATIENCE, check=False
    )
    for name in UNITS:
        assert f"{name_unit(name)} active" in done.stdout, done.stdout


def test_the_recorder_has_recorded() -> None:
    run("systemctl", "stop", name_unit("recorder"))
    runs = sorted(Path("/var/lib/clutch-hil/runs").glob("*.parquet"))
    assert runs, read_log()
    assert max(len(read_run(path)["time_s"]) for path in runs) > 1000  # twenty seconds at 50 Hz


def test_uninstall_leaves_nothing() -> None:
    run(sys.executable, "-m", "clutch_hil", "service", "uninstall", "--purge")
    await_that(
        "systemd without units", lambda: not run("systemctl", "list-units", "--all", "--no-legend", "clutch-hil*")
    )
    files = subprocess.run(
        ["systemctl", "list-unit-files", "--no-legend", "clutch-hil*"], capture_output=True, text=True, check=False
    )
    assert files.stdout == ""  # it ends with 1 where there is none
    left = [
        path
        for folder in ("/etc", "/var/lib", "/var/cache", "/run", "/dev/shm")
        for path in Path(folder).rglob("*clutch-hil*")
    ]
    assert not left
    assert not Path(f"/sys/class/net/{BUS}").exists()
    assert subprocess.run(["getent", "passwd", "clutch-hil"], check=False).returncode == 2  # no such user
    own = {os.getpid(), *(parent.pid for parent in psutil.Process().parents())}
    commands = [one.info["cmdline"] or () for one in psutil.process_iter(["cmdline"]) if one.pid not in own]
    assert not [command for command in commands if "clutch_hil" in " ".join(command)]
