"""Compiled steps of a sample of the plant: `take` the commands, `begin` the sample, `show` the sensor signals."""

from collections.abc import Sequence
from enum import IntEnum
from typing import Any

import numpy as np
from numba import njit

from plant_sim.blocks import dac
from plant_sim.node.noise import draw
from plant_sim.profiles.profile import interpolate_setpoint
from plant_sim.rigs.sensors import acquire
from protocols.can.frame_batch import read_word
from protocols.can.frames import load_frames
from protocols.can.lifecycle import Lifecycle
from protocols.can.reception import (
    INTRUDER,
    MOST_DOUBTS,
    RECEPTION,
    WRONG_RATES,
    count_doubts,
    count_rejected,
    intrudes,
)
from protocols.can.two_clutches import CLUTCHES
from protocols.can.words import count_turn, make_frame_layout, put, put_raw, read_raw, read_value, write_frame

# Cycles without a valve command after which the valve amplifier switches off: as `stale_cycles` of the controller's guard
STALE_CYCLES = 5
# s for which a wrong command may act: with 4 V, the highest that the controller's guard passes, the torque rises in this time
# from 10 to 28.6 Nm, below the 30 Nm that a supervisor may demand. After this time without a usable command the valve stays
# closed
FAULT_TOLERANT_TIME = 0.015
# Gaps of STALE_CYCLES that are tolerated in about GAP_MEMORY [s]; with one more the connection is lost. Each gap closes the
# valve briefly, and the controller, which does not know this, increases its demand: with half of the commands lost, 16 Nm were
# measured at a demand of 10 Nm, and 11 Nm since gaps are counted
MOST_GAPS, GAP_MEMORY = 3, 1.0
COMMAND_AGE = 0.01  # s: oldest sample that a command may answer: the time above, less STALE_CYCLES at 1 kHz
# Highest number of frames in a sample: heartbeat, status; claim, set-point, sensors, encoder of two clutches
OUTBOX = 10
SHARED_FRAMES = ("MOTOR_COMMAND", "PLANT_STATUS", "PLANT_HEARTBEAT")  # frames that exist once on a rig
CLUTCH_FRAMES = (
    "VALVE_COMMAND", "CONTROLLER_HEARTBEAT", "SUPERVISOR_CLAIM", "TORQUE_SETPOINT", "ANALOG_SENSORS", "ENCODER",
)  # fmt: skip


class Actuators(IntEnum):
    """Values of PLANT_STATUS.ACTUATORS."""

    SAFE = 0
    COMMANDED = 1
    STALE = 2
    LOST = 3
    LATE = 4
    TWO_SENDERS = 5


class Refusal(IntEnum):
    """Reasons not to use a frame. Before the first sample the first two end the service; in a run they close the valves."""

    SECOND_PLANT = 1
    RATE = 2
    LENGTH = 3
    LIFECYCLE = 4
    AGE = 5


# A clutch on the bus. voltage [V] at its valve. answered_tick: SAMPLE_TICK of the last valve command, -1 before the first.
# controller: Lifecycle of its controller. commanded: a valve command has arrived; age: cycles since the last one. pressure to
# motor_torque: the measured values [bar, rad/s, rad, degC, Nm, Nm]; slip_speed is the difference of two encoder counts, begun:
# whether there is an earlier one. noise: standard normal numbers for the sensors, from the generator at noise_source
# (`noise.py`).
# wrong_rates: consecutive heartbeats with another rate. late: consecutive commands that were too old. actuators: Actuators
# of the sample. latched: LOST, LATE or TWO_SENDERS while the valve stays closed, which a command to close it ends; else 0.
# stale: commands have stopped, until the next one that is used. gaps: cycles, GAP_MEMORY for each gap of commands, less
# those since then
CLUTCH = np.dtype(
    [("voltage", "f8"), ("answered_tick", "i8"), ("controller", "i8"), ("age", "i8"), ("commanded", "?"),
     ("torque_demand", "f8"), ("begun", "?"), ("count", "i8"), ("pressure", "f8"), ("slip_speed", "f8"), ("angle", "f8"),
     ("temperature", "f8"), ("clutch_torque", "f8"), ("motor_torque", "f8"), ("noise", "f8", (4,)), ("valve", RECEPTION),
     ("heartbeat", RECEPTION), ("wrong_rates", "i8"), ("late", "i8"), ("actuators", "i8"), ("latched", "i8"),
     ("stale", "?"), ("gaps", "i8")]
)  # fmt: skip


