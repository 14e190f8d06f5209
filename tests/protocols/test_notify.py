"""What systemd is told: by datagrams, never with a wait, and alive only as long as the loop counts."""

import os
import time
from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np
import pytest

from protocols.node import Column
from protocols.realtime import notify
from protocols.realtime.beat import TIMING, Beat, record_cycle
from protocols.realtime.clock import Clock
from protocols.realtime.notify import NoNotifier, SystemdNotifier, find_watchdog, open_notifier
from protocols.realtime.ring import RingWriter
from tests.protocols.manager import Manager

WATCHDOG = 0.4  # s: pings each 0.1 s
SILENCE = 0.5  # s without a datagram that counts as silence: five periods of pings


@pytest.fixture(params=["path", "abstract"])
def manager(request: pytest.FixtureRequest, tmp_path: Path) -> Iterator[Manager]:
    manager = Manager(str(tmp_path / "notify") if request.param == "path" else f"@clutch-hil-test-{os.getpid()}")
    yield manager
    manager.close()


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
    assert [find_watchdog(sentence) for sentence in ({}, {"WATCHDOG_USEC": "0"}, {"WATCHDOG_USEC": "soon"})] == [
        None
    ] * 3


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


def make_loop(folder: Path, ping: np.ndarray) -> Iterator[tuple[Beat, Callable[[int], None]]]:
    """A beat of compiled code that tells by `ping`, and what does a cycle of it that began at a time [ns]."""
    ring = RingWriter(folder / "ring", [Column("value", "1", "of a cycle"), *TIMING], 4)
    beat = Beat(Clock(1_000_000), ring, ping=ping)

    def run_cycle(woken: int) -> None:
        beat.clock.woken_ns = woken
        record_cycle(beat.memory, np.zeros(1), 0)

    yield beat, run_cycle
    ring.close()


Loop = tuple[Beat, Callable[[int], None]]


@pytest.fixture
def loop(manager: Manager, tmp_path: Path) -> Iterator[Loop]:
    notifier = SystemdNotifier(manager.address, WATCHDOG)
    yield from make_loop(tmp_path, notifier.make_ping())


def test_a_loop_is_ready_after_its_first_cycle_and_alive_while_it_counts(loop: Loop, manager: Manager) -> None:
    run_cycle = loop[1]
    assert manager.read() == []
    for at in range(0, 1_000_000_000, 1_000_000):  # ns: a second at 1 kHz, made up
        run_cycle(at)
    assert manager.read() == ["READY=1", "WATCHDOG=1"] * 10
    assert manager.read(SILENCE) == []  # the loop stands, although the service lives


def test_a_loop_that_slept_pings_once(loop: Loop, manager: Manager) -> None:
    run_cycle = loop[1]
    run_cycle(5)
    run_cycle(3_000_000_005)
    run_cycle(3_001_000_005)
    assert manager.read() == ["READY=1", "WATCHDOG=1"] * 2


def test_a_loop_without_a_watchdog_is_ready_once(manager: Manager, tmp_path: Path) -> None:
    notifier = SystemdNotifier(manager.address)
    for _, run_cycle in make_loop(tmp_path, notifier.make_ping()):
        for at in (0, 1, 10**9, 10**17):
            run_cycle(at)
    assert manager.read() == ["READY=1", "WATCHDOG=1"]


def test_a_loop_does_not_wait_for_a_manager_that_does_not_read(tmp_path: Path) -> None:
    """Nor for one that is gone."""
    manager = Manager(str(tmp_path / "notify"))
    notifier = SystemdNotifier(manager.address, 1e-9)
    began = time.monotonic()
    for beat, run_cycle in make_loop(tmp_path, notifier.make_ping()):
        for at in range(10_000):  # far more than the socket's queue takes
            run_cycle(at)
        manager.close()
        run_cycle(10_000)
        assert beat.memory.counts[0] == 10_001
    assert time.monotonic() - began < 5.0


def test_a_loop_without_systemd_or_its_socket_runs(tmp_path: Path) -> None:
    missing = SystemdNotifier(str(tmp_path / "nobody"), WATCHDOG)
    for notifier in (NoNotifier(), missing):
        for beat, run_cycle in make_loop(tmp_path, notifier.make_ping()):
            run_cycle(time.monotonic_ns())
            assert beat.memory.counts[0] == 1
