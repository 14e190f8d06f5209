"""The controller as a node: frames in, frames out; the guard sees both."""

from collections.abc import Mapping, Sequence
from dataclasses import fields
from pathlib import Path
from typing import Any

from protocols.errors import InputError
from protocols.frames import Frame, load_frames
from protocols.heartbeat import Heartbeat
from protocols.lifecycle import Lifecycle
from protocols.node import Column
from protocols.parameters import ParameterSet, load_defaults, load_overlay
from protocols.reception import Reception
from protocols.request import Request
from protocols.two_clutches import OFFSET, SHARED
from protocols.units import BAR
from rt_controller.law import TERMS, TorqueLaw
from rt_controller.limits import Guard, Limits
from rt_controller.phases import Fault, Phase, PhaseMachine, PhaseSettings
from rt_controller.sample import Sample

_STEP_LIMIT = 10  # periods: a longer gap between samples is not integrated over (estimator, regulators)
PARAMETERS = Path(__file__).with_name("parameters") / "controller.toml"
LIMITS = Path(__file__).with_name("parameters") / "limits.toml"
_OWN = ("VALVE_COMMAND", "MOTOR_COMMAND", "CONTROLLER_STATUS", "CONTROLLER_HEARTBEAT")

COLUMNS = (
    Column("sample_tick", "1", "number of the sample answered, unwrapped; -1 before the first"),
    Column("sample_age", "cycles", "cycles since the last believable sample"),
    Column("phase", "1", "0 idle, 1 fill, 2 slip control, 3 release, 4 fault"),
    Column("fault", "1", f"why the phase is fault: {', '.join(f'{f.value} {f.name.lower()}' for f in Fault)}"),
    Column(
        "request", "1", f"what the supervisor asks for: {', '.join(f'{r.value} {r.name.lower()}' for r in Request)}"
    ),
    *TERMS,
    Column("commands_lowered", "1", "commands the guard has cut to its limit, total"),
    Column("commands_replaced", "1", "commands the guard has replaced by the safe one, total"),
)


def controller_parameters(changed: Path | None = None) -> ParameterSet:
    """The controller's parameters as shipped, or as changed by a user's file. Raises InputError."""
    shipped = load_defaults(PARAMETERS)
    return load_overlay(changed, shipped) if changed else shipped


def shipped_parameters() -> ParameterSet:
    """Parameters of controller and guard as shipped: the defaults."""
    return ParameterSet({**load_defaults(PARAMETERS), **load_defaults(LIMITS)})


def _check(parameters: ParameterSet) -> None:
    asked, allowed = parameters["pressure.voltage_limit"], parameters["guard.voltage"]
    if asked.value > allowed.value:
        raise InputError(
            f"parameter {asked.name} = {asked.value:g} V is above the guard's limit of {allowed.value:g} V"
        )


def _phase_settings(parameters: ParameterSet) -> PhaseSettings:
    values = parameters.si("phases") | {"contact_pressure": parameters["model.contact_pressure"].si}
    return PhaseSettings(**{field.name: values[field.name] for field in fields(PhaseSettings)})


