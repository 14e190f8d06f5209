"""Samples: frames of the plant as they arrive on a port; a sample ends with its ENCODER frame."""

import time
from collections.abc import Mapping, Sequence

import numpy as np

from protocols.buses.exchange import Exchange
from protocols.can.frame_batch import unload
from protocols.can.frames import FrameCodec
from protocols.can.lifecycle import Lifecycle


class Samples:
    """Waits for samples; their frames stay in `line.inbox` until `line.clear()`."""

    def __init__(self, line: Exchange, frames: Mapping[str, FrameCodec]) -> None:
        self.line = line
        self._plant = frames["PLANT_HEARTBEAT"]

    def wait_for_next(self, timeout: float) -> bool:
        """Wait for the next complete sample, the end of the plant or `timeout` [s]; return whether a sample is complete."""
        line, marks = self.line, self.line.marks
        end = time.monotonic() + timeout
        remaining = timeout
        while True:
            before = line.count
            received_some = line.receive(max(remaining, 0.0))
            if line.marks > marks:
                return True
            remaining = end - time.monotonic()
            if not received_some or remaining <= 0.0 or self.has_plant_ended(before):
                return False

    def find_arrival_ns(self) -> int:
        """Return when the last sample was complete [ns of CLOCK_MONOTONIC], from the time stamp of its frame."""
        now = time.monotonic_ns()
        return now - max(time.time_ns() - self.line.marked_ns, 0)

    def has_plant_ended(self, since: int = 0) -> bool:
        """Return whether the inbox, from index `since` on, has a heartbeat with the state "ended" of the plant."""
        codec, inbox = self._plant, self.line.inbox
        received = inbox[since : self.line.count]
        heartbeats = received[received["can_id"] == codec.can_id]
        return any(codec.unpack(data).lifecycle == Lifecycle.FINALIZED for _, data in unload(heartbeats))


def estimate_usual_arrival(arrivals_ns: Sequence[int], period_ns: int) -> int:
    """Return when the last sample would have arrived [ns] with the mean phase of all: so one late sample has little effect.

    The mean phase is the circular mean of the arrivals within a period; Mardia and Jupp 2000, Directional Statistics, eq.
    2.2.4.
    """
    arrivals = np.array(arrivals_ns)
    turns = (arrivals - arrivals[-1]) % period_ns / period_ns
    return int(arrivals[-1]) + round(np.angle(np.exp(2j * np.pi * turns).sum()) / (2.0 * np.pi) * period_ns)
