"""Turn: frames in, a cycle, frames out, in one compiled call; the slot or the sample waited for in it, too.

Nothing of Python runs between a sample and its answer: after a sleep caches are cold, and an interpreter needs much of them.
"""

from math import floor
from typing import Any

import numpy as np
from numba import njit

from protocols.buses.exchange import (
    CLOCK_MONOTONIC,
    CLOCK_REALTIME,
    empty_lines,
    gather,
    gather_marked,
    is_settled,
    now,
    spread,
)
from protocols.can.frame_batch import batch
from protocols.realtime.beat import Beat, arrive, is_called, record_cycle, wait, write
from protocols.realtime.clock import Clock
from rt_controller.loop.cycle import ControllerMemory, cycle
from rt_controller.loop.node import ControllerNode
from rt_controller.loop.phase_lock import follow
from rt_controller.loop.samples import Samples

_SAMPLE_WAIT = 200_000_000  # ns that compiled code waits for a sample in lock-step; then Python looks
# Of the last turn: frames in the inbox, slots since the one before, when it woke, when its sample was there, and until when it
# would have been waited for [ns of CLOCK_MONOTONIC], frames sent, or minus the Refusal, where sending them ended
_TURN = np.dtype([(name, "i8") for name in ("count", "slots", "woken", "arrived", "patience", "sent", "position")])
GRID = np.zeros(0)  # drift of a grid that follows nothing


class Turn:
    """Turns of `node` on the line of `samples`."""

    def __init__(self, samples: Samples, node: ControllerNode) -> None:
        self.samples, self.node = samples, node
        self._turns = np.zeros(1, _TURN)
        # an element of a memory view is read ten times as fast as a field of a record
        views = [self._turns[name].data for name in _TURN.names or ()]
        self._count, self._slots, self._woken, self._arrived, self._patience, self._sent, self._position = views
        warm(node)

    def answer(self, slots: int) -> bool:
        """Take the frames that wait, run the cycle `slots` periods after the last one, send its frames.

        Returns whether a sample is complete by them. Raises InputError as `ControllerNode.cycle`.
        """
        line, node = self.samples.line, self.node
        marks, first = line.marks, line.count
        line.refresh()
        answer(line.lines, line.inbox, first, slots, node.memory, self._turns)
        complete = line.marks > marks
        self._finish()
        return complete

    def answer_slots(self, beat: Beat, changes: int, drifts: np.ndarray = GRID) -> int:
        """Wait for the next slot, then the same, and so on, `beat.most` times at most; rows but the last are booked.

        `drifts` is that of a grid which follows the samples (`phase_lock.follow`). Returns the slots slept through before the
        last.
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
            follow(beat.memory.clocks, drifts, complete, self.samples.arrived_ns())
        return missed

    def answer_samples(self, beat: Beat, changes: int) -> int:
        """Wait for the next sample until half a period after it is due, run its cycle, and so on, as `answer_slots` does.

        A slot whose sample has not come by then has its cycle without one.
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
            line.accept(self._count[0], first)  # somebody has come, or gone
            patience = self._patience[0]

    def answer_in_step(self, beat: Beat, changes: int) -> tuple[bool, bool]:
        """The same for a sample that is complete, wait for the next one, and so on, `beat.most` times at most.

        Rows but the last are in the ring; returns whether the last is, and whether the sample after it is complete.
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
        """What the compiled call leaves to do: of the frames it has sent, then of those used."""
        line, node = self.samples.line, self.node
        line.finish_send(node.outbox, node.check_sent(self._sent[0]), self._position[0])
        line.discard_used(self._count[0])


def warm(node: ControllerNode) -> None:
    """Compile, or load from disk, the turns of a node: now, not in the loop; nothing is taken or sent."""
    copy, inbox, turns = ControllerMemory(*(part.copy() for part in node.memory)), batch(1), np.zeros(1, _TURN)
    lines, beat = empty_lines(), Beat(Clock(1000)).memory
    answer(lines, inbox, 0, 1, copy, turns)
    answer_slots(beat, lines, inbox, 0, copy, turns, 1, 0, GRID)
    answer_samples(beat, lines, inbox, 0, copy, turns, 1, 0, 0)
    answer_in_step(beat, lines, inbox, 0, copy, turns, 1, 0)
    follow(beat.clocks, np.zeros(1), False, 0)


@njit
def choose_slot(before: Any, period: Any, arrived: Any, at: Any, patience: Any, extended: Any) -> tuple[int, int, int]:
    """What begins `at`, where a sample `came`, or none (0): slots since the one at `before`, the last one's time, new patience.

    No slots: go on waiting. A sample of the slot before, which has gone without it, begins nothing; a slot without a sample
    begins at `patience`, unless the machine stood still, and the plant with it: its frames are on the way, and waited for
    `anew`, once. All ns of one clock.
    """
    if arrived > 0:
        return slots_since(before, arrived, at, period), arrived, patience
    if at < patience:
        return 0, 0, patience
    if at >= patience + period // 2 and not extended:
        return 0, 0, at + period // 2
    slots = max(1, round((at - before) / period - 0.5))
    return slots, before + slots * period, patience


@njit
def slots_since(before_ns: Any, arrived_ns: Any, now_ns: Any, period_ns: Any) -> Any:
    """Slots of `period_ns` from the one at `before_ns` to that of a sample which `arrived_ns` and is seen `now_ns`.

    0 where it is of the slot before: less than half a period is over. All of one clock.
    """
    if now_ns - before_ns < period_ns // 2:
        return 0
    return max(1, floor((arrived_ns - before_ns) / period_ns + 0.5))


@njit(cache=True, nogil=True)
def answer(lines: Any, inbox: Any, count: Any, slots: Any, node: Any, turns: Any) -> None:
    """See `Turn.answer`; `count` frames are in the inbox, `node` is a ControllerMemory, `turns` (1,) of _TURN is filled."""
    turn = turns[0]
    turn.count, turn.slots = gather(lines, 0, inbox, count, count), slots
    turn.sent = cycle(node.states, node.settings, inbox, turn.count, slots, node.outbox)
    turn.position = spread(lines, 0, node.outbox, max(turn.sent, 0))


@njit(cache=True, nogil=True)
def answer_slots(
    beat: Any, lines: Any, inbox: Any, count: Any, node: Any, turns: Any, most: Any, changes: Any, drifts: Any
) -> tuple[int, int]:
    """See `Turn.answer_slots`; returns what the last `beat.wait` did, and the turns made. `beat` is a BeatMemory.

    Up to one after which something is left to Python: a refusal, somebody who has come, gone or asked.
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
            follow(beat.clocks, drifts, line.marks > marks, _find_arrival(line, now(CLOCK_MONOTONIC, line.time)))
        if runs == most or is_called(line, beat) or not is_settled(line, count, turn.count, turn.sent, turn.position):
            return missed, runs
        record_cycle(beat, node.row, changes)
        count = 0


