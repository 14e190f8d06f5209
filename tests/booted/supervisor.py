"""A supervisor that asks for idle, then for torque, and goes on with it whatever the controller does, until its input ends."""

import os
import select
import sys
import time

from protocols.buses.bus import open_bus
from protocols.can.frames import Frame, load_frames
from protocols.can.request import Request

TORQUE, SPEED = 5.0, 10.5  # Nm, rad/s
_PERIOD = 0.01  # s; after 0.1 s without a set-point the controller releases the clutch
_IDLE = 1.0  # s
_PRIORITY = 40  # of SCHED_FIFO, as of `clutch-hil demand`


def demand(bus: str) -> None:
    """Send set-points; say `engaged` on stdout with the first request for torque."""
    codec, count = load_frames()["TORQUE_SETPOINT"], 0
    os.sched_setscheduler(0, os.SCHED_FIFO, os.sched_param(_PRIORITY))
    with open_bus(bus, []) as port:
        began, engaged = time.monotonic(), False
        while not select.select([sys.stdin], [], [], _PERIOD)[0]:
            if not engaged and time.monotonic() - began > _IDLE:
                engaged = True
                print("engaged", flush=True)
            request, torque = (Request.ENGAGE, TORQUE) if engaged else (Request.IDLE, 0.0)
            port.send(Frame(codec.can_id, codec.pack(count & 15, request, torque, SPEED, 0.0)))
            count += 1


if __name__ == "__main__":
    demand(sys.argv[1])
