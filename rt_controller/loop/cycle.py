"""A control cycle: decode, check, estimate, control, encode. It is one compiled call without GIL and memory allocation."""

from enum import IntEnum
from math import inf, nan
from typing import NamedTuple

import numpy as np
from numba import njit

from protocols.can.frame_batch import read_word
from protocols.can.frames import load_frames
from protocols.can.lifecycle import Lifecycle
from protocols.can.reception import (
    INTRUDER,
    MOST_DOUBTS,
    RECEPTION,
    WRONG_RATES,
    count_doubts,
    intrudes,
    is_intruded,
)
from protocols.can.request import Request
from protocols.can.words import make_frame_layout, put, put_raw, read_raw, read_value, write_frame
from protocols.files.units import BAR, ZERO_CELSIUS
from rt_controller.guard.limits import GUARD, LIMITS, check_inbound, close_cycle, limit_outbound
from rt_controller.law.lock import motor_limit
from rt_controller.law.other_clutch import (
    OTHER,
    PAIR_SETTINGS,
    find_applied_torque,
    pair_mismatch,
    take_other_encoder,
    take_other_status,
    use_newest_status,
)  # fmt: skip
from rt_controller.law.phases import PHASE_SETTINGS, PHASES, Fault, Phase, advance
from rt_controller.law.plausibility import PLAUSIBILITY, PLAUSIBILITY_SETTINGS, check_pressure, check_torque
from rt_controller.law.sample import SAMPLE, take_analog, take_encoder
from rt_controller.law.torque_law import LAW, LAW_SETTINGS, control
from rt_controller.law.transmitted import mismatch
from rt_controller.loop.claim import CLAIM, end_silent_claim, find_supervision, is_of_another, take_claim
from rt_controller.loop.cycle_record import RECORD, note_cycle
from rt_controller.loop.faults import FAULTS, note_fault

# Frames that a controller receives, in the order of NODE's receptions. With two clutches, frames of the other one follow
RECEIVED_FRAMES = ("ANALOG_SENSORS", "ENCODER", "TORQUE_SETPOINT", "PLANT_HEARTBEAT", "SUPERVISOR_CLAIM")
OTHER_CLUTCH_FRAMES = ("ENCODER", "CONTROLLER_STATUS")
SENT_FRAMES = ("VALVE_COMMAND", "MOTOR_COMMAND", "CONTROLLER_STATUS", "CONTROLLER_HEARTBEAT")
OUTBOX = len(SENT_FRAMES)  # highest number of frames that a cycle sends
_RECEPTIONS = len(RECEIVED_FRAMES) + len(OTHER_CLUTCH_FRAMES)
_ANALOG, _ENCODER, _SETPOINT, _PLANT, _CLAIM, _OTHER_ENCODER, _OTHER_STATUS = range(_RECEPTIONS)
_STEP_LIMIT = 10  # periods: longest step of estimator and regulators after a gap between samples
# Of the torque limit: above it the motor counts as at its limit. The margin covers the gain error of the torque sensor
_LIMITED_SHARE = 0.9


class Refusal(IntEnum):
    """Reasons not to use a frame. Before the first cycle the first two end the service; in a run they are a fault."""

    SECOND_CONTROLLER = 1
    RATE = 2
    LENGTH = 3
    REQUEST = 4
    TORQUE = 5
    PRESSURE = 6
    SPEED = 7
    SUPERVISOR = 8


# own: identifiers of the frames that the controller sends; then the definition of each frame that it receives or sends
SETTINGS = np.dtype(
    [("period", "f8"), ("rate", "i8"), ("session", "i8"), ("drives", "?"), ("own", "i8", (len(SENT_FRAMES),)),
     ("status_every", "i8"), ("heartbeat_every", "i8"), ("setpoint_timeout", "f8"), ("motor_torque_limit", "f8"),
     ("demand_limit", "f8"), ("speed_limit", "f8"), ("pressure_limit", "f8"),
     *((name.lower(), make_frame_layout(load_frames()[name])) for name in RECEIVED_FRAMES + SENT_FRAMES),
     ("phases", PHASE_SETTINGS), ("pair", PAIR_SETTINGS), ("plausibility", PLAUSIBILITY_SETTINGS), ("law", LAW_SETTINGS),
     ("guard", LIMITS)]
)  # fmt: skip
# record: of the last cycle; it is the first field, so that it is aligned as a row of doubles. slot: number of periods so far;
# beat_after, status_after: slots after which the next heartbeat and status are sent. Set-point: request, demand [Nm],
# pressure_demand [Pa], speed_demand [rad/s], setpoint_age [s]. motor_limit [Nm]: torque limit of the motor; locked: the plates
# still stand since lock. refused_...: identifier and value of the frame that ends the service; rejected_...: Refusal,
# identifier and value of the first frame that was not used for its length or values, 0 before. own: receptions of others'
# frames on the identifiers that this controller sends; wrong_rates: consecutive heartbeats with another rate
NODE = np.dtype(
    [("record", RECORD), ("cycle", "i8"), ("slot", "i8"), ("beats", "i8"), ("beat_after", "i8"), ("statuses", "i8"),
     ("status_after", "i8"), ("late_cycles", "i8"), ("request", "i8"), ("demand", "f8"), ("pressure_demand", "f8"),
     ("speed_demand", "f8"), ("motor_limit", "f8"), ("locked", "?"), ("setpoint_age", "f8"),
     ("refused_id", "i8"), ("refused_value", "f8"), ("rejected_why", "i8"), ("rejected_id", "i8"), ("rejected_value", "f8"),
     ("wrong_rates", "i8"), ("intruder", INTRUDER), ("own", RECEPTION, (len(SENT_FRAMES),)),
     ("receptions", RECEPTION, (_RECEPTIONS,)), ("claim", CLAIM), ("sample", SAMPLE), ("other", OTHER), ("phases", PHASES),
     ("plausibility", PLAUSIBILITY), ("law", LAW), ("guard", GUARD), ("faults", FAULTS)]
)  # fmt: skip


