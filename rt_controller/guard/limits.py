"""Guard: watchdog and limiter between controller and bus.

The guard reads the frames of both directions. It shares no code with the controller: it has its own layout of the frames
(`layout.py` compares it with the database at the start), its own CRC table and its own limits (`limits.toml`), in raw
counts. It passes a command, lowers it to the limit, or replaces it by the safe command: valve closed, motor off. Its finding is
one of the codes below. A finding is latched until its cause is gone and the supervisor requests idle.

While a supervisor has claimed the set-points, only its request counts. The guard reads the claims itself. The first
supervisor that claims the set-points holds the claim until it releases it or is silent for too long. A first claim is not
accepted while set-points without a claim request to close the clutch.
"""

from collections.abc import Mapping

import numpy as np
from numba import njit

HEALTHY, STALE_SENSORS, OVERPRESSURE, OVERTEMPERATURE, OVERSPEED = range(5)
SENSOR_IMPLAUSIBLE, SENSOR_FROZEN = 10, 11  # 5 to 9 are the controller's

VALVE_COMMAND, MOTOR_COMMAND, ANALOG_SENSORS, ENCODER, TORQUE_SETPOINT = 0x080, 0x090, 0x100, 0x101, 0x180
SUPERVISOR_CLAIM = 0x170
DATA_ID = 0xC000  # of clutch a's frames, minus the identifier; DBC
BYTES = 8  # of a frame; the first three are CRC-16, low byte first, and counter
_SESSIONS = 0x0800  # least session of a supervisor: with it the data ID of set-points is that of no other frame; DBC
_ASKED = 0.1  # s for which a set-point is valid; `setpoint_timeout` of controller.toml
_SILENCE = 0.25  # s without a claim frame after which the claim ends: sent every 50 ms, so four of five may be lost
# Highest step of a counter that is a new frame: 3 may be lost. The CRC misses 6 bursts of 16 bits, which change it by more
_MAX_DELTA = 4
PRESSURE_COUNTS = 2048.0  # counts of the pressure, 12 bit with a sign, which are `pressure_range`: DBC
TEMPERATURE_COUNTS = 4096 / 20.0 * 0.05  # counts/K: 12 bit over 20 V, 0.05 V/degC, 0 counts at 0 degC; DBC
ANGLE_COUNTS = 163840 / 6.283185307179586  # counts/rad: counts of a turn of the encoder; DBC
VALVE_COUNTS = 65536 / 10.0  # counts/V: 16 bit over 10 V; DBC
MOTOR_COUNTS = 65536.0  # counts of the limit's 16 bits, which are `motor_range`: DBC
_VACUUM = -1.0e5  # Pa: no gauge pressure is below -1 bar
_RAIL = 2047  # counts, of a signed 12-bit channel: at this end, or the other, the wire is broken or the converter full
_KNOWN = 4096  # 2^12, added to a stored 12-bit value, as 0 means no value
_crc_of_byte = []
for _byte in range(256):
    _crc = _byte << 8
    for _ in range(8):
        _crc = (_crc << 1) ^ (0x11021 if _crc & 0x8000 else 0)  # polynomial x^16 + x^12 + x^5 + 1
    _crc_of_byte.append(_crc)
_CRC_TABLE = tuple(_crc_of_byte)

# Limits in counts, and the offset of the clutch's identifiers; filled by `make_guard_limits`. turn: counts per tick; cold,
# warming: least temperature, and its largest step; followed: change of the valve command that the pressure must follow in
# frozen_samples; asked, silence: validity of set-point and claim in cycles; vacuum: least pressure; key: XOR the data IDs
LIMITS = np.dtype(
    [("stale_cycles", "f8"), ("confirm_samples", "f8"), ("pressure", "f8"), ("temperature", "f8"), ("turn", "f8"),
     ("cold", "f8"), ("warming", "f8"), ("followed", "f8"), ("frozen_samples", "f8"), ("asked", "f8"), ("silence", "f8"),
     ("vacuum", "f8"), ("valve", "i8"), ("motor", "i8"), ("offset", "i8"), ("key", "i8")]
)  # fmt: skip
# finding: HEALTHY or the latched cause. age: cycles since the last valid sample. lowered: number of commands lowered to the
# limit; replaced: number of commands replaced by the safe one. armed: a sample has arrived; before, valve and motor are off,
# and from then on samples must not stop. analog, encoder, claimed: received since the last cycle. counters (of analog, encoder,
# set-point, claim) and tick: last value plus 1, 0 before the first. broken: consecutive samples beyond a limit, by finding.
# pressure, oil: last pressure, last plausible temperature, plus _KNOWN. sent: valve command [counts]; held: the one that was
# sent when the pressure last changed. railed: the motor's torque is at an end of its range. session: of the supervisor that has
# claimed the set-points, 0 for none; unclaimed: cycles since its last claim; asked: remaining cycles of a request to close.
_COUNTERS, _BROKEN = ("counters", "i8", (4,)), ("broken", "i8", (12,))
GUARD = np.dtype(
    [("finding", "i8"), ("age", "i8"), ("lowered", "i8"), ("replaced", "i8"), ("armed", "?"),
     ("analog", "?"), ("encoder", "?"), ("railed", "?"), ("angle", "i8"), ("tick", "i8"), ("pressure", "i8"), ("oil", "i8"),
     ("sent", "i8"), ("held", "i8"), ("claimed", "?"), ("session", "i8"), ("unclaimed", "i8"), ("asked", "f8"),
     _COUNTERS, _BROKEN]
)  # fmt: skip


