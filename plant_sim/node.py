"""The plant as a node: commands in, sensor frames out, ground truth in its record."""

from collections.abc import Mapping, Sequence
from math import ceil
from typing import Any

from plant_sim.clutch_interface import ClutchInterface
from plant_sim.effects.catalogue import effects
from plant_sim.injection import Injection, requested
from plant_sim.profile import Profile
from plant_sim.rigs import wet_clutch
from plant_sim.rigs.clutch_phase import Phase, phase
from plant_sim.schedule import Schedule
from protocols.errors import InputError
from protocols.frames import Frame, load_frames
from protocols.heartbeat import Heartbeat
from protocols.lifecycle import Lifecycle
from protocols.node import Column
from protocols.parameters import ParameterSet
from protocols.reception import Reception
from protocols.units import BAR, ZERO_CELSIUS

_TEMPERATURES = 35.0, 150.0  # degC: valid range of eq. 6.3 (blocks/oil.py) and of fig 6.8

# Columns of a recorded run (rig.md), then the truth.
COLUMNS = tuple(
    Column(*column)
    for column in (
        ("time_s", "s", "time since the run's start"),
        ("valve_voltage_v", "V", "voltage to the V/A converter, acting from this row on"),
        ("motor_speed_demand_rad_s", "rad/s", "speed demand of the motor, acting from this row on"),
        ("cylinder_pressure_bar", "bar", "measured oil pressure behind the piston"),
        ("slip_speed_rad_s", "rad/s", "measured slip speed, from encoder counts"),
        ("shaft_angle_rad", "rad", "encoder angle of the turning plate"),
        ("oil_temperature_degc", "degC", "measured oil temperature"),
        ("clutch_torque_nm", "Nm", "measured clutch torque, for validation"),
        ("motor_torque_nm", "Nm", "measured torque of the motor"),
        ("truth_valve_pressure_bar", "bar", "pressure after the valve"),
        ("truth_cylinder_pressure_bar", "bar", "pressure behind the piston"),
        ("truth_piston_position_m", "m", "0 at rest"),
        ("truth_normal_force_n", "N", "on the plates"),
        ("truth_seal_force_n", "N", "friction of the piston's seals"),
        ("truth_friction_state", "1", "m of eq. 6.9"),
        ("truth_clutch_torque_nm", "Nm", "M"),
        ("truth_motor_torque_nm", "Nm", "M_m"),
        ("truth_slip_speed_rad_s", "rad/s", "omega"),
        ("truth_oil_temperature_degc", "degC", "T"),
        ("truth_phase", "1", ", ".join(f"{p.value} {p.name.lower()}" for p in Phase)),
    )
)


