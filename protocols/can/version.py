"""Version: how the frames of a version of the bench's database are protected, and which signals they carry.

Version 2       sent by the bench: AUTOSAR E2E profile 5, a CRC of 16 bits with a data ID and a counter of 8 bits
Version 1       only read, in old databases and logs: a CRC-8 SAE J1850 over the bytes after it, and a counter of 4 bits
"""

from collections.abc import Callable
from dataclasses import dataclass

from cantools.database.can import Database, Message
from e2e.crc import calculate_crc8
from e2e.p05 import e2e_p05_check, e2e_p05_protect

DATA_ID = "E2EDataId"  # attribute of a frame: its data ID, which is part of the CRC and not sent
LENGTH = 8  # bytes of every frame of version 2: with fewer, more bursts of 16 bits pass (docs/protection.md)
_SHORTEST = 2  # bytes of a frame of version 1: CRC and counter

Carried = dict[str, dict[str, tuple[float, float]]]


@dataclass(frozen=True)
class Version:
    """Protection and signals of a version of the bench's database.

    protection: signals at the beginning of every frame: name, first bit, length [bit]; the first is the CRC, the second the
    counter. lengths: lowest and highest number of bytes of a frame. carried: frame -> signal -> lowest and highest value that
    is sent or measured, in the unit of the database. protect: writes the CRC of a payload with a data ID. check: returns
    whether the CRC is correct.
    """

    number: int
    protection: tuple[tuple[str, int, int], ...]
    lengths: tuple[int, int]
    carried: Carried
    protect: Callable[[bytearray, int], None]
    check: Callable[[bytes, int], bool]

    @property
    def counter_start(self) -> int:
        """First bit of the counter."""
        return self.protection[1][1]

    @property
    def counter_modulus(self) -> int:
        """Number of counter values, after which it wraps."""
        return 1 << self.protection[1][2]

    @property
    def needs_data_id(self) -> bool:
        """Whether the CRC includes a data ID."""
        return self.number > 1


def _protect_1(data: bytearray, _: int) -> None:
    data[0] = calculate_crc8(bytes(data[1:]))


def _check_1(data: bytes, _: int) -> bool:
    return bool(calculate_crc8(data[1:]) == data[0])


def _protect_2(data: bytearray, data_id: int) -> None:
    e2e_p05_protect(data, data_id, length=len(data), increment_counter=False)


def _check_2(data: bytes, data_id: int) -> bool:
    return bool(e2e_p05_check(data, data_id, length=len(data)))


_BIT, _SPEED, _TORQUE, _TICK = (0, 1), (-26.2, 26.2), (-40.0, 40.0), (0, 1023)
# Limits of rt_controller/parameters; the sample's tick has 10 bits; enumerations have these values
_CARRIED_2: Carried = {
    "VALVE_COMMAND": {"VALVE_ENABLE": _BIT, "VALVE_VOLTAGE": (0.0, 4.0), "SAMPLE_TICK": _TICK},
    "MOTOR_COMMAND": {
        "MOTOR_ENABLE": _BIT, "SAMPLE_TICK": (0, 127), "SPEED_DEMAND": _SPEED, "TORQUE_LIMIT": (0.0, 40.0),
    },
    "ANALOG_SENSORS": {
        "CYLINDER_PRESSURE": (0.0, 5.0), "OIL_TEMPERATURE": (0.0, 150.0), "CLUTCH_TORQUE": _TORQUE,
    },
    "ENCODER": {"SHAFT_ANGLE": (-3.14, 3.14), "SAMPLE_TICK": _TICK, "MOTOR_TORQUE": _TORQUE},
    "TORQUE_SETPOINT": {
        "REQUEST": (0, 4), "TORQUE_DEMAND": (0.0, 30.0), "SPEED_DEMAND": _SPEED, "PRESSURE_DEMAND": (0.0, 4.5),
    },
    "CONTROLLER_STATUS": {
        "PHASE": (0, 5), "STICKING": _BIT, "FAULT": (0, 11), "TORQUE_ESTIMATE": (0.0, 30.0), "LATE_CYCLES": (0, 255),
        "FRICTION_LEVEL": (0.5, 1.5),
    },
    "PLANT_STATUS": {"ACTUATORS": (0, 5), "LATE_CYCLES": (0, 255), "REJECTED_FRAMES": (0, 255)},
    "CONTROLLER_HEARTBEAT": {"LIFECYCLE": (0, 3), "RATE": (50, 10_000), "SESSION": (0, 0xFFFF)},
    "PLANT_HEARTBEAT": {"LIFECYCLE": (0, 3), "RATE": (50, 10_000), "SESSION": (0, 0xFFFF)},
}  # fmt: skip
_TICK_1, _SESSION_1 = (0, 0xFFFF), (0, 0xFFFFFFFF)
_CARRIED_1: Carried = _CARRIED_2 | {
    "VALVE_COMMAND": _CARRIED_2["VALVE_COMMAND"] | {"SAMPLE_TICK": _TICK_1},
    "MOTOR_COMMAND": {"MOTOR_ENABLE": _BIT, "SPEED_DEMAND": _SPEED, "TORQUE_LIMIT": (0.0, 40.0)},
    "ANALOG_SENSORS": {
        "CYLINDER_PRESSURE": (0.0, 5.0), "OIL_TEMPERATURE": (0.0, 150.0), "MOTOR_TORQUE": _TORQUE, "CLUTCH_TORQUE": _TORQUE,
    },
    "ENCODER": {"SHAFT_ANGLE": (-3.14, 3.14), "SAMPLE_TICK": _TICK_1},
    "CONTROLLER_STATUS": _CARRIED_2["CONTROLLER_STATUS"] | {"FAULT": (0, 7)},
    "PLANT_STATUS": _CARRIED_2["PLANT_STATUS"] | {"ACTUATORS": (0, 2)},
    "CONTROLLER_HEARTBEAT": _CARRIED_2["CONTROLLER_HEARTBEAT"] | {"SESSION": _SESSION_1},
    "PLANT_HEARTBEAT": _CARRIED_2["PLANT_HEARTBEAT"] | {"SESSION": _SESSION_1},
}  # fmt: skip

VERSION_1 = Version(1, (("CRC", 0, 8), ("COUNTER", 8, 4)), (_SHORTEST, LENGTH), _CARRIED_1, _protect_1, _check_1)
VERSION_2 = Version(2, (("CRC", 0, 16), ("COUNTER", 16, 8)), (LENGTH, LENGTH), _CARRIED_2, _protect_2, _check_2)


def find_version(database: Database) -> Version:
    """Return the version of a database: 1 if most of the bench's frames have the protection signals of version 1, else 2."""
    frames = [message for message in database.messages if message.name in VERSION_2.carried]
    old = [message for message in frames if _read_protection(message) == {*VERSION_1.protection}]
    return VERSION_1 if len(old) > len(frames) / 2 else VERSION_2


def _read_protection(message: Message) -> set[tuple[str, int, int]]:
    """Return name, first bit and length [bit] of the protection signals of a frame."""
    names = [name for name, _, _ in VERSION_1.protection]
    return {(signal.name, signal.start, signal.length) for signal in message.signals if signal.name in names}
