"""Turn of the controller: one compiled call waits for a slot or a sample, receives, runs a cycle and sends.

No Python code runs between a sample and its answer: after a sleep the CPU caches are cold, and an interpreter needs much
memory.
"""

from math import floor
from typing import Any

import numpy as np
from numba import njit

from protocols.buses.exchange import (
    CLOCK_MONOTONIC,
    CLOCK_REALTIME,
    gather,
    gather_marked,
    is_settled,
    make_empty_lines,
    read_clock,
    send_to_all,
)
from protocols.can.frame_batch import make_batch
from protocols.realtime.beat import Beat, arrive, is_called, record_cycle, wait, write
from protocols.realtime.clock import Clock
from rt_controller.loop.cycle import ControllerMemory, run_cycle
from rt_controller.loop.node import ControllerNode
from rt_controller.loop.phase_lock import follow
from rt_controller.loop.samples import Samples

_SAMPLE_WAIT = 200_000_000  # ns of waiting for a sample in lock-step, after which Python checks for a stop request
# The last turn: count: frames in the inbox; slots: since the turn before; woken, arrived, patience: time of wake-up, arrival
# of the sample and end of waiting for it [ns of CLOCK_MONOTONIC]; sent: frames sent, or minus the Refusal; position: where
# sending ended
_TURN = np.dtype([(name, "i8") for name in ("count", "slots", "woken", "arrived", "patience", "sent", "position")])
GRID = np.zeros(0)  # drift of an absolute grid: no value


class Turn:
    """Turns of `node` on the bus line of `samples`."""

    def __init__(self, samples: Samples, node: ControllerNode) -> None:
        self.samples, self.node = samples, node
        self._turns = np.zeros(1, _TURN)
        # Reading an element of a memory view is ten times as fast as reading a field of a record
        views = [self._turns[name].data for name in _TURN.names or ()]
        self._count, self._slots, self._woken, self._arrived, self._patience, self._sent, self._position = views
        warm(node)

    def answer(self, slots: int) -> bool:
        """Receive the waiting frames, run the cycle `slots` periods after the last one, send its frames.

        Returns whether they complete a sample. Raises InputError as `ControllerNode.run_cycle`.
        """
        line, node = self.samples.line, self.node
        marks, first = line.marks, line.count
        line.refresh()
        answer(line.lines, line.inbox, first, slots, node.memory, self._turns)
        complete = line.marks > marks
        self._finish()
        return complete

    def answer_slots(self, beat: Beat, changes: int, drifts: np.ndarray = GRID) -> int:
        """Wait for the next slot and do a turn as `answer`; repeat, at most `beat.most` times.

        All rows but the last are recorded. `drifts` is the state of a grid that follows the samples (`phase_lock.follow`),
        empty for an absolute grid. Returns the number of missed slots before the last turn.
        """
        line, node = self.samples.line, self.node
        line.refresh()
        missed, runs = answer_slots(
            beat.memory, line.lines, line.inbox, line.count, node.memory, self._turns, beat.most, changes, drifts
        )
        if runs > (missed >= 0):
            line.count_settled()
        if missed >= 0:
            self._finish()
            return int(missed)
        missed = beat.wake_up(missed)
        complete = self.answer(1 + missed)
        if drifts.size:
            follow(beat.memory.clocks, drifts, complete, self.samples.find_arrival_ns())
        return missed

    def answer_samples(self, beat: Beat, changes: int) -> int:
        """Wait for the next sample and do its turn; repeat, at most `beat.most` times. See `answer_slots`.

        If a sample is late by half a period, the cycle runs without it.
        """
        line, node, patience = self.samples.line, self.node, 0
        while True:
            first = line.count
            line.refresh()
            runs = answer_samples(
                beat.memory, line.lines, line.inbox, first, node.memory, self._turns, beat.most, changes, patience
            )
            slots = self._slots[0]
            if runs > (slots > 0):
                line.count_settled()
                first = 0
            if slots:
                self._finish()
                return slots - 1
            line.accept(self._count[0], first)  # a participant has joined or left the bus
            patience = self._patience[0]

    def answer_in_step(self, beat: Beat, changes: int) -> tuple[bool, bool]:
        """Answer a complete sample and wait for the next one; repeat, at most `beat.most` times.

        All rows but the last are written to the ring. Returns whether the last row is also written, and whether the next sample
        is complete.
        """
        line, node = self.samples.line, self.node
        line.refresh()
        runs, waited, marks = answer_in_step(
            beat.memory, line.lines, line.inbox, line.count, node.memory, self._turns, beat.most, changes
        )
        if runs > (not waited):
            line.count_settled()
        if waited:
            line.accept(self._count[0], 0)
        else:
            self._finish()
        return bool(waited), line.marks > marks

    def _finish(self) -> None:
        """Finish sending and discard the used frames, after the compiled call. Raises InputError for a Refusal."""
        line, node = self.samples.line, self.node
        line.finish_send(node.outbox, node.check_sent(self._sent[0]), self._position[0])
        line.discard_used(self._count[0])