def _list_layouts(names: Sequence[str]) -> list[tuple[str, np.dtype]]:
    """Return one field for the definition of each frame, named as in the DBC but in lower case."""
    return [(name.lower(), make_frame_layout(load_frames()[name])) for name in names]


# D/A converter of the valve: range [V] and bits; address of the noise generator; the clutch's frames as the DBC defines them
CLUTCH_SETTINGS = np.dtype(
    [("dac_range", "f8"), ("dac_bits", "i8"), ("noise_source", "i8"), *_list_layouts(CLUTCH_FRAMES)]
)
# Motor command [rad/s, Nm]; refused_...: identifier, value and clutch of the frame that ends the service; rejected_...:
# Refusal, identifier, value and clutch of the first frame that was not used for its length or values, 0 before. period: calls
# of `take` so far; tick: of the last sample, -1 before the first; own: receptions of others' frames on the identifiers that
# this plant sends
INTERFACE = np.dtype(
    [("speed_demand", "f8"), ("torque_limit", "f8"), ("beats", "i8"), ("claims", "i8"), ("refused_id", "i8"),
     ("refused_value", "i8"), ("refused_clutch", "i8"), ("rejected_why", "i8"), ("rejected_id", "i8"), ("rejected_value", "i8"),
     ("rejected_clutch", "i8"), ("period", "i8"), ("tick", "i8"), ("intruder", INTRUDER),
     ("own", RECEPTION, (OUTBOX,)), ("motor", RECEPTION), ("clutches", CLUTCH, (len(CLUTCHES),))]
)  # fmt: skip
# count: number of clutches; oldest: COMMAND_AGE [ticks]; latch_after, gap_memory: FAULT_TOLERANT_TIME, GAP_MEMORY [cycles].
# own: identifiers of the frames that the plant sends; then the shared frames as the DBC defines them
SETTINGS = np.dtype(
    [("rate", "i8"), ("period", "f8"), ("session", "i8"), ("count", "i8"), ("oldest", "i8"), ("latch_after", "i8"),
     ("gap_memory", "i8"), ("own", "i8", (OUTBOX,)), ("status_every", "i8"), ("heartbeat_every", "i8"),
     ("claim_every", "i8"), ("claim_session", "i8"), *_list_layouts(SHARED_FRAMES),
     ("clutches", CLUTCH_SETTINGS, (len(CLUTCHES),))]
)  # fmt: skip
_dac, _setpoint = njit(dac.quantise_voltage), njit(interpolate_setpoint)


@njit(cache=True, nogil=True)
def take(interfaces: Any, all_settings: Any, inbox: Any, count: Any) -> Any:
    """Take the first `count` frames of `inbox`; return the Refusal of one that ends the service, or 0."""
    interfaces[0].period += 1
    for index in range(count):
        why = _receive(interfaces[0], all_settings[0], inbox[index])
        if why != 0 and interfaces[0].tick < 0:
            return why
        if why != 0:
            for k in range(all_settings[0].count):
                interfaces[0].clutches[k].latched = Actuators.TWO_SENDERS.value
    return 0


