"""The controller as a process with a bus, a clock and a telemetry ring. It always sends the safe command when it ends."""

import time
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from protocols.buses.bus import Port, open_bus
from protocols.buses.exchange import Exchange
from protocols.buses.heartbeat import check_alone, make_session
from protocols.can.frame_batch import load, unload
from protocols.can.frames import Frame, load_frames
from protocols.can.lifecycle import Lifecycle
from protocols.can.other_size import SizeWatch
from protocols.errors import InputError
from protocols.realtime import rights as realtime
from protocols.realtime.beat import Beat, compile_record_cycle
from protocols.realtime.clock import Clock
from protocols.realtime.footprint import Footprint
from protocols.realtime.notify import Notifier, open_notifier
from protocols.realtime.overrun import OverrunError, find_overrun_policy
from protocols.realtime.stopping import Stop
from protocols.realtime.waiting import check_spin, choose_waiting
from protocols.telemetry.lab import read_bench_lab
from protocols.telemetry.outlet import Outlet
from rt_controller.loop.node import COLUMNS, ControllerNode
from rt_controller.loop.parameter_sets import load_shipped_parameters
from rt_controller.loop.samples import Samples, estimate_usual_arrival
from rt_controller.loop.trigger import Trigger, find_trigger
from rt_controller.loop.turn import Turn, warm

_SILENCE_TIMEOUT = 5.0  # s without a sample in lock-step after which the plant counts as dead
_WARM_UP_TIME = 0.05  # s of cycles before the clock is set: then caches are warm and the plant's grid is steady
# Frames before the first sample that its cycle still receives. More are dropped: a supervisor may send long before the plant
_FRAMES_BEFORE_START = 64
# Hz. Up to this rate a controller on the plant's CPU interrupts the plant: it answers 7 us earlier, and the plant loses 90 us.
# At higher rates the plant would be late by these 90 us
_HIGHEST_RATE_AT_ONCE = 1000
_SAFE_REPEATS = 3  # cycles in which the safe command is sent: a frame may be lost


