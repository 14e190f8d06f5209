"""A sample of the plant, in compiled calls on records: `take` commands, `begin` the sample, `show` what its sensors see."""

from enum import IntEnum
from typing import Any

import numpy as np
from numba import njit

from plant_sim.blocks import dac
from plant_sim.node.noise import draw
from plant_sim.profiles.profile import setpoint
from plant_sim.rigs.sensors import acquire
from protocols.can.frame_batch import word_of, write
from protocols.can.lifecycle import Lifecycle
from protocols.can.reception import RECEPTION, accepted
from protocols.can.two_clutches import CLUTCHES
from protocols.can.words import SIGNAL, put, put_raw, raw, sealed, value

# cycles without a valve command that close the valve's amplifier: as long as the controller's guard waits
STALE_CYCLES = 5
OUTBOX = 8  # frames of a sample at most: heartbeat, status, and of each of two clutches set-point, sensors, encoder
_SHORT, _LONG = 6, 8  # bytes of PLANT_STATUS, and of all else that a plant sends
_WRAP = 1 << 32  # counts of the encoder's counter
_TICK = 0xFFFF  # mask of the sample's number in a frame
_COUNT_MAX = 65535  # end of what PLANT_STATUS can count


class Refusal(IntEnum):
    """Why a bus cannot be worked on."""

    SECOND_PLANT = 1
    LENGTH = 2
    RATE = 3
    LIFECYCLE = 4


# A clutch on the bus. voltage [V] at its valve; answered_tick: SAMPLE_TICK of the last valve command, -1 before the first;
# controller: Lifecycle of its controller; age: cycles since the last valve command, if one has come (commanded); what the data
# acquisition shows [bar, rad/s, rad, degC, Nm, Nm], slip_speed as the difference of encoder counts, once there are two; noise:
# that of its sensors in the sample, standard normal, from the generator at noise_source (`noise.py`)
CLUTCH = np.dtype(
    [("voltage", "f8"), ("answered_tick", "i8"), ("controller", "i8"), ("age", "i8"), ("commanded", "?"),
     ("torque_demand", "f8"), ("begun", "?"), ("count", "i8"), ("pressure", "f8"), ("slip_speed", "f8"), ("angle", "f8"),
     ("temperature", "f8"), ("clutch_torque", "f8"), ("motor_torque", "f8"), ("noise", "f8", (4,)), ("valve", RECEPTION),
     ("heartbeat", RECEPTION)]
)  # fmt: skip
CLUTCH_SETTINGS = np.dtype(
    [("dac_range", "f8"), ("dac_bits", "i8"), ("noise_source", "i8"), ("analog_id", "i8"), ("encoder_id", "i8"),
     ("setpoint_id", "i8")]
)  # fmt: skip
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
     ("plant_status", SIGNAL, (3,)), ("plant_heartbeat", SIGNAL, (3,)), ("clutches", CLUTCH_SETTINGS, (len(CLUTCHES),))]
)  # fmt: skip
_dac, _setpoint = njit(dac.voltage), njit(setpoint)


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
def slept(interfaces: Any, all_settings: Any, periods: Any) -> None:
    """See `Interface.slept`."""
    if periods > 1:
        for k in range(all_settings[0].count):
            interfaces[0].clutches[k].age -= periods - 1


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
    interfaces: Any, all_settings: Any, k: Any, tick: Any, y: Any, states: Any, parameters: Any, effects: Any, outbox: Any,
    sent: Any,
) -> Any:  # fmt: skip
    """Sensor frames of clutch `k`, the encoder's last: it completes the sample; return the number of frames in `outbox`.

    Rig and effects as of `sensors.acquire`; `states` move on in place.
    """
    settings = all_settings[0]
    clutch, its = interfaces[0].clutches[k], settings.clutches[k]
    if _stale(clutch):
        clutch.voltage = 0.0
    clutch.age += 1
    draw(its.noise_source, clutch.noise)
    (pressure, temperature, motor_torque, clutch_torque, count), after = acquire(
        y, states, clutch.noise, parameters, effects, settings.period
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
