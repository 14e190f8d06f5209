"""Trigger: the event that starts a control cycle.

clock   an absolute time grid, half a period after the first sample. With a plant on this computer the phase is constant, as
        both use CLOCK_MONOTONIC; with a real rig it drifts by the difference of two crystals
bus     the arrival of the sample: lowest latency. When a sample is late by half a period, the cycle runs without it
pll     a time grid that follows the arrival of the samples, a quarter of a period behind: no drift, and little jitter of the
        bus (`phase_lock.py`)

Assumptions     the samples have nearly the period of the controller; time stamps of frames are CLOCK_REALTIME
"""

from collections.abc import Callable
from typing import Protocol

import numpy as np

from protocols.errors import InputError, join_names
from protocols.realtime.beat import Beat
from protocols.realtime.clock import Clock
from rt_controller.loop.turn import Turn


class Trigger(Protocol):
    """Starts cycles, each in a slot of `clock`."""

    clock: Clock

    def start(self, arrived_ns: int) -> None:
        """Set the grid. The last sample was complete at `arrived_ns` [ns of CLOCK_MONOTONIC], and its cycle is done."""

    def run(self, changes: int) -> int:
        """Wait for the next cycle and run it; repeat some times. All rows but the last are recorded (`Beat.record_cycle`).

        Returns the number of missed slots before the last cycle.
        """
        ...


class ClockTrigger:
    """Starts cycles on an absolute time grid."""

    def __init__(self, beat: Beat, turn: Turn) -> None:
        self.clock, self._turn, self._beat = beat.clock, turn, beat

    def start(self, arrived_ns: int) -> None:
        """See `Trigger`."""
        self.clock.start(arrived_ns + self.clock.period_ns // 2)

    def run(self, changes: int) -> int:
        """See `Trigger`."""
        return self._turn.answer_slots(self._beat, changes)


class BusTrigger:
    """Starts a cycle when a sample arrives, or half a period after its time."""

    def __init__(self, beat: Beat, turn: Turn) -> None:
        self.clock, self._turn, self._beat = beat.clock, turn, beat

    def start(self, arrived_ns: int) -> None:
        """See `Trigger`."""
        self.clock.start(arrived_ns + self.clock.period_ns)

    def run(self, changes: int) -> int:
        """See `Trigger`."""
        return self._turn.answer_samples(self._beat, changes)


class PllTrigger:
    """Starts cycles on a time grid that follows the samples."""

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


def find_trigger(name: str) -> Callable[[Beat, Turn], Trigger]:
    """Return the class of the trigger `name`. Raises InputError for an unknown name."""
    if name not in TRIGGERS:
        raise InputError(f"trigger {name!r} is unknown; allowed are {join_names(TRIGGERS)}")
    return TRIGGERS[name]
