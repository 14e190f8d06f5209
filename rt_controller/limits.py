"""Guard: watchdog and limiter between controller and bus.

It sees the frames themselves, in both directions, and shares no code with the controller: own layout of the frames
(held to the DBC by a test), own CRC table, own limits (`limits.toml`), in raw counts. It lets a command pass, lowers it
to the limit, or replaces it by the safe command: valve closed, motor off. What it finds is one of the codes below.
It is latched until the cause is gone and the supervisor asks for idle.
"""

import struct
from dataclasses import dataclass

HEALTHY, STALE_SENSORS, OVERPRESSURE, OVERTEMPERATURE, OVERSPEED = range(5)

VALVE_COMMAND, MOTOR_COMMAND, ANALOG_SENSORS, ENCODER, TORQUE_SETPOINT = 0x080, 0x090, 0x100, 0x101, 0x180
_INBOUND_BYTES = {ANALOG_SENSORS: 8, ENCODER: 8, TORQUE_SETPOINT: 8}
_PRESSURE_COUNTS = 4096 / 20.0 / 1e5  # 1/Pa: 12 bit over 20 V, 1 V/bar
_TEMPERATURE_COUNTS = 4096 / 20.0 * 0.05  # 1/K: 12 bit over 20 V, 0.05 V/degC, zero at 0 degC
_ANGLE_COUNTS = 163840 / 6.283185307179586  # 1/rad
_VALVE_COUNTS = 65536 / 10.0  # 1/V
_MOTOR_COUNTS = 1000.0  # 1/Nm
_CRC_TABLE = []
for _byte in range(256):
    for _ in range(8):
        _byte = (_byte << 1) ^ (0x11D if _byte & 0x80 else 0)  # SAE J1850 polynomial x^8 + x^4 + x^3 + x^2 + 1
    _CRC_TABLE.append(_byte)


def crc8(data: bytes) -> int:
    """CRC-8 SAE J1850 of `data`: start 0xFF, final xor 0xFF."""
    crc = 0xFF
    for byte in data:
        crc = _CRC_TABLE[crc ^ byte]
    return crc ^ 0xFF


@dataclass(frozen=True)
class Limits:
    """SI units, names as in `limits.toml`."""

    stale_cycles: float
    confirm_samples: float
    pressure: float
    temperature: float
    slip_speed: float
    voltage: float
    motor_torque: float


class Guard:
    """One instance between one controller and its bus, working at `period` [s].

    `offset` is added to the identifiers, for the second of two clutches. `finding` is HEALTHY or the latched cause; `age`
    counts cycles since the last believable sample; `lowered` counts commands cut to the limit, `replaced` commands replaced
    by the safe one.
    """

    def __init__(self, limits: Limits, period: float, offset: int = 0) -> None:
        self.finding = HEALTHY
        self._offset = offset
        self.age = 0
        self.lowered = self.replaced = 0
        self._stale = limits.stale_cycles
        self._confirm = limits.confirm_samples
        self._pressure = limits.pressure * _PRESSURE_COUNTS
        self._temperature = (limits.temperature - 273.15) * _TEMPERATURE_COUNTS
        self._slip = limits.slip_speed * _ANGLE_COUNTS * period  # counts a tick
        self._valve = int(limits.voltage * _VALVE_COUNTS)
        self._motor = int(limits.motor_torque * _MOTOR_COUNTS)
        self._armed = False  # no sample yet: valve closed, motor off; after the first, samples must not fail
        self._slept = 0  # periods slept through before a cycle without a sample
        self._analog = self._encoder = False  # seen since the last cycle
        self._counters: dict[int, int] = {}
        self._angle = self._tick = -1
        self._broken = {OVERPRESSURE: 0, OVERTEMPERATURE: 0, OVERSPEED: 0}

    def inbound(self, can_id: int, data: bytes) -> None:
        """Look at a frame from the bus."""
        can_id -= self._offset
        if len(data) != _INBOUND_BYTES.get(can_id) or crc8(data[1:]) != data[0]:
            return
        counter = data[1] & 15
        if self._counters.get(can_id) == counter:
            return  # a stuck sender is no sample
        self._counters[can_id] = counter
        if can_id == ANALOG_SENSORS:
            self._analog = True
            word = int.from_bytes(data, "little")
            self._judge(OVERPRESSURE, _signed12(word >> 12) > self._pressure)
            self._judge(OVERTEMPERATURE, _signed12(word >> 24) > self._temperature)
        elif can_id == ENCODER:
            self._encoder = True
            angle, tick = struct.unpack_from("<iH", data, 2)
            if self._tick >= 0:
                ticks = (tick - self._tick) & 0xFFFF
                turned = (angle - self._angle + 0x80000000 & 0xFFFFFFFF) - 0x80000000
                self._judge(OVERSPEED, abs(turned) > self._slip * ticks)
            self._angle, self._tick = angle, tick
        elif data[1] >> 4 == 0 and self.age == 0 and not any(self._broken.values()):
            self.finding = HEALTHY  # the supervisor asks for idle and the cause is gone

    def cycle(self, slots: int = 1) -> int:
        """Close a control cycle that took `slots` periods: age the sample, return the finding.

        Periods the loop has slept through age the sample only when the cycle after them has none either: what stood
        still may have been the machine, sensors and all, and their frames are on the way.
        """
        if self._analog and self._encoder:
            self._armed, self.age, self._slept = True, 0, 0
        else:
            self.age += 1 + self._slept
            self._slept = slots - 1
        self._analog = self._encoder = False
        if self._armed and self.age > self._stale and not self.finding:
            self.finding = STALE_SENSORS
        return self.finding

    def outbound(self, can_id: int, data: bytes) -> bytes:
        """The payload that may go to the bus instead of `data`."""
        if can_id == VALVE_COMMAND + self._offset:
            counts = data[2] | data[3] << 8
            if self.finding or not self._armed or not data[1] & 0x10:
                if counts or data[1] & 0x10:
                    self.replaced += 1
                return self._rewritten(data, data[1] & 0xEF, 0, data[4:])
            if counts > self._valve:
                self.lowered += 1
                return self._rewritten(data, data[1], self._valve, data[4:])
        elif can_id == MOTOR_COMMAND:
            if self.finding or not self._armed:
                self.replaced += 1
                return self._rewritten(data, data[1] & 0xEF, 0, b"\0\0")
            if data[4] | data[5] << 8 > self._motor:
                self.lowered += 1
                return self._rewritten(data, data[1], data[2] | data[3] << 8, self._motor.to_bytes(2, "little"))
        return data

    def _judge(self, finding: int, broken: bool) -> None:
        self._broken[finding] = self._broken[finding] + 1 if broken else 0
        if self._broken[finding] >= self._confirm:
            self.finding = finding

    @staticmethod
    def _rewritten(data: bytes, flags: int, counts: int, rest: bytes) -> bytes:
        body = bytes((flags,)) + counts.to_bytes(2, "little") + rest
        return bytes((crc8(body),)) + body


def _signed12(bits: int) -> int:
    return (bits & 0xFFF ^ 0x800) - 0x800
