"""One clutch of the power-shift rig on the bus: commands of its controller in, its sensor frames out."""

from plant_sim.blocks import dac
from plant_sim.blocks.sensors import Sensors
from plant_sim.node import STALE_CYCLES
from plant_sim.rigs.wet_clutch import Rig, State, Whole
from plant_sim.schedule import Schedule
from protocols.errors import InputError
from protocols.frames import Frame, load_frames
from protocols.lifecycle import Lifecycle
from protocols.node import Column
from protocols.parameters import ParameterSet
from protocols.reception import Reception
from protocols.units import BAR, ZERO_CELSIUS

_COLUMNS = (
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


def clutch_columns(clutch: str) -> tuple[Column, ...]:
    """Names of a clutch's part of the record."""
    return tuple(Column(name.format(clutch), unit, meaning) for name, unit, meaning in _COLUMNS)


class ClutchInterface:
    """A clutch between rig and bus: its frames, its data acquisition, its parameters over time.

    `answered_tick`, `controller` and `commanded` tell of its controller; `voltage` [V] is at its valve.
    """

    def __init__(self, clutch: str, rate: int, parameters: ParameterSet, seed: int) -> None:
        frames = load_frames(clutch=clutch)
        self.clutch = clutch
        self.analog, self.encoder, self.setpoint = (
            frames[name] for name in ("ANALOG_SENSORS", "ENCODER", "TORQUE_SETPOINT")
        )
        commands = frames["VALVE_COMMAND"], frames["CONTROLLER_HEARTBEAT"]
        self.receptions = {codec.can_id: Reception(codec) for codec in commands}
        self._valve_id, _ = self.receptions
        self.own = {codec.can_id: codec.name for codec in (self.analog, self.encoder)}
        self.schedule = Schedule(parameters)
        self.voltage = 0.0
        self.answered_tick = -1
        self.controller = Lifecycle.UNCONFIGURED
        self.age, self.commanded = 0, False  # cycles since the last valve command
        self._rate, self._sensors = rate, Sensors(seed)
        self._dac = parameters["sensors.dac_range"].value, int(parameters["sensors.dac_bits"].value)
        self._count: int | None = None
        self._angle = 0.0
        self._measured = (0.0,) * 6

    def receive(self, can_id: int, data: bytes) -> None:
        """Take a command or a heartbeat of its controller. Raises InputError for another rate."""
        reception = self.receptions[can_id]
        if not reception.accept(data):
            return
        values = reception.codec.unpack(data)
        if can_id == self._valve_id:
            counts = reception.codec.raw(data).valve_voltage
            self.voltage = dac.voltage(counts, *self._dac) if values.valve_enable else 0.0
            self.answered_tick, self.age, self.commanded = values.sample_tick, 0, True
        elif values.rate != self._rate:
            raise InputError(
                f"the controller of clutch {self.clutch} runs at {values.rate} Hz, this plant at {self._rate} Hz:"
                " give all one rate"
            )
        elif values.lifecycle > Lifecycle.FINALIZED:
            raise InputError(f"lifecycle {values.lifecycle} of a controller is unknown; allowed are 0 to 3")
        else:
            self.controller = Lifecycle(values.lifecycle)

    @property
    def stale(self) -> bool:
        """Whether commands have come and come no more."""
        return self.commanded and self.age >= STALE_CYCLES

    def sample(self, tick: int, rig: Rig, state: Whole) -> tuple[list[Frame], Whole]:
        """Sensor frames of `tick`, and the state with those of its effects moved on."""
        if self.stale:
            self.voltage = 0.0
        self.age += 1
        slip = state.read().slip_speed
        counts, state = self._sensors.sample(rig, state, 1.0 / self._rate)
        analog = self.analog.pack_raw(tick, *counts[:4])
        encoder = self.encoder.pack_raw(tick, counts.encoder, tick & 0xFFFF)
        turned = 0 if self._count is None else (counts.encoder - self._count + 0x80000000 & 0xFFFFFFFF) - 0x80000000
        step = turned * self.encoder.scale["shaft_angle"]
        slip = slip if self._count is None else step * self._rate
        self._count, self._angle = counts.encoder, self._angle + step
        shown = self.analog.unpack(analog)
        self._measured = (
            shown.cylinder_pressure, slip, self._angle, shown.oil_temperature, shown.clutch_torque, shown.motor_torque,
        )  # fmt: skip
        return [Frame(self.analog.can_id, analog), Frame(self.encoder.can_id, encoder)], state

    @property
    def motor_torque(self) -> float:
        """As its data acquisition shows it [Nm]."""
        return self._measured[-1]

    def row(self, y: State, demand: float, heat: float) -> tuple[float, ...]:
        """Its part of the record, in the order of `clutch_columns`."""
        return (
            self.voltage, demand, *self._measured[:-1],
            y.valve_pressure / BAR, y.pressure / BAR, y.position, y.normal_force, y.friction_state,
            y.clutch_torque, y.slip_speed, y.temperature - ZERO_CELSIUS, heat,
        )  # fmt: skip
