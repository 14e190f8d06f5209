"""Interface: what is between the bus and the clutches of a rig: commands in, the frames of a sample out.

Decoding, checks, data acquisition and encoding are compiled calls on records, as the controller's cycle is.
"""

from abc import ABC, abstractmethod
from collections.abc import Sequence
from enum import IntEnum
from typing import Any

import numpy as np
from numba import njit

from plant_sim.blocks import dac
from plant_sim.blocks.sensors import acquire
from plant_sim.profile import setpoint
from plant_sim.rigs.wet_clutch import Rig, Whole
from protocols.batch import batch, load, unload, word_of, write
from protocols.errors import InputError
from protocols.frames import Frame, FrameCodec, load_frames
from protocols.lifecycle import Lifecycle
from protocols.node import Column
from protocols.parameters import ParameterSet
from protocols.reception import RECEPTION, accepted, counted, receptions
from protocols.two_clutches import CLUTCHES
from protocols.words import SIGNAL, put, put_raw, raw, sealed, signals, value

# cycles without a valve command that close the valve's amplifier: as long as the controller's guard waits
STALE_CYCLES = 5
INBOX = 4096  # frames at once; more are given in parts
OUTBOX = 8  # frames of a sample at most: heartbeat, status, and of each of two clutches set-point, sensors, encoder
_SHORT, _LONG = 6, 8  # bytes of PLANT_STATUS, and of all else that a plant sends
_WRAP = 1 << 32  # counts of the encoder's counter
_TICK = 0xFFFF  # mask of the sample's number in a frame
_COUNT_MAX = 65535  # end of what PLANT_STATUS can count
_BLOCK = 64  # samples of which noise is drawn at once, as by blocks/sensors.py, whose stream it is
_NO_FRAME = -1  # an identifier that no frame has
_CODECS = (
    "VALVE_COMMAND", "MOTOR_COMMAND", "ANALOG_SENSORS", "ENCODER", "TORQUE_SETPOINT",
    "CONTROLLER_HEARTBEAT", "PLANT_STATUS", "PLANT_HEARTBEAT",
)  # fmt: skip


class Refusal(IntEnum):
    """Why a bus cannot be worked on."""

    SECOND_PLANT = 1
    LENGTH = 2
    RATE = 3
    LIFECYCLE = 4


# A clutch on the bus. voltage [V] at its valve; answered_tick: SAMPLE_TICK of the last valve command, -1 before the first;
# controller: Lifecycle of its controller; age: cycles since the last valve command, if one has come (commanded); what the data
# acquisition shows [bar, rad/s, rad, degC, Nm, Nm], slip_speed as the difference of encoder counts, once there are two
CLUTCH = np.dtype(
    [("voltage", "f8"), ("answered_tick", "i8"), ("controller", "i8"), ("age", "i8"), ("commanded", "?"),
     ("torque_demand", "f8"), ("begun", "?"), ("count", "i8"), ("pressure", "f8"), ("slip_speed", "f8"), ("angle", "f8"),
     ("temperature", "f8"), ("clutch_torque", "f8"), ("motor_torque", "f8"), ("valve", RECEPTION), ("heartbeat", RECEPTION)]
)  # fmt: skip
_CLUTCH_SETTINGS = np.dtype(
    [("dac_range", "f8"), ("dac_bits", "i8"), ("analog_id", "i8"), ("encoder_id", "i8"), ("setpoint_id", "i8")]
)
# refused_...: why the bus cannot be worked on, which of its clutches says so
INTERFACE = np.dtype(
    [("speed_demand", "f8"), ("torque_limit", "f8"), ("beats", "i8"), ("refused_id", "i8"), ("refused_value", "i8"),
     ("refused_clutch", "i8"), ("motor", RECEPTION), ("clutches", CLUTCH, (len(CLUTCHES),))]
)  # fmt: skip
SETTINGS = np.dtype(
    [("rate", "i8"), ("period", "f8"), ("session", "i8"), ("count", "i8"), ("own", "i8", (OUTBOX,)),
     ("status_id", "i8"), ("heartbeat_id", "i8"), ("status_every", "i8"), ("heartbeat_every", "i8"), ("angle_step", "f8"),
     ("valve_command", SIGNAL, (3,)), ("motor_command", SIGNAL, (3,)), ("analog_sensors", SIGNAL, (4,)),
     ("encoder", SIGNAL, (2,)), ("torque_setpoint", SIGNAL, (4,)), ("controller_heartbeat", SIGNAL, (3,)),
     ("plant_status", SIGNAL, (3,)), ("plant_heartbeat", SIGNAL, (3,)), ("clutches", _CLUTCH_SETTINGS, (len(CLUTCHES),))]
)  # fmt: skip
_dac, _setpoint = njit(dac.voltage), njit(setpoint)


