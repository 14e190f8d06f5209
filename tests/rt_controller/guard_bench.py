"""Test bench of the guard: frames are encoded by cantools, protected by the e2e library."""

from functools import lru_cache
from types import ModuleType
from typing import Any

import cantools.database
import numpy as np
from e2e.p05 import e2e_p05_check, e2e_p05_protect

from protocols.can.frames import DBC
from protocols.files.parameters import load_defaults
from rt_controller.law.record import make_record
from rt_controller.loop.parameter_sets import LIMITS

PERIOD = 1e-3  # s
STALE, CONFIRM = 5, 3  # cycles, samples: limits.toml
VALVE_LIMIT, MOTOR_LIMIT = 26214, 40000  # counts: 4 V of 16 bit over 10 V, 40 Nm of 1 mNm
PRESSURE_LIMIT, TEMPERATURE_LIMIT = 1024, 1536  # counts: 5 bar at 4.88 mbar, 150 degC at 0.0977 K
TURN_LIMIT = 818  # counts a tick: 31.4 rad/s x 1 ms x 26075.9 counts/rad = 818.8
NOMINAL = load_defaults(LIMITS).list_si("guard")

DATABASE: Any = cantools.database.load_file(DBC)
IDENTIFIERS = {message.name: message.frame_id for message in DATABASE.messages}
IDLE, ENGAGE, RELEASE = range(3)


def read_data_id(message: Any) -> int:
    """Data ID of a message of cantools."""
    return int(message.dbc.attributes["E2EDataId"].value)


def protect(body: bytes, number: int) -> bytes:
    """Return a payload, in which the counter is set, with the CRC of the e2e library for the data ID `number`."""
    data = bytearray(body)
    e2e_p05_protect(data, number, length=len(data), increment_counter=False)
    return bytes(data)


@lru_cache(maxsize=4096)
def encode(name: str, counter: int, signals: tuple[tuple[str, int], ...], offset: int) -> bytes:
    """Return the payload of a frame with raw values, from cantools; `offset` is added to its data ID."""
    message = DATABASE.get_message_by_name(name)
    values = {signal.name: 0 for signal in message.signals} | dict(signals) | {"COUNTER": counter & 255}
    return protect(message.encode(values, scaling=False, strict=False), read_data_id(message) + offset)


def make_frame(name: str, counter: int = 0, offset: int = 0, **signals: int) -> bytes:
    return encode(name, counter, tuple(signals.items()), offset)


def decode(name: str, data: bytes, offset: int = 0) -> Any:
    message = DATABASE.get_message_by_name(name)
    assert len(data) == message.length
    assert e2e_p05_check(data, read_data_id(message) + offset, length=len(data)), (
        "every command on the bus has a valid CRC"
    )
    return message.decode(data, decode_choices=False, scaling=False)


class Guard:
    """The functions of a guard module on records of their own; frames are bytes."""

    def __init__(self, limits: ModuleType, offset: int = 0, **changed: float) -> None:
        self._module = limits
        self._limits = make_record(limits.LIMITS, limits.make_guard_limits(NOMINAL | changed, PERIOD, offset))
        self._guard = make_record(limits.GUARD)

    def check_inbound(self, can_id: int, data: bytes) -> None:
        self._module.check_inbound(
            self._guard, self._limits, can_id, np.frombuffer(data.ljust(8, b"\0"), np.uint8), len(data)
        )

    def run_cycle(self, slots: int = 1) -> int:
        return int(self._module.close_cycle(self._guard, self._limits, slots))

    def limit_outbound(self, can_id: int, data: bytes) -> bytes:
        command = np.frombuffer(data.ljust(8, b"\0"), np.uint8).copy()
        self._module.limit_outbound(self._guard, self._limits, can_id, command)
        return command[: len(data)].tobytes()

    def __getattr__(self, name: str) -> int:
        return int(getattr(self._guard, name))


class Bench:
    """A guard with frames of a bus."""

    def __init__(self, limits: ModuleType, **changed: float) -> None:
        self.guard = Guard(limits, **changed)
        self.counters = dict.fromkeys(IDENTIFIERS, 0)
        self.angle, self.tick = 1000, 100

    def send(self, name: str, **signals: int) -> None:
        self.counters[name] += 1
        self.guard.check_inbound(IDENTIFIERS[name], make_frame(name, self.counters[name], **signals))

    def send_analog(self, pressure: int = 700, temperature: int = 717) -> None:
        self.send("ANALOG_SENSORS", CYLINDER_PRESSURE=pressure, OIL_TEMPERATURE=temperature)

    def send_encoder(self, turned: int = 500, ticks: int = 1, torque: int = 400) -> None:
        self.angle = (self.angle + turned + 0x20000) % 0x40000 - 0x20000
        self.tick = (self.tick + ticks) % 0x400
        self.send("ENCODER", SHAFT_ANGLE=self.angle, SAMPLE_TICK=self.tick, MOTOR_TORQUE=torque)

    def run_cycle(
        self, pressure: int = 700, temperature: int = 717, turned: int = 500, ticks: int = 1, torque: int = 400
    ) -> int:
        """Run a cycle with a new sample of raw values; return the finding."""
        self.send_analog(pressure, temperature)
        self.send_encoder(turned, ticks, torque)
        return self.guard.run_cycle()

    def run_silent(self, cycles: int) -> int:
        for _ in range(cycles):
            self.guard.run_cycle()
        return self.guard.finding

    def ask(self, request: int) -> None:
        self.send("TORQUE_SETPOINT", REQUEST=request, TORQUE_DEMAND=1000)

    def command_valve(self, counts: int = 9000, enable: int = 1, counter: int = 5, tick: int = 0x234) -> Any:
        command = make_frame("VALVE_COMMAND", counter, VALVE_ENABLE=enable, VALVE_VOLTAGE=counts, SAMPLE_TICK=tick)
        return decode("VALVE_COMMAND", self.guard.limit_outbound(IDENTIFIERS["VALVE_COMMAND"], command))

    def command_motor(
        self, speed: int = -20000, torque: int = 30000, enable: int = 1, counter: int = 5, tick: int = 0x34
    ) -> Any:
        signals = {"MOTOR_ENABLE": enable, "SAMPLE_TICK": tick, "SPEED_DEMAND": speed, "TORQUE_LIMIT": torque}
        command = make_frame("MOTOR_COMMAND", counter, **signals)
        return decode("MOTOR_COMMAND", self.guard.limit_outbound(IDENTIFIERS["MOTOR_COMMAND"], command))

    @property
    def open(self) -> bool:
        return bool(self.command_valve()["VALVE_ENABLE"])