class PlantNode:
    """The wet-clutch rig behind its data acquisition, with the profile player of the bench.

    rate [Hz]; `temperature` is the oil's at the start [degC]; `injections` change the plant while it runs, and `injected`
    tells those that have begun; a `blind` plant does not say what it is beyond its own parameters at the start. A step
    answers with the frames of the present tick and then advances the rig by one period; what it was sent acts from this
    tick on, so a command that answers tick k acts from tick k + 1.
    """

    columns = COLUMNS

    def __init__(
        self,
        rate: int = 1000,
        parameters: ParameterSet | None = None,
        profile: Profile | None = None,
        seed: int = 1,
        temperature: float | None = None,
        session: int = 1,
        injections: Sequence[Injection] = (),
        blind: bool = False,
    ) -> None:
        parameters = parameters or wet_clutch.nominal()
        self.rate = rate
        self.profile = profile
        self.late_cycles = 0  # set by the service for PLANT_STATUS
        self._period = 1.0 / rate
        self._substeps = ceil(self._period / wet_clutch.STEP_LIMIT - 1e-9)
        self._schedule = Schedule(parameters)
        self.injected: list[dict[str, Any]] = []
        self._plain = parameters
        self._open = _without_effects(parameters) if blind else None  # what a blind plant says of itself
        self.tick = -1
        self.inject(*injections)
        self._rig, _ = self._schedule.rig(0.0)
        self._clutch = ClutchInterface(rate, parameters, seed)
        kelvin = initial_temperature(parameters["oil.reference"].value if temperature is None else temperature)
        speed = profile.at(0.0).speed if profile else 0.0
        self._state = self._rig.at_rest(speed, kelvin)
        self._y = self._state.read()

        frames = load_frames()
        self._status = frames["PLANT_STATUS"]
        self._motor = Reception(frames["MOTOR_COMMAND"])
        self.heartbeat = Heartbeat(frames["PLANT_HEARTBEAT"], rate, session)
        shared = {frames[name].can_id: name for name in ("PLANT_STATUS", "PLANT_HEARTBEAT")}
        self._own = self._clutch.own | shared
        self._status_every = max(1, round(self._status.cycle_time * rate))
        self._speed_demand, self._torque_limit = speed, self._rig.record["motor_torque_limit"][0]
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
            if can_id in self._clutch.receptions:
                self._clutch.receive(can_id, data)
            elif can_id == self._motor.codec.can_id and self._motor.accept(data):
                values = self._motor.codec.unpack(data)
                self._speed_demand, self._torque_limit = (
                    (values.speed_demand, values.torque_limit) if values.motor_enable else (0.0, 0.0)
                )

    def slept(self, periods: int) -> None:
        """The machine has slept through `periods`, whose samples come now, at once: nobody could answer them."""
        self._clutch.slept(periods)

    def sample(self) -> list[Frame]:
        """Frames of the present tick: set-point, status, sensors; the encoder frame comes last and completes the sample."""
        self.tick = tick = self.tick + 1
        clutch = self._clutch
        if clutch.stale:
            self._speed_demand = self._torque_limit = 0.0
        self._follow(tick * self._period)
        frames = []
        if tick % self.heartbeat.every == 0:
            frames.append(self.heartbeat.next(Lifecycle.ACTIVE))
        if tick % self._status_every == 0:
            counts = self.reception_counts().values()
            rejected = sum(count["corrupt"] + count["repeated"] for count in counts)
            status = (self._actuators(), min(self.late_cycles, 65535), min(rejected, 65535))
            frames.append(Frame(self._status.can_id, self._status.pack(tick // self._status_every, *status)))
        if self.profile:
            setpoint = self.profile.at(tick * self._period)
            frames.append(Frame(clutch.setpoint.can_id, clutch.setpoint.pack(tick, *setpoint)))
        sampled, self._state = clutch.sample(tick, self._rig, self._state, self._y)
        self._note()
        return frames + sampled

    def advance(self) -> None:
        """Let the rig run for one period with the inputs held."""
        self._state = self._rig.advance(
            self._state, self._clutch.voltage, self._speed_demand, self._torque_limit, self._period, self._substeps
        )
        self._y = self._state.read()

    def safe(self) -> list[Frame]:
        """A plant commands nothing: it says that it ends."""
        return [self.heartbeat.next(Lifecycle.FINALIZED)]

    def fixed(self, name: str) -> str | None:
        """Why a parameter cannot be changed while the plant runs; None when it can."""
        if name.partition(".")[0] == "sensors":
            return f"parameter {name} is fixed while the plant runs: its data acquisition is set up at the start"
        return None

    @property
    def answered_tick(self) -> int:
        """SAMPLE_TICK of the last valve command; -1 before the first."""
        return self._clutch.answered_tick

    @property
    def controller(self) -> Lifecycle:
        """State of the controller by its heartbeat."""
        return self._clutch.controller

    @property
    def blind(self) -> bool:
        """Whether the truth is kept from everybody but the recording."""
        return self._open is not None

    @property
    def parameters(self) -> ParameterSet:
        """What the plant says of its parameters: as they act from the next sample on, or, when blind, its own at the start."""
        return self._schedule.parameters(self._now) if self._open is None else self._open

    @property
    def planned(self) -> list[dict[str, Any]]:
        """Changes by injections that have not begun, as those `injected`."""
        return [change.told(self.rate) for change in self._schedule.planned]

    def tune(self, values: Mapping[str, float]) -> None:
        """Change parameters between two samples, each in its declared unit; states stay. All or none: raises InputError."""
        said = self._open if self._open is None else self._open.with_values(values)
        self._schedule = self._schedule.tuned(values, self._now)
        self._open = said
        self._follow(self._now)

    def inject(self, *injections: Injection) -> None:
        """Take changes of parameters at times to come; states stay. All or none: raises InputError."""
        for injection in injections:
            self._check_free(injection)
        self._schedule = self._schedule.extended(injections, self._now)

    def accept(self, values: Mapping[str, float], when: Mapping[str, float]) -> list[dict[str, Any]]:
        """Inject `values` when somebody from outside asks (`injection.requested`); return the changes planned for that.

        A blind plant tells neither what was before nor why it refuses what any other plant would take. Raises InputError.
        """
        injection = requested(values, when, self._now)
        if self._open is None:
            self.inject(injection)
            return self._told(injection, (injection.at, injection.until))
        self._check_free(injection)
        off = {name: value for effect in effects().values() for name, value in effect.switches}
        Schedule(self._plain.with_values(off)).extended([injection], self._now)  # what any plant would refuse is told
        try:
            self.inject(injection)
        except InputError:
            raise InputError(
                "the plant refuses this beside what it is already; being blind, it does not say why"
            ) from None
        return [told | {"old": None} for told in self._told(injection, (injection.at,))]

    def row(self) -> tuple[float, ...]:
        """The record of the last sample, in the order of COLUMNS."""
        return self._row

    @property
    def finished(self) -> bool:
        """Whether the profile has been played to its end."""
        return self.profile is not None and (self.tick + 1) * self._period >= self.profile.duration

    def reception_counts(self) -> dict[str, dict[str, int]]:
        """Counts of `protocols.reception.Reception` by frame name."""
        receptions = (*self._clutch.receptions.values(), self._motor)
        return {reception.codec.name: reception.counts() for reception in receptions}

    def _check_free(self, injection: Injection) -> None:
        if reasons := [reason for name in injection.values if (reason := self.fixed(name))]:
            raise InputError(reasons[0])

    def _told(self, injection: Injection, times: Sequence[float]) -> list[dict[str, Any]]:
        """What is planned at `times` [s] because of an injection: later ones come last."""
        planned = {(c.name, c.at): c for c in self._schedule.planned if c.name in injection.values and c.at in times}
        return [change.told(self.rate) for change in planned.values()]

    @property
    def _now(self) -> float:
        """Time of the next sample [s]."""
        return (self.tick + 1) * self._period

    def _follow(self, time: float) -> None:
        """Let the rig be what it is to be at `time` [s], of the next sample or of this one; its outputs follow."""
        rig, moved = self._schedule.rig(time)
        if rig is not self._rig or moved:
            states = rig.table.carried(self._state.effects, self._rig.table)
            self._rig = rig
            self._state = rig.advance(
                self._state._replace(effects=states),
                self._clutch.voltage,
                self._speed_demand,
                self._torque_limit,
                0.0,
                0,
            )
            self._y = self._state.read()
        if self._schedule.planned:
            self.injected += [change.told(self.rate) for change in self._schedule.begin(time)]

    def _actuators(self) -> int:
        """Value of PLANT_STATUS.ACTUATORS."""
        if not self._clutch.commanded:
            return 0
        return 2 if self._clutch.stale else 1

    def _note(self) -> None:
        y = self._y
        self._row = (
            self.tick * self._period, self._clutch.voltage, self._speed_demand, *self._clutch.measured,
            y.valve_pressure / BAR, y.pressure / BAR, y.position, y.normal_force, y.seal_force, y.friction_state,
            y.clutch_torque, y.motor_torque, y.slip_speed, y.temperature - ZERO_CELSIUS,
            phase(y, *self._rig.phase_pressures),
        )  # fmt: skip


def initial_temperature(celsius: float) -> float:
    """The oil's temperature at the start [K] from that in degC. Raises InputError."""
    low, high = _TEMPERATURES
    if not low <= celsius <= high:
        raise InputError(f"oil temperature {celsius:g} degC is outside {low:g}..{high:g} degC")
    return celsius + ZERO_CELSIUS


def _without_effects(parameters: ParameterSet) -> ParameterSet:
    return ParameterSet({name: p for name, p in parameters.items() if name.partition(".")[0] not in effects()})
