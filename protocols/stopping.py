"""Stop: SIGINT, SIGTERM and SIGHUP ask a service to end at its next cycle, so that its last frames are the safe ones."""

import signal
from types import FrameType
from typing import Any


class Stop:
    """While entered, SIGINT, SIGTERM and SIGHUP (a closed terminal) only set `asked`."""

    def __init__(self) -> None:
        self.asked = False
        self._before: dict[int, Any] = {}

    def __enter__(self) -> "Stop":
        for number in (signal.SIGINT, signal.SIGTERM, signal.SIGHUP):
            self._before[number] = signal.signal(number, self._ask)
        return self

    def __exit__(self, *_: object) -> None:
        for number, handler in self._before.items():
            signal.signal(number, handler)

    def _ask(self, number: int, frame: FrameType | None) -> None:
        self.asked = True