class ControllerMemory(NamedTuple):
    """Memory of a node for kernels that run many cycles. `run_cycle` takes single arrays: a call from Python with a named
    tuple costs 2 us more.

    states (1,) of NODE; settings (1,) of SETTINGS; outbox (OUTBOX,) of frame_batch.FRAME; row (columns,): the record in
    `states` as plain numbers.
    """

    states: np.ndarray
    settings: np.ndarray
    outbox: np.ndarray
    row: np.ndarray


@njit(cache=True, nogil=True)
def run_cycle(states, all_settings, inbox, count, slots, outbox):
    """Run one cycle, `slots` periods after the last one, on the first `count` frames of `inbox`.

    `states` (1,) of NODE, `all_settings` (1,) of SETTINGS, `inbox` and `outbox` (n,) of FRAME. Fills `outbox` and the node's
    record; returns the number of frames in `outbox`, or minus the Refusal.
    """
    node, settings = states[0], all_settings[0]
    guard, law, sample, record = node.guard, node.law, node.sample, node.record
    elapsed = slots * settings.period
    node.setpoint_age += elapsed
    node.claim.age += elapsed
    node.claim.refused_age += elapsed
    node.other.age += elapsed
    node.slot += slots
    ticks = 0
    for index in range(count):
        frame = inbox[index]
        check_inbound(guard, settings.guard, np.int64(frame.can_id), frame.data, np.int64(frame.length))
        periods = _receive(node, settings, frame)
        if periods < 0 and node.cycle == 0:
            return periods
        ticks += max(periods, 0)
    end_silent_claim(node, settings, node.receptions[_CLAIM], node.receptions[_SETPOINT])
    step = min(ticks, _STEP_LIMIT) * settings.period
    request = node.request if node.setpoint_age <= settings.setpoint_timeout else Request.RELEASE.value
    finding = close_cycle(guard, settings.guard, slots)
    if not finding:
        finding = _find_other_sender(node)
    _update_applied_torque(node, settings, slots)
    limit = node.motor_limit if settings.drives else settings.motor_torque_limit
    motor_limited = abs(sample.motor_torque) >= _LIMITED_SHARE * limit
    lost, implausible = _check_plausibility(node, settings, request, motor_limited, elapsed)
    phase = advance(node.phases, settings.phases, request, sample.pressure, lost, implausible, finding, elapsed)
    target = node.pressure_demand if request == Request.PRESSURE else nan
    control(law, settings.law, phase, node.demand, node.speed_demand, motor_limited, sample, step, target, record)
    note_cycle(record, node, phase, request, find_supervision(node.claim))
    note_fault(node.faults, record)
    return _write_commands(node, settings, phase, outbox)


@njit
def _find_other_sender(node):
    """Return the Fault if another sender uses identifiers of this controller, the plant or the supervisor, else 0."""
    if is_intruded(node.intruder, node.slot):
        return Fault.SECOND_SENDER.value
    for kind in (_ANALOG, _ENCODER, _SETPOINT):
        if node.receptions[kind].doubts >= MOST_DOUBTS:
            return Fault.SECOND_SENDER.value
    return Fault.WRONG_RATE.value if node.wrong_rates >= WRONG_RATES else Fault.NONE.value