class ControllerNode:
    """Decode, check, estimate, control, encode.

    rate [Hz]; `parameters_file` changes parameters of `controller.toml`; `law` is one of `law.LAWS`; `adaptation` switches
    the adaptive level on; `session` tells two controllers apart. `clutch` is a or b of two on one bus, None for a clutch
    alone. `late_cycles` is set by the service, for CONTROLLER_STATUS.

    One of two clutches neither adapts nor compares its estimate with the motor's torque, which is that of both; the motor
    is commanded by clutch a's controller.
    """

    columns = COLUMNS

    def __init__(
        self,
        rate: int = 1000,
        parameters_file: Path | None = None,
        law: str = "both",
        adaptation: bool = True,
        session: int = 1,
        clutch: str | None = None,
    ) -> None:
        limits = load_defaults(LIMITS)
        parameters = ParameterSet({**controller_parameters(parameters_file), **limits})
        _check(parameters)
        self.parameters = parameters
        self.rate = rate
        self.late_cycles = 0
        self._period = 1.0 / rate
        self._alone, self._drives = clutch is None, clutch != "b"
        self._law = TorqueLaw(parameters, law, adaptation and self._alone)
        self._phases = PhaseMachine(_phase_settings(parameters))
        self._guard = Guard(Limits(**limits.si("guard")), self._period, OFFSET if clutch == "b" else 0)

        frames = load_frames(clutch=clutch or "a")
        self._sample = Sample(
            self._period,
            parameters["slip.bandwidth"].si,
            self._law.model.oil_reference,
            frames["ENCODER"].scale["shaft_angle"],
        )
        self._valve, self._motor = frames["VALVE_COMMAND"], frames["MOTOR_COMMAND"]
        self._status = frames["CONTROLLER_STATUS"]
        self.heartbeat = Heartbeat(frames["CONTROLLER_HEARTBEAT"], rate, session)
        names = ("ANALOG_SENSORS", "ENCODER", "TORQUE_SETPOINT", "PLANT_HEARTBEAT")
        self._receptions = {frames[name].can_id: Reception(frames[name]) for name in names}
        self._analog_id, self._encoder_id, self._setpoint_id, self._plant_id = self._receptions
        own = [frames[name] for name in _OWN if self._drives or name not in SHARED]
        self._own = {codec.can_id: codec.name for codec in own}
        self.heard = [*self._receptions, *self._own]  # identifiers of all frames that matter to it
        self._commands_of_others = {self._valve.can_id, self._motor.can_id} & self._own.keys()
        self._cycle = 0
        self._status_every = max(1, round(self._status.cycle_time * rate))

        self._request, self._demand, self._pressure_demand, self._speed_demand = Request.IDLE, 0.0, 0.0, 0.0
        self._setpoint_age = float("inf")  # s
        self._configure(parameters)
        self._row: tuple[float, ...] = (0.0,) * len(COLUMNS)

    def step(self, inbox: Sequence[Frame], slots: int = 1) -> list[Frame]:
        """One control cycle, `slots` periods after the last one: more than 1 when the loop has slept through some.

        Raises InputError when the bus has a second controller or speaks another protocol.
        """
        elapsed = slots * self._period
        self._setpoint_age += elapsed
        ticks = 0
        for can_id, data in inbox:
            self._guard.inbound(can_id, data)
            ticks += self._receive(can_id, data)
        step = min(ticks, _STEP_LIMIT) * self._period
        request = self._request if self._setpoint_age <= self._setpoint_timeout else Request.RELEASE
        finding = Fault(self._guard.cycle(slots))
        mismatch = self._law.mismatch if self._alone else 0.0
        phase = self._phases.step(request, self._sample.pressure, mismatch, finding, elapsed)
        followed = self._pressure_demand if request is Request.PRESSURE else None
        self._law.step(phase, self._demand, self._sample, step, followed)
        guard = self._guard
        self._row = (
            self._sample.tick, guard.age, phase, self._phases.fault, request, *self._law.terms, guard.lowered, guard.replaced,
        )  # fmt: skip
        return self._commands(phase)

    def listen(self, frames: Sequence[Frame]) -> list[Frame]:
        """Heed heartbeats before the first cycle; return the frames left for it.

        Raises InputError when the plant runs at another rate or another controller speaks.
        """
        left = []
        for frame in frames:
            if frame.can_id == self._plant_id or frame.can_id in self._commands_of_others:
                self._receive(*frame)
            else:
                left.append(frame)
        return left

    def fixed(self, name: str) -> str | None:
        """Why a parameter cannot be changed while the controller runs; None when it can."""
        if name.partition(".")[0] == "guard":
            return f"parameter {name} is fixed while the controller runs: the guard's limits are set at the start"
        return None

    def tune(self, values: Mapping[str, float]) -> None:
        """Change parameters between two cycles, each in its declared unit; states stay. All or none: raises InputError."""
        changed = self.parameters.with_values(values)
        _check(changed)
        self.parameters = changed
        self._law.configure(changed)
        self._configure(changed)

    def safe(self) -> list[Frame]:
        """Valve closed, motor off, heartbeat finalised."""
        self._cycle += 1
        valve = self._valve.pack(self._cycle - 1, 0, 0.0, max(self._sample.tick, 0) & 0xFFFF)
        motor = [Frame(self._motor.can_id, self._motor.pack(self._cycle - 1, 0, 0.0, 0.0))] if self._drives else []
        return [Frame(self._valve.can_id, valve), *motor, self.heartbeat.next(Lifecycle.FINALIZED)]

    def row(self) -> tuple[float, ...]:
        """The record of the last cycle, in the order of COLUMNS."""
        return self._row

    @property
    def sample_tick(self) -> int:
        """Unwrapped number of the last sample; -1 before the first."""
        return self._sample.tick

    def reception_counts(self) -> dict[str, dict[str, int]]:
        """Counts of `protocols.reception.Reception` by frame name."""
        return {reception.codec.name: reception.counts() for reception in self._receptions.values()}

    def _configure(self, parameters: ParameterSet) -> None:
        phases = parameters.si("phases")
        self._setpoint_timeout, self._motor_torque_limit = phases["setpoint_timeout"], phases["motor_torque_limit"]
        self._demand_limit, self._speed_limit = parameters["torque.demand_limit"].si, phases["speed_limit"]
        self._pressure_limit = parameters["torque.pressure_limit"].value  # bar
        self._phases.settings = _phase_settings(parameters)
        self._sample.bandwidth = parameters["slip.bandwidth"].si

    def _receive(self, can_id: int, data: bytes) -> int:
        """Take one frame; return how many sample periods it moved the controller's time on."""
        if can_id in self._own:
            raise InputError(f"a second controller is on the bus: it sends {self._own[can_id]} (0x{can_id:03X})")
        reception = self._receptions.get(can_id)
        if reception is None or not reception.accept(data):
            return 0
        codec = reception.codec
        if can_id == self._analog_id:
            self._sample.analog(codec.unpack(data))
        elif can_id == self._encoder_id:
            return self._sample.encoder(codec.raw(data), self._speed_demand)
        elif can_id == self._setpoint_id:
            self._take_setpoint(codec.unpack(data))
        elif (rate := codec.unpack(data).rate) != self.rate:
            raise InputError(f"the plant runs at {rate} Hz, this controller at {self.rate} Hz: give both one rate")
        return 0

    def _take_setpoint(self, values: Any) -> None:
        if values.torque_demand > self._demand_limit:
            raise InputError(f"set-point {values.torque_demand:g} Nm is outside 0..{self._demand_limit:g} Nm")
        if values.pressure_demand > (limit := self._pressure_limit):
            raise InputError(f"set-point {values.pressure_demand:g} bar is outside 0..{limit:g} bar")
        if values.request > max(Request):
            known = ", ".join(f"{request.value} {request.name.lower()}" for request in Request)
            raise InputError(f"request {values.request} is unknown; allowed are {known}")
        if not abs(values.speed_demand) <= (limit := self._speed_limit):
            raise InputError(f"set-point {values.speed_demand:g} rad/s is outside {-limit:g}..{limit:g} rad/s")
        self._request, self._demand = Request(values.request), values.torque_demand
        self._speed_demand, self._pressure_demand = values.speed_demand, values.pressure_demand * BAR
        self._setpoint_age = 0.0

    def _commands(self, phase: Phase) -> list[Frame]:
        cycle, law = self._cycle, self._law
        open_valve = phase in (Phase.FILL, Phase.SLIP_CONTROL)
        run_motor = phase is not Phase.FAULT and self._setpoint_age != float("inf")
        motor = self._motor.pack(
            cycle, run_motor, *((self._speed_demand, self._motor_torque_limit) if run_motor else (0.0, 0.0))
        )
        valve = self._valve.pack(cycle, open_valve, law.voltage, max(self._sample.tick, 0) & 0xFFFF)
        frames = []
        if cycle % self.heartbeat.every == 0:
            frames.append(self.heartbeat.next(Lifecycle.ACTIVE))
        if cycle % self._status_every == 0:
            estimate = min(max(law.estimate, -65.0), 65.0)  # range of the signal
            status = (phase, self._phases.fault, estimate, min(self.late_cycles, 65535), min(law.level, 2.55))
            frames.append(Frame(self._status.can_id, self._status.pack(cycle // self._status_every, *status)))
        if self._drives:
            frames.append(Frame(self._motor.can_id, self._guard.outbound(self._motor.can_id, motor)))
        frames.append(Frame(self._valve.can_id, self._guard.outbound(self._valve.can_id, valve)))
        self._cycle = cycle + 1
        return frames
