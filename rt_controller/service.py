"""The controller as a process: a bus, a clock, a ring, and the safe command whatever ends it."""

import os
import time
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from protocols import realtime
from protocols.bus import Port, listen, open_bus
from protocols.clock import Clock
from protocols.errors import InputError
from protocols.frames import Frame, load_frames
from protocols.lifecycle import Lifecycle
from protocols.node import Column
from protocols.ring import RingWriter
from protocols.stopping import Stop
from rt_controller.node import COLUMNS, ControllerNode

LISTEN = 0.2  # s, four heartbeats: long enough to hear another controller
_SILENCE = 5.0  # s without a sample after which lock-step gives up: the plant has died
_RING_ROWS = 65_536  # a minute at 1 kHz
RING_COLUMNS = (
    *COLUMNS,
    Column("wake_us", "us", "lateness of the cycle's wake-up"),
    Column("work_us", "us", "duration of the cycle before"),
    Column("late_cycles", "1", "cycles that ended after their slot, total"),
)


@dataclass(frozen=True)
class ControllerService:
    """Settings of a controller process. rate [Hz]; `ring` is where the record goes, None for nowhere."""

    bus: str
    rate: int
    lockstep: bool = False
    parameters_file: Path | None = None
    law: str = "both"
    adaptation: bool = True
    ring: Path | None = None
    cpu: int | None = None

    def run(self, ready: Callable[[str], None]) -> dict[str, Any]:
        """Serve until SIGTERM, SIGINT or, in lock-step, the plant's end; return the summary.

        Raises InputError for a bad bus, a second controller, another rate or protocol; the actuators are safe then.
        """
        session = os.getpid() << 8 & 0xFFFFFF00 | time.monotonic_ns() & 0xFF
        node = ControllerNode(self.rate, self.parameters_file, self.law, self.adaptation, session)
        clock = Clock(1_000_000_000 // self.rate)
        with Stop() as stop, open_bus(self.bus) as port:
            node.listen(_refuse_second(port))
            ring = RingWriter(self.ring, RING_COLUMNS, _RING_ROWS) if self.ring else None
            ready(f"controller on {port.name} at {self.rate} Hz, {'lock-step' if self.lockstep else 'real time'}")
            missing = [] if self.lockstep else realtime.prepare(self.cpu)
            try:
                inbox = self._await_plant(node, port, stop)
                if self.lockstep:
                    self._lockstep(node, port, ring, stop, inbox)
                else:
                    self._real_time(node, port, ring, clock, stop, inbox)
            finally:
                for frame in node.safe():
                    port.send(frame)
                if ring:
                    ring.close()
        return {
            "bus": port.name,
            "rate_hz": self.rate,
            "lockstep": self.lockstep,
            "timing": None if self.lockstep else clock.summary(),
            "not_available": missing,
            "port": port.counts(),
            "frames": node.reception_counts(),
            "parameters": node.parameters.as_values(),
        }

    def _await_plant(self, node: ControllerNode, port: Port, stop: Stop) -> list[Frame]:
        """Say "active" every 50 ms until the plant's first sample is complete; return the frames so far."""
        frames = load_frames()
        encoder_id, heartbeat_period = frames["ENCODER"].can_id, frames["CONTROLLER_HEARTBEAT"].cycle_time
        inbox: list[Frame] = []
        spoken = 0.0
        while not stop.asked and all(frame.can_id != encoder_id for frame in inbox):
            if time.monotonic() - spoken >= heartbeat_period:
                port.send(node.heartbeat(Lifecycle.ACTIVE))
                spoken = time.monotonic()
            if port.wait(heartbeat_period):
                inbox += node.listen(port.receive())
        return inbox

    def _real_time(
        self, node: ControllerNode, port: Port, ring: RingWriter | None, clock: Clock, stop: Stop, inbox: list[Frame]
    ) -> None:
        """Answer the first sample at once, then run half a period after the plant: both clocks are CLOCK_MONOTONIC."""
        work_us = 0.0
        self._cycle(node, port, ring, inbox, (0.0, 0.0, 0.0))
        if not stop.asked:
            port.wait(2.0 / self.rate)
        clock.start(time.monotonic_ns() + clock.period_ns // 2)
        while not stop.asked:
            clock.wait()
            self._cycle(node, port, ring, port.receive(), (clock.lateness_ns / 1e3, work_us, clock.late))
            clock.done()
            work_us = clock.work_ns / 1e3
            node.late_cycles = clock.late

    @staticmethod
    def _cycle(
        node: ControllerNode, port: Port, ring: RingWriter | None, inbox: list[Frame], timing: tuple[float, ...]
    ) -> None:
        for frame in node.step(inbox):
            port.send(frame)
        if ring:
            ring.write(node.row() + timing)

    def _lockstep(
        self, node: ControllerNode, port: Port, ring: RingWriter | None, stop: Stop, came: list[Frame]
    ) -> None:
        """Answer each complete sample at once; end when the plant says it ends."""
        frames = load_frames()
        encoder_id, plant = frames["ENCODER"].can_id, frames["PLANT_HEARTBEAT"]
        inbox: list[Frame] = []
        last = time.monotonic()
        while not stop.asked:
            for frame in came:
                inbox.append(frame)
                if frame.can_id == encoder_id:
                    self._cycle(node, port, ring, inbox, (0.0, 0.0, 0.0))
                    inbox = []
                elif frame.can_id == plant.can_id and plant.unpack(frame.data).lifecycle == Lifecycle.FINALIZED:
                    return
            if port.wait(0.2):
                last = time.monotonic()
            elif time.monotonic() - last > _SILENCE:
                raise InputError(f"the plant on {port.name} has been silent for {_SILENCE:g} s of lock-step")
            came = port.receive()


def _refuse_second(port: Port) -> list[Frame]:
    """Raise InputError when another controller is heard; return what was heard."""
    frames = load_frames()
    heartbeat, valve = frames["CONTROLLER_HEARTBEAT"], frames["VALVE_COMMAND"]
    heard = listen(port, LISTEN)
    for can_id, data in heard:
        if can_id == heartbeat.can_id and heartbeat.valid(data):
            values = heartbeat.unpack(data)
            if values.lifecycle != Lifecycle.FINALIZED:
                raise InputError(
                    f"a second controller is on {port.name} (session {values.session:08x}); only one may command the rig"
                )
        elif can_id == valve.can_id:
            raise InputError(
                f"a second controller is on {port.name}: it sends VALVE_COMMAND; only one may command the rig"
            )
    return heard
