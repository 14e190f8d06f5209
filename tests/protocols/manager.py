"""A manager of services for tests: what systemd is told at $NOTIFY_SOCKET."""

import socket
import time
from collections.abc import Callable

PATIENCE = 120.0  # s for a process to start, and to compile, on a busy machine


class Manager:
    """Stands for systemd: `address` as in $NOTIFY_SOCKET; reads what it is told."""

    def __init__(self, address: str) -> None:
        self.address = address
        self._socket = socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM)
        self._socket.bind("\0" + address[1:] if address.startswith("@") else address)

    def read(self, timeout: float = 0.0) -> list[str]:
        """Lines that came: of all that waits, or of what comes first within `timeout` [s]."""
        sentence: list[str] = []
        self._socket.settimeout(timeout or 1e-9)
        while True:
            try:
                sentence += self._socket.recv(4096).decode().splitlines()
            except (TimeoutError, BlockingIOError):
                return sentence
            self._socket.settimeout(1e-9)

    def await_word(self, word: str, alive: Callable[[], bool] = lambda: True) -> list[str]:
        """What came until `word` did."""
        sentence: list[str] = []
        deadline = time.monotonic() + PATIENCE
        while word not in sentence:
            assert time.monotonic() < deadline, f"{word} never came, but {sentence}"
            assert alive(), f"the service has ended; it said {sentence}"
            sentence += self.read(0.1)
        return sentence

    def close(self) -> None:
        """Nobody listens any more."""
        self._socket.close()
