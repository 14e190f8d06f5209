"""Mailbox: one request at a time to a real-time loop, in shared memory. The loop checks it once a cycle, in 0.1 us.

The asking side writes a request and its number. The loop sees a new number, acts between two cycles, and writes the answer and
the same number. Neither side waits for a lock. A request that is not answered in time is an error on the asking side.

Layout: request number (u64), its length (u64), answer number (u64), its length (u64), request text, answer text.
"""

import mmap
import time
from pathlib import Path

import numpy as np

from protocols.errors import InputError

MOST_BYTES = 65_536  # bytes of a request or answer: some hundred parameters
_HEADER_BYTES = 32
REQUEST_NUMBER, _REQUEST_LENGTH, ANSWER_NUMBER, _ANSWER_LENGTH = range(4)  # 64-bit words
WORDS = _HEADER_BYTES // 8
_POLL_PERIOD = 1e-3  # s between two checks for the answer


class _MappedFile:
    def __init__(self, path: Path, create: bool) -> None:
        try:
            with path.open("w+b" if create else "r+b") as file:
                if create:
                    file.write(bytes(_HEADER_BYTES + 2 * MOST_BYTES))
                    file.flush()
                self._map = mmap.mmap(file.fileno(), _HEADER_BYTES + 2 * MOST_BYTES)
        except (OSError, ValueError) as error:
            raise InputError(f"mailbox {path} cannot be opened: {error}") from None
        self._words = memoryview(self._map)[:_HEADER_BYTES].cast("Q")

    def close(self) -> None:
        """Release the memory."""
        self._words.release()
        self._map.close()

    def _write_text(self, start: int, text: str) -> int:
        data = text.encode()
        if len(data) > MOST_BYTES:
            raise InputError(f"a request of {len(data)} bytes is too long; allowed are {MOST_BYTES}")
        self._map[start : start + len(data)] = data
        return len(data)

    def _read_text(self, start: int, length: int) -> str:
        return self._map[start : start + length].decode()


class Mailbox(_MappedFile):
    """The loop's side."""

    def __init__(self, path: Path) -> None:
        super().__init__(path, create=True)

    @property
    def numbers(self) -> np.ndarray:
        """Header words (4,), for compiled code: a request waits if REQUEST_NUMBER and ANSWER_NUMBER differ."""
        return np.frombuffer(self._map, np.int64, WORDS)

    def has_request(self) -> bool:
        """Return whether a request waits for an answer."""
        return self._words[REQUEST_NUMBER] != self._words[ANSWER_NUMBER]

    def request(self) -> str:
        """Return the text of the waiting request."""
        return self._read_text(_HEADER_BYTES, self._words[_REQUEST_LENGTH])

    def answer(self, text: str) -> None:
        """Answer the waiting request."""
        self._words[_ANSWER_LENGTH] = self._write_text(_HEADER_BYTES + MOST_BYTES, text)
        self._words[ANSWER_NUMBER] = self._words[REQUEST_NUMBER]


class Asker(_MappedFile):
    """The asking side. Only one asker may use a mailbox."""

    def __init__(self, path: Path) -> None:
        super().__init__(path, create=False)

    def ask(self, text: str, timeout: float) -> str:
        """Send a request and return the answer. Raises InputError if none comes within `timeout` [s]."""
        end = time.monotonic() + timeout
        if not self._wait_for_answer(end):  # a service that has just resumed answers in its next cycle
            raise InputError("an earlier change still waits for the service; it is busy or stopped")
        self._words[_REQUEST_LENGTH] = self._write_text(_HEADER_BYTES, text)
        self._words[REQUEST_NUMBER] += 1
        if not self._wait_for_answer(end):
            raise InputError(
                f"the service has not answered within {timeout:.2g} s; it may still be starting, or be stopped"
            )
        return self._read_text(_HEADER_BYTES + MOST_BYTES, self._words[_ANSWER_LENGTH])

    def _wait_for_answer(self, end: float) -> bool:
        """Wait for the answer until `end` [s of CLOCK_MONOTONIC]; return whether it has come."""
        while self._words[ANSWER_NUMBER] != self._words[REQUEST_NUMBER]:
            if time.monotonic() > end:
                return False
            time.sleep(_POLL_PERIOD)
        return True
