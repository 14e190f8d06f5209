"""What systemd is told: by datagrams, never with a wait, and alive only as long as the loop counts."""

import os
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest

from protocols.node import Column
from protocols.realtime import notify
from protocols.realtime.notify import LoopWatch, NoNotifier, SystemdNotifier, find_watchdog, open_notifier, watch
from protocols.realtime.ring import RingWriter
from tests.protocols.manager import PATIENCE, Manager

WATCHDOG = 0.4  # s: pings each 0.1 s
SILENCE = 0.5  # s without a datagram that counts as silence: five periods of pings


@pytest.fixture(params=["path", "abstract"])
def manager(request: pytest.FixtureRequest, tmp_path: Path) -> Iterator[Manager]:
    manager = Manager(str(tmp_path / "notify") if request.param == "path" else f"@clutch-hil-test-{os.getpid()}")
    yield manager
    manager.close()


@pytest.fixture
def ring(tmp_path: Path) -> Iterator[RingWriter]:
    ring = RingWriter(tmp_path / "ring", [Column("value", "1", "of a cycle")], 4)
    yield ring
    ring.close()


def test_a_service_tells_its_state(manager: Manager) -> None:
    notifier = open_notifier({"NOTIFY_SOCKET": manager.address})
    notifier.say("waits\nfor a plant")
    notifier.be_ready()
    notifier.stop()
    assert manager.read() == ["STATUS=waits for a plant", "READY=1", "STOPPING=1"]


@pytest.mark.parametrize("environment", [{}, {"NOTIFY_SOCKET": ""}, {"NOTIFY_SOCKET": "vsock:2:1234"}])
def test_without_systemd_nothing_is_told(environment: dict[str, str]) -> None:
    assert isinstance(open_notifier(environment), NoNotifier)


def test_nobody_who_reads_delays_nobody(tmp_path: Path) -> None:
    manager = Manager(str(tmp_path / "notify"))
    notifier = SystemdNotifier(manager.address)
    began = time.monotonic()
    for _ in range(10_000):  # far more than the socket's queue takes
        notifier.be_ready()
    manager.close()
    notifier.be_ready()
    assert time.monotonic() - began < 5.0


def test_pings_are_as_frequent_as_the_watchdog_needs() -> None:
    assert find_watchdog({"WATCHDOG_USEC": "2000000"}) == 2.0
    assert find_watchdog({"WATCHDOG_USEC": "2000000", "WATCHDOG_PID": str(os.getpid())}) == 2.0
    assert find_watchdog({"WATCHDOG_USEC": "2000000", "WATCHDOG_PID": "1"}) is None  # that of another process
    assert [find_watchdog(told) for told in ({}, {"WATCHDOG_USEC": "0"}, {"WATCHDOG_USEC": "soon"})] == [None] * 3


def test_a_ping_is_not_repeated_at_once(manager: Manager) -> None:
    notifier = SystemdNotifier(manager.address, WATCHDOG)
    for _ in range(100):
        notifier.ping()
    assert manager.read() == ["WATCHDOG=1"]
    time.sleep(WATCHDOG / 2)
    notifier.ping()
    assert manager.read() == ["WATCHDOG=1"]
    SystemdNotifier(manager.address).ping()  # without a watchdog
    assert manager.read() == []


def test_a_start_is_extended_while_another_service_is_waited_for(
    manager: Manager, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(notify, "_EXTEND_PERIOD", 0.1)
    notifier = SystemdNotifier(manager.address)
    for _ in range(100):
        notifier.extend_start()
    time.sleep(0.15)
    notifier.extend_start()
    assert manager.read() == ["EXTEND_TIMEOUT_USEC=30000000"] * 2
    assert notify._GRANTED > 2 * 5.0  # a request may be lost


@pytest.fixture
def watched(manager: Manager, ring: RingWriter, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[LoopWatch]:
    monkeypatch.setenv("NOTIFY_SOCKET", manager.address)
    monkeypatch.setenv("WATCHDOG_USEC", str(round(WATCHDOG * 1e6)))
    watching = LoopWatch(tmp_path / "ring", ring.count_place, "controls")
    yield watching
    watching.end()


def run_loop(ring: RingWriter, seconds: float) -> None:
    """Count cycles at 1 kHz."""
    end = time.monotonic() + seconds
    while time.monotonic() < end:
        ring.write([1.0])
        time.sleep(0.001)


def test_a_loop_is_ready_after_its_first_cycle_and_alive_while_it_counts(
    watched: LoopWatch, manager: Manager, ring: RingWriter
) -> None:
    assert manager.read(1.0) == []  # not before
    ring.write([1.0])
    assert manager.await_word("READY=1")[:2] == ["STATUS=controls", "READY=1"]
    run_loop(ring, 1.0)
    pings = manager.read()
    assert set(pings) == {"WATCHDOG=1"}
    assert len(pings) >= 4  # of ten: a busy machine may be late
    manager.read(0.2)
    time.sleep(SILENCE)
    manager.read()
    assert manager.read(SILENCE) == []  # the loop stands, although the service lives


def test_who_watches_ends_with_the_service(watched: LoopWatch, manager: Manager, ring: RingWriter) -> None:
    ring.write([1.0])
    manager.await_word("READY=1")
    process = watched._process
    assert process
    watched.end()
    assert process.returncode == 0
    run_loop(ring, 0.2)
    assert manager.read() in ([], ["WATCHDOG=1"])


def test_who_watches_ends_with_a_service_that_is_killed(manager: Manager, ring: RingWriter, tmp_path: Path) -> None:
    code = (
        "import sys, time; from pathlib import Path; from protocols.realtime.notify import LoopWatch;"
        f"watch = LoopWatch(Path({str(tmp_path / 'ring')!r}), {ring.count_place}, 'controls');"
        "print(watch._process.pid, flush=True); time.sleep(60)"
    )
    environment = os.environ | {"NOTIFY_SOCKET": manager.address}
    with subprocess.Popen([sys.executable, "-c", code], stdout=subprocess.PIPE, env=environment) as service:
        assert service.stdout
        pid = int(service.stdout.readline())
        os.kill(service.pid, signal.SIGKILL)
        await_end(lambda: not Path(f"/proc/{pid}").exists() or is_zombie(pid))


def is_zombie(pid: int) -> bool:
    return Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()[0] == "Z"


def await_end(is_over: Callable[[], bool]) -> None:
    deadline = time.monotonic() + PATIENCE
    while not is_over():
        assert time.monotonic() < deadline
        time.sleep(0.02)


def test_a_service_without_systemd_has_nobody_who_watches(ring: RingWriter, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delenv("NOTIFY_SOCKET", raising=False)
    watching = LoopWatch(Path("ring"), ring.count_place, "controls")
    assert watching._process is None
    watching.end()


def test_a_count_that_stands_is_no_ping(manager: Manager) -> None:
    """Without a process: each look but the last two finds a cycle more."""
    reading, writing = os.pipe()
    counts = iter([1, 2, 3, 3, 3])

    def read_count() -> int:
        count = next(counts, None)
        if count is None:
            os.close(writing)
            return 3
        return count

    notifier = SystemdNotifier(manager.address, 1e-6)
    watch(read_count, notifier, "controls", 0.001, reading)
    os.close(reading)
    assert manager.read() == ["STATUS=controls", "READY=1", "WATCHDOG=1", "WATCHDOG=1", "WATCHDOG=1"]