@dataclass(frozen=True)
class ControllerService:
    """Settings of a controller process.

    rate [Hz]. `ring`, `telemetry` and `router` are those of `Outlet`; `parameters_file`, `law`, `adaptation` and `clutch` those
    of `ControllerNode`. `cpu` is the number of the CPU to run on. `trigger` is one of trigger.TRIGGERS, `overrun` one of
    overrun.POLICIES. The process may wait actively for the last `spin_us` [us] before a slot of a grid. Raises InputError for
    impossible settings.
    """

    bus: str
    rate: int
    lockstep: bool = False
    parameters_file: Path | None = None
    law: str = "both"
    adaptation: bool = True
    ring: Path | None = None
    telemetry: bool = True
    router: str | None = None
    cpu: int | None = None
    clutch: str | None = None
    trigger: str = "clock"
    overrun: str = "skip"
    spin_us: float = 0.0

    def __post_init__(self) -> None:
        """Raise InputError for impossible settings, before anything is compiled."""
        find_trigger(self.trigger)
        find_overrun_policy(self.overrun)
        check_spin(self.spin_us)
        read_bench_lab(self.router)
        realtime.check_cpu(self.cpu)

    @property
    def name(self) -> str:
        """Name in telemetry: `controller_b` for clutch b, otherwise `controller`, the name that every viewer shows."""
        return "controller_b" if self.clutch == "b" else "controller"

    @property
    def priority(self) -> int:
        """Priority of SCHED_FIFO, relative to a plant on the same CPU.

        With the trigger `bus` the controller has the higher priority, so that it answers a sample at once. At a high rate it
        has the lower priority: otherwise each frame of a sample would wake it, which takes a third of the period; so it wakes
        only once, when the plant sleeps. On a time grid it also has the lower priority: when both are late, the samples have
        arrived before the controller looks for them.
        """
        at_once = self.trigger == "bus" and self.rate <= _HIGHEST_RATE_AT_ONCE
        return realtime.PRIORITY + (1 if at_once else -1)

    @staticmethod
    def warm() -> None:
        """Compile, or load from disk, all kernels of a controller. Before `run`, so that SIGINT ends the process at once."""
        warm(ControllerNode())
        compile_record_cycle()

    def run(self, ready: Callable[[str], None]) -> dict[str, Any]:
        """Run until SIGTERM, SIGINT or, in lock-step, the end of the plant; return the summary.

        `ready` is called with each message for the user. Raises InputError for an unusable bus, a second controller or another
        rate; the safe command is sent before.
        """
        session, make_trigger, notifier = make_session(), find_trigger(self.trigger), open_notifier()
        node = ControllerNode(self.rate, self.parameters_file, self.law, self.adaptation, session, self.clutch)
        parameters = node.parameters.as_values()  # at the start; changes are reported separately
        period = 1_000_000_000 // self.rate
        clock = Clock(period, choose_waiting(self.spin_us, period), find_overrun_policy(self.overrun))
        with Stop() as stop, open_bus(self.bus, node.received_ids) as port:
            frames = load_frames(clutch=self.clutch or "a")
            node.listen(check_alone(port, self.name, frames["CONTROLLER_HEARTBEAT"]))
            samples = Samples(Exchange(port, frames["ENCODER"].can_id, stop.wakes), frames)
            outlet = Outlet(
                self.name, node, COLUMNS, port.name, self.rate, session,
                shipped=load_shipped_parameters(), ring=self.ring, publish=self.telemetry, router=self.router,
            )  # fmt: skip
            turn = Turn(samples, node)
            beat = outlet.make_beat(clock, notifier)
            cycle_trigger = make_trigger(beat, turn)
            ready(f"{self.name} on {port.name} at {self.rate} Hz, {'lock-step' if self.lockstep else 'real time'}")
            missing = [] if self.lockstep else realtime.prepare(self.cpu, self.priority)
            for text in missing:
                ready(f"note: {text}")
            if self.clutch and self.adaptation:
                ready("note: no adaptation with two clutches: the motor's torque belongs to both")
            overrun, footprint = None, None
            try:
                self._await_plant(node, samples, outlet, stop, notifier)
                notifier.say(f"controls at {self.rate} Hz on {port.name}")
                if self.lockstep:
                    self._run_in_lockstep(turn, outlet, beat, stop)
                else:
                    self._warm_up(node, turn, outlet, cycle_trigger)
                    footprint = self._run_in_real_time(node, outlet, beat, cycle_trigger, stop)
            except OverrunError as error:
                overrun = str(error)
            finally:
                notifier.stop()
                closed = _send_safe_commands(node, port, 1.0 / self.rate)
                realtime.relax()
                port.close()  # else its queue fills up while the telemetry ends, and the plant cannot send
                published = outlet.close()
        faults = node.watch_faults()
        return {
            "bus": port.name,
            "rate_hz": self.rate,
            "lockstep": self.lockstep,
            "timing": None if self.lockstep else clock.summarise(),
            "footprint": footprint,
            "trigger": self.trigger,
            "overrun": overrun,
            "not_available": missing,
            "valve_closed": closed,
            "faults": faults.count,
            "first_fault": faults.first.line if faults.first else None,
            "port": port.read_counts(),
            "frames": node.count_receptions(),
            "stray_frames": node.count_strays(),
            "supervisor": node.describe_claim(),
            "first_rejected": node.first_rejected,
            "parameters": parameters,
            **published,
        }

    def _await_plant(
        self, node: ControllerNode, samples: Samples, outlet: Outlet, stop: Stop, notifier: Notifier
    ) -> None:
        """Send the heartbeat "active" every 50 ms until the first sample is complete; its frames stay in the inbox.

        Raises InputError when the plant belongs to a bench of another size.
        """
        line, complete = samples.line, False
        inbox: list[Frame] = []
        watch = SizeWatch(load_frames(clutch=self.clutch or "a").values(), f"on {line.port.name}")
        notifier.say(f"waits for samples of a plant, or rig, on {line.port.name}")
        while not (stop.asked or complete):
            line.port.send(node.make_heartbeat(Lifecycle.ACTIVE))
            notifier.extend_start()
            outlet.tune()
            complete = samples.wait_for_next(node.heartbeat_period)
            heard = unload(line.inbox[: line.count])
            watch.hear(heard)
            inbox = (inbox + node.listen(heard))[-_FRAMES_BEFORE_START:]
            line.clear()
        line.count = load(line.inbox, inbox)

    def _warm_up(self, node: ControllerNode, turn: Turn, outlet: Outlet, cycle_trigger: Trigger) -> None:
        """Run cycles at the pace of the plant, without timing; then set the grid of the trigger."""
        arrivals = []
        for _ in range(max(1, round(_WARM_UP_TIME * self.rate))):
            self._run_cycle(node, turn, outlet)
            turn.samples.wait_for_next(2.0 / self.rate)
            arrivals.append(turn.samples.find_arrival_ns())
        self._run_cycle(node, turn, outlet)
        cycle_trigger.start(estimate_usual_arrival(arrivals, cycle_trigger.clock.period_ns))

    def _run_in_real_time(
        self, node: ControllerNode, outlet: Outlet, beat: Beat, cycle_trigger: Trigger, stop: Stop
    ) -> dict[str, int]:
        """Run cycles by the trigger until a stop; return the use of system resources (`Footprint`)."""
        clock = beat.clock
        measured = Footprint()
        while not stop.asked:
            cycle_trigger.run(outlet.changes)
            if outlet.has_change():
                outlet.write(
                    node.record, clock.woken_ns / 1e9, clock.lateness_ns / 1e3, clock.work_ns / 1e3, clock.late
                )
                outlet.tune()
                clock.end_cycle()
            else:
                beat.record_cycle(node.record, outlet.changes)
            node.late_cycles = clock.late
        return measured.summarise()

    def _run_in_lockstep(self, turn: Turn, outlet: Outlet, beat: Beat, stop: Stop) -> None:
        """Answer each complete sample at once, until the plant ends. Raises InputError when no sample comes.

        If the collector of the rows is behind, the plant may wait for it too; its silence is then no error.
        """
        samples = turn.samples
        while not stop.asked:
            written, complete = turn.answer_in_step(beat, outlet.changes)
            if not written:
                outlet.write(turn.node.record, time.monotonic(), 0.0, 0.0, 0)
            outlet.tune()
            while not (complete or stop.asked):
                behind = outlet.backlog > 0
                if samples.has_plant_ended():
                    return
                complete = samples.wait_for_next(_SILENCE_TIMEOUT)
                if not (complete or behind or samples.has_plant_ended()):
                    raise InputError(
                        f"the plant on {samples.line.port.name} has been silent for {_SILENCE_TIMEOUT:g} s of lock-step"
                    )

    def _run_cycle(self, node: ControllerNode, turn: Turn, outlet: Outlet) -> None:
        """Run a cycle without timing."""
        turn.answer(1)
        outlet.write(node.record, time.monotonic(), 0.0, 0.0, 0)
        outlet.tune()


def _send_safe_commands(node: ControllerNode, port: Port, period: float) -> bool:
    """Send the safe frames in some cycles of `period` [s]; return whether all frames of at least one cycle were sent."""
    all_sent = False
    for _ in range(_SAFE_REPEATS):
        before = port.refused + port.down
        try:
            for frame in node.list_safe_frames():
                port.send(frame)
            all_sent = all_sent or port.refused + port.down == before
        except OSError:  # the bus is gone: the watchdog of the rig closes the valve
            break
        time.sleep(period)
    return all_sent
