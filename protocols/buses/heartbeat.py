"""Heartbeat: detects a second service of the same kind on the bus."""

import os
import time

from protocols.buses.bus import Port, listen
from protocols.can.frames import Frame, FrameCodec, load_frames
from protocols.can.lifecycle import Lifecycle
from protocols.errors import InputError

LISTEN_SECONDS = 0.2  # s, four heartbeats: long enough to receive one of another service


def make_session() -> int:
    """Return the session number of this service, from process number and time; heartbeats carry 16 bits of it."""
    number = os.getpid() << 8 ^ time.monotonic_ns()
    return load_frames()["PLANT_HEARTBEAT"].wrap("session", number)


def check_alone(port: Port, kind: str, codec: FrameCodec) -> list[Frame]:
    """Listen before sending, and return the frames received. Raises InputError when another service of this `kind` runs."""
    heard = listen(port, LISTEN_SECONDS)
    for can_id, data in heard:
        if can_id == codec.can_id and codec.is_valid(data):
            values = codec.unpack(data)
            if values.lifecycle != Lifecycle.FINALIZED:
                session = f"session {values.session:04x}"
                raise InputError(
                    f"a second {kind} is on {port.name} ({session}); only one is allowed: give another bench another bus by"
                    " --bus"
                )
    return heard