def make_guard_limits(limits: Mapping[str, float], period: float, offset: int) -> dict[str, float]:
    """Return the fields of LIMITS. `limits` are in SI with the names of `limits.toml`; `period` [s] of the controller.

    `offset` is added to the identifiers of the clutch's frames; it is not 0 for clutch b.
    """
    pressure_counts = PRESSURE_COUNTS / limits["pressure_range"]  # counts/Pa
    return {
        "stale_cycles": limits["stale_cycles"],
        "confirm_samples": limits["confirm_samples"],
        "pressure": limits["pressure"] * pressure_counts,
        "temperature": (limits["temperature"] - 273.15) * TEMPERATURE_COUNTS,
        "turn": limits["slip_speed"] * ANGLE_COUNTS * period,  # counts a tick
        "cold": (limits["temperature_low"] - 273.15) * TEMPERATURE_COUNTS,
        "warming": limits["temperature_step"] * TEMPERATURE_COUNTS,
        "followed": limits["frozen_voltage"] * VALVE_COUNTS,
        "frozen_samples": limits["frozen_dwell"] / period,
        "asked": _ASKED / period,
        "silence": _SILENCE / period,
        "vacuum": _VACUUM * pressure_counts,
        "valve": int(limits["voltage"] * VALVE_COUNTS),
        "motor": int(limits["motor_torque"] * MOTOR_COUNTS / limits["motor_range"]),
        "offset": offset,
        "key": int(limits["data_key"]),
    }


@njit
def compute_crc16(data, data_id):
    """Return the CRC-16 of AUTOSAR E2E profile 5: of bytes 2 to 7 of `data` and of `data_id`, low byte first."""
    crc = 0xFFFF
    for index in range(2, BYTES):
        crc = ((crc & 0xFF) << 8) ^ _CRC_TABLE[crc >> 8 ^ int(data[index])]
    crc = ((crc & 0xFF) << 8) ^ _CRC_TABLE[crc >> 8 ^ data_id & 0xFF]
    return ((crc & 0xFF) << 8) ^ _CRC_TABLE[crc >> 8 ^ data_id >> 8]


@njit
def check_inbound(guard, limits, can_id, data, length):
    """Check a frame from the bus: `data` has at least 8 bytes, the first `length` are the payload."""
    kind = _find_kind(can_id - limits.offset)
    data_id = _find_data_id(limits, can_id) ^ (guard.session if kind == 2 else 0)
    if kind < 0 or length != BYTES or compute_crc16(data, data_id) != int(data[0]) | int(data[1]) << 8:
        return
    session = int(data[4]) | int(data[5]) << 8
    if kind == 3 and guard.session and session != guard.session:
        return  # of a supervisor other than the holder of the claim
    last, guard.counters[kind] = guard.counters[kind], 1 + int(data[2])
    step = (guard.counters[kind] - last) & 0xFF
    if last and (step == 0 or step > _MAX_DELTA):
        return  # repeated, older, or after a gap that is too long: the next frame is compared with it
    if kind == 0:
        guard.analog = True
        pressure = _read_signed12(int(data[3]) | int(data[4]) << 8)
        temperature = _read_signed12(int(data[4]) >> 4 | int(data[5]) << 4)
        _judge_content(guard, limits, pressure, temperature)
        _judge(guard, limits, OVERPRESSURE, pressure > limits.pressure)
        _judge(guard, limits, OVERTEMPERATURE, temperature > limits.temperature)
    elif kind == 1:
        guard.encoder = True
        angle = int(data[3]) | int(data[4]) << 8 | (int(data[5]) & 3) << 16
        tick = int(data[5]) >> 2 | (int(data[6]) & 15) << 6
        if guard.tick:
            ticks = (tick - guard.tick + 1) & 0x3FF
            turned = (angle - guard.angle + 0x20000 & 0x3FFFF) - 0x20000
            _judge(guard, limits, OVERSPEED, abs(turned) > limits.turn * ticks)
        guard.angle, guard.tick = angle, tick + 1
        torque = _read_signed12(int(data[6]) >> 4 | int(data[7]) << 4)
        guard.railed = torque >= _RAIL or torque < -_RAIL
    elif kind == 2:
        request = int(data[3]) & 7
        guard.asked = 0.0 if request == 0 or request == 2 else limits.asked  # 0: idle; 2: release
        if request == 0:
            guard.oil = 0  # the next oil temperature is accepted without comparison: it may be of another rig or day
            if guard.age == 0 and not guard.broken.max():
                guard.finding = HEALTHY  # the cause is gone
    else:
        claims = session >= _SESSIONS and (guard.session > 0 or guard.asked <= 0)
        _bind(guard, session if int(data[3]) & 1 and claims else 0)


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
    guard.asked -= slots
    guard.unclaimed = 0 if guard.claimed else guard.unclaimed + slots
    guard.claimed = False
    if guard.unclaimed > limits.silence:
        _bind(guard, 0)
    if guard.armed and guard.age > limits.stale_cycles and guard.finding == HEALTHY:
        guard.finding = STALE_SENSORS
    return guard.finding


