"""The controller as a node: frames in, frames out, both checked by the guard. A cycle is one compiled call (`cycle.py`)."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from protocols.can.fault_text import FaultWatch
from protocols.can.frame_batch import load, make_batch, unload
from protocols.can.frames import DBC, Frame, FrameCodec, load_frames
from protocols.can.lifecycle import Lifecycle
from protocols.can.reception import make_receptions, read_counts
from protocols.can.request import Request
from protocols.can.two_clutches import OFFSET, SHARED, find_other_clutch
from protocols.can.words import make_frame_definition
from protocols.errors import InputError
from protocols.files.parameters import ParameterSet
from rt_controller.guard.allowed_limits import check_speed
from rt_controller.guard.layout import check_layout
from rt_controller.guard.limits import LIMITS as GUARD_LIMITS
from rt_controller.guard.limits import make_guard_limits
from rt_controller.law.other_clutch import PAIR_SETTINGS, make_other
from rt_controller.law.phases import PHASE_SETTINGS
from rt_controller.law.plausibility import PLAUSIBILITY_SETTINGS
from rt_controller.law.record import make_record
from rt_controller.law.torque_law import LAW_SETTINGS, make_law_at_rest, make_law_settings
from rt_controller.law.valve_gains import VALVE
from rt_controller.loop.cycle import (
    NODE,
    OTHER_CLUTCH_FRAMES,
    OUTBOX,
    RECEIVED_FRAMES,
    SENT_FRAMES,
    SETTINGS,
    ControllerMemory,
    Refusal,
    receive_before_start,
    run_cycle,
)
from rt_controller.loop.cycle_record import COLUMNS
from rt_controller.loop.parameter_sets import (
    check_parameters,
    check_slip_limit,
    follow_clutch,
    load_node_parameters,
    select_layout_values,
)

INBOX = 4096  # frames in one call: more than a bus of 1 Mbit/s carries in 0.2 s
_NO_FRAME = -1  # marks an unused place: no frame has this identifier


class ControllerNode:
    """The controller of one clutch: decodes, checks, estimates, controls, encodes.

    rate [Hz]. `parameters_file` changes parameters of `controller.toml`. `law` is one of `torque_law.LAWS`; `adaptation`
    switches the adaptive level on. `session` is a number that distinguishes two controllers. `clutch` is a or b where two are
    on one bus, None for a single clutch. Raises InputError.

    `outbox` has the frames of the last cycle, shape (OUTBOX,) of frame_batch.FRAME. `record` is its row, shape (columns,), a
    view of the RECORD in `states`. `states` and `settings`, shape (1,), are the memory of `cycle.run_cycle`. `memory` has
    all of them.

    With two clutches there is no adaptation: the motor torque is the sum for both, and is compared with both (`other_clutch`).
    The controller of clutch a commands the motor.
    """

    columns = COLUMNS
    follow_clutch = staticmethod(follow_clutch)

    def __init__(
        self,
        rate: int = 1000,
        parameters_file: Path | None = None,
        law: str = "both",
        adaptation: bool = True,
        session: int = 1,
        clutch: str | None = None,
    ) -> None:
        self.parameters = parameters = load_node_parameters(parameters_file, clutch)
        self.rate = rate
        self._session = session
        self._kind = law, adaptation and clutch is None, clutch is None
        self._drives = clutch != "b"
        check_layout(DBC, load_frames(), select_layout_values(parameters))
        check_slip_limit(parameters, load_frames()["MOTOR_COMMAND"])
        check_speed(parameters, rate)
        self.frames = frames = load_frames(clutch=clutch or "a")
        self._valve, self._motor = frames["VALVE_COMMAND"], frames["MOTOR_COMMAND"]
        self._heartbeat, self._status = frames["CONTROLLER_HEARTBEAT"], frames["CONTROLLER_STATUS"]
        self.heartbeat_period = self._heartbeat.cycle_time  # s
        received = [frames[name] for name in RECEIVED_FRAMES]
        self._clutch = clutch
        if clutch:
            others = load_frames(clutch=find_other_clutch(clutch))
            received += [others[name] for name in OTHER_CLUTCH_FRAMES]
        self._codecs = {codec.can_id: codec for codec in received}
        own = [frames[name] for name in SENT_FRAMES if self._drives or name not in SHARED]
        self._own = {codec.can_id: codec.name for codec in own}
        self.received_ids = [*self._codecs, *self._own]  # identifiers of all frames that the node checks
        self._early = {frames["PLANT_HEARTBEAT"].can_id} | {self._valve.can_id, self._motor.can_id} & self._own.keys()

        self.states, self.settings = np.zeros(1, NODE), np.zeros(1, SETTINGS)
        self._state = state = self.states.view(np.recarray)[0]
        fixed = self.settings.view(np.recarray)[0]
        state.receptions["can_id"] = _NO_FRAME
        state.receptions[: len(received)] = make_receptions(received)
        state.own[: len(own)] = make_receptions(own)
        state.claim.others = make_receptions([frames["SUPERVISOR_CLAIM"]])[0]
        state.other = make_other()
        state.setpoint_age = np.inf  # s
        state.sample.tick = -1
        state.sample.temperature = parameters["model.oil_reference"].si  # until the first sample
        state.law = make_law_at_rest()
        for name in RECEIVED_FRAMES + SENT_FRAMES:
            setattr(fixed, name.lower(), make_frame_definition(frames[name]))
        fixed.own = [*self._own, *[_NO_FRAME] * (len(SENT_FRAMES) - len(self._own))]
        fixed.period, fixed.rate, fixed.session = 1.0 / rate, rate, session
        fixed.drives = self._drives
        fixed.status_every = max(1, round(self._status.cycle_time * rate))
        fixed.heartbeat_every = max(1, round(self.heartbeat_period * rate))
        fixed.guard = make_record(
            GUARD_LIMITS, make_guard_limits(parameters.list_si("guard"), fixed.period, OFFSET if clutch == "b" else 0)
        )
        self._configure(parameters)
        self._inbox = make_batch(INBOX)
        self.outbox = make_batch(OUTBOX)
        self.record = self.states["record"].view(np.float64)
        self.memory = ControllerMemory(self.states, self.settings, self.outbox, self.record)
        # Compiles now, not in the loop
        run_cycle(self.states.copy(), self.settings, self._inbox, 0, 1, make_batch(OUTBOX))
        receive_before_start(self.states.copy(), self.settings, self._inbox, 0)

    def run_cycle(self, inbox: np.ndarray, count: int, slots: int = 1) -> int:
        """Run one control cycle on the first `count` frames of the batch `inbox`; return the number of frames in `outbox`.

        It is `slots` periods after the last cycle: more than 1 after missed slots. Raises InputError when another controller is
        on the bus, or the plant has another rate. A frame that cannot be used is counted (`count_receptions`).
        """
        return self.check_sent(run_cycle(self.states, self.settings, inbox, count, slots, self.outbox))

    def check_sent(self, count: int) -> int:
        """Return `count`, the result of a cycle. Raises InputError when it is minus a Refusal."""
        if count < 0:
            state = self._state
            raise InputError(self._describe(Refusal(-count), int(state.refused_id), float(state.refused_value)))
        return count

    def step(self, inbox: Sequence[Frame], slots: int = 1) -> list[Frame]:
        """Run one control cycle on frames as objects; return the frames sent. See `run_cycle`."""
        return unload(self.outbox[: self.run_cycle(self._inbox, load(self._inbox, inbox), slots)])

    def listen(self, frames: Sequence[Frame]) -> list[Frame]:
        """Take the heartbeats among the frames before the first cycle; return the other frames.

        Raises InputError when the plant has another rate, or another controller sends.
        """
        early = [frame for frame in frames if frame.can_id in self._early]
        if code := receive_before_start(self.states, self.settings, self._inbox, load(self._inbox, early)):
            self.check_sent(-code)
        return [frame for frame in frames if frame.can_id not in self._early]

    def read_setpoints_by(self, setpoint: FrameCodec) -> None:
        """Read set-points by another definition of TORQUE_SETPOINT with the same signals, identifier and data ID."""
        self.settings.view(np.recarray)[0].torque_setpoint = make_frame_definition(setpoint)

    def explain_fixed(self, name: str) -> str | None:
        """Return why a parameter cannot change while the controller runs; None if it can."""
        if name.partition(".")[0] == "guard":
            return f"parameter {name} is fixed while the controller runs: the guard's limits are set at the start"
        if name in VALVE:
            return f"parameter {name} is fixed while the controller runs: the gains follow it at the start; change the gains"
        return None

    def tune(self, values: Mapping[str, float]) -> None:
        """Change parameters between two cycles, each in its declared unit; states are unchanged.

        All values are taken or, with an InputError, none.
        """
        changed = self.parameters.with_values(values)
        check_parameters(changed)
        self.parameters = changed
        self._configure(changed)

    def make_heartbeat(self, lifecycle: Lifecycle) -> Frame:
        """Return the next heartbeat frame, with the state `lifecycle`."""
        self._state.beats += 1
        data = self._heartbeat.pack(int(self._state.beats), lifecycle=lifecycle, rate=self.rate, session=self._session)
        return Frame(self._heartbeat.can_id, data)

    def list_safe_frames(self) -> list[Frame]:
        """Return the safe frames: valve closed, motor off, heartbeat with the state finalized."""
        self._state.cycle += 1
        counter = int(self._state.cycle) - 1
        tick = max(self.sample_tick, 0)
        valve = self._valve.pack(counter, sample_tick=self._valve.wrap("sample_tick", tick))
        motor = self._motor.pack(counter, sample_tick=self._motor.wrap("sample_tick", tick))
        commands = [Frame(self._valve.can_id, valve)]
        if self._drives:
            commands.append(Frame(self._motor.can_id, motor))
        return [*commands, self.make_heartbeat(Lifecycle.FINALIZED)]

    def watch_faults(self) -> FaultWatch:
        """Return a FaultWatch with the number of faults so far, and the first."""
        faults = self.states["faults"][0]
        values = {parameter.name: parameter.value for parameter in self.parameters.values()}
        watch = FaultWatch([column.name for column in COLUMNS], self.rate, values)
        watch.take(np.array([faults["before"].item(), faults["first"].item()]))  # zeros without a fault
        watch.count = int(faults["count"])
        return watch

    def make_row(self) -> tuple[float, ...]:
        """Return the record of the last cycle, in the order of COLUMNS."""
        return tuple(self.record.tolist())

    @property
    def late_cycles(self) -> int:
        """Number of late cycles, set by the service for CONTROLLER_STATUS."""
        return int(self.states["late_cycles"][0])

    @late_cycles.setter
    def late_cycles(self, count: int) -> None:
        self.states["late_cycles"] = count

    @property
    def sample_tick(self) -> int:
        """Number of the last sample (unwrapped); -1 before the first."""
        return int(self._state.sample.tick)

    def count_receptions(self) -> dict[str, dict[str, int]]:
        """Return the counts of `protocols.can.reception.Reception` by frame name."""
        return {
            codec.name: read_counts(row)
            for codec, row in zip(self._codecs.values(), self.states["receptions"][0], strict=False)
        }

    def count_strays(self) -> dict[str, dict[str, int]]:
        """Return the counts of the frames that others sent on this service's own identifiers, by frame name."""
        rows = zip(self._own.values(), self.states["own"][0], strict=False)
        return {name: counts for name, row in rows if any((counts := read_counts(row)).values())}

    def describe_claim(self) -> dict[str, Any]:
        """Return the session of the supervisor that has claimed the set-points, or None, and the number of refused claims."""
        claim = self.states["claim"][0]
        return {
            "session": f"{claim['session']:04x}" if claim["session"] else None,
            "claims_refused": int(claim["refused"]),
        }

    @property
    def first_rejected(self) -> str:
        """Reason why the first rejected frame (wrong length or values) was not used; "" if there was none."""
        state = self._state
        if not state.rejected_why:
            return ""
        return self._describe(Refusal(int(state.rejected_why)), int(state.rejected_id), float(state.rejected_value))

    def _configure(self, parameters: ParameterSet) -> None:
        """Fill the settings that depend on parameters."""
        settings = self.settings.view(np.recarray)[0]
        phases = parameters.list_si("phases")
        contact = {"contact_pressure": parameters["model.contact_pressure"].si}
        settings.phases = make_record(
            PHASE_SETTINGS, {name: (phases | contact)[name] for name in PHASE_SETTINGS.names or ()}
        )
        plausibility = {name: phases[name] for name in PLAUSIBILITY_SETTINGS.names or ()}
        settings.plausibility = make_record(PLAUSIBILITY_SETTINGS, plausibility)
        if self._clutch:
            own, other = (
                parameters[f"driveline.ratio_{name}"].si for name in (self._clutch, find_other_clutch(self._clutch))
            )
            patience = 2.5 * self._status.cycle_time  # s: two may be lost
            settings.pair = make_record(PAIR_SETTINGS, ratio=own, other_ratio=other, patience=patience)
        settings.law = make_record(LAW_SETTINGS, make_law_settings(parameters, *self._kind))
        settings.setpoint_timeout, settings.motor_torque_limit = (
            phases["setpoint_timeout"],
            phases["motor_torque_limit"],
        )
        settings.demand_limit, settings.speed_limit = parameters["torque.demand_limit"].si, phases["speed_limit"]
        settings.pressure_limit = parameters["torque.pressure_limit"].value  # bar

    def _describe(self, why: Refusal, can_id: int, value: float) -> str:
        """Return the message for a frame that was not used."""
        settings = self.settings[0]
        if why is Refusal.SECOND_CONTROLLER:
            return f"a second controller is on the bus: it sends {self._own[can_id]} (0x{can_id:03X})"
        if why is Refusal.LENGTH:
            codec = self._codecs[can_id]
            return f"frame {codec.name} (0x{can_id:03X}) was received with {value:g} bytes; its definition has {codec.length}"
        if why is Refusal.RATE:
            return f"the plant runs at {value:g} Hz, this controller at {self.rate} Hz: give both one rate"
        if why is Refusal.SUPERVISOR:
            return f"the claim of supervisor {int(value):04x} was refused: another supervisor had the clutch"
        if why is Refusal.REQUEST:
            known = ", ".join(f"{request.value} {request.name.lower()}" for request in Request)
            return f"request {value:g} is unknown; allowed are {known}"
        if why is Refusal.TORQUE:
            return f"set-point {value:g} Nm is outside 0..{settings['demand_limit']:g} Nm"
        if why is Refusal.PRESSURE:
            return f"set-point {value:g} bar is outside 0..{settings['pressure_limit']:g} bar"
        limit = settings["speed_limit"]
        return f"set-point {value:g} rad/s is outside {-limit:g}..{limit:g} rad/s"
