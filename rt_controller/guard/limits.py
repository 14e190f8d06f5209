"""Guard: watchdog and limiter between controller and bus.

It sees the frames themselves, in both directions, and shares no code with the controller: own layout of the frames
(held to the DBC by a test), own CRC table, own limits (`limits.toml`), in raw counts. It lets a command pass, lowers it
to the limit, or replaces it by the safe command: valve closed, motor off. What it finds is one of the codes below.
It is latched until the cause is gone and the supervisor asks for idle.
"""

from collections.abc import Mapping

import numpy as np
from numba import njit

HEALTHY, STALE_SENSORS, OVERPRESSURE, OVERTEMPERATURE, OVERSPEED = range(5)

VALVE_COMMAND, MOTOR_COMMAND, ANALOG_SENSORS, ENCODER, TORQUE_SETPOINT = 0x080, 0x090, 0x100, 0x101, 0x180
_INBOUND_BYTES, _COMMAND_BYTES = 8, 6
_PRESSURE_COUNTS = 4096 / 20.0 / 1e5  # 1/Pa: 12 bit over 20 V, 1 V/bar
_TEMPERATURE_COUNTS = 4096 / 20.0 * 0.05  # 1/K: 12 bit over 20 V, 0.05 V/degC, zero at 0 degC
_ANGLE_COUNTS = 163840 / 6.283185307179586  # 1/rad
_VALVE_COUNTS = 65536 / 10.0  # 1/V
_MOTOR_COUNTS = 1000.0  # 1/Nm
_crc_of_byte = []
for _byte in range(256):
    for _ in range(8):
        _byte = (_byte << 1) ^ (0x11D if _byte & 0x80 else 0)  # SAE J1850 polynomial x^8 + x^4 + x^3 + x^2 + 1
    _crc_of_byte.append(_byte)
_CRC_TABLE = tuple(_crc_of_byte)

# Limits as they are looked at: in counts, identifiers with the clutch's offset; made by `guard_limits`
LIMITS = np.dtype(
    [("stale_cycles", "f8"), ("confirm_samples", "f8"), ("pressure", "f8"), ("temperature", "f8"), ("turn", "f8"),
     ("valve", "i8"), ("motor", "i8"), ("offset", "i8")]
)  # fmt: skip
# finding: HEALTHY or the latched cause. age: cycles since the last believable sample. lowered: commands cut to the limit,
# replaced: those replaced by the safe one. armed: a sample has come; before, valve closed and motor off, after it samples must
# not fail. analog, encoder: seen since the last cycle. counters of analog, encoder and set-point, and tick: one more than the
# last, 0 before the first. broken: samples beyond a limit in a row, by finding.
_COUNTERS, _BROKEN = ("counters", "i8", (3,)), ("broken", "i8", (5,))
GUARD = np.dtype(
    [("finding", "i8"), ("age", "i8"), ("lowered", "i8"), ("replaced", "i8"), ("armed", "?"),
     ("analog", "?"), ("encoder", "?"), ("angle", "i8"), ("tick", "i8"), _COUNTERS, _BROKEN]
)  # fmt: skip


def guard_limits(limits: Mapping[str, float], period: float, offset: int) -> dict[str, float]:
    """Fields of LIMITS from `limits` in SI, by the names in `limits.toml`; `period` [s] of the controller.

    `offset` is added to the identifiers, for the second of two clutches.
    """
    return {
        "stale_cycles": limits["stale_cycles"],
        "confirm_samples": limits["confirm_samples"],
        "pressure": limits["pressure"] * _PRESSURE_COUNTS,
        "temperature": (limits["temperature"] - 273.15) * _TEMPERATURE_COUNTS,
        "turn": limits["slip_speed"] * _ANGLE_COUNTS * period,  # counts a tick
        "valve": int(limits["voltage"] * _VALVE_COUNTS),
        "motor": int(limits["motor_torque"] * _MOTOR_COUNTS),
        "offset": offset,
    }


@njit
def crc8(data, length):
    """CRC-8 SAE J1850 of bytes 1 to `length` of `data`: start 0xFF, final xor 0xFF."""
    crc = 0xFF
    for index in range(1, length):
        crc = _CRC_TABLE[crc ^ int(data[index])]
    return crc ^ 0xFF


