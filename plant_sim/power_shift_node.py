"""The power-shift rig as a node: commands of two controllers in, sensor frames of two clutches out, the truth in its record."""

from collections.abc import Mapping, Sequence
from dataclasses import replace
from math import ceil
from typing import Any

from plant_sim.clutch_interface import ClutchInterface
from plant_sim.effects.catalogue import effects
from plant_sim.effects.signals import DRIVE
from plant_sim.injection import Injection, requested
from plant_sim.node import initial_temperature
from plant_sim.profile import Setpoint
from plant_sim.rigs import power_shift
from plant_sim.rigs.power_shift import PowerShift
from plant_sim.rigs.wet_clutch import STEP_LIMIT, State
from plant_sim.schedule import Change, Schedule
from plant_sim.shift_profile import ShiftProfile
from protocols.errors import InputError
from protocols.frames import Frame, load_frames
from protocols.heartbeat import Heartbeat
from protocols.lifecycle import Lifecycle
from protocols.node import Column
from protocols.parameters import ParameterSet
from protocols.reception import Reception
from protocols.two_clutches import CLUTCHES
from protocols.units import BAR, ZERO_CELSIUS

_CLUTCH_COLUMNS = (
    ("valve_voltage_{}_v", "V", "voltage to the V/A converter, acting from this row on"),
    ("torque_demand_{}_nm", "Nm", "the supervisor's demand to the controller"),
    ("cylinder_pressure_{}_bar", "bar", "measured oil pressure behind the piston"),
    ("slip_speed_{}_rad_s", "rad/s", "measured slip speed, from encoder counts"),
    ("slip_angle_{}_rad", "rad", "encoder angle of the clutch's input against its output"),
    ("oil_temperature_{}_degc", "degC", "measured oil temperature"),
    ("clutch_torque_{}_nm", "Nm", "measured clutch torque, for validation"),
    ("truth_valve_pressure_{}_bar", "bar", "pressure after the valve"),
    ("truth_cylinder_pressure_{}_bar", "bar", "pressure behind the piston"),
    ("truth_piston_position_{}_m", "m", "0 at rest"),
    ("truth_normal_force_{}_n", "N", "on the plates"),
    ("truth_friction_state_{}", "1", "m of eq. 6.9"),
    ("truth_clutch_torque_{}_nm", "Nm", "M"),
    ("truth_slip_speed_{}_rad_s", "rad/s", "input speed less ratio times output speed"),
    ("truth_oil_temperature_{}_degc", "degC", "T"),
    ("truth_heat_{}_j", "J", "friction heat since the start"),
)

COLUMNS = (
    Column("time_s", "s", "time since the run's start"),
    Column("input_speed_demand_rad_s", "rad/s", "speed demand of the motor, acting from this row on"),
    Column("motor_torque_nm", "Nm", "measured torque of the motor"),
    *(Column(name.format(clutch), unit, meaning) for clutch in CLUTCHES for name, unit, meaning in _CLUTCH_COLUMNS),
    Column("truth_motor_torque_nm", "Nm", "M_m"),
    Column("truth_input_speed_rad_s", "rad/s", "of the motor and both clutches' inputs"),
    Column("truth_output_speed_rad_s", "rad/s", "of the output shaft"),
    Column("truth_vehicle_speed_m_s", "m/s", "output speed times the wheel's radius"),
    Column("truth_output_torque_nm", "Nm", "i_a M_a + i_b M_b"),
    Column("truth_road_torque_nm", "Nm", "rolling resistance, drag and grade, about the output shaft"),
    Column("truth_input_work_j", "J", "of the motor since the start"),
    Column("truth_road_work_j", "J", "into the road since the start"),
)