class Interface(ABC):
    """The clutches of a rig on the bus: the base of its node, which moves them and tells of them.

    rate [Hz]; `parameters`, `seeds` of the sensors' noise: one of each clutch; `session` tells two plants apart; `setpoints`
    are the tables of the clutches' profiles, shape (clutches, 4, rows), see `profile.setpoint`, or (0, 4, 0).

    Of the last sample `tick` is the number, -1 before the first, `outbox` holds the frames, shape (OUTBOX,) of batch.FRAME, and
    `record` the row, shape (columns,).
    """

    columns: tuple[Column, ...]

    def __init__(
        self, rate: int, parameters: Sequence[ParameterSet], seeds: Sequence[int], session: int, setpoints: np.ndarray
    ) -> None:
        self.rate, self.tick = rate, -1
        self.late_cycles = 0  # set by the service for PLANT_STATUS
        self.outbox, self.record = batch(OUTBOX), np.zeros(len(self.columns))
        self._period, self._session, self._setpoints = 1.0 / rate, session, setpoints
        self._names = CLUTCHES[: len(parameters)]
        self._inbox = batch(INBOX)
        self._interfaces, self._settings = np.zeros(1, INTERFACE), np.zeros(1, SETTINGS)
        self._interface = self._interfaces.view(np.recarray)[0]
        self._generators = [np.random.default_rng(seed) for seed in seeds]
        self._noise = np.zeros((len(seeds), _BLOCK, 4))
        by_clutch = [load_frames(clutch=name) for name in self._names]
        self._connect(by_clutch, parameters)

    def _connect(self, by_clutch: Sequence[dict[str, FrameCodec]], parameters: Sequence[ParameterSet]) -> None:
        """Fill records and settings for the frames of each clutch."""
        frames, interface = by_clutch[0], self._interface
        fixed = self._settings.view(np.recarray)[0]
        for name in _CODECS:
            setattr(fixed, name.lower(), signals(frames[name]))
        self._heartbeat, status = frames["PLANT_HEARTBEAT"], frames["PLANT_STATUS"]
        self.heartbeat_period = self._heartbeat.cycle_time  # s
        own = [self._heartbeat, status]
        self._heard = [frames["MOTOR_COMMAND"]]
        for k, (codecs, of_clutch) in enumerate(zip(by_clutch, parameters, strict=True)):
            clutch, its = interface.clutches[k], fixed.clutches[k]
            heard = [codecs["VALVE_COMMAND"], codecs["CONTROLLER_HEARTBEAT"]]
            clutch.valve, clutch.heartbeat = receptions(heard)
            clutch.answered_tick = -1
            its.dac_range, its.dac_bits = of_clutch["sensors.dac_range"].value, int(of_clutch["sensors.dac_bits"].value)
            sensors = codecs["ANALOG_SENSORS"], codecs["ENCODER"]
            its.analog_id, its.encoder_id = (codec.can_id for codec in sensors)
            its.setpoint_id = codecs["TORQUE_SETPOINT"].can_id
            own += sensors
            self._heard += heard
        interface.motor = receptions(self._heard[:1])[0]
        self._own = {codec.can_id: codec.name for codec in own}
        fixed.own = [*self._own, *[_NO_FRAME] * (OUTBOX - len(self._own))]
        fixed.rate, fixed.period, fixed.session, fixed.count = self.rate, self._period, self._session, len(self._names)
        fixed.status_id, fixed.heartbeat_id = status.can_id, self._heartbeat.can_id
        fixed.status_every = max(1, round(status.cycle_time * self.rate))
        fixed.heartbeat_every = max(1, round(self.heartbeat_period * self.rate))
        fixed.angle_step = frames["ENCODER"].scale["shaft_angle"]  # rad

    @abstractmethod
    def show(self) -> int:
        """The frames of the present tick to the outbox: heartbeat, status, set-points, sensors; return their number."""

    @abstractmethod
    def advance(self) -> None:
        """Let the rig run for one period with the inputs held."""

    def step(self, inbox: Sequence[Frame]) -> list[Frame]:
        """One sample, and on by a period. Raises InputError when the bus has a second plant or speaks another protocol."""
        self.receive(inbox)
        frames = self.sample()
        self.advance()
        return frames

    def sample(self) -> list[Frame]:
        """The frames of the present tick as objects; see `show`."""
        return unload(self.outbox[: self.show()])

    def row(self) -> tuple[float, ...]:
        """The record of the last sample, in the order of `columns`."""
        return tuple(self.record.tolist())

    def receive(self, inbox: Sequence[Frame]) -> None:
        """Take commands; they act from the next sample on. Raises InputError as `take`."""
        self.take(self._inbox, load(self._inbox, inbox))

    def take(self, inbox: np.ndarray, count: int) -> None:
        """The same with the first `count` frames of a batch.

        Raises InputError when the bus has a second plant, another rate or another protocol.
        """
        if why := take(self._interfaces, self._settings, inbox, count):
            raise InputError(self._refusal(Refusal(why)))

    def slept(self, periods: int) -> None:
        """The machine has slept through `periods`, whose samples come now, at once: nobody could answer them.

        They age commands by one at most, as the controller may have slept, too.
        """
        if periods > 1:
            self._interfaces["clutches"]["age"] -= periods - 1

    def heartbeat(self, lifecycle: Lifecycle) -> Frame:
        """The next heartbeat."""
        self._interface.beats += 1
        data = self._heartbeat.pack(int(self._interface.beats), lifecycle, self.rate, self._session)
        return Frame(self._heartbeat.can_id, data)

    def safe(self) -> list[Frame]:
        """A plant commands nothing: it says that it ends."""
        return [self.heartbeat(Lifecycle.FINALIZED)]

    @property
    def answered_tick(self) -> int:
        """SAMPLE_TICK that every controller has answered, of those that have not ended; -1 while they differ."""
        clutches = self._clutches()
        ticks = {
            int(c["answered_tick"]) for c in clutches if c["controller"] != Lifecycle.FINALIZED or len(clutches) == 1
        }
        return ticks.pop() if len(ticks) == 1 else -1

    @property
    def controller(self) -> Lifecycle:
        """The state of all controllers, inactive while theirs differ: active once all are, finalized when all have ended."""
        states = {int(clutch["controller"]) for clutch in self._clutches()}
        return Lifecycle(states.pop()) if len(states) == 1 else Lifecycle.INACTIVE

    def reception_counts(self) -> dict[str, dict[str, int]]:
        """Counts of `protocols.reception.Reception` by frame name."""
        rows = [self._interfaces[0]["motor"]]
        for clutch in self._clutches():
            rows += [clutch["valve"], clutch["heartbeat"]]
        return {codec.name: counted(row) for codec, row in zip(self._heard, rows, strict=True)}

    def _clutches(self) -> np.ndarray:
        """Records of the clutches, shape (clutches,) of CLUTCH."""
        rows: np.ndarray = self._interfaces[0]["clutches"][: len(self._names)]
        return rows

    def _begin(self) -> int:
        """Go on to the next tick; frames of the plant itself and of the supervisor to the outbox: return their number."""
        self.tick += 1
        sent: int = begin(self._interfaces, self._settings, self.tick, self.late_cycles, self._setpoints, self.outbox)
        return sent

    def _show(self, k: int, rig: Rig, whole: Whole, sent: int) -> int:
        """Sensor frames of clutch `k` to the outbox behind `sent` others; its effects' states move on. Return their number."""
        if not self.tick % _BLOCK:
            self._generators[k].standard_normal(out=self._noise[k])
        noise = self._noise[k, self.tick % _BLOCK]
        shown: int = show(
            self._interfaces,
            self._settings,
            k,
            self.tick,
            *whole,
            noise,
            rig.record,
            rig.table.kernel,
            self.outbox,
            sent,
        )
        return shown

    def _refusal(self, why: Refusal) -> str:
        """What an unusable bus said, in a sentence."""
        can_id, said = int(self._interface.refused_id), int(self._interface.refused_value)
        if why is Refusal.SECOND_PLANT:
            return f"a second plant is on the bus: it sends {self._own[can_id]} (0x{can_id:03X})"
        if why is Refusal.LENGTH:
            (codec,) = (codec for codec in self._heard if codec.can_id == can_id)
            return f"frame {codec.name} (0x{can_id:03X}) came with {said} bytes; its definition has {codec.length}"
        clutch = f" of clutch {self._names[self._interface.refused_clutch]}" if len(self._names) > 1 else ""
        if why is Refusal.RATE:
            return f"the controller{clutch} runs at {said} Hz, this plant at {self.rate} Hz: give both one rate"
        return f"lifecycle {said} of the controller{clutch} is unknown; allowed are 0 to 3"


