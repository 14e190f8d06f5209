"""The plant as a process with a bus, a clock and a telemetry ring. Time starts when a controller is active on the bus."""

import time
from collections.abc import Callable, Sequence
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from plant_sim.bus_faults.catalogue import PARAMETERS
from plant_sim.node.injection import Injection
from plant_sim.node.plant_node import convert_initial_temperature
from plant_sim.node.plant_rig import PlantRig, RigProfile
from protocols.buses.bus import Port, listen, open_bus
from protocols.buses.exchange import Exchange
from protocols.buses.heartbeat import check_alone, make_session
from protocols.can.frames import list_bus_frames, load_frames
from protocols.can.lifecycle import Lifecycle
from protocols.can.other_size import SizeWatch
from protocols.can.two_clutches import CLUTCHES
from protocols.errors import InputError
from protocols.files.parameters import ParameterSet
from protocols.realtime import rights as realtime
from protocols.realtime.beat import Beat, compile_record_cycle
from protocols.realtime.clock import Clock
from protocols.realtime.footprint import Footprint
from protocols.realtime.notify import Notifier, open_notifier
from protocols.realtime.stopping import Stop
from protocols.telemetry.lab import read_bench_lab
from protocols.telemetry.outlet import RING_ROWS, Outlet
from protocols.telemetry.tuning import describe_parameter
from protocols.user_code import tell_node_failure

_ANSWER_TIMEOUT = 5.0  # s without an answer in lock-step after which the controller counts as dead
_KERNEL_TICK = 1_000_000  # ns: timer tick of a Linux kernel at 1000 Hz; the ticks at 250 and 100 Hz are multiples
# Rows by which the collector may be behind in lock-step. One compiled call adds up to 2 s, 20 000 rows at 10 kHz. The ring of a
# controller is read after the plant's, and may have to hold twice as many.
_MOST_BACKLOG = RING_ROWS // 8
_BACKLOG_CHECK_PERIOD = 0.005  # s between two checks whether rows were collected
_STOP_CHECK_PERIOD = 0.2  # s between two checks for a stop request in lock-step


