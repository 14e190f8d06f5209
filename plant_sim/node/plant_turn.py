"""Turns of the plant: one compiled call waits for a slot, makes a sample, sends it and writes its row, many times.

No Python code runs in between: after a sleep the CPU caches are cold, and an interpreter needs much memory.
"""

from typing import Any, NamedTuple

import numpy as np
from numba import njit

from plant_sim.node.plant_cycle import begin, show, skip_periods, take
from plant_sim.node.plant_record import note_sample
from plant_sim.rigs import wet_clutch
from protocols.buses.exchange import CLOCK_MONOTONIC, gather, gather_marked, is_settled, read_clock, send_to_all
from protocols.realtime.beat import BeatMemory, is_called, record_cycle, wait, write

_ANSWER_WAIT = 200_000_000  # ns that compiled code waits for an answer; then Python checks for a stop request


class PlantMemory(NamedTuple):
    """Memory of a node for compiled turns: bus interface, rig, and the destination of a sample.

    interfaces (1,) of INTERFACE; settings (1,) of SETTINGS; setpoints of `Interface`; rig_state (1,) of STATE; states (k,) of
    the effects; parameters and effects of `Rig`; preload_pressure and contact_pressure [Pa] of the piston; period [s],
    integrated in `substeps`; outbox (OUTBOX,) of frame_batch.FRAME; row (columns,), the memory of a RECORD.
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
    """Advance the rig in place by `duration` [s] (`wet_clutch.advance`), with the inputs of the interface."""
    interface = interfaces[0]
    after, states_after = wet_clutch.advance(
        rig_state, states, interface.clutches[0].voltage, interface.speed_demand, interface.torque_limit, parameters,
        effects, duration, substeps,
    )  # fmt: skip
    rig_state[0] = after[0]
    states[:] = states_after


@njit
def advance(plant: Any) -> None:
    """Advance a PlantMemory by a period."""
    move(plant.interfaces, plant.rig_state, plant.states, plant.parameters, plant.effects, plant.period, plant.substeps)


@njit
def make_sample(plant: Any, tick: Any, late_cycles: Any) -> Any:
    """Make the sample `tick` of a PlantMemory: its frames and its record; return the number of frames."""
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
def run_real_time(
    beats: Any, lines: Any, inbox: Any, count: Any, plants: Any, tick: Any, most: Any, changes: Any, owed: Any
) -> tuple[int, int, int, int, int]:
    """Make samples in real time, beginning with `tick`; the rig advances by a period before each.

    `beats` is a BeatMemory and `plants` a PlantMemory, as plain tuples: for a named tuple Numba keeps some kB. `count` frames
    are in `inbox` already; none may be there where samples are owed, which take no frames. The first `owed` samples do not
    wait; the others wait for their slots. The call ends after `most` samples, or when Python has work: a frame is refused,
    a participant joins or leaves, a request arrives. All rows but the last are written.

    Returns the number of samples; then, after the last one: the samples still owed, the frames in the inbox, the frames sent
    (or minus the Refusal), and the position where sending ended (`send_to_all`).
    """
    beat, plant = BeatMemory(*beats), PlantMemory(*plants)
    samples, known, behind, clock = 0, count, owed > 0, beat.clocks[0]
    while True:
        waits = owed == 0
        owed = wait(beat) if waits else owed - 1
        samples += 1
        advance(plant)
        if waits:
            behind, count = owed > 0, gather(lines, 0, inbox, count, count)
            why = take(plant.interfaces, plant.settings, inbox, count)
            if why != 0:
                return samples, owed, count, -why, 0
            skip_periods(plant.interfaces, plant.settings, owed)
        sent = make_sample(plant, tick, clock.late)
        position = send_to_all(lines, 0, plant.outbox, sent)
        if samples == most or is_called(lines[0], beat) or not is_settled(lines[0], known, count, sent, position):
            return samples, owed, count, sent, position
        tick, known, count = tick + 1, 0, 0
        if owed > 0:
            write(beat, plant.row, changes)
            continue
        record_cycle(beat, plant.row, changes)
        if behind:  # lets a controller on this CPU answer before the plant continues
            count = gather(lines, clock.period // 2, inbox, 0, 0)


@njit(cache=True, nogil=True)
def run_lockstep(
    beats: Any, lines: Any, inbox: Any, plants: Any, tick: Any, most: Any, changes: Any
) -> tuple[int, int, int, int]:
    """Make samples in lock-step, beginning with `tick`; after each the rig advances by a period and the answer is awaited.

    The call ends after `most` samples, or when Python has work, as `run_real_time` does; also when an answer does not
    come. All rows are written but that of a last sample whose answer was not awaited.

    Returns the number of samples; the frames in the inbox, which are already taken; the frames sent for the last sample (0 when
    its row is written, or minus the Refusal); and the position where sending ended.
    """
    beat, plant = BeatMemory(*beats), PlantMemory(*plants)
    line, clutch, clock, samples = lines[0], plant.interfaces[0].clutches[0], beat.clocks[0], 0
    answered = plant.settings[0].clutches[0].valve_command.sample_tick
    while True:
        sent = make_sample(plant, tick, clock.late)
        position = send_to_all(lines, 0, plant.outbox, sent)
        samples += 1
        advance(plant)  # while the controller answers
        if samples == most or is_called(line, beat) or not is_settled(line, 0, 0, sent, position):
            return samples, 0, sent, position
        clock.woken = read_clock(CLOCK_MONOTONIC, line.time)
        write(beat, plant.row, changes)
        if clutch.answered_tick != tick & answered.mask:
            count = gather_marked(lines, _ANSWER_WAIT, inbox, 0, 0)
            why = take(plant.interfaces, plant.settings, inbox, count)
            if why != 0 or line.changed or clutch.answered_tick != tick & answered.mask:
                return samples, count, -why, 0
            line.taken += count
        tick += 1
