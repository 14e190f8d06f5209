"""Notify: reports the state of a service to systemd, by datagrams to the socket $NOTIFY_SOCKET; without it nothing is sent.

A loop in compiled code sends these itself, at the end of a cycle (`beat.py`): READY=1 and WATCHDOG=1 after its first cycle, and
again several times per watchdog period. So systemd ends a loop that hangs, whatever the reason. A datagram for which systemd
has no room is lost: the loop does not wait.

References      sd_notify(3), systemd.service(5) on Type=notify, WatchdogSec= and NotifyAccess=
"""

import os
import socket
import time
from collections.abc import Mapping
from contextlib import suppress
from typing import Protocol

import numpy as np

SOCKET, WATCHDOG, WATCHDOG_PID = "NOTIFY_SOCKET", "WATCHDOG_USEC", "WATCHDOG_PID"
_PINGS = 4  # per watchdog period: two may be lost or late without ending the service
# s by which each request extends the start of a service that waits for another one. A waiting service is not ended, a service
# that hangs while it waits is
_GRANTED = 30.0
_EXTEND_PERIOD = 5.0  # s between two such requests
# Message of a loop: `length` bytes at the address `text`, to the descriptor `socket`, at the end of the first cycle that begins
# at or after `due` [ns of CLOCK_MONOTONIC], then each `period` [ns]
PING = np.dtype((np.record, [("due", "i8"), ("period", "i8"), ("socket", "i8"), ("text", "i8"), ("length", "i8")]))
_NEVER = 1 << 62  # ns: 146 years; added to the present time it still fits 64 bits
_ALIVE = np.frombuffer(b"READY=1\nWATCHDOG=1", np.uint8)


class Notifier(Protocol):
    """Reports the state of this service to the service manager."""

    def say(self, status: str) -> None:
        """Report what the service is doing, in one line."""

    def be_ready(self) -> None:
        """Report that the service is ready."""

    def ping(self) -> None:
        """Report that the service makes progress; sends no more often than the watchdog needs."""

    def extend_start(self) -> None:
        """Report that the start takes longer, because another service is awaited; call it repeatedly meanwhile."""

    def stop(self) -> None:
        """Report that the service ends."""

    def make_ping(self) -> np.ndarray:
        """Return the message of a loop, (1,) of PING; valid as long as the notifier exists."""


class NoNotifier:
    """Notifier without a service manager: sends nothing."""

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

    def make_ping(self) -> np.ndarray:
        """See `Notifier`."""
        return np.array([(_NEVER, _NEVER, -1, 0, 0)], PING)


class SystemdNotifier:
    """Reports to systemd. `address`: of $NOTIFY_SOCKET, a path, or an abstract name with a leading @.

    watchdog [s]: time without a ping after which systemd ends the service; None without a watchdog. A datagram that cannot be
    sent is lost: sending never blocks and raises nothing.
    """

    def __init__(self, address: str, watchdog: float | None = None) -> None:
        self._address = "\0" + address[1:] if address.startswith("@") else address
        self._socket = socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM | socket.SOCK_CLOEXEC | socket.SOCK_NONBLOCK)
        self._ping_period = watchdog / _PINGS if watchdog else float("inf")
        self._next_ping = self._next_extension = 0.0  # s of CLOCK_MONOTONIC
        with suppress(OSError):
            self._socket.connect(self._address)  # for a loop, which sends without an address

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

    def make_ping(self) -> np.ndarray:
        """See `Notifier`."""
        period = round(self._ping_period * 1e9) if self._ping_period < float("inf") else _NEVER
        return np.array([(0, period, self._socket.fileno(), _ALIVE.ctypes.data, _ALIVE.size)], PING)

    def _send(self, text: str) -> None:
        with suppress(OSError):
            self._socket.sendto(text.encode(), self._address)


def open_notifier(environment: Mapping[str, str] = os.environ) -> Notifier:
    """Return the notifier that the environment selects."""
    address = environment.get(SOCKET, "")
    if address[:1] not in ("/", "@"):  # other addresses, such as vsock, are for virtual machines
        return NoNotifier()
    return SystemdNotifier(address, find_watchdog(environment))


def find_watchdog(environment: Mapping[str, str]) -> float | None:
    """Return the watchdog time [s]; None if this process has no watchdog."""
    time_us, pid = environment.get(WATCHDOG, ""), environment.get(WATCHDOG_PID, "")
    if not time_us.isdigit() or int(time_us) == 0 or (pid and pid != str(os.getpid())):
        return None
    return int(time_us) / 1e6
