"""Turn: samples of the plant in one compiled call: waited for, made, sent, their rows written.

Nothing of Python runs in between, as in the controller's turns: what an interpreter needs is cold after a sleep.
"""

from typing import Any

from numba import njit

from plant_sim.node.plant_cycle import begin, show, slept, take
from plant_sim.rigs import wet_clutch
from plant_sim.rigs.clutch_phase import phase
from protocols.buses.exchange import CLOCK_MONOTONIC, gather, gather_marked, is_settled, now, spread
from protocols.files.units import BAR, ZERO_CELSIUS
from protocols.realtime.beat import is_called, record_cycle, wait, write
from protocols.realtime.clock import Word

_LATE, _PERIOD, _WOKEN = int(Word.LATE), int(Word.PERIOD), int(Word.WOKEN)
_PATIENCE = 200_000_000  # ns that compiled code waits for an answer; then Python looks
_TICK = 0xFFFF  # mask of a sample's number in its answer
_phase = njit(phase)


@njit(cache=True, nogil=True)
def move(
    interfaces: Any, rig_state: Any, states: Any, parameters: Any, effects: Any, duration: Any, substeps: Any
) -> None:
    """As `wet_clutch.advance` with the inputs that the interface holds, in place."""
    interface = interfaces[0]
    after, states_after = wet_clutch.advance(
        rig_state, states, interface.clutches[0].voltage, interface.speed_demand, interface.torque_limit, parameters,
        effects, duration, substeps,
    )  # fmt: skip
    rig_state[0] = after[0]
    states[:] = states_after


@njit(cache=True, nogil=True)
def note(row: Any, time: Any, interfaces: Any, rig_state: Any, preload_pressure: Any, contact_pressure: Any) -> None:
    """Fill the record of a sample, in the order of COLUMNS."""
    interface, y = interfaces[0], rig_state[0]
    c = interface.clutches[0]
    row[0], row[1], row[2], row[3] = time, c.voltage, interface.speed_demand, c.pressure
    row[4], row[5], row[6], row[7], row[8] = c.slip_speed, c.angle, c.temperature, c.clutch_torque, c.motor_torque
    row[9], row[10], row[11] = y.valve_pressure / BAR, y.pressure / BAR, y.position
    row[12], row[13], row[14] = y.normal_force, y.seal_force, y.friction_state
    row[15], row[16], row[17] = y.clutch_torque, y.motor_torque, y.slip_speed
    row[18], row[19] = y.temperature - ZERO_CELSIUS, _phase(y, preload_pressure, contact_pressure).value


@njit(cache=True, nogil=True)
def in_time(
    words: Any, spins: Any, lines: Any, inbox: Any, count: Any, interfaces: Any, settings: Any, tick: Any, setpoints: Any,
    rig_state: Any, states: Any, parameters: Any, effects: Any, preload_pressure: Any, contact_pressure: Any,
    period: Any, substeps: Any, outbox: Any, row: Any, most: Any, rows: Any, counts: Any, numbers: Any, changes: Any, owed: Any,
) -> tuple[int, int, int, int, int]:  # fmt: skip
    """Samples from that of `tick` on, each at the end of the period before it, with what comes behind `count` frames.

    `owed` of them without waiting, then as slots begin; `most`, or up to one after which something is left to Python: a
    refusal, somebody who has come, gone or asked. Rows but the last are written. Returns the samples made, and after the last
    of them those still owed, the frames in the inbox, those sent, or minus the Refusal, and where sending ended (`spread`).
    """
    made, known, behind = 0, count, owed > 0
    while True:
        waits = owed == 0
        owed = wait(words, spins) if waits else owed - 1
        made += 1
        move(interfaces, rig_state, states, parameters, effects, period, substeps)
        if waits:
            behind, count = owed > 0, gather(lines, 0, inbox, count, count)
            why = take(interfaces, settings, inbox, count)
            if why != 0:
                return made, owed, count, -why, 0
            slept(interfaces, settings, owed)
        sent = begin(interfaces, settings, tick, words[_LATE], setpoints, outbox)
        sent = show(interfaces, settings, 0, tick, rig_state, states, parameters, effects, outbox, sent)
        note(row, tick * period, interfaces, rig_state, preload_pressure, contact_pressure)
        position = spread(lines, 0, outbox, sent)
        if made == most or is_called(lines[0], numbers) or not is_settled(lines[0], known, count, sent, position):
            return made, owed, count, sent, position
        tick, known, count = tick + 1, 0, 0
        if owed > 0:
            write(words, rows, counts, row, changes)
            continue
        record_cycle(words, rows, counts, row, changes)
        if behind:  # before it goes on: the controller can answer, which may wait for this CPU
            count = gather(lines, words[_PERIOD] // 2, inbox, 0, 0)


@njit(cache=True, nogil=True)
def in_step(
    words: Any, lines: Any, inbox: Any, interfaces: Any, settings: Any, tick: Any, setpoints: Any,
    rig_state: Any, states: Any, parameters: Any, effects: Any, preload_pressure: Any, contact_pressure: Any,
    period: Any, substeps: Any, outbox: Any, row: Any, most: Any, rows: Any, counts: Any, numbers: Any, changes: Any,
) -> tuple[int, int, int, int]:  # fmt: skip
    """Samples from that of `tick` on, each moved on from through its period, then waited for until it is answered.

    `most`, or up to one after which, or after whose row, something is left to Python, as of `in_time`: an answer that has not
    come, too. Rows are written but that of a last one that was not waited for. Returns the samples made, the frames in the
    inbox, taken already, those sent of the last one, 0 once its row is written, minus the Refusal, and where sending ended.
    """
    line, clutch, made = lines[0], interfaces[0].clutches[0], 0
    while True:
        sent = begin(interfaces, settings, tick, words[_LATE], setpoints, outbox)
        sent = show(interfaces, settings, 0, tick, rig_state, states, parameters, effects, outbox, sent)
        note(row, tick * period, interfaces, rig_state, preload_pressure, contact_pressure)
        position = spread(lines, 0, outbox, sent)
        made += 1
        move(interfaces, rig_state, states, parameters, effects, period, substeps)  # while the controller answers
        if made == most or is_called(line, numbers) or not is_settled(line, 0, 0, sent, position):
            return made, 0, sent, position
        words[_WOKEN] = now(CLOCK_MONOTONIC, line.time)
        write(words, rows, counts, row, changes)
        if clutch.answered_tick != tick & _TICK:
            count = gather_marked(lines, _PATIENCE, inbox, 0, 0)
            why = take(interfaces, settings, inbox, count)
            if why != 0 or line.changed or clutch.answered_tick != tick & _TICK:
                return made, count, -why, 0
            line.taken += count
        tick += 1