@njit(cache=True, nogil=True)
def answer_samples(
    beat: Any, lines: Any, inbox: Any, count: Any, node: Any, turns: Any, most: Any, changes: Any, patience: Any
) -> int:
    """See `Turn.answer_samples`; returns the turns made. `patience` [ns of CLOCK_MONOTONIC] is that of the first; 0: the usual.

    Up to one after which something is left to Python, as of `answer_slots`; in a last one that has not been made, as somebody
    has come or gone, `slots` is 0.
    """
    turn, line, clock, runs = turns[0], lines[0], beat.clocks[0], 0
    while True:
        before, period, at = clock.deadline, clock.period, now(CLOCK_MONOTONIC, line.time)
        turn.patience = patience if patience > 0 else max(before + period, at) + period // 2
        node.states[0].late_cycles = clock.late
        _await_sample(lines, inbox, count, turn, before, period)
        if turn.slots == 0:
            return runs
        runs += 1
        turn.sent = cycle(node.states, node.settings, inbox, turn.count, turn.slots, node.outbox)
        turn.position = spread(lines, 0, node.outbox, max(turn.sent, 0))
        arrive(beat.clocks, turn.woken, turn.arrived, turn.slots)
        if runs == most or is_called(line, beat) or not is_settled(line, count, turn.count, turn.sent, turn.position):
            return runs
        record_cycle(beat, node.row, changes)
        count = patience = 0


@njit(cache=True, nogil=True)
def answer_in_step(
    beat: Any, lines: Any, inbox: Any, count: Any, node: Any, turns: Any, most: Any, changes: Any
) -> tuple[int, bool, int]:
    """See `Turn.answer_in_step`; returns the turns made, whether it ended waiting, and marked frames up to the last answer.

    Up to one after which something is left to Python, as of `answer_slots`.
    """
    turn, line, known, runs = turns[0], lines[0], count, 0
    while True:
        answer(lines, inbox, count, 1, node, turns)
        runs, marks = runs + 1, line.marks
        if runs == most or is_called(line, beat) or not is_settled(line, known, turn.count, turn.sent, turn.position):
            return runs, False, marks
        beat.clocks[0].woken = now(CLOCK_MONOTONIC, line.time)
        write(beat, node.row, changes)
        turn.count = gather_marked(lines, _SAMPLE_WAIT, inbox, 0, 0)
        if line.marks == marks or line.changed:
            return runs, True, marks
        known, count = 0, turn.count


@njit
def _await_sample(lines, inbox, count, turn, before, period):
    """Wait for a sample, or until the turn's patience: `slots` since the one at `before`, 0 where somebody has come or gone."""
    line = lines[0]
    turn.slots, turn.count, turn.woken = 0, count, now(CLOCK_MONOTONIC, line.time)
    patience = turn.patience
    while turn.slots == 0:
        marks, remaining = line.marks, max(turn.patience - turn.woken, 0)
        turn.count = gather_marked(lines, remaining, inbox, count, turn.count)
        turn.woken = now(CLOCK_MONOTONIC, line.time)
        arrived = _find_arrival(line, turn.woken) if line.marks > marks else 0
        turn.slots, turn.arrived, turn.patience = choose_slot(
            before, period, arrived, turn.woken, turn.patience, turn.patience > patience
        )
        if turn.slots == 0 and line.changed:
            return


@njit
def _find_arrival(line, at):
    """When the last sample was complete, seen from `at`, which is now [ns of CLOCK_MONOTONIC]: by the frame's stamp."""
    return at - max(now(CLOCK_REALTIME, line.time) - line.marked_ns, 0)