@njit
def inbound(guard, limits, can_id, data, length):
    """Look at a frame from the bus: `data` holds at least 8 bytes, `length` of them are the payload."""
    kind = _kind(can_id - limits.offset)
    if kind < 0 or length != _INBOUND_BYTES or crc8(data, length) != data[0]:
        return
    counter = 1 + (int(data[1]) & 15)
    if guard.counters[kind] == counter:
        return  # a stuck sender is no sample
    guard.counters[kind] = counter
    if kind == 0:
        guard.analog = True
        _judge(guard, limits, OVERPRESSURE, _signed12(int(data[1]) >> 4 | int(data[2]) << 4) > limits.pressure)
        _judge(guard, limits, OVERTEMPERATURE, _signed12(int(data[3]) | int(data[4]) << 8) > limits.temperature)
    elif kind == 1:
        guard.encoder = True
        angle = int(data[2]) | int(data[3]) << 8 | int(data[4]) << 16 | int(data[5]) << 24
        tick = int(data[6]) | int(data[7]) << 8
        if guard.tick:
            ticks = (tick - guard.tick + 1) & 0xFFFF
            turned = (angle - guard.angle + 0x80000000 & 0xFFFFFFFF) - 0x80000000
            _judge(guard, limits, OVERSPEED, abs(turned) > limits.turn * ticks)
        guard.angle, guard.tick = angle, tick + 1
    elif int(data[1]) >> 4 == 0 and guard.age == 0 and not guard.broken.max():
        guard.finding = HEALTHY  # the supervisor asks for idle and the cause is gone


@njit
def close_cycle(guard, limits, slots):
    """Close a control cycle that took `slots` periods: age the sample, return the finding.

    Periods the loop has slept through age the sample by one at most: what stood still may have been the machine, sensors and
    all, and their frames are on the way. A loop that runs every other slot still knows the time.
    """
    if guard.analog and guard.encoder:
        guard.armed, guard.age = True, 0
    else:
        guard.age += min(slots, 2)
    guard.analog = guard.encoder = False
    if guard.armed and guard.age > limits.stale_cycles and guard.finding == HEALTHY:
        guard.finding = STALE_SENSORS
    return guard.finding


@njit
def outbound(guard, limits, can_id, data):
    """Make the command in `data`, 6 bytes, one that may go to the bus."""
    if can_id == VALVE_COMMAND + limits.offset:
        counts = int(data[2]) | int(data[3]) << 8
        if guard.finding or not guard.armed or not data[1] & 0x10:
            if counts or data[1] & 0x10:
                guard.replaced += 1
            data[1] &= 0xEF
            _rewrite(data, 2, 0)
        elif counts > limits.valve:
            guard.lowered += 1
            _rewrite(data, 2, limits.valve)
    elif can_id == MOTOR_COMMAND:
        if guard.finding or not guard.armed:
            guard.replaced += 1
            data[1] &= 0xEF
            _rewrite(data, 2, 0)
            _rewrite(data, 4, 0)
        elif int(data[4]) | int(data[5]) << 8 > limits.motor:
            guard.lowered += 1
            _rewrite(data, 4, limits.motor)


@njit
def _kind(can_id):
    """Place of a frame that is looked at, -1 for any other."""
    if can_id == ANALOG_SENSORS:
        return 0
    if can_id == ENCODER:
        return 1
    return 2 if can_id == TORQUE_SETPOINT else -1


@njit
def _judge(guard, limits, finding, broken):
    guard.broken[finding] = guard.broken[finding] + 1 if broken else 0
    if guard.broken[finding] >= limits.confirm_samples:
        guard.finding = finding


@njit
def _rewrite(data, at, counts):
    """Two bytes of a command, and its CRC."""
    data[at], data[at + 1] = counts & 0xFF, counts >> 8
    data[0] = crc8(data, _COMMAND_BYTES)


@njit
def _signed12(bits):
    return (bits & 0xFFF ^ 0x800) - 0x800