def warm(node: ControllerNode) -> None:
    """Compile, or load from disk, the turns of a node before the loop starts. No frames are received or sent."""
    copy, inbox, turns = ControllerMemory(*(part.copy() for part in node.memory)), make_batch(1), np.zeros(1, _TURN)
    lines, beat = make_empty_lines(), Beat(Clock(1000)).memory
    answer(lines, inbox, 0, 1, copy, turns)
    answer_slots(beat, lines, inbox, 0, copy, turns, 1, 0, GRID)
    answer_samples(beat, lines, inbox, 0, copy, turns, 1, 0, 0)
    answer_in_step(beat, lines, inbox, 0, copy, turns, 1, 0)
    follow(beat.clocks, np.zeros(1), False, 0)


@njit
def choose_slot(before: Any, period: Any, arrived: Any, at: Any, patience: Any, extended: Any) -> tuple[int, int, int]:
    """Decide at the time `at` which slot begins; return slots since `before`, the time of the slot, and the end of waiting.

    `before` is the time of the last slot; `arrived` is the arrival of a sample, 0 without one; `patience` is the end of
    waiting. All times are ns of one clock. With 0 slots the wait continues.

    A late sample of the last slot, whose cycle ran without it, begins no slot. Without a sample a slot begins at `patience`. If
    this time is exceeded by half a period, the computer has stopped, and the plant with it: its frames may be on the way. Then
    the wait is extended, once (`extended`).
    """
    if arrived > 0:
        return count_slots(before, arrived, at, period), arrived, patience
    if at < patience:
        return 0, 0, patience
    if at >= patience + period // 2 and not extended:
        return 0, 0, at + period // 2
    slots = max(1, round((at - before) / period - 0.5))
    return slots, before + slots * period, patience


@njit
def count_slots(before_ns: Any, arrived_ns: Any, now_ns: Any, period_ns: Any) -> Any:
    """Return the slots of `period_ns` from `before_ns` to a sample that arrived at `arrived_ns`; `now_ns` is the present time.

    It is 0 for a sample of the last slot, less than half a period ago. All times are of one clock.
    """
    if now_ns - before_ns < period_ns // 2:
        return 0
    return max(1, floor((arrived_ns - before_ns) / period_ns + 0.5))


@njit(cache=True, nogil=True)
def answer(lines: Any, inbox: Any, count: Any, slots: Any, node: Any, turns: Any) -> None:
    """Do one turn, see `Turn.answer`, and fill `turns` (1,) of _TURN.

    `count` frames are in `inbox` already; `node` is a ControllerMemory.
    """
    turn = turns[0]
    turn.count, turn.slots = gather(lines, 0, inbox, count, count), slots
    turn.sent = run_cycle(node.states, node.settings, inbox, turn.count, slots, node.outbox)
    turn.position = send_to_all(lines, 0, node.outbox, max(turn.sent, 0))


@njit(cache=True, nogil=True)
def answer_slots(
    beat: Any, lines: Any, inbox: Any, count: Any, node: Any, turns: Any, most: Any, changes: Any, drifts: Any
) -> tuple[int, int]:
    """Do turns by slots, see `Turn.answer_slots`; return the result of the last `beat.wait`, and the number of turns.

    `beat` is a BeatMemory. The call also ends when Python has work: a frame is refused, a participant joins or leaves the
    bus, a request arrives.
    """
    turn, line, clock, runs = turns[0], lines[0], beat.clocks[0], 0
    while True:
        missed = wait(beat)
        if missed < 0:
            return missed, runs
        runs += 1
        node.states[0].late_cycles, marks = clock.late, line.marks
        answer(lines, inbox, count, 1 + missed, node, turns)
        if drifts.size > 0:
            follow(beat.clocks, drifts, line.marks > marks, _find_arrival(line, read_clock(CLOCK_MONOTONIC, line.time)))
        if runs == most or is_called(line, beat) or not is_settled(line, count, turn.count, turn.sent, turn.position):
            return missed, runs
        record_cycle(beat, node.row, changes)
        count = 0