@njit
def limit_outbound(guard, limits, can_id, data):
    """Limit the command in `data`, 8 bytes, in place, or replace it by the safe command."""
    data_id = _find_data_id(limits, can_id)
    if can_id == VALVE_COMMAND + limits.offset:
        counts = int(data[4]) | int(data[5]) << 8
        guard.sent = min(counts, limits.valve)
        if guard.finding or not guard.armed or not data[3] & 1:
            if counts or data[3] & 1:
                guard.replaced += 1
            data[3] &= 0xFE
            guard.sent = 0
            _rewrite(data, data_id, 4, 0)
        elif counts > limits.valve:
            guard.lowered += 1
            _rewrite(data, data_id, 4, limits.valve)
    elif can_id == MOTOR_COMMAND:
        if guard.finding or not guard.armed:
            guard.replaced += 1
            data[3] &= 0xFE
            _rewrite(data, data_id, 4, 0)
            _rewrite(data, data_id, 6, 0)
        elif int(data[6]) | int(data[7]) << 8 > limits.motor:
            guard.lowered += 1
            _rewrite(data, data_id, 6, limits.motor)


@njit
def _bind(guard, session):
    """Note the session of the supervisor that has claimed the set-points, 0 for none. Its counters may start at any value."""
    guard.claimed = True
    if session != guard.session:
        guard.session, guard.counters[2], guard.asked = session, 0, 0.0
    if not session:
        guard.counters[3] = 0


@njit
def _find_kind(can_id):
    """Return the index of a checked frame in `counters`, -1 for another frame."""
    if can_id == ANALOG_SENSORS:
        return 0
    if can_id == ENCODER:
        return 1
    if can_id == TORQUE_SETPOINT:
        return 2
    return 3 if can_id == SUPERVISOR_CLAIM else -1


@njit
def _judge(guard, limits, finding, broken):
    """Count consecutive samples beyond the limit of `finding`; latch the finding after `confirm_samples`."""
    guard.broken[finding] = guard.broken[finding] + 1 if broken else 0
    if guard.broken[finding] >= limits.confirm_samples:
        guard.finding = finding


@njit
def _judge_content(guard, limits, pressure, temperature):
    """Check the plausibility of new `pressure` and `temperature` values [counts]."""
    jumped = guard.oil != 0 and abs(temperature + _KNOWN - guard.oil) > limits.warming
    out_of_range = pressure < limits.vacuum or temperature < limits.cold or guard.railed
    _judge(guard, limits, SENSOR_IMPLAUSIBLE, jumped or out_of_range)
    if not jumped and limits.cold <= temperature <= limits.temperature:
        guard.oil = temperature + _KNOWN
    if pressure + _KNOWN != guard.pressure:
        guard.pressure, guard.held, guard.broken[SENSOR_FROZEN] = pressure + _KNOWN, guard.sent, 0
    elif abs(guard.sent - guard.held) > limits.followed:
        guard.broken[SENSOR_FROZEN] += 1
        if guard.broken[SENSOR_FROZEN] >= limits.frozen_samples and guard.finding == HEALTHY:
            guard.finding = SENSOR_FROZEN
    else:
        guard.broken[SENSOR_FROZEN] = 0


@njit
def _find_data_id(limits, can_id):
    """Return the data ID of a frame on a bench of this size."""
    return (can_id + DATA_ID) ^ limits.key


@njit
def _rewrite(data, data_id, at, counts):
    """Write two bytes of a command, from byte `at` on, and its CRC."""
    data[at], data[at + 1] = counts & 0xFF, counts >> 8
    crc = compute_crc16(data, data_id)
    data[0], data[1] = crc & 0xFF, crc >> 8


@njit
def _read_signed12(bits):
    """Return the low 12 of `bits` as a signed integer."""
    return (bits & 0xFFF ^ 0x800) - 0x800