@dataclass(frozen=True)
class PlantService:
    """Settings of a plant process.

    rate [Hz]; temperature [degC] of the oil at the start. `rig` is the plant, `profile` a profile of this rig; without one the
    process runs until it is stopped. `injections` and `blind` are those of `PlantNode`; `ring`, `telemetry` and `router` are
    those of `Outlet`; `cpu` is the number of the CPU to run on. Raises InputError for impossible settings.
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

    def __post_init__(self) -> None:
        """Raise InputError for impossible settings, before anything is compiled."""
        if self.temperature is not None:
            convert_initial_temperature(self.temperature)
        read_bench_lab(self.router)
        realtime.check_cpu(self.cpu)

    def warm(self) -> None:
        """Compile, or load from disk, all kernels of this plant: nothing compiles later, whatever is injected.

        Call it before `run`, where SIGINT only requests a stop: here SIGINT ends the process at once.
        """
        self.rig.node.warm()
        compile_record_cycle()

    def run(self, ready: Callable[[str], None]) -> dict[str, Any]:
        """Run until SIGTERM or SIGINT or, in lock-step, until the end of the profile; return the summary.

        `ready` is called with each message for the user. Raises InputError for an unusable bus, a second plant, another rate,
        or any error of a node of a user's class.
        """
        session, notifier = make_session(), open_notifier()
        node = self._make_node(session)
        clock = Clock(1_000_000_000 // self.rate)
        with Stop() as stop, open_bus(self.bus) as port:
            frames = load_frames()
            check_alone(port, "plant", frames["PLANT_HEARTBEAT"])
            line = Exchange(port, frames["VALVE_COMMAND"].can_id, stop.wakes)
            outlet = Outlet(
                "plant", node, node.columns, port.name, self.rate, session, shipped=self.rig.load_parameters(),
                ring=self.ring, publish=self.telemetry, router=self.router, prefix="plant_",
                about={
                    "rig": self.rig.name, "controllers": list(self.rig.controllers),
                    "profile_end_s": self.profile.duration if self.profile else None,
                    "bus_faults": [] if self.lockstep else [describe_parameter(p, p.value) for p in PARAMETERS.values()],
                },
            )  # fmt: skip
            ready(f"plant on {port.name} at {self.rate} Hz, {'lock-step' if self.lockstep else 'real time'}")
            beat = outlet.make_beat(clock, notifier)
            missing = [] if self.lockstep else realtime.prepare(self.cpu)
            for text in missing:
                ready(f"note: {text}")
            timing = footprint = None
            try:
                self._await_controller(node, port, outlet, stop, notifier)
                notifier.say(f"simulates at {self.rate} Hz on {port.name}")
                with tell_node_failure(node):
                    if self.lockstep:
                        self._run_in_lockstep(node, line, outlet, beat, stop)
                    else:
                        measured = Footprint()
                        timing = self._run_in_real_time(node, line, outlet, beat, stop)
                        footprint = measured.summarise()
            finally:
                notifier.stop()
                with suppress(OSError):  # the bus is gone: other resources are closed all the same
                    for frame in node.list_safe_frames():
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
            "port": port.read_counts(),
            "frames": node.count_receptions(),
            "stray_frames": node.count_strays(),
            "first_rejected": node.first_rejected,
            **published,
        }

    def _make_node(self, session: int) -> Any:
        """Construct the node of the rig."""
        node = self.rig.make_node(
            self.rate, self.parameters, self.profile, self.seed, self.temperature, session=session, blind=self.blind,
        )  # fmt: skip
        node.lockstep = self.lockstep
        node.inject(*self.injections)
        return node

    def _await_controller(self, node: Any, port: Port, outlet: Outlet, stop: Stop, notifier: Notifier) -> None:
        """Send the heartbeat "inactive" every 50 ms until all controllers are active.

        Raises InputError if a controller belongs to a bench of another size.
        """
        notifier.say(f"waits for a controller on {port.name}")
        watch = SizeWatch(list_bus_frames(clutches=len(CLUTCHES)), f"on {port.name}")
        while not stop.asked and node.controller != Lifecycle.ACTIVE:
            port.send(node.make_heartbeat(Lifecycle.INACTIVE))
            notifier.extend_start()
            outlet.tune()
            heard = listen(port, node.heartbeat_period)
            watch.hear(heard)
            node.receive(heard)

    def _run_in_real_time(self, node: Any, line: Exchange, outlet: Outlet, beat: Beat, stop: Stop) -> dict[str, Any]:
        """Run in real time; return the timing. Samples of missed slots are made and sent when the process wakes up."""
        timing, clock, owed = None, beat.clock, 0
        clock.start(find_first_slot(time.monotonic_ns(), clock.period_ns))
        while not stop.asked:
            behind = owed > 0
            keeps = owed > 0 and line.count > 0  # frames of a participant just admitted: owed samples take no frames
            if node.steady and not outlet.has_change() and not keeps:
                owed = node.run_real_time(line, beat, outlet.changes, owed)
            else:
                owed = self._run_in_python(node, line, outlet, clock, owed)
            if owed:
                outlet.write(
                    node.record, clock.woken_ns / 1e9, clock.lateness_ns / 1e3, clock.work_ns / 1e3, clock.late
                )
                continue
            beat.record_cycle(node.record, outlet.changes)
            node.late_cycles = clock.late
            if timing is None and node.finished:
                timing = clock.summarise()  # of the profile only, without the end of the controller after it
            if behind:  # lets a controller on this CPU answer before the plant continues
                line.receive(0.5 / self.rate)
        return timing or clock.summarise()

    def _run_in_python(self, node: Any, line: Exchange, outlet: Outlet, clock: Clock, owed: int) -> int:
        """Make one sample in Python, with changes of parameters. `owed` and return value as of `PlantNode.run_real_time`."""
        waits = not owed
        owed = clock.wait() if waits else owed - 1
        if node.tick >= 0:
            node.advance()  # over the last period
        outlet.tune()
        if waits:
            line.receive()
            node.take(line.inbox, line.count)
            line.clear()
            node.skip_periods(owed)
        line.send(node.outbox, node.show())  # from here on a controller on this CPU may run
        return owed

    def _run_in_lockstep(self, node: Any, line: Exchange, outlet: Outlet, beat: Beat, stop: Stop) -> None:
        """Run in lock-step: make a sample, wait for its answer, advance. Raises InputError if no answer comes.

        If the collector of the rows is behind, the plant waits, so that no row is overwritten.
        """
        valve = load_frames()["VALVE_COMMAND"]
        while not (stop.asked or node.finished):
            if outlet.backlog > _MOST_BACKLOG:
                time.sleep(_BACKLOG_CHECK_PERIOD)
                continue
            written = False
            if node.steady and not outlet.has_change():
                written = node.run_lockstep(line, beat, outlet.changes)
                node.take(line.inbox, line.count)
                line.clear()
            else:
                line.send(node.outbox, node.show())
                node.advance()
            if not written:
                outlet.write(node.record, time.monotonic(), 0.0, 0.0, 0)
            outlet.tune()
            deadline = time.monotonic() + _ANSWER_TIMEOUT
            tick = valve.wrap("sample_tick", node.tick)
            while node.answered_tick != tick and not stop.asked:
                line.receive(_STOP_CHECK_PERIOD)
                node.take(line.inbox, line.count)
                line.clear()
                if node.controller == Lifecycle.FINALIZED:
                    return
                if time.monotonic() > deadline and node.answered_tick != tick:
                    raise InputError(
                        f"the controller on {line.port.name} has not answered for {_ANSWER_TIMEOUT:g} s of lock-step"
                    )


def find_first_slot(now_ns: int, period_ns: int) -> int:
    """Return a first slot [ns of CLOCK_MONOTONIC], at least a period from now, that avoids the timer ticks of the kernel.

    Ticks are at whole milliseconds (`tick_setup_device`, since Linux 6.4). A sample at a tick is 20 to 40 us late
    (docs/timing.md). The slot is a quarter of a period after a tick; a controller half a period later avoids the ticks, too.
    """
    return (now_ns // period_ns + 2) * period_ns + min(period_ns, _KERNEL_TICK) // 4
