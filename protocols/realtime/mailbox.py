"""Mailbox: one request at a time to a real-time loop, in shared memory. The loop looks once a cycle, for 0.1 us.

The asking side writes a request and its number, the loop finds a new number, acts between two cycles and writes the
answer and the same number. Neither side ever waits for a lock; a request that is not answered in time is told so.

Layout: request number (u64), its length (u64), answer number (u64), its length (u64), request text, answer text.
"""

import mmap
import time
from pathlib import Path

import numpy as np

from protocols.errors import InputError

_TEXT = 65_536  # bytes of a request or answer: some hundred parameters
_HEAD = 32
ASKED, _ASKED_LENGTH, ANSWERED, _ANSWERED_LENGTH = range(4)  # 64-bit words
WORDS = _HEAD // 8
_LOOK = 1e-3  # s between looks for the answer


class _Mapped:
    def __init__(self, path: Path, create: bool) -> None:
        try:
            with path.open("w+b" if create else "r+b") as file:
                if create:
                    file.write(bytes(_HEAD + 2 * _TEXT))
                    file.flush()
                self._map = mmap.mmap(file.fileno(), _HEAD + 2 * _TEXT)
        except (OSError, ValueError) as error:
            raise InputError(f"mailbox {path} cannot be opened: {error}") from None
        self._words = memoryview(self._map)[:_HEAD].cast("Q")

    def close(self) -> None:
        """Release the memory."""
        self._words.release()
        self._map.close()

    def _put(self, start: int, text: str) -> int:
        data = text.encode()
        if len(data) > _TEXT:
            raise InputError(f"a request of {len(data)} bytes is too long; allowed are {_TEXT}")
        self._map[start : start + len(data)] = data
        return len(data)

    def _get(self, start: int, length: int) -> str:
        return self._map[start : start + length].decode()


class Mailbox(_Mapped):
    """The loop's side."""

    def __init__(self, path: Path) -> None:
        super().__init__(path, create=True)

    @property
    def numbers(self) -> np.ndarray:
        """Those of the head, for compiled code: a request waits where number ASKED is not number ANSWERED; shape (4,)."""
        return np.frombuffer(self._map, np.int64, WORDS)

    def waiting(self) -> bool:
        """Whether a request has come that is not answered."""
        return self._words[ASKED] != self._words[ANSWERED]

    def request(self) -> str:
        """Text of the waiting request."""
        return self._get(_HEAD, self._words[_ASKED_LENGTH])

    def answer(self, text: str) -> None:
        """Answer it."""
        self._words[_ANSWERED_LENGTH] = self._put(_HEAD + _TEXT, text)
        self._words[ANSWERED] = self._words[ASKED]


class Asker(_Mapped):
    """The asking side; one asker a mailbox."""

    def __init__(self, path: Path) -> None:
        super().__init__(path, create=False)

    def ask(self, text: str, timeout: float) -> str:
        """Ask and return the answer. Raises InputError when none comes within `timeout` [s]."""
        end = time.monotonic() + timeout
        if not self._answered(end):  # a service that has just gone on answers it in its next cycle
            raise InputError("an earlier change still waits for the service; it is busy or stopped")
        self._words[_ASKED_LENGTH] = self._put(_HEAD, text)
        self._words[ASKED] += 1
        if not self._answered(end):
            raise InputError(
                f"the service has not answered within {timeout:g} s; it may still be starting, or be stopped"
            )
        return self._get(_HEAD + _TEXT, self._words[_ANSWERED_LENGTH])

    def _answered(self, end: float) -> bool:
        """Wait until nothing waits, at most until `end` of CLOCK_MONOTONIC [s]; whether that is so."""
        while self._words[ANSWERED] != self._words[ASKED]:
            if time.monotonic() > end:
                return False
            time.sleep(_LOOK)
        return True
