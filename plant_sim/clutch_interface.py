"""One clutch between rig and bus: the commands of its controller in, its sensor frames out."""

from typing import NamedTuple

from plant_sim.blocks import dac
from plant_sim.blocks.sensors import Sensors
from plant_sim.rigs.wet_clutch import Rig, State, Whole
from protocols.errors import InputError
from protocols.frames import Frame, load_frames
from protocols.lifecycle import Lifecycle
from protocols.parameters import ParameterSet
from protocols.reception import Reception

STALE_CYCLES = (
    5  # cycles without a valve command that close the valve's amplifier: as long as the controller's guard waits
)


class Measured(NamedTuple):
    """What the data acquisition shows of a clutch, as the columns of rig.md."""

    pressure: float  # bar
    slip_speed: float  # rad/s, from encoder counts
    angle: float  # rad, of the encoder since the start
    temperature: float  # degC
    clutch_torque: float  # Nm
    motor_torque: float  # Nm


class ClutchInterface:
    """A clutch on the bus, with its data acquisition; rate [Hz], `seed` of the sensors' noise, `sender` for messages.

    `answered_tick` (SAMPLE_TICK of the last valve command), `controller` and `commanded` tell of its controller; `voltage` [V]
    is at its valve. The measured slip is the encoder's difference over a period; in the first sample, where there is none yet,
    it is the true one.
    """

    def __init__(
        self, rate: int, parameters: ParameterSet, seed: int, clutch: str = "a", sender: str = "the controller"
    ) -> None:
        frames = load_frames(clutch=clutch)
        self.clutch = clutch
        self.analog, self.encoder, self.setpoint = (
            frames[name] for name in ("ANALOG_SENSORS", "ENCODER", "TORQUE_SETPOINT")
        )
        commands = frames["VALVE_COMMAND"], frames["CONTROLLER_HEARTBEAT"]
        self.receptions = {codec.can_id: Reception(codec) for codec in commands}
        self._valve_id, _ = self.receptions
        self.own = {codec.can_id: codec.name for codec in (self.analog, self.encoder)}
        self.voltage = 0.0
        self.answered_tick = -1
        self.controller = Lifecycle.UNCONFIGURED
        self.age, self.commanded = 0, False  # cycles since the last valve command
        self.measured = Measured(0.0, 0.0, 0.0, 0.0, 0.0, 0.0)
        self._rate, self._sensors, self._sender = rate, Sensors(seed), sender
        self._dac = parameters["sensors.dac_range"].value, int(parameters["sensors.dac_bits"].value)
        self._angle_step = self.encoder.scale["shaft_angle"]  # rad
        self._count: int | None = None

    def receive(self, can_id: int, data: bytes) -> None:
        """Take a command or a heartbeat of its controller. Raises InputError for another rate or protocol."""
        reception = self.receptions[can_id]
        if not reception.accept(data):
            return
        values = reception.codec.unpack(data)
        if can_id == self._valve_id:
            self.voltage = dac.voltage(values.valve_voltage, *self._dac) if values.valve_enable else 0.0
            self.answered_tick, self.age, self.commanded = values.sample_tick, 0, True
        elif values.rate != self._rate:
            raise InputError(
                f"{self._sender} runs at {values.rate} Hz, this plant at {self._rate} Hz: give both one rate"
            )
        elif values.lifecycle > Lifecycle.FINALIZED:
            raise InputError(f"lifecycle {values.lifecycle} of {self._sender} is unknown; allowed are 0 to 3")
        else:
            self.controller = Lifecycle(values.lifecycle)

    @property
    def stale(self) -> bool:
        """Whether commands have come and come no more."""
        return self.commanded and self.age >= STALE_CYCLES

    def slept(self, periods: int) -> None:
        """The machine has slept through `periods`: they age the command by one at most, as its sender may have slept, too."""
        self.age -= max(periods - 1, 0)

    def sample(self, tick: int, rig: Rig, state: Whole, y: State) -> tuple[list[Frame], Whole]:
        """Sensor frames of `tick`, and the state with those of its effects moved on; `y` is what `state` reads."""
        if self.stale:
            self.voltage = 0.0
        self.age += 1
        counts, state = self._sensors.sample(rig, state, 1.0 / self._rate, y)
        analog = self.analog.pack_raw(tick, *counts[:4])
        encoder = self.encoder.pack_raw(tick, counts.encoder, tick & 0xFFFF)
        turned, slip_speed = 0.0, y.slip_speed
        if self._count is not None:
            turned = ((counts.encoder - self._count + 0x80000000 & 0xFFFFFFFF) - 0x80000000) * self._angle_step
            slip_speed = turned * self._rate
        self._count = counts.encoder
        shown = self.analog.unpack(analog)
        self.measured = Measured(
            shown.cylinder_pressure, slip_speed, self.measured.angle + turned,
            shown.oil_temperature, shown.clutch_torque, shown.motor_torque,
        )  # fmt: skip
        return [Frame(self.analog.can_id, analog), Frame(self.encoder.can_id, encoder)], state
