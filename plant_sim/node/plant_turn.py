"""Turn: samples of the plant in one compiled call: waited for, made, sent, their rows written.

Nothing of Python runs in between, as in the controller's turns: what an interpreter needs is cold after a sleep.
"""

from typing import Any, NamedTuple

import numpy as np
from numba import njit

from plant_sim.node.plant_cycle import begin, show, slept, take
from plant_sim.node.plant_record import note_sample
from plant_sim.rigs import wet_clutch
from protocols.buses.exchange import CLOCK_MONOTONIC, gather, gather_marked, is_settled, now, spread
from protocols.realtime.beat import BeatMemory, is_called, record_cycle, wait, write

_PATIENCE = 200_000_000  # ns that compiled code waits for an answer; then Python looks


class PlantMemory(NamedTuple):
    """What compiled turns work on of a node: the bus's side, the rig, and where a sample goes.

    interfaces (1,) of INTERFACE, settings (1,) of SETTINGS, setpoints as of `Interface`; rig_state (1,) of STATE and the states
    (k,) of its effects, parameters and effects as of `Rig`, the piston's preload_pressure and contact_pressure [Pa]; period [s]
    of a sample in `substeps`; outbox (OUTBOX,) of frame_batch.FRAME, row (columns,), which is a RECORD.
    """

    interfaces: np.ndarray
    settings: np.ndarray
    setpoints: np.ndarray
    rig_state: np.ndarray
    states: np.ndarray
    parameters: np.ndarray
    effects: Any
    preload_pressure: float
    contact_pressure: float
    period: float
    substeps: int
    outbox: np.ndarray
    row: np.ndarray


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


@njit
def _advance(plant):
    """Move a PlantMemory on by a period."""
    move(plant.interfaces, plant.rig_state, plant.states, plant.parameters, plant.effects, plant.period, plant.substeps)


@njit
def _sample(plant, tick, late_cycles):
    """Make the sample of `tick` of a PlantMemory: frames, whose number is returned, and record."""
    sent = begin(plant.interfaces, plant.settings, tick, late_cycles, plant.setpoints, plant.outbox)
    sent = show(
        plant.interfaces, plant.settings, 0, tick, plant.rig_state, plant.states, plant.parameters, plant.effects,
        plant.outbox, sent,
    )  # fmt: skip
    note_sample(
        plant.row, tick * plant.period, plant.interfaces, plant.rig_state, plant.preload_pressure,
        plant.contact_pressure,
    )  # fmt: skip
    return sent


@njit(cache=True, nogil=True)
def in_time(
    beats: Any, lines: Any, inbox: Any, count: Any, plants: Any, tick: Any, most: Any, changes: Any, owed: Any
) -> tuple[int, int, int, int, int]:
    """Samples from that of `tick` on, each at the end of the period before it, with what comes behind `count` frames.

    `beats` is a BeatMemory, `plants` a PlantMemory, both as plain tuples: of a named one Numba keeps some kB. `owed` of the
    samples come without waiting, then as slots begin; `most`, or up to one after which something is left to Python: a refusal,
    somebody who has come, gone or asked. Rows but the last are written. Returns the samples made, and after the last of them
    those still owed, the frames in the inbox, those sent, or minus the Refusal, and where sending ended (`spread`).
    """
    beat, plant = BeatMemory(*beats), PlantMemory(*plants)
    made, known, behind, clock = 0, count, owed > 0, beat.clocks[0]
    while True:
        waits = owed == 0
        owed = wait(beat) if waits else owed - 1
        made += 1
        _advance(plant)
        if waits:
            behind, count = owed > 0, gather(lines, 0, inbox, count, count)
            why = take(plant.interfaces, plant.settings, inbox, count)
            if why != 0:
                return made, owed, count, -why, 0
            slept(plant.interfaces, plant.settings, owed)
        sent = _sample(plant, tick, clock.late)
        position = spread(lines, 0, plant.outbox, sent)
        if made == most or is_called(lines[0], beat) or not is_settled(lines[0], known, count, sent, position):
            return made, owed, count, sent, position
        tick, known, count = tick + 1, 0, 0
        if owed > 0:
            write(beat, plant.row, changes)
            continue
        record_cycle(beat, plant.row, changes)
        if behind:  # before it goes on: the controller can answer, which may wait for this CPU
            count = gather(lines, clock.period // 2, inbox, 0, 0)


@njit(cache=True, nogil=True)
def in_step(
    beats: Any, lines: Any, inbox: Any, plants: Any, tick: Any, most: Any, changes: Any
) -> tuple[int, int, int, int]:
    """Samples from that of `tick` on, each moved on from through its period, then waited for until it is answered.

    `most`, or up to one after which, or after whose row, something is left to Python, as of `in_time`: an answer that has not
    come, too. Rows are written but that of a last one that was not waited for. Returns the samples made, the frames in the
    inbox, taken already, those sent of the last one, 0 once its row is written, minus the Refusal, and where sending ended.
    """
    beat, plant = BeatMemory(*beats), PlantMemory(*plants)
    line, clutch, clock, made = lines[0], plant.interfaces[0].clutches[0], beat.clocks[0], 0
    answered = plant.settings[0].clutches[0].valve_command.sample_tick
    while True:
        sent = _sample(plant, tick, clock.late)
        position = spread(lines, 0, plant.outbox, sent)
        made += 1
        _advance(plant)  # while the controller answers
        if made == most or is_called(line, beat) or not is_settled(line, 0, 0, sent, position):
            return made, 0, sent, position
        clock.woken = now(CLOCK_MONOTONIC, line.time)
        write(beat, plant.row, changes)
        if clutch.answered_tick != tick & answered.mask:
            count = gather_marked(lines, _PATIENCE, inbox, 0, 0)
            why = take(plant.interfaces, plant.settings, inbox, count)
            if why != 0 or line.changed or clutch.answered_tick != tick & answered.mask:
                return made, count, -why, 0
            line.taken += count
        tick += 1
