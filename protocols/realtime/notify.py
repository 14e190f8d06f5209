"""Notify: tells systemd how a service is, by datagrams to the socket $NOTIFY_SOCKET; without it nothing is told.

The real-time thread tells nothing while its loop runs, and no other thread runs beside it. A `LoopWatch` is a process of its
own that reads how many cycles the loop has counted in its ring. It says READY=1 when the first cycle is done, and WATCHDOG=1
only if the loop has done a cycle since it was last said. So systemd ends a loop that stands still, whatever the reason.

This file is that process's program too, and imports nothing but the standard library: it is light and starts at once.

References      sd_notify(3), systemd.service(5) on Type=notify, WatchdogSec= and NotifyAccess=
"""

import mmap
import os
import select
import signal
import socket
import struct
import subprocess
import sys
import time
from collections.abc import Callable, Mapping
from contextlib import suppress
from pathlib import Path
from typing import Protocol

SOCKET, WATCHDOG, WATCHDOG_PID = "NOTIFY_SOCKET", "WATCHDOG_USEC", "WATCHDOG_PID"
_PINGS = 4  # in a time of the watchdog: two may be lost or late, and the service lives
_READY_PERIOD = 0.1  # s between two looks for the first cycle
# s granted to a service that waits for another one, from each time that it says so: one that waits is not given up, one that
# stands still while it waits is
_GRANTED = 30.0
_EXTEND_PERIOD = 5.0  # s between two requests for it
_COUNT = struct.Struct("<q")
_END_TIMEOUT = 2.0  # s for the process that watches to end


class Notifier(Protocol):
    """Tells the manager of services how this one is."""

    def say(self, status: str) -> None:
        """Tell what the service does, in one line."""

    def be_ready(self) -> None:
        """Tell that the service does what it is for."""

    def ping(self) -> None:
        """Tell that the service makes progress; not more often than the watchdog needs it."""

    def extend_start(self) -> None:
        """Tell that the start takes longer, as another service is waited for; call it as long as that is so."""

    def stop(self) -> None:
        """Tell that the service ends."""


class NoNotifier:
    """Nobody is there to be told."""

    def say(self, status: str) -> None:
        """See `Notifier`."""

    def be_ready(self) -> None:
        """See `Notifier`."""

    def ping(self) -> None:
        """See `Notifier`."""

    def extend_start(self) -> None:
        """See `Notifier`."""

    def stop(self) -> None:
        """See `Notifier`."""


class SystemdNotifier:
    """Tells systemd. `address`: of $NOTIFY_SOCKET, a path, or with a leading @ a name without a file.

    watchdog [s]: time without a ping after which systemd ends the service, None where it has no watchdog. A datagram that
    cannot be sent is lost: telling never waits and raises nothing.
    """

    def __init__(self, address: str, watchdog: float | None = None) -> None:
        self._address = "\0" + address[1:] if address.startswith("@") else address
        self._socket = socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM | socket.SOCK_CLOEXEC | socket.SOCK_NONBLOCK)
        self._ping_period = watchdog / _PINGS if watchdog else float("inf")
        self._next_ping = self._next_extension = 0.0  # s of CLOCK_MONOTONIC

    def say(self, status: str) -> None:
        """See `Notifier`."""
        self._send(f"STATUS={' '.join(status.split())}")

    def be_ready(self) -> None:
        """See `Notifier`."""
        self._send("READY=1")

    def ping(self) -> None:
        """See `Notifier`."""
        now = time.monotonic()
        if self._ping_period < float("inf") and now >= self._next_ping:
            self._next_ping = now + self._ping_period
            self._send("WATCHDOG=1")

    def extend_start(self) -> None:
        """See `Notifier`."""
        now = time.monotonic()
        if now >= self._next_extension:
            self._next_extension = now + _EXTEND_PERIOD
            self._send(f"EXTEND_TIMEOUT_USEC={round(_GRANTED * 1e6)}")

    def stop(self) -> None:
        """See `Notifier`."""
        self._send("STOPPING=1")

    def _send(self, text: str) -> None:
        with suppress(OSError):
            self._socket.sendto(text.encode(), self._address)


def open_notifier(environment: Mapping[str, str] = os.environ) -> Notifier:
    """The notifier that the environment asks for."""
    address = environment.get(SOCKET, "")
    if address[:1] not in ("/", "@"):  # others, such as of vsock, are for virtual machines
        return NoNotifier()
    return SystemdNotifier(address, find_watchdog(environment))


def find_watchdog(environment: Mapping[str, str]) -> float | None:
    """Time of the watchdog [s]; None where this process has none."""
    time_us, pid = environment.get(WATCHDOG, ""), environment.get(WATCHDOG_PID, "")
    if not time_us.isdigit() or int(time_us) == 0 or (pid and pid != str(os.getpid())):
        return None
    return int(time_us) / 1e6


class LoopWatch:
    """A process that tells systemd that a loop is ready and alive; without systemd there is none.

    ring: file of the loop's ring; place: byte of its count of rows there. status: what it tells once the loop is ready.
    """

    def __init__(self, ring: Path, place: int, status: str) -> None:
        self._process: subprocess.Popen[bytes] | None = None
        if os.environ.get(SOCKET):
            watchdog = find_watchdog(os.environ)
            command = [sys.executable, "-I", "-S", __file__, str(ring), str(place), str(watchdog or 0.0), status]
            # it ends when its input does: with this process, however that ends
            self._process = subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.DEVNULL)

    def end(self) -> None:
        """End the process."""
        if self._process and self._process.stdin:
            self._process.stdin.close()
            try:
                self._process.wait(_END_TIMEOUT)
            except subprocess.TimeoutExpired:
                self._process.kill()
                self._process.wait()


def watch(read_count: Callable[[], int], notifier: Notifier, status: str, period: float, end: int) -> None:
    """Tell of a loop until the descriptor `end` can be read. read_count: number of its cycles. period [s] between two looks."""
    known, ready = 0, False
    while not select.select([end], [], [], period if ready else _READY_PERIOD)[0]:
        count = read_count()
        if count == known:
            continue
        known = count
        if not ready:
            notifier.say(status)
            notifier.be_ready()
            ready = True
        notifier.ping()


def _run(ring: str, place: str, watchdog: str, status: str) -> None:
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # the service decides when it ends
    signal.signal(signal.SIGTERM, signal.SIG_IGN)
    with open(ring, "rb") as file:
        memory = mmap.mmap(file.fileno(), 0, access=mmap.ACCESS_READ)
    time_left = float(watchdog) or None
    notifier = SystemdNotifier(os.environ[SOCKET], time_left)
    # looks are as frequent as pings, and a ping is never left out because a look came just before its time
    period = time_left / (2 * _PINGS) if time_left else _READY_PERIOD
    watch(lambda: _COUNT.unpack_from(memory, int(place))[0], notifier, status, period, sys.stdin.fileno())


if __name__ == "__main__":
    _run(*sys.argv[1:])