@njit(cache=True, nogil=True)
def take(interfaces: Any, all_settings: Any, inbox: Any, count: Any) -> Any:
    """Take the first `count` frames of `inbox`, up to one that is refused; return the Refusal, 0 where there is none."""
    for index in range(count):
        why = _receive(interfaces[0], all_settings[0], inbox[index])
        if why != 0:
            return why
    return 0


@njit
def _receive(interface, settings, frame):
    """Take one frame; return the Refusal, 0 where there is none."""
    can_id, length = np.int64(frame.can_id), np.int64(frame.length)
    for own in settings.own:
        if can_id == own:
            return _refuse(interface, Refusal.SECOND_PLANT, can_id, 0, 0)
    word = word_of(frame.data)
    if can_id == interface.motor.can_id:
        if length != interface.motor.length:
            return _refuse(interface, Refusal.LENGTH, can_id, length, 0)
        if accepted(interface.motor, word, length):
            s = settings.motor_command
            on = raw(word, s[0]) != 0
            interface.speed_demand = value(word, s[1]) if on else 0.0
            interface.torque_limit = value(word, s[2]) if on else 0.0
        return 0
    for k in range(settings.count):
        clutch = interface.clutches[k]
        if can_id == clutch.valve.can_id:
            if length != clutch.valve.length:
                return _refuse(interface, Refusal.LENGTH, can_id, length, k)
            if accepted(clutch.valve, word, length):
                s, its = settings.valve_command, settings.clutches[k]
                on = raw(word, s[0]) != 0
                clutch.voltage = _dac(value(word, s[1]), its.dac_range, its.dac_bits) if on else 0.0
                clutch.answered_tick, clutch.age, clutch.commanded = raw(word, s[2]), 0, True
        elif can_id == clutch.heartbeat.can_id:
            if length != clutch.heartbeat.length:
                return _refuse(interface, Refusal.LENGTH, can_id, length, k)
            if accepted(clutch.heartbeat, word, length):
                s = settings.controller_heartbeat
                lifecycle, rate = raw(word, s[0]), raw(word, s[1])
                if rate != settings.rate:
                    return _refuse(interface, Refusal.RATE, can_id, rate, k)
                if lifecycle > Lifecycle.FINALIZED.value:
                    return _refuse(interface, Refusal.LIFECYCLE, can_id, lifecycle, k)
                clutch.controller = lifecycle
    return 0