class PowerShiftNode:
    """The power-shift rig behind the data acquisitions of its clutches, with the profile player of the bench.

    Arguments and steps as of `PlantNode`. Each clutch has its own frames (protocols/two_clutches.py), sensors and noise; the
    motor obeys clutch a's controller. Injections name parameters with the prefix of their clutch. It cannot be blind.
    """

    columns = COLUMNS

    def __init__(
        self,
        rate: int = 1000,
        parameters: ParameterSet | None = None,
        profile: ShiftProfile | None = None,
        seed: int = 1,
        temperature: float | None = None,
        session: int = 1,
        injections: Sequence[Injection] = (),
        blind: bool = False,
    ) -> None:
        if blind:
            raise InputError("the power-shift rig cannot be blind; allowed is the rig wet_clutch")
        self.blind = blind
        self._base = parameters = parameters or power_shift.nominal()
        self.rate, self.profile = rate, profile
        self.late_cycles = 0  # set by the service for PLANT_STATUS
        self._period = 1.0 / rate
        self._substeps = ceil(self._period / STEP_LIMIT - 1e-9)
        self._rig = power_shift.Rig(parameters)
        self._radius = parameters["driveline.wheel_radius"].si
        own = [power_shift.clutch_parameters(parameters, clutch) for clutch in CLUTCHES]
        self._clutches = [
            ClutchInterface(rate, own[k], len(CLUTCHES) * seed + k, clutch, f"the controller of clutch {clutch}")
            for k, clutch in enumerate(CLUTCHES)
        ]
        self._schedules = [Schedule(each) for each in own]
        self.tick = -1
        self.injected: list[dict[str, Any]] = []
        self.inject(*injections)
        kelvin = initial_temperature(parameters["a.oil.reference"].value if temperature is None else temperature)
        speed = profile.at(0.0)[0].speed if profile else 0.0
        self._state = self._rig.at_rest(speed, 0.0, kelvin)

        frames = load_frames()
        self._status = frames["PLANT_STATUS"]
        self._motor = Reception(frames["MOTOR_COMMAND"])
        self.heartbeat = Heartbeat(frames["PLANT_HEARTBEAT"], rate, session)
        shared = {frames[name].can_id: name for name in ("PLANT_STATUS", "PLANT_HEARTBEAT")}
        self._own = {can_id: name for each in self._clutches for can_id, name in each.own.items()} | shared
        self._status_every = max(1, round(self._status.cycle_time * rate))
        self._speed_demand, self._torque_limit = speed, self._rig.a.record["motor_torque_limit"][0]
        self._row: tuple[float, ...] = (0.0,) * len(COLUMNS)

    def step(self, inbox: Sequence[Frame]) -> list[Frame]:
        """One sample. Raises InputError when the bus has a second plant or speaks another protocol."""
        self.receive(inbox)
        frames = self.sample()
        self.advance()
        return frames

    def receive(self, inbox: Sequence[Frame]) -> None:
        """Take commands; they act from the next sample on."""
        for can_id, data in inbox:
            if can_id in self._own:
                raise InputError(f"a second plant is on the bus: it sends {self._own[can_id]} (0x{can_id:03X})")
            if can_id == self._motor.codec.can_id:
                if self._motor.accept(data):
                    values = self._motor.codec.unpack(data)
                    self._speed_demand, self._torque_limit = (
                        (values.speed_demand, values.torque_limit) if values.motor_enable else (0.0, 0.0)
                    )
                continue
            for clutch in self._clutches:
                if can_id in clutch.receptions:
                    clutch.receive(can_id, data)

    def slept(self, periods: int) -> None:
        """See `PlantNode`."""
        for clutch in self._clutches:
            clutch.slept(periods)

    def sample(self) -> list[Frame]:
        """Frames of the present tick; of each clutch the encoder frame comes last and completes its sample."""
        self.tick = tick = self.tick + 1
        time = tick * self._period
        self._follow(time)
        frames = []
        if tick % self.heartbeat.every == 0:
            frames.append(self.heartbeat.next(Lifecycle.ACTIVE))
        if tick % self._status_every == 0:
            counts = self.reception_counts().values()
            rejected = sum(count["corrupt"] + count["repeated"] for count in counts)
            status = (self._actuators(), min(self.late_cycles, 65535), min(rejected, 65535))
            frames.append(Frame(self._status.can_id, self._status.pack(tick // self._status_every, *status)))
        setpoints: Sequence[Setpoint] = self.profile.at(time) if self.profile else ()
        for clutch, setpoint in zip(self._clutches, setpoints, strict=False):
            frames.append(Frame(clutch.setpoint.can_id, clutch.setpoint.pack(tick, *setpoint)))
        if self._clutches[0].stale:  # nobody commands the motor
            self._speed_demand = self._torque_limit = 0.0
        before, after = self._state, []
        for clutch, rig, state in zip(self._clutches, (self._rig.a, self._rig.b), before[1:], strict=True):
            sampled, state = clutch.sample(tick, rig, state, state.read())
            frames += sampled
            after.append(state)
        self._state = PowerShift(before.driveline, *after)
        self._note(time, [setpoint.torque for setpoint in setpoints] or [0.0, 0.0])
        return frames

    def advance(self) -> None:
        """Let the rig run for one period with the inputs held."""
        self._advance(self._period, self._substeps)

    def safe(self) -> list[Frame]:
        """A plant commands nothing: it says that it ends."""
        return [self.heartbeat.next(Lifecycle.FINALIZED)]

    @property
    def answered_tick(self) -> int:
        """SAMPLE_TICK that every controller has answered, of those that have not ended; -1 while they differ."""
        ticks = {clutch.answered_tick for clutch in self._clutches if clutch.controller != Lifecycle.FINALIZED}
        return ticks.pop() if len(ticks) == 1 else -1

    @property
    def controller(self) -> Lifecycle:
        """The state of both controllers, inactive while theirs differ: active once both are, finalized when both have ended."""
        states = {clutch.controller for clutch in self._clutches}
        return states.pop() if len(states) == 1 else Lifecycle.INACTIVE

    @property
    def parameters(self) -> ParameterSet:
        """As they act from the next sample on."""
        values: dict[str, float] = {}
        for clutch, schedule in zip(self._clutches, self._schedules, strict=True):
            present = schedule.parameters(self._now)
            values |= {_whole_name(name, clutch): p.value for name, p in present.items()}
        return self._base.with_values(values)

    @property
    def planned(self) -> list[dict[str, Any]]:
        """Changes by injections that have not begun, as those `injected`."""
        parts = zip(self._clutches, self._schedules, strict=True)
        return [told for clutch, schedule in parts for told in self._told(schedule.planned, clutch)]

    def fixed(self, name: str) -> str | None:
        """Why a parameter cannot be changed while the plant runs; None when it can."""
        group, _, rest = name.partition(".")
        part = rest.partition(".")[0] if group in CLUTCHES else group
        if part in ("driveline", "sensors"):
            return f"parameter {name} is fixed while the plant runs: driveline and data acquisition are set up at the start"
        if group in CLUTCHES and part in effects() and DRIVE in effects()[part].laws:
            return power_shift.refusal(group, part)
        return None

    def tune(self, values: Mapping[str, float]) -> None:
        """Change parameters between two samples, each in its declared unit; states stay. All or none: raises InputError."""
        self._check_free(values)
        parts = [power_shift.of_clutch(values, clutch.clutch) for clutch in self._clutches]
        self._schedules = [
            schedule.tuned(part, self._now) if part else schedule
            for schedule, part in zip(self._schedules, parts, strict=True)
        ]
        self._follow(self._now)

    def inject(self, *injections: Injection) -> None:
        """Take changes of parameters at times to come; states stay. All or none: raises InputError."""
        for injection in injections:
            self._check_free(injection.values)
        schedules = []
        for clutch, schedule in zip(self._clutches, self._schedules, strict=True):
            parts = [(i, power_shift.of_clutch(i.values, clutch.clutch)) for i in injections]
            own = [replace(injection, values=part) for injection, part in parts if part]
            schedules.append(schedule.extended(own, self._now) if own else schedule)
        self._schedules = schedules

    def accept(self, values: Mapping[str, float], when: Mapping[str, float]) -> list[dict[str, Any]]:
        """Inject `values` when somebody from outside asks (`injection.requested`); return the changes planned for that."""
        known = self.planned
        self.inject(requested(values, when, self._now))
        return [change for change in self.planned if change not in known]

    def row(self) -> tuple[float, ...]:
        """The record of the last sample, in the order of COLUMNS."""
        return self._row

    @property
    def finished(self) -> bool:
        """Whether the profile has been played to its end."""
        return self.profile is not None and self._now >= self.profile.duration

    def reception_counts(self) -> dict[str, dict[str, int]]:
        """Counts of `protocols.reception.Reception` by frame name."""
        receptions = [r for clutch in self._clutches for r in clutch.receptions.values()]
        return {reception.codec.name: reception.counts() for reception in (self._motor, *receptions)}

    @property
    def _now(self) -> float:
        """Time of the next sample [s]."""
        return (self.tick + 1) * self._period

    def _check_free(self, values: Mapping[str, float]) -> None:
        """Raise InputError for values that cannot be, or cannot be changed while the plant runs."""
        self._base.with_values(values)
        if reasons := [reason for name in values if (reason := self.fixed(name))]:
            raise InputError(reasons[0])

    def _advance(self, duration: float, substeps: int) -> None:
        a, b = self._clutches
        self._state = self._rig.advance(
            self._state, (a.voltage, b.voltage), self._speed_demand, self._torque_limit, duration, substeps
        )

    def _follow(self, time: float) -> None:
        """Let both clutches be what they are to be at `time` [s]; outputs follow."""
        driveline, *wholes = self._state
        rigs = [self._rig.a, self._rig.b]
        changed = False
        for k, (clutch, schedule) in enumerate(zip(self._clutches, self._schedules, strict=True)):
            rig, moved = schedule.rig(time)
            if rig is not rigs[k] or moved:
                states = rig.table.carried(wholes[k].effects, rigs[k].table)
                rigs[k], wholes[k] = rig, wholes[k]._replace(effects=states)
                changed = True
            if schedule.planned:
                self.injected += self._told(schedule.begin(time), clutch)
        if changed:
            self._rig.a, self._rig.b = rigs
            self._state = PowerShift(driveline, *wholes)
            self._advance(0.0, 0)

    def _told(self, changes: Sequence[Change], clutch: ClutchInterface) -> list[dict[str, Any]]:
        """Changes of a clutch for people and files. Those of the motor, which both clutches have, are told once."""
        return [
            change.told(self.rate) | {"name": _whole_name(change.name, clutch)}
            for change in changes
            if clutch is self._clutches[0] or not power_shift.is_motor(change.name)
        ]

    def _actuators(self) -> int:
        """Value of PLANT_STATUS.ACTUATORS: the worst of both clutches."""
        if not any(clutch.commanded for clutch in self._clutches):
            return 0
        return 2 if any(clutch.stale for clutch in self._clutches) else 1

    def _note(self, time: float, demands: Sequence[float]) -> None:
        d = self._state.read()
        (a, b), (demand_a, demand_b) = self._clutches, demands
        self._row = (
            time, self._speed_demand, a.measured.motor_torque,
            *_part(a, self._state.a.read(), demand_a, d.heat_a), *_part(b, self._state.b.read(), demand_b, d.heat_b),
            d.motor_torque, d.input_speed, d.output_speed, d.output_speed * self._radius, d.output_torque, d.road_torque,
            d.input_work, d.road_work,
        )  # fmt: skip


def _part(clutch: ClutchInterface, y: State, demand: float, heat: float) -> tuple[float, ...]:
    """A clutch's part of the record, in the order of _CLUTCH_COLUMNS; demand [Nm], heat [J]."""
    m = clutch.measured
    return (
        clutch.voltage, demand, m.pressure, m.slip_speed, m.angle, m.temperature, m.clutch_torque,
        y.valve_pressure / BAR, y.pressure / BAR, y.position, y.normal_force, y.friction_state,
        y.clutch_torque, y.slip_speed, y.temperature - ZERO_CELSIUS, heat,
    )  # fmt: skip


def _whole_name(name: str, clutch: ClutchInterface) -> str:
    """Name of a clutch's or the motor's parameter among those of the power-shift rig."""
    return name if power_shift.is_motor(name) else f"{clutch.clutch}.{name}"
