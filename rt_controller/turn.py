"""Turn: frames in, a cycle, frames out, in one compiled call; the slot or the sample waited for in it, too.

Nothing of Python runs between a sample and its answer: after a sleep caches are cold, and an interpreter needs much of them.
"""

from math import floor
from typing import Any

import numpy as np
from numba import njit

from protocols.batch import batch
from protocols.beat import BEGUN, Beat, arrive, book, called, wait
from protocols.clock import Clock, Word
from protocols.exchange import CLOCK_MONOTONIC, CLOCK_REALTIME, gather, gather_marked, now, settled, silence, spread
from rt_controller.cycle import cycle
from rt_controller.node import ControllerNode
from rt_controller.phase_lock import follow
from rt_controller.samples import Samples

_LATE, _DEADLINE, _PERIOD = int(Word.LATE), int(Word.DEADLINE), int(Word.PERIOD)
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
        self._compile()

    def _compile(self) -> None:
        """Now, not in the loop; nothing is taken or sent."""
        node, line = self.node, self.samples.line
        states, rest = node.states.copy(), (node.settings, batch(len(node.outbox)), node.record.copy(), self._turns)
        lines = silence()
        answer(lines, line.inbox, 0, 1, states, *rest)
        answer_sample(lines, 0, 0, 1, line.inbox, 0, states, *rest)
        beat = Beat(Clock(1))
        answer_slots(beat.words, beat.spins, lines, line.inbox, 0, states, *rest, 1, *beat.outlet, 0, GRID)
        answer_samples(beat.words, lines, line.inbox, 0, states, *rest, 1, *beat.outlet, 0)
        arrive(beat.words, 0, 0, 1)
        follow(beat.words, np.zeros(1), False, 0)

    @property
    def woken_ns(self) -> int:
        """When the last sample waited for was there for us, when it had `arrived_ns` [ns of CLOCK_MONOTONIC]."""
        return self._woken[0]

    @property
    def arrived_ns(self) -> int:
        """See `woken_ns`."""
        return self._arrived[0]

    @property
    def patience_ns(self) -> int:
        """Until when `answer_samples` has waited, or would have [ns of CLOCK_MONOTONIC]."""
        return self._patience[0]

    def answer(self, slots: int) -> bool:
        """Take the frames that wait, run the cycle `slots` periods after the last one, send its frames.

        Returns whether a sample is complete by them. Raises InputError as `ControllerNode.cycle`.
        """
        line, node = self.samples.line, self.node
        marks, first = line.marks, line.count
        line.ready()
        answer(line.lines, line.inbox, first, slots, node.states, node.settings, node.outbox, node.record, self._turns)
        complete = line.marks > marks
        self._finish()
        return complete

    def answer_slots(self, beat: Beat, changes: int, drifts: np.ndarray = GRID) -> int:
        """Wait for the next slot, then the same, and so on, `beat.most` times at most; rows but the last are booked.

        `drifts` is that of a grid which follows the samples (`phase_lock.follow`). Returns the slots slept through before the
        last.
        """
        line, node = self.samples.line, self.node
        line.ready()
        how, made = answer_slots(
            beat.words, beat.spins, line.lines, line.inbox, line.count, node.states, node.settings, node.outbox,
            node.record, self._turns, beat.most, *beat.outlet, changes, drifts,
        )  # fmt: skip
        if made > (how == BEGUN):
            line.passed()
        if how == BEGUN:
            self._finish()
            return 0
        missed = beat.woke(how)
        complete = self.answer(1 + missed)
        if drifts.size:
            follow(beat.words, drifts, complete, self.samples.arrived_ns())
        return missed

    def answer_samples(self, beat: Beat, changes: int) -> int:
        """Wait for the next sample until half a period after it is due, answer it, and so on, as `answer_slots` does.

        Returns the slots since the one before the last; 0 where there was no cycle but those booked, as of `answer_sample`.
        """
        line, node = self.samples.line, self.node
        first = line.count
        line.ready()
        made = answer_samples(
            beat.words, line.lines, line.inbox, first, node.states, node.settings, node.outbox, node.record, self._turns,
            beat.most, *beat.outlet, changes,
        )  # fmt: skip
        slots: int = self._slots[0]
        if made > (slots > 0):
            line.passed()
            first = 0
        if slots:
            self._finish()
        else:
            line.took(self._count[0], first)
        return slots

    def answer_sample(self, patience_ns: int, before_ns: int, period_ns: int) -> int:
        """Wait for the next complete sample for `patience_ns` [ns] at most; if it comes, the same at once.

        Returns the slots of `period_ns` since the one at `before_ns` of CLOCK_MONOTONIC; 0 when there was no cycle: nothing
        has come, or somebody new, or the sample of the slot before, see `slots_since`.
        """
        line, node = self.samples.line, self.node
        first = line.count
        line.ready()
        slots = answer_sample(
            line.lines, patience_ns, before_ns, period_ns, line.inbox, first, node.states, node.settings, node.outbox,
            node.record, self._turns,
        )  # fmt: skip
        if slots:
            self._finish()
        else:
            line.took(self._count[0], first)
        return int(slots)

    def _finish(self) -> None:
        """What the compiled call leaves to do: of the frames it has sent, then of those used."""
        line, node = self.samples.line, self.node
        line.sent(node.outbox, node.sent(self._sent[0]), self._position[0])
        line.used(self._count[0])


