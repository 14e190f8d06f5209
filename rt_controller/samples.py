"""Samples: the plant's frames as they come on a port; a sample ends with its ENCODER frame."""

import time
from collections.abc import Mapping

from protocols.bus import Port
from protocols.frames import Frame, FrameCodec
from protocols.lifecycle import Lifecycle


class Samples:
    """What a controller waits for on `port`."""

    def __init__(self, port: Port, frames: Mapping[str, FrameCodec]) -> None:
        self.port = port
        self._encoder_id, self._plant = frames["ENCODER"].can_id, frames["PLANT_HEARTBEAT"]

    def next(self, timeout: float) -> list[Frame]:
        """Frames up to and with the next complete sample, the plant's end, or what came within `timeout` [s]."""
        frames: list[Frame] = []
        end = time.monotonic() + timeout
        while not (self.complete(frames) or self.plant_ended(frames)):
            left = end - time.monotonic()
            came = self.port.wait(max(left, 0.0))
            if came:
                frames += self.port.receive()
            if left <= 0.0 or not came:
                break
        return frames

    def arrived_ns(self) -> int:
        """When the last sample was complete [ns of CLOCK_MONOTONIC]: by the frame's stamp."""
        now = time.monotonic_ns()
        return now - max(time.time_ns() - self.port.stamps[self._encoder_id], 0)

    def complete(self, frames: list[Frame]) -> bool:
        """Whether the last sensor frame of a sample is among `frames`."""
        return any(frame.can_id == self._encoder_id for frame in frames)

    def plant_ended(self, frames: list[Frame]) -> bool:
        """Whether the plant says among `frames` that it ends."""
        codec = self._plant
        return any(i == codec.can_id and codec.unpack(d).lifecycle == Lifecycle.FINALIZED for i, d in frames)