@njit
def _receive(interface, settings, frame):
    """Take one frame; return its Refusal if it ends the service, else 0."""
    can_id, length = np.int64(frame.can_id), np.int64(frame.length)
    word = read_word(frame.data)
    for index in range(len(settings.own)):
        if can_id == settings.own[index]:
            if intrudes(interface.intruder, interface.own[index], word, length, interface.period):
                return _refuse(interface, Refusal.SECOND_PLANT, can_id, 0, 0)
            return 0
    if can_id == interface.motor.can_id:
        s = settings.motor_command
        if _accept(interface, interface.motor, word, length, 0) and not _is_late(
            interface, settings, interface.motor, read_raw(word, s.sample_tick), s.sample_tick.mask, 0
        ):
            on = read_raw(word, s.motor_enable) != 0
            interface.speed_demand = read_value(word, s.speed_demand) if on else 0.0
            interface.torque_limit = read_value(word, s.torque_limit) if on else 0.0
        return 0
    for k in range(settings.count):
        clutch = interface.clutches[k]
        if can_id == clutch.valve.can_id:
            if _accept(interface, clutch.valve, word, length, k):
                its = settings.clutches[k]
                s = its.valve_command
                on, answered = read_raw(word, s.valve_enable) != 0, read_raw(word, s.sample_tick)
                if _is_late(interface, settings, clutch.valve, answered, s.sample_tick.mask, k):
                    clutch.late += 1
                    clutch.voltage = clutch.voltage if on else 0.0  # a late command may always close the valve
                    return 0
                if not on:
                    clutch.latched = clutch.gaps = 0
                follows = on and clutch.latched == 0
                clutch.voltage = (
                    _dac(read_value(word, s.valve_voltage), its.dac_range, its.dac_bits) if follows else 0.0
                )
                clutch.answered_tick, clutch.age, clutch.commanded, clutch.late = answered, 0, True, 0
                clutch.stale = False
        elif can_id == clutch.heartbeat.can_id and _accept(interface, clutch.heartbeat, word, length, k):
            s = settings.clutches[k].controller_heartbeat
            lifecycle, rate = read_raw(word, s.lifecycle), read_raw(word, s.rate)
            clutch.wrong_rates = clutch.wrong_rates + 1 if rate != settings.rate else 0
            if clutch.wrong_rates >= WRONG_RATES or (clutch.wrong_rates and not clutch.commanded):
                return _refuse(interface, Refusal.RATE, can_id, rate, k)
            if lifecycle > Lifecycle.FINALIZED.value:
                clutch.heartbeat.unusable += 1
                _note_rejected(interface, Refusal.LIFECYCLE, can_id, lifecycle, k)
            elif rate == settings.rate:
                clutch.controller = lifecycle
    return 0


@njit
def _accept(interface, reception, word, length, k):
    """Count a frame of clutch `k`; return whether it may be used. A frame of wrong length is noted for the summary."""
    if count_doubts(reception, word, length):
        return True
    if length != reception.length:
        _note_rejected(interface, Refusal.LENGTH, reception.can_id, length, k)
    return False


@njit
def _is_late(interface, settings, reception, answered, mask, k):
    """Return whether a command answers a sample that is too old or was never sent; `answered` is its tick, with bits `mask`."""
    age = interface.tick - answered & mask
    if interface.tick < 0 or age <= settings.oldest:
        return False
    reception.unusable += 1
    _note_rejected(interface, Refusal.AGE, reception.can_id, age, k)
    return True


@njit
def _note_rejected(interface, why, can_id, value_received, k):
    """Keep the first frame that is not used, for the summary."""
    if interface.rejected_why == 0:
        interface.rejected_why, interface.rejected_id = why.value, can_id
        interface.rejected_value, interface.rejected_clutch = value_received, k


@njit
def _refuse(interface, why, can_id, value_received, k):
    """Store the refused frame, for the error message and the summary; return the Refusal `why` as a number."""
    _note_rejected(interface, why, can_id, value_received, k)
    interface.refused_id, interface.refused_value, interface.refused_clutch = can_id, value_received, k
    return why.value


@njit(cache=True, nogil=True)
def skip_periods(interfaces: Any, all_settings: Any, periods: Any) -> None:
    """Account for missed periods; see `Interface.skip_periods`."""
    if periods > 1:
        for k in range(all_settings[0].count):
            interfaces[0].clutches[k].age -= periods - 1


