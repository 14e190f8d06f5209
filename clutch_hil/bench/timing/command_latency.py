"""Command latency: time from the stamp of a sample's frame to the stamp of the command that answers it."""

import contextlib
import threading
from collections.abc import Iterator, Sequence

import numpy as np

from protocols.buses.bus import Port, open_bus
from protocols.can.frames import load_frames
from protocols.errors import InputError

_POLL_INTERVAL = 0.02  # s; chosen: short compared with a phase, and a negligible load


@contextlib.contextmanager
def watch_frames(bus: str) -> Iterator[list[tuple[int, int, int]]]:
    """Record samples and commands on the bus while entered: stamp [ns], identifier and tick of each frame.

    A thread reads continuously: a participant that does not read fills its queue, and senders count refusals.
    """
    codecs = {codec.can_id: codec for name, codec in load_frames().items() if name in ("ENCODER", "VALVE_COMMAND")}
    frames: list[tuple[int, int, int]] = []
    ending = threading.Event()

    def listen(port: Port) -> None:
        while not ending.is_set():
            if port.wait(_POLL_INTERVAL):
                for stamp, (can_id, data) in port.receive_stamped():
                    if can_id in codecs:
                        frames.append((stamp, can_id, codecs[can_id].raw(data).sample_tick))

    with open_bus(bus) as port:
        thread = threading.Thread(target=listen, args=(port,))
        thread.start()
        try:
            yield frames
        finally:
            ending.set()
            thread.join()


def compute_latencies(frames: Sequence[tuple[int, int, int]]) -> np.ndarray:
    """Return the time from each sample to the first command that answers it, (n,) [us]. Raises InputError without answers."""
    encoder = load_frames()["ENCODER"].can_id
    sample_stamps: dict[int, int] = {}
    latencies = []
    for stamp, can_id, tick in sorted(frames):
        if can_id == encoder:
            sample_stamps[tick] = stamp
        elif tick in sample_stamps:
            latencies.append(stamp - sample_stamps.pop(tick))
    if not latencies:
        raise InputError("no sample of the measurement was answered")
    return np.array(latencies) / 1e3