@njit(cache=True, nogil=True)
def answer_samples(
    beat: Any, lines: Any, inbox: Any, count: Any, node: Any, turns: Any, most: Any, changes: Any, patience: Any
) -> int:
    """Do turns by samples, see `Turn.answer_samples`; return the number of turns.

    `patience` [ns of CLOCK_MONOTONIC] is the end of waiting for the first sample, 0 for the usual one. The call also ends when
    Python has work, as `answer_slots` does. If a participant joins or leaves during a wait, `slots` of the turn is 0.
    """
    turn, line, clock, runs = turns[0], lines[0], beat.clocks[0], 0
    while True:
        before, period, at = clock.deadline, clock.period, read_clock(CLOCK_MONOTONIC, line.time)
        turn.patience = patience if patience > 0 else max(before + period, at) + period // 2
        node.states[0].late_cycles = clock.late
        _await_sample(lines, inbox, count, turn, before, period)
        if turn.slots == 0:
            return runs
        runs += 1
        turn.sent = run_cycle(node.states, node.settings, inbox, turn.count, turn.slots, node.outbox)
        turn.position = send_to_all(lines, 0, node.outbox, max(turn.sent, 0))
        arrive(beat.clocks, turn.woken, turn.arrived, turn.slots)
        if runs == most or is_called(line, beat) or not is_settled(line, count, turn.count, turn.sent, turn.position):
            return runs
        record_cycle(beat, node.row, changes)
        count = patience = 0


@njit(cache=True, nogil=True)
def answer_in_step(
    beat: Any, lines: Any, inbox: Any, count: Any, node: Any, turns: Any, most: Any, changes: Any
) -> tuple[int, bool, int]:
    """Do turns in lock-step, see `Turn.answer_in_step`.

    Returns the number of turns, whether it ended in a wait, and the number of marked frames up to the last answer. The call
    also ends when Python has work, as `answer_slots` does.
    """
    turn, line, known, runs = turns[0], lines[0], count, 0
    while True:
        answer(lines, inbox, count, 1, node, turns)
        runs, marks = runs + 1, line.marks
        if runs == most or is_called(line, beat) or not is_settled(line, known, turn.count, turn.sent, turn.position):
            return runs, False, marks
        beat.clocks[0].woken = read_clock(CLOCK_MONOTONIC, line.time)
        write(beat, node.row, changes)
        turn.count = gather_marked(lines, _SAMPLE_WAIT, inbox, 0, 0)
        if line.marks == marks or line.changed:
            return runs, True, marks
        known, count = 0, turn.count


@njit
def _await_sample(lines, inbox, count, turn, before, period):
    """Wait for a sample or until the turn's `patience`; set its `slots` since `before`, 0 if a participant joins or leaves."""
    line = lines[0]
    turn.slots, turn.count, turn.woken = 0, count, read_clock(CLOCK_MONOTONIC, line.time)
    patience = turn.patience
    while turn.slots == 0:
        marks, remaining = line.marks, max(turn.patience - turn.woken, 0)
        turn.count = gather_marked(lines, remaining, inbox, count, turn.count)
        turn.woken = read_clock(CLOCK_MONOTONIC, line.time)
        arrived = _find_arrival(line, turn.woken) if line.marks > marks else 0
        turn.slots, turn.arrived, turn.patience = choose_slot(
            before, period, arrived, turn.woken, turn.patience, turn.patience > patience
        )
        if turn.slots == 0 and line.changed:
            return


@njit
def _find_arrival(line, at):
    """Return when the last sample was complete, from its time stamp; `at` is the present time [ns of CLOCK_MONOTONIC]."""
    return at - max(read_clock(CLOCK_REALTIME, line.time) - line.marked_ns, 0)