@njit
def _update_applied_torque(node, settings, slots):
    """Update the torque applied to this clutch: that of the motor, without the part of another clutch.

    The status of the other clutch comes into use half a status period after its slot, or in the first cycle after this time:
    the cycle is `slots` periods after the last one.
    """
    sample, torque = node.sample, settings.law.torque
    if torque.alone:
        sample.applied, sample.known = sample.motor_torque, True
        return
    due_since = (node.slot - settings.status_every // 2) % settings.status_every  # slots
    if due_since < slots:
        use_newest_status(node.other)
    sample.applied, sample.known = find_applied_torque(node.other, settings.pair, torque, sample.motor_torque)


@njit
def _check_plausibility(node, settings, request, motor_limited, elapsed):
    """Return whether the pressure signal is lost, and whether the torque is implausible; `elapsed` [s]."""
    law, sample, checks, s = node.law, node.sample, node.plausibility, settings.plausibility
    closed = node.phases.phase == Phase.SLIP_CONTROL or node.phases.phase == Phase.LOCK
    most = settings.law.valve_gain * settings.law.voltage_limit  # the valve gives no more, whatever is demanded
    lost = check_pressure(checks, s, sample.pressure, min(law.pressure_demand, most), elapsed)
    alone, torque = settings.law.torque.alone, law.torque
    compared = closed and request != Request.PRESSURE
    sticks = torque.contact and not torque.motion.moves
    residual = 0.0
    if compared and alone:
        residual = mismatch(torque, settings.law.torque)
    elif compared:
        capacity = torque.level * torque.coulomb_torque
        residual = pair_mismatch(
            node.other, settings.pair, settings.law.torque, torque.estimate, capacity, sticks, sample
        )
    stands = compared and alone and sticks
    implausible = check_torque(checks, s, residual, node.speed_demand - sample.speed, stands, motor_limited, elapsed)
    return lost, implausible


@njit(cache=True, nogil=True)
def receive_before_start(states, all_settings, inbox, count):
    """Take frames before the first cycle, without the guard; return the Refusal, or 0."""
    for index in range(count):
        periods = _receive(states[0], all_settings[0], inbox[index])
        if periods < 0:
            return -periods
    return 0


@njit
def _receive(node, settings, frame):
    """Take one frame; return the sample periods by which it advances the time, or minus the Refusal."""
    can_id, length = np.int64(frame.can_id), np.int64(frame.length)
    for index in range(len(settings.own)):
        if can_id == settings.own[index]:
            if intrudes(node.intruder, node.own[index], read_word(frame.data), length, node.slot):
                return _refuse(node, Refusal.SECOND_CONTROLLER, can_id, 0.0)
            return 0
    kind = -1
    for index in range(_RECEPTIONS):
        if node.receptions[index].can_id == can_id:
            kind = index
    if kind < 0:
        return 0
    reception, word = node.receptions[kind], read_word(frame.data)
    if kind == _CLAIM and is_of_another(node.claim, settings, word):
        reception = node.claim.others
    if not count_doubts(reception, word, length):
        if length != reception.length:
            _note_rejected(node, Refusal.LENGTH, can_id, length)
        return 0
    if kind == _ANALOG:
        s = settings.analog_sensors  # its CLUTCH_TORQUE is for comparison only
        pressure = read_value(word, s.cylinder_pressure) * BAR
        take_analog(node.sample, pressure, read_value(word, s.oil_temperature) + ZERO_CELSIUS)
    elif kind == _ENCODER:
        bandwidth, motor_zero = settings.law.torque.bandwidth, settings.law.torque.model.motor_torque_zero
        return take_encoder(
            node.sample, word, settings.encoder, settings.period, bandwidth, node.speed_demand, motor_zero
        )
    elif kind == _SETPOINT:
        _take_setpoint(node, settings, reception, word)
    elif kind == _CLAIM:
        if take_claim(node, settings, node.receptions[_CLAIM], node.receptions[_SETPOINT], word):
            _note_rejected(node, Refusal.SUPERVISOR, can_id, read_raw(word, settings.supervisor_claim.session))
    elif kind == _OTHER_ENCODER:
        take_other_encoder(node.other, word, settings.encoder, settings.period, settings.law.torque.bandwidth)
    elif kind == _OTHER_STATUS:
        s = settings.controller_status
        take_other_status(node.other, read_value(word, s.torque_estimate), read_raw(word, s.sticking) != 0)
    elif read_raw(word, settings.plant_heartbeat.rate) == settings.rate:
        node.wrong_rates = 0
    else:
        node.wrong_rates += 1
        if node.wrong_rates >= WRONG_RATES or node.cycle == 0:  # before the first cycle there is no run to continue
            return _refuse(node, Refusal.RATE, can_id, read_raw(word, settings.plant_heartbeat.rate))
    return 0


@njit
def _take_setpoint(node, settings, reception, word):
    """Take the payload `word` of TORQUE_SETPOINT.

    A set-point that cannot be followed is counted, and the previous set-point keeps ageing.
    """
    s = settings.torque_setpoint
    request, torque = read_raw(word, s.request), read_value(word, s.torque_demand)
    speed, pressure = read_value(word, s.speed_demand), read_value(word, s.pressure_demand)
    if torque > settings.demand_limit:
        return _reject(node, reception, Refusal.TORQUE, torque)
    if pressure > settings.pressure_limit:
        return _reject(node, reception, Refusal.PRESSURE, pressure)
    if request > Request.LOCK:  # the highest request
        return _reject(node, reception, Refusal.REQUEST, request)
    if abs(speed) > settings.speed_limit:
        return _reject(node, reception, Refusal.SPEED, speed)
    node.request, node.demand, node.speed_demand, node.pressure_demand = request, torque, speed, pressure * BAR
    node.setpoint_age = 0.0
    return None


@njit
def _reject(node, reception, why, value_received):
    """Count a frame whose values cannot be followed."""
    reception.unusable += 1
    _note_rejected(node, why, reception.can_id, value_received)


@njit
def _note_rejected(node, why, can_id, value_received):
    """Keep the first frame that is not used, for the summary."""
    if node.rejected_why == 0:
        node.rejected_why, node.rejected_id, node.rejected_value = why.value, can_id, value_received


@njit
def _refuse(node, why, can_id, value_received):
    """Store the refused frame, for the error message and the summary; return minus the Refusal `why`."""
    _note_rejected(node, why, can_id, value_received)
    node.refused_id, node.refused_value = can_id, value_received
    return -why.value


@njit
def _write_commands(node, settings, phase, outbox):
    """Fill `outbox`; return the number of frames. The valve command is last: in lock-step the plant waits for it."""
    cycle, law, sent = node.cycle, node.law, 0
    if node.slot > node.beat_after:
        s = settings.controller_heartbeat
        node.beats += 1
        node.beat_after = _find_next(node.slot, settings.heartbeat_every)
        word = put(np.int64(0), s.lifecycle, Lifecycle.ACTIVE.value)
        word = put(word, s.rate, settings.rate)
        word = put(word, s.session, settings.session)
        word = put(word, s.supervisor, find_supervision(node.claim))
        write_frame(outbox[sent], s, word, node.beats)
        sent += 1
    if node.slot > node.status_after:
        s = settings.controller_status
        word = put(np.int64(0), s.phase, phase)
        word = put(word, s.sticking, law.torque.contact and not law.torque.motion.moves)
        word = put(word, s.fault, node.phases.fault)
        word = put(word, s.torque_estimate, law.torque.estimate)
        word = put(word, s.late_cycles, node.late_cycles)
        word = put(word, s.friction_level, law.torque.adaptation.level)
        write_frame(outbox[sent], s, word, node.statuses)
        node.statuses += 1
        node.status_after = _find_next(node.slot, settings.status_every)
        sent += 1
    if settings.drives:
        s = settings.motor_command
        word = np.int64(0)
        if phase != Phase.FAULT and node.setpoint_age != inf:
            _update_motor_limit(node, settings, phase)
            word = put(word, s.motor_enable, True)
            word = put(word, s.speed_demand, node.speed_demand)
            word = put(word, s.torque_limit, node.motor_limit)
        word = put_raw(word, s.sample_tick, max(node.sample.tick, 0))  # it wraps around
        write_frame(outbox[sent], s, word, cycle)
        limit_outbound(node.guard, settings.guard, s.can_id, outbox[sent].data)
        sent += 1
    s = settings.valve_command
    opened = phase == Phase.FILL or phase == Phase.SLIP_CONTROL or phase == Phase.LOCK
    word = put(np.int64(0), s.valve_enable, opened)
    word = put(word, s.valve_voltage, law.voltage)
    word = put_raw(word, s.sample_tick, max(node.sample.tick, 0))  # it wraps around
    write_frame(outbox[sent], s, word, cycle)
    limit_outbound(node.guard, settings.guard, s.can_id, outbox[sent].data)
    node.cycle = cycle + 1
    return sent + 1


@njit
def _update_motor_limit(node, settings, phase):
    """Update the torque limit of the motor: in lock the torque that the plates carry with a margin, if it is lower.

    The lower limit holds until locked plates slide or separate: a higher motor torque would make them slide.
    """
    law, model = node.law, settings.law.torque.model
    leaves = not law.torque.motion.moves or law.held > 0.0 or phase == Phase.RELEASE
    node.locked = phase == Phase.LOCK or (node.locked and law.torque.contact and leaves)
    node.motor_limit = settings.motor_torque_limit
    if node.locked and settings.law.torque.alone:
        carried = motor_limit(settings.law.lock, model, law.torque.adaptation.level)
        node.motor_limit = min(node.motor_limit, carried)


@njit
def _find_next(slot, every):
    """Return the next multiple of `every` from `slot` on: frames keep their rate when slots are missed."""
    return ((slot - 1) // every + 1) * every