@njit
def _refuse(interface, why, can_id, said, k):
    interface.refused_id, interface.refused_value, interface.refused_clutch = can_id, said, k
    return why.value


@njit(cache=True, nogil=True)
def begin(interfaces: Any, all_settings: Any, tick: Any, late_cycles: Any, setpoints: Any, outbox: Any) -> Any:
    """Frames of the plant itself and of the supervisor at `tick`; return their number. Nobody's command drives no motor."""
    interface, settings, sent = interfaces[0], all_settings[0], 0
    if _stale(interface.clutches[0]):
        interface.speed_demand = interface.torque_limit = 0.0
    if tick % settings.heartbeat_every == 0:
        s = settings.plant_heartbeat
        interface.beats += 1
        word = put(put(put(np.int64(0), s[0], Lifecycle.ACTIVE.value), s[1], settings.rate), s[2], settings.session)
        write(outbox[sent], settings.heartbeat_id, _LONG, sealed(word, _LONG, interface.beats))
        sent += 1
    if tick % settings.status_every == 0:
        s = settings.plant_status
        actuators, rejected = 0, interface.motor.corrupt + interface.motor.repeated
        for k in range(settings.count):
            clutch = interface.clutches[k]
            if clutch.commanded:
                actuators = max(actuators, 2 if _stale(clutch) else 1)
            rejected += clutch.valve.corrupt + clutch.valve.repeated
            rejected += clutch.heartbeat.corrupt + clutch.heartbeat.repeated
        word = put(put(np.int64(0), s[0], actuators), s[1], min(late_cycles, _COUNT_MAX))
        word = put(word, s[2], min(rejected, _COUNT_MAX))
        write(outbox[sent], settings.status_id, _SHORT, sealed(word, _SHORT, tick // settings.status_every))
        sent += 1
    s, time = settings.torque_setpoint, tick * settings.period
    for k in range(len(setpoints)):
        request, torque, speed, pressure = _setpoint(setpoints[k], time)
        interface.clutches[k].torque_demand = torque
        word = put(put(put(put(np.int64(0), s[0], request), s[1], torque), s[2], speed), s[3], pressure)
        write(outbox[sent], settings.clutches[k].setpoint_id, _LONG, sealed(word, _LONG, tick))
        sent += 1
    return sent


@njit(cache=True, nogil=True)
def show(
    interfaces: Any, all_settings: Any, k: Any, tick: Any, y: Any, states: Any, noise: Any, parameters: Any, effects: Any,
    outbox: Any, sent: Any,
) -> Any:  # fmt: skip
    """Sensor frames of clutch `k`, the encoder's last: it completes the sample; return the number of frames in `outbox`.

    Rig, noise (4,) and effects as of `sensors.acquire`; `states` move on in place.
    """
    settings = all_settings[0]
    clutch, its = interfaces[0].clutches[k], settings.clutches[k]
    if _stale(clutch):
        clutch.voltage = 0.0
    clutch.age += 1
    (pressure, temperature, motor_torque, clutch_torque, count), after = acquire(
        y, states, noise, parameters, effects, settings.period
    )
    states[:] = after
    s = settings.analog_sensors
    word = put_raw(put_raw(np.int64(0), s[0], pressure), s[1], temperature)
    word = put_raw(put_raw(word, s[2], motor_torque), s[3], clutch_torque)
    write(outbox[sent], its.analog_id, _LONG, sealed(word, _LONG, tick))
    clutch.pressure, clutch.temperature = value(word, s[0]), value(word, s[1])
    clutch.motor_torque, clutch.clutch_torque = value(word, s[2]), value(word, s[3])
    turned, clutch.slip_speed = 0.0, y[0].slip_speed  # in the first sample the true one
    if clutch.begun:
        turned = ((count - clutch.count + _WRAP // 2) % _WRAP - _WRAP // 2) * settings.angle_step
        clutch.slip_speed = turned * settings.rate
    clutch.begun, clutch.count = True, count
    clutch.angle += turned
    s = settings.encoder
    word = put_raw(put_raw(np.int64(0), s[0], count), s[1], tick & _TICK)
    write(outbox[sent + 1], its.encoder_id, _LONG, sealed(word, _LONG, tick))
    return sent + 2


@njit
def _stale(clutch):
    """Whether commands have come and come no more."""
    return clutch.commanded and clutch.age >= STALE_CYCLES