@njit
def slots_since(before_ns: Any, arrived_ns: Any, now_ns: Any, period_ns: Any) -> Any:
    """Slots of `period_ns` from the one at `before_ns` to that of a sample which `arrived_ns` and is seen `now_ns`.

    0 where it is of the slot before, which has gone without it: less than half a period is over. All of one clock.
    """
    if now_ns - before_ns < period_ns // 2:
        return 0
    return max(1, floor((arrived_ns - before_ns) / period_ns + 0.5))


@njit(cache=True, nogil=True)
def answer(
    lines: Any, inbox: Any, count: Any, slots: Any, states: Any, settings: Any, outbox: Any, row: Any, turns: Any
) -> None:
    """See `Turn.answer`; `count` frames are in the inbox."""
    turn = turns[0]
    turn.count, turn.slots = gather(lines, 0, inbox, count, count), slots
    _run(lines, inbox, states, settings, outbox, row, turn)


@njit(cache=True, nogil=True)
def answer_slots(
    words: Any, spins: Any, lines: Any, inbox: Any, count: Any, states: Any, settings: Any, outbox: Any, row: Any, turns: Any,
    most: Any, rows: Any, counts: Any, numbers: Any, changes: Any, drifts: Any,
) -> tuple[int, int]:  # fmt: skip
    """See `Turn.answer_slots`; returns how it woke last (`beat.wait`), and the turns made.

    Up to one after which something is left to Python: a slot slept through, a refusal, somebody who has come, gone or asked.
    """
    turn, line, made = turns[0], lines[0], 0
    while True:
        how = wait(words, spins)
        if how != BEGUN:
            return how, made
        made += 1
        states[0].late_cycles, marks = words[_LATE], line.marks
        answer(lines, inbox, count, 1, states, settings, outbox, row, turns)
        if drifts.size > 0:
            follow(words, drifts, line.marks > marks, _arrived(line, now(CLOCK_MONOTONIC, line.time)))
        if made == most or called(words, numbers) or not settled(line, count, turn.count, turn.sent, turn.position):
            return how, made
        book(words, rows, counts, row, changes)
        count = 0


@njit(cache=True, nogil=True)
def answer_sample(
    lines: Any, patience_ns: Any, before_ns: Any, period_ns: Any, inbox: Any, count: Any, states: Any, settings: Any,
    outbox: Any, row: Any, turns: Any,
) -> Any:  # fmt: skip
    """See `Turn.answer_sample`."""
    turn, line = turns[0], lines[0]
    marks, turn.slots = line.marks, 0
    turn.count = gather_marked(lines, patience_ns, inbox, count, count)
    if line.marks == marks:
        return 0
    turn.woken = now(CLOCK_MONOTONIC, line.time)
    turn.arrived = _arrived(line, turn.woken)
    turn.slots = slots_since(before_ns, turn.arrived, turn.woken, period_ns)
    if turn.slots > 0:
        _run(lines, inbox, states, settings, outbox, row, turn)
    return turn.slots


@njit(cache=True, nogil=True)
def answer_samples(
    words: Any, lines: Any, inbox: Any, count: Any, states: Any, settings: Any, outbox: Any, row: Any, turns: Any,
    most: Any, rows: Any, counts: Any, numbers: Any, changes: Any,
) -> int:  # fmt: skip
    """See `Turn.answer_samples`; returns the turns made."""
    turn, line, made = turns[0], lines[0], 0
    while True:
        before, period, at = words[_DEADLINE], words[_PERIOD], now(CLOCK_MONOTONIC, line.time)
        turn.patience = max(before + period, at) + period // 2
        states[0].late_cycles = words[_LATE]
        answer_sample(lines, turn.patience - at, before, period, inbox, count, states, settings, outbox, row, turns)
        if turn.slots == 0:
            return made
        made += 1
        arrive(words, turn.woken, turn.arrived, turn.slots)
        if made == most or called(words, numbers) or not settled(line, count, turn.count, turn.sent, turn.position):
            return made
        book(words, rows, counts, row, changes)
        count = 0


@njit
def _arrived(line, at):
    """When the last sample was complete, seen from `at`, which is now [ns of CLOCK_MONOTONIC]: by the frame's stamp."""
    return at - max(now(CLOCK_REALTIME, line.time) - line.marked_ns, 0)


@njit
def _run(lines, inbox, states, settings, outbox, row, turn):
    turn.sent = cycle(states, settings, inbox, turn.count, turn.slots, outbox, row)
    turn.position = spread(lines, 0, outbox, max(turn.sent, 0))
