"""The plant as a process: a bus, a clock, a ring. Time begins when a controller is on the bus."""

import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from plant_sim.node.injection import Injection
from plant_sim.node.plant_rig import PlantRig, RigProfile
from protocols.buses.bus import Port, listen, open_bus
from protocols.buses.exchange import Exchange
from protocols.buses.heartbeat import check_alone, new_session
from protocols.can.frames import load_frames
from protocols.can.lifecycle import Lifecycle
from protocols.errors import InputError
from protocols.files.parameters import ParameterSet
from protocols.realtime import rights as realtime
from protocols.realtime.beat import Beat, compile_record_cycle
from protocols.realtime.clock import Clock
from protocols.realtime.footprint import Footprint
from protocols.realtime.stopping import Stop
from protocols.telemetry.outlet import Outlet

_ANSWER = 5.0  # s to wait for a controller's answer in lock-step: it has died
_TICK = 1_000_000  # ns; of a kernel with 1000 Hz, whose multiples are those of others
_LOOK = 0.2  # s between looks whether it is to end


@dataclass(frozen=True)
class PlantService:
    """Settings of a plant process. rate [Hz]; temperature [degC]; `profile` None plays none and runs until stopped.

    `rig` is the plant that runs, `profile` one that it loads. `injections` and `blind` as of `PlantNode`; `ring`,
    `telemetry` and `router` as of `Outlet`.
    """

    bus: str
    rate: int
    rig: PlantRig
    lockstep: bool = False
    parameters: ParameterSet | None = None
    profile: RigProfile | None = None
    seed: int = 1
    temperature: float | None = None
    injections: Sequence[Injection] = ()
    blind: bool = False
    ring: Path | None = None
    telemetry: bool = True
    router: str | None = None
    cpu: int | None = None

    def warm(self) -> None:
        """Compile, or load from disk, all that this plant runs: nothing compiles later, whatever is injected.

        Before its signals are those of `Stop`: this can be ended.
        """
        self.rig.node.warm()
        compile_record_cycle()

    def run(self, ready: Callable[[str], None]) -> dict[str, Any]:
        """Serve until SIGTERM or SIGINT, in lock-step to the end of the profile; return the summary.

        Raises InputError for a bad bus, a second plant, another rate or protocol.
        """
        session = new_session()
        node = self._new_node(session)
        clock = Clock(1_000_000_000 // self.rate)
        with Stop() as stop, open_bus(self.bus) as port:
            frames = load_frames()
            check_alone(port, "plant", frames["PLANT_HEARTBEAT"])
            line = Exchange(port, frames["VALVE_COMMAND"].can_id, stop.wakes)
            outlet = Outlet(
                "plant", node, node.columns, port.name, self.rate, session, shipped=self.rig.nominal(None),
                ring=self.ring, publish=self.telemetry, router=self.router, prefix="plant_",
                about={"rig": self.rig.name, "controllers": list(self.rig.controllers)},
            )  # fmt: skip
            ready(f"plant on {port.name} at {self.rate} Hz, {'lock-step' if self.lockstep else 'real time'}")
            missing = [] if self.lockstep else realtime.prepare(self.cpu)
            for text in missing:
                ready(f"note: {text}")
            timing = footprint = None
            try:
                self._await_controller(node, port, outlet, stop)
                if self.lockstep:
                    self._lockstep(node, line, outlet, outlet.beat(clock), stop)
                else:
                    taken = Footprint()
                    timing = self._real_time(node, line, outlet, clock, stop)
                    footprint = taken.summary()
            finally:
                for frame in node.safe():
                    port.send(frame)
                realtime.relax()
                published = outlet.close()
        return {
            "bus": port.name,
            "rate_hz": self.rate,
            "lockstep": self.lockstep,
            "samples": node.tick + 1,
            "timing": timing,
            "footprint": footprint,
            "not_available": missing,
            "port": port.counts(),
            "frames": node.reception_counts(),
            **published,
        }

    def _new_node(self, session: int) -> Any:
        return self.rig.node(
            self.rate, self.parameters, self.profile, self.seed, self.temperature,
            session=session, injections=self.injections, blind=self.blind,
        )  # fmt: skip

    def _await_controller(self, node: Any, port: Port, outlet: Outlet, stop: Stop) -> None:
        """Say "inactive" every 50 ms until a controller says "active"."""
        while not stop.asked and node.controller != Lifecycle.ACTIVE:
            port.send(node.heartbeat(Lifecycle.INACTIVE))
            outlet.tune()
            node.receive(listen(port, node.heartbeat_period))

    def _real_time(self, node: Any, line: Exchange, outlet: Outlet, clock: Clock, stop: Stop) -> dict[str, Any]:
        """Real time does not wait: samples of slots slept through are made and sent when the plant wakes."""
        timing, beat, owed = None, outlet.beat(clock), 0
        clock.start(between_ticks(time.monotonic_ns(), clock.period_ns))
        while not stop.asked:
            behind = owed > 0
            if node.steady and not outlet.asked():
                owed = node.turns(line, beat, outlet.changes, owed)
            else:
                owed = self._by_parts(node, line, outlet, clock, owed)
                behind = behind or owed > 0
            if owed:
                outlet.write(
                    node.record, clock.woken_ns / 1e9, clock.lateness_ns / 1e3, clock.work_ns / 1e3, clock.late
                )
                continue
            beat.record_cycle(node.record, outlet.changes)
            node.late_cycles = clock.late
            if timing is None and node.finished:
                timing = clock.summary()  # of the run, not of the controller's end after it
            if behind:  # before it goes on: the controller can answer, which may wait for this CPU
                line.receive(0.5 / self.rate)
        return timing or clock.summary()

    def _by_parts(self, node: Any, line: Exchange, outlet: Outlet, clock: Clock, owed: int) -> int:
        """A sample where more is to do than a turn, changes of parameters. `owed` and what it returns: `PlantNode.turns`."""
        waits = not owed
        owed = clock.wait() if waits else owed - 1
        if node.tick >= 0:
            node.advance()  # through the period that is over
        outlet.tune()
        if waits:
            line.receive()
            node.take(line.inbox, line.count)
            line.clear()
            node.slept(owed)
        line.send(node.outbox, node.show())  # a controller on this CPU may go first from here on
        return owed

    def _lockstep(self, node: Any, line: Exchange, outlet: Outlet, beat: Beat, stop: Stop) -> None:
        """Sample, wait for the answer to this sample, go on."""
        while not (stop.asked or node.finished):
            written = False
            if node.steady and not outlet.asked():
                written = node.in_step(line, beat, outlet.changes)
                node.take(line.inbox, line.count)
                line.clear()
            else:
                line.send(node.outbox, node.show())
                node.advance()
            if not written:
                outlet.write(node.record, time.monotonic(), 0.0, 0.0, 0)
            outlet.tune()
            deadline = time.monotonic() + _ANSWER
            while node.answered_tick != node.tick & 0xFFFF and not stop.asked:
                line.receive(_LOOK)
                node.take(line.inbox, line.count)
                line.clear()
                if node.controller == Lifecycle.FINALIZED:
                    return
                if time.monotonic() > deadline and node.answered_tick != node.tick & 0xFFFF:
                    raise InputError(
                        f"the controller on {line.port.name} has not answered for {_ANSWER:g} s of lock-step"
                    )


def between_ticks(now_ns: int, period_ns: int) -> int:
    """A first slot, a period or more from now, that the kernel's ticks do not meet [ns of CLOCK_MONOTONIC].

    They come at whole milliseconds (`tick_setup_device`, since Linux 6.4), and a sample that meets one comes 20 to 40 us
    later (docs/timing.md). A quarter of a period behind them a controller half a period later does not meet them either.
    """
    return (now_ns // period_ns + 2) * period_ns + min(period_ns, _TICK) // 4
