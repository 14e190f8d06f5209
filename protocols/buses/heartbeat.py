"""Heartbeat: tells a service from a second one of its kind."""

import os
import time

from protocols.buses.bus import Port, listen
from protocols.can.frames import Frame, FrameCodec
from protocols.can.lifecycle import Lifecycle
from protocols.errors import InputError

LISTEN = 0.2  # s, four heartbeats: long enough to hear another service of one's kind


def new_session() -> int:
    """A number that tells two services apart: process and start time."""
    return os.getpid() << 8 & 0xFFFFFF00 | time.monotonic_ns() & 0xFF


def heard_alone(port: Port, kind: str, codec: FrameCodec) -> list[Frame]:
    """Listen before speaking; return what was heard. Raises InputError when another service of this `kind` lives."""
    heard = listen(port, LISTEN)
    for can_id, data in heard:
        if can_id == codec.can_id and codec.valid(data):
            values = codec.unpack(data)
            if values.lifecycle != Lifecycle.FINALIZED:
                session = f"session {values.session:08x}"
                raise InputError(f"a second {kind} is on {port.name} ({session}); only one may be there")
    return heard