@njit(cache=True, nogil=True)
def begin(interfaces: Any, all_settings: Any, tick: Any, late_cycles: Any, setpoints: Any, outbox: Any) -> Any:
    """Write the frames of plant and supervisor at `tick`; return their number. Stale commands of clutch a stop the motor."""
    interface, settings, sent = interfaces[0], all_settings[0], 0
    interface.tick = tick
    if _find_actuators(interface.clutches[0]) >= Actuators.STALE.value:
        interface.speed_demand = interface.torque_limit = 0.0
    if tick % settings.heartbeat_every == 0:
        s = settings.plant_heartbeat
        interface.beats += 1
        word = put(np.int64(0), s.lifecycle, Lifecycle.ACTIVE.value)
        word = put(word, s.rate, settings.rate)
        word = put(word, s.session, settings.session)
        write_frame(outbox[sent], s, word, interface.beats)
        sent += 1
    if tick % settings.status_every == 0:
        s = settings.plant_status
        actuators, rejected = Actuators.SAFE.value, count_rejected(interface.motor)
        for k in range(settings.count):
            clutch = interface.clutches[k]
            actuators = max(actuators, _find_actuators(clutch))
            rejected += count_rejected(clutch.valve) + count_rejected(clutch.heartbeat)
        for reception in interface.own:
            rejected += reception.received + count_rejected(reception)
        word = put(np.int64(0), s.actuators, actuators)
        word = put(word, s.late_cycles, late_cycles)
        word = put(word, s.rejected_frames, rejected)
        write_frame(outbox[sent], s, word, tick // settings.status_every)
        sent += 1
    time = tick * settings.period
    if tick % settings.claim_every == 0:
        interface.claims += 1
        for k in range(len(setpoints)):  # a plant without a profile does not act as supervisor
            s = settings.clutches[k].supervisor_claim
            word = put(put(np.int64(0), s.claim, True), s.session, settings.claim_session)
            write_frame(outbox[sent], s, word, interface.claims)
            sent += 1
    for k in range(len(setpoints)):
        s = settings.clutches[k].torque_setpoint
        request, torque, speed, pressure = _setpoint(setpoints[k], time)
        interface.clutches[k].torque_demand = torque
        word = put(np.int64(0), s.request, request)
        word = put(word, s.torque_demand, torque)
        word = put(word, s.speed_demand, speed)
        word = put(word, s.pressure_demand, pressure)
        write_frame(outbox[sent], s, word, tick)
        sent += 1
    return sent


@njit(cache=True, nogil=True)
def show(
    interfaces: Any, all_settings: Any, k: Any, tick: Any, y: Any, states: Any, parameters: Any, effects: Any, outbox: Any,
    sent: Any,
) -> Any:  # fmt: skip
    """Write the sensor frames of clutch `k`; return the number of frames in `outbox`, which was `sent` before.

    The encoder frame is the last: it completes the sample. `y`, `states`, `parameters` and `effects` are those of
    `sensors.acquire`; `states` advance in place.
    """
    settings = all_settings[0]
    clutch, its = interfaces[0].clutches[k], settings.clutches[k]
    if clutch.commanded and clutch.age >= settings.latch_after and clutch.controller != Lifecycle.FINALIZED.value:
        clutch.latched = Actuators.LATE.value if clutch.late > 0 else Actuators.LOST.value
    if clutch.commanded and clutch.age >= STALE_CYCLES and not clutch.stale:
        clutch.stale = True
        clutch.gaps += settings.gap_memory
    if clutch.gaps > MOST_GAPS * settings.gap_memory:
        clutch.latched = Actuators.LOST.value
    clutch.gaps = max(clutch.gaps - 1, 0)
    if clutch.valve.doubts >= MOST_DOUBTS or (k == 0 and interfaces[0].motor.doubts >= MOST_DOUBTS):
        clutch.latched = Actuators.TWO_SENDERS.value
    clutch.actuators = _find_actuators(clutch)
    if clutch.actuators >= Actuators.STALE.value:
        clutch.voltage = 0.0
    clutch.age += 1
    draw(its.noise_source, clutch.noise)
    (pressure, temperature, motor_torque, clutch_torque, count), after = acquire(
        y, states, clutch.noise, parameters, effects, settings.period
    )
    states[:] = after
    s = its.analog_sensors
    word = put_raw(np.int64(0), s.cylinder_pressure, pressure)
    word = put_raw(word, s.oil_temperature, temperature)
    word = put_raw(word, s.clutch_torque, clutch_torque)
    write_frame(outbox[sent], s, word, tick)
    clutch.pressure, clutch.temperature = read_value(word, s.cylinder_pressure), read_value(word, s.oil_temperature)
    clutch.clutch_torque = read_value(word, s.clutch_torque)
    s = its.encoder
    angle, clutch.slip_speed = 0.0, y[0].slip_speed  # true slip speed in the first sample
    if clutch.begun:
        angle = count_turn(count, clutch.count, s.shaft_angle) * s.shaft_angle.scale
        clutch.slip_speed = angle * settings.rate
    clutch.begun, clutch.count = True, count
    clutch.angle += angle
    word = put_raw(np.int64(0), s.shaft_angle, count)
    word = put_raw(word, s.sample_tick, tick)  # it wraps around
    word = put_raw(word, s.motor_torque, motor_torque)
    clutch.motor_torque = read_value(word, s.motor_torque)
    write_frame(outbox[sent + 1], s, word, tick)
    return sent + 2


@njit
def _find_actuators(clutch):
    """Return the Actuators of a clutch: stale if valve commands have stopped after at least one has arrived."""
    if not clutch.commanded:
        return Actuators.SAFE.value
    if clutch.latched != 0:
        return clutch.latched
    return Actuators.STALE.value if clutch.stale or clutch.age >= STALE_CYCLES else Actuators.COMMANDED.value
