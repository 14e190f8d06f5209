"""Trigger: what begins a control cycle.

clock   an absolute grid, half a period after the first sample: with a plant on this machine the phase stays, both clocks
        being CLOCK_MONOTONIC; with a real rig it drifts by the difference of two crystals
bus     the sample itself: lowest latency; a slot whose sample has not come half a period after it was due runs without one
pll     a grid that follows the samples' arrival, a quarter of a period behind it: no drift, and no jitter of the bus
        (`phase_lock.py`)

Assumptions     sample times are a grid of nearly our period; stamps of frames are CLOCK_REALTIME
"""

from collections.abc import Callable
from typing import Protocol

import numpy as np

from protocols.errors import InputError, listing
from protocols.realtime.beat import Beat
from protocols.realtime.clock import Clock
from rt_controller.loop.turn import Turn


class Trigger(Protocol):
    """Runs cycles, each in a slot of `clock`."""

    clock: Clock

    def start(self, arrived_ns: int) -> None:
        """The last sample was complete at `arrived_ns` of CLOCK_MONOTONIC; its cycle has been run."""

    def run(self, changes: int) -> int:
        """Wait for the next cycle and run it, and so on for some; all rows but the last are recorded (`Beat.record_cycle`).

        Returns how many slots were left out before the last.
        """
        ...


class ClockTrigger:
    """On an absolute grid."""

    def __init__(self, beat: Beat, turn: Turn) -> None:
        self.clock, self._turn, self._beat = beat.clock, turn, beat

    def start(self, arrived_ns: int) -> None:
        """See `Trigger`."""
        self.clock.start(arrived_ns + self.clock.period_ns // 2)

    def run(self, changes: int) -> int:
        """See `Trigger`."""
        return self._turn.answer_slots(self._beat, changes)


class BusTrigger:
    """When a sample comes, or half a period after it was due."""

    def __init__(self, beat: Beat, turn: Turn) -> None:
        self.clock, self._turn, self._beat = beat.clock, turn, beat

    def start(self, arrived_ns: int) -> None:
        """See `Trigger`."""
        self.clock.start(arrived_ns + self.clock.period_ns)

    def run(self, changes: int) -> int:
        """See `Trigger`."""
        return self._turn.answer_samples(self._beat, changes)


class PllTrigger:
    """On a grid that follows the samples."""

    def __init__(self, beat: Beat, turn: Turn) -> None:
        self.clock, self._turn, self._beat = beat.clock, turn, beat
        self._drifts = np.zeros(1)

    def start(self, arrived_ns: int) -> None:
        """See `Trigger`."""
        self.clock.start(arrived_ns + self.clock.period_ns + self.clock.period_ns // 4)

    def run(self, changes: int) -> int:
        """See `Trigger`."""
        return self._turn.answer_slots(self._beat, changes, self._drifts)


TRIGGERS: dict[str, Callable[[Beat, Turn], Trigger]] = {
    "clock": ClockTrigger, "bus": BusTrigger, "pll": PllTrigger
}  # fmt: skip


def trigger(name: str) -> Callable[[Beat, Turn], Trigger]:
    """The trigger of that name, to be made of a beat and turns. Raises InputError."""
    if name not in TRIGGERS:
        raise InputError(f"trigger {name!r} is unknown; allowed are {listing(TRIGGERS)}")
    return TRIGGERS[name]
