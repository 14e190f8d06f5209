"""Guard: watchdog and limiter between controller and bus.

The guard reads the frames of both directions. It shares no code with the controller: it has its own layout of the frames
(`layout.py` compares it with the database at the start), its own CRC table and its own limits (`limits.toml`), in raw
counts. It passes a command, lowers it to the limit, or replaces it by the safe command: valve closed, motor off. Its finding is
one of the codes below. A finding is latched until its cause is gone and the supervisor requests idle.
"""

from collections.abc import Mapping

import numpy as np
from numba import njit

HEALTHY, STALE_SENSORS, OVERPRESSURE, OVERTEMPERATURE, OVERSPEED = range(5)

VALVE_COMMAND, MOTOR_COMMAND, ANALOG_SENSORS, ENCODER, TORQUE_SETPOINT = 0x080, 0x090, 0x100, 0x101, 0x180
_INBOUND_BYTES, _COMMAND_BYTES = 8, 6
PRESSURE_COUNTS = 4096 / 20.0 / 1e5  # counts/Pa: 12 bit over 20 V, 1 V/bar; DBC
TEMPERATURE_COUNTS = 4096 / 20.0 * 0.05  # counts/K: 12 bit over 20 V, 0.05 V/degC, 0 counts at 0 degC; DBC
ANGLE_COUNTS = 163840 / 6.283185307179586  # counts/rad: counts of a turn of the encoder; DBC
VALVE_COUNTS = 65536 / 10.0  # counts/V: 16 bit over 10 V; DBC
MOTOR_COUNTS = 1000.0  # counts/Nm: DBC
_crc_of_byte = []
for _byte in range(256):
    for _ in range(8):
        _byte = (_byte << 1) ^ (0x11D if _byte & 0x80 else 0)  # SAE J1850 polynomial x^8 + x^4 + x^3 + x^2 + 1
    _crc_of_byte.append(_byte)
_CRC_TABLE = tuple(_crc_of_byte)

# Limits in counts, and the offset of the clutch's identifiers; filled by `make_guard_limits`. turn: counts per tick
LIMITS = np.dtype(
    [("stale_cycles", "f8"), ("confirm_samples", "f8"), ("pressure", "f8"), ("temperature", "f8"), ("turn", "f8"),
     ("valve", "i8"), ("motor", "i8"), ("offset", "i8")]
)  # fmt: skip
# finding: HEALTHY or the latched cause. age: cycles since the last valid sample. lowered: number of commands lowered to the
# limit; replaced: number of commands replaced by the safe one. armed: a sample has arrived; before, valve and motor are off,
# and from then on samples must not stop. analog, encoder: received since the last cycle. counters (of analog, encoder,
# set-point) and tick: last value plus 1, 0 before the first. broken: consecutive samples beyond a limit, by finding.
_COUNTERS, _BROKEN = ("counters", "i8", (3,)), ("broken", "i8", (5,))
GUARD = np.dtype(
    [("finding", "i8"), ("age", "i8"), ("lowered", "i8"), ("replaced", "i8"), ("armed", "?"),
     ("analog", "?"), ("encoder", "?"), ("angle", "i8"), ("tick", "i8"), _COUNTERS, _BROKEN]
)  # fmt: skip


def make_guard_limits(limits: Mapping[str, float], period: float, offset: int) -> dict[str, float]:
    """Return the fields of LIMITS. `limits` are in SI with the names of `limits.toml`; `period` [s] of the controller.

    `offset` is added to the identifiers of the clutch's frames; it is not 0 for clutch b.
    """
    return {
        "stale_cycles": limits["stale_cycles"],
        "confirm_samples": limits["confirm_samples"],
        "pressure": limits["pressure"] * PRESSURE_COUNTS,
        "temperature": (limits["temperature"] - 273.15) * TEMPERATURE_COUNTS,
        "turn": limits["slip_speed"] * ANGLE_COUNTS * period,  # counts a tick
        "valve": int(limits["voltage"] * VALVE_COUNTS),
        "motor": int(limits["motor_torque"] * MOTOR_COUNTS),
        "offset": offset,
    }


@njit
def compute_crc8(data, length):
    """Return the CRC-8 SAE J1850 of bytes 1 to `length` - 1 of `data`: start value 0xFF, final xor 0xFF."""
    crc = 0xFF
    for index in range(1, length):
        crc = _CRC_TABLE[crc ^ int(data[index])]
    return crc ^ 0xFF


@njit
def check_inbound(guard, limits, can_id, data, length):
    """Check a frame from the bus: `data` has at least 8 bytes, the first `length` are the payload."""
    kind = _find_kind(can_id - limits.offset)
    if kind < 0 or length != _INBOUND_BYTES or compute_crc8(data, length) != data[0]:
        return
    counter = 1 + (int(data[1]) & 15)
    if guard.counters[kind] == counter:
        return  # the sender is stuck: this is no new sample
    guard.counters[kind] = counter
    if kind == 0:
        guard.analog = True
        _judge(guard, limits, OVERPRESSURE, _read_signed12(int(data[1]) >> 4 | int(data[2]) << 4) > limits.pressure)
        _judge(guard, limits, OVERTEMPERATURE, _read_signed12(int(data[3]) | int(data[4]) << 8) > limits.temperature)
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
        guard.finding = HEALTHY  # the supervisor requests idle, and the cause is gone


@njit
def close_cycle(guard, limits, slots):
    """End a control cycle, `slots` periods after the last one: update the age of the sample, return the finding.

    Missed periods add at most 1 to the age: the whole computer may have stopped, with the sensors, and their frames may be on
    the way. A loop that runs in every second slot still ages the sample by the true time.
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
def limit_outbound(guard, limits, can_id, data):
    """Change the command in `data`, 6 bytes, in place so that it may be sent."""
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
def _find_kind(can_id):
    """Return the index of a checked frame in `counters`, -1 for another frame."""
    if can_id == ANALOG_SENSORS:
        return 0
    if can_id == ENCODER:
        return 1
    return 2 if can_id == TORQUE_SETPOINT else -1


@njit
def _judge(guard, limits, finding, broken):
    """Count a sample that is beyond the limit of `finding`, or not; latch the finding after `confirm_samples` in a row."""
    guard.broken[finding] = guard.broken[finding] + 1 if broken else 0
    if guard.broken[finding] >= limits.confirm_samples:
        guard.finding = finding


@njit
def _rewrite(data, at, counts):
    """Write two bytes of a command, from byte `at` on, and its CRC."""
    data[at], data[at + 1] = counts & 0xFF, counts >> 8
    data[0] = compute_crc8(data, _COMMAND_BYTES)


@njit
def _read_signed12(bits):
    """Return the low 12 of `bits` as a signed integer."""
    return (bits & 0xFFF ^ 0x800) - 0x800
